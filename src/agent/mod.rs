//! The learners: networks, optimiser, PPO and DQN over an axis of seeds. Nothing here touches a file or a terminal.

pub mod algorithm;
pub mod config;
pub mod dqn;
pub mod engine;
pub mod mitigation;
pub mod network;
pub mod ppo;
pub mod snapshot;
pub mod state;

mod choice;
mod episodes;
mod observe;

use std::sync::Arc;

use coverage_env::Level;

use config::Config;
use engine::EngineKind;
use snapshot::{Snapshot, SnapshotError};
use state::AgentState;

pub use choice::{greedy, sample};
pub use episodes::EpisodeWindow;

/// An algorithm at work on one stage with S seeds side by side.
pub trait Learner: Send {
    /// Collects and updates once: a rollout for PPO; for DQN up to the next multiple of 2,048 timesteps, or of the
    /// environments' `train_freq` steps if that is more.
    ///
    /// Returns each seed's metrics, in the order of the seeds.
    fn advance(&mut self) -> Vec<Metrics>;
    /// Timesteps of this stage so far, the same for each seed.
    fn timesteps(&self) -> u64;
    /// What [`timesteps`](Self::timesteps) will be after the next [`advance`](Self::advance).
    fn next_timesteps(&self) -> u64;
    /// θ of one seed as it is now, `[P]`; seeds are counted in their order here.
    fn parameters(&self, seed: usize) -> &[f32];
    /// The agents as they are now.
    fn states(&self) -> Vec<AgentState>;
    /// All that the rest of the stage depends on, of the seed with this place in their order.
    fn snapshot(&self, seed: usize) -> Snapshot;
}

/// Names and values of one log row, named as Stable-Baselines3's logger names them.
pub type Metrics = Vec<(&'static str, f64)>;

/// One stage as a learner sees it.
#[derive(Clone, Debug)]
pub struct Stage {
    /// Its place in the curriculum, from 0.
    pub index: u16,
    /// The map that all environments have.
    pub level: Arc<Level>,
    /// Timesteps to train for.
    pub timesteps: u64,
    /// Timesteps that schedules span: `timesteps`, unless the run was extended.
    pub horizon: u64,
}

/// ‖θ‖₂.
fn weight_norm(agent: &AgentState) -> f64 {
    agent.parameters.iter().map(|&p| f64::from(p).powi(2)).sum::<f64>().sqrt()
}

/// A learner at the beginning of `stage`, with agents as they come out of the stage before.
pub fn learner(config: &Config, stage: &Stage, agents: Vec<AgentState>, engine: EngineKind) -> Box<dyn Learner> {
    let beginning = |agent| Snapshot::beginning(config, stage, agent);
    build(config, stage, agents.into_iter().map(beginning).collect(), engine)
}

/// A learner in the midst of `stage`, where its seeds were when these snapshots were taken; it goes on as if it had
/// never stopped.
///
/// # Errors
/// Snapshots that cannot be of this stage, or of seeds that stand at different timesteps.
pub fn resume(
    config: &Config,
    stage: &Stage,
    snapshots: Vec<Snapshot>,
    engine: EngineKind,
) -> Result<Box<dyn Learner>, SnapshotError> {
    snapshots.iter().try_for_each(|snapshot| snapshot.check(config, stage))?;
    SnapshotError::unless_together(&snapshots)?;
    Ok(build(config, stage, snapshots, engine))
}

/// A learner from snapshots that are known to fit.
fn build(config: &Config, stage: &Stage, snapshots: Vec<Snapshot>, engine: EngineKind) -> Box<dyn Learner> {
    let agents = snapshots.iter().map(|snapshot| snapshot.agent.clone()).collect();
    let engine = engine::new(engine, config.parts(&stage.level, agents));
    config.algorithm.learner(config, stage, snapshots, engine)
}
