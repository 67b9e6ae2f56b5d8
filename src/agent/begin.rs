//! How a stage begins, and how it goes on from its midst.

use coverage_env::VecEnv;

use super::algorithm::Setup;
use super::buffers::Buffers;
use super::config::Config;
use super::engine::{self, EngineKind};
use super::episodes::EpisodeWindow;
use super::learner::Learner;
use super::snapshot::{Position, Snapshot, SnapshotError};
use super::stage::Stage;
use super::state::AgentState;
use crate::random::{Purpose, Stream, StreamState};

impl Snapshot {
    /// The beginning of a stage, with an agent as it comes out of the stage before.
    pub fn beginning(config: &Config, stage: &Stage, mut agent: AgentState) -> Self {
        let shared = &config.shared;
        let copies = config.algorithm.copies();
        config.mitigations.begin_stage(&config.network(&stage.level), &mut agent, copies, stage.index);
        let stream = |purpose| Stream::new(agent.seed, stage.index, purpose);
        let starts = (0..shared.num_envs as u32).map(|i| stream(Purpose::Environment(i))).collect();
        let envs = VecEnv::new(stage.level.clone(), shared.max_steps, starts);
        let [actions, minibatches] = [Purpose::Actions, Purpose::Minibatches].map(stream);
        let position = Position::of(0, &envs, &actions, &minibatches, &EpisodeWindow::default());
        let mut snapshot = Self { agent, position, buffers: Buffers::default() };
        config.algorithm.begin(&mut snapshot, &stage.level);
        snapshot
    }

    /// Checks everything that a learner relies on, since a file need not be trusted.
    ///
    /// # Errors
    /// The first thing that cannot be so in this stage under these settings.
    pub fn check(&self, config: &Config, stage: &Stage) -> Result<(), SnapshotError> {
        let wrong = |what: &str| Err(SnapshotError(what.to_owned()));
        let shared = &config.shared;
        let Self { agent, position, .. } = self;
        let parameters = config.network(&stage.level).num_parameters();
        let slices = [&agent.parameters, &agent.adam.exp_avg, &agent.adam.exp_avg_sq];
        if slices.into_iter().chain(agent.kept.copies.values()).any(|slice| slice.len() != parameters) {
            return wrong("the network has another size");
        }
        if config.copies().iter().any(|&name| !agent.kept.copies.contains_key(name)) {
            return wrong("it belongs to another algorithm, or to other mitigations");
        }
        if position.timesteps > agent.counters.timesteps
            || !position.timesteps.is_multiple_of(shared.num_envs as u64)
            || position.episodes.count > position.timesteps
        {
            return wrong("its counts contradict one another");
        }
        if position.states.len() != shared.num_envs || position.starts.len() != shared.num_envs {
            return wrong("the number of environments differs");
        }
        let own = |state: &StreamState, purpose| {
            let beginning = Stream::new(agent.seed, stage.index, purpose).state();
            (state.seed, state.stream) == (beginning.seed, beginning.stream)
        };
        let mut starts = position.starts.iter().zip(0..);
        if !own(&position.actions, Purpose::Actions)
            || !own(&position.minibatches, Purpose::Minibatches)
            || !starts.all(|(state, i)| own(state, Purpose::Environment(i)))
        {
            return wrong("its random streams belong to another seed or stage");
        }
        if !position.episodes.is_possible(shared.max_steps) {
            return wrong("its window of episodes is not possible");
        }
        self.envs(shared.max_steps, stage)?;
        config.algorithm.check_snapshot(self, shared, &stage.level).map_err(SnapshotError)
    }
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
    let regimen = config.regimen(stage, snapshots.iter().map(|snapshot| &snapshot.agent));
    config.algorithm.learner(Setup { shared: &config.shared, stage, snapshots, engine, regimen })
}
