//! One seed in the midst of a stage: all that the rest of the stage depends on.

use coverage_env::{State, StateError, VecEnv};
use serde::{Deserialize, Serialize};

use super::buffers::Buffers;
use super::episodes::EpisodeWindow;
use super::stage::Stage;
use super::state::AgentState;
use crate::random::{Stream, StreamState};

/// One seed between two calls of [`advance`](super::Learner::advance).
///
/// A stage's beginning is a snapshot as well, so that there is one way into a learner. What is missing here is made
/// anew by each `advance`: PPO's rollout and the order of its minibatches, and the sums of DQN's log row.
#[derive(Clone, Debug, PartialEq)]
pub struct Snapshot {
    /// The agent, its counters as they are now.
    pub agent: AgentState,
    /// Where it stands in the stage.
    pub position: Position,
    /// What its algorithm keeps in the midst of a stage.
    pub buffers: Buffers,
}

/// Where a seed stands in a stage, N being the number of environments.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Position {
    /// Timesteps of the stage so far.
    pub timesteps: u64,
    /// The environments' running episodes, `[N]`.
    pub states: Vec<State>,
    /// The streams of their starts, `[N]`.
    pub starts: Vec<StreamState>,
    /// The stream of the actions.
    pub actions: StreamState,
    /// The stream of the minibatches.
    pub minibatches: StreamState,
    /// The window of finished episodes.
    pub episodes: EpisodeWindow,
}

impl Position {
    /// That of a seed with these environments, streams and episodes.
    pub(super) fn of(
        timesteps: u64,
        envs: &VecEnv<Stream>,
        actions: &Stream,
        minibatches: &Stream,
        episodes: &EpisodeWindow,
    ) -> Self {
        Self {
            timesteps,
            states: envs.states().to_vec(),
            starts: envs.rngs().iter().map(Stream::state).collect(),
            actions: actions.state(),
            minibatches: minibatches.state(),
            episodes: episodes.clone(),
        }
    }
}

/// A snapshot that cannot be one of the stage, as read from a damaged or foreign file.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("not a snapshot of this stage: {0}")]
pub struct SnapshotError(pub(super) String);

impl From<StateError> for SnapshotError {
    fn from(error: StateError) -> Self {
        Self(error.to_string())
    }
}

impl SnapshotError {
    /// Refuses seeds that cannot advance together, since they stand at different timesteps.
    pub(super) fn unless_together(snapshots: &[Snapshot]) -> Result<(), Self> {
        let together = |pair: &[Snapshot]| pair[0].position.timesteps == pair[1].position.timesteps;
        if snapshots.windows(2).all(together) {
            return Ok(());
        }
        Err(Self("its seeds stand at different timesteps".to_owned()))
    }
}

impl Snapshot {
    /// The environments as they stand.
    pub(super) fn envs(&self, max_steps: u32, stage: &Stage) -> Result<VecEnv<Stream>, StateError> {
        let starts = self.position.starts.iter().map(Stream::at).collect();
        VecEnv::restore(stage.level.clone(), max_steps, self.position.states.clone(), starts)
    }
}
