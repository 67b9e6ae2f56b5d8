//! What a learner is to the loop.

use super::snapshot::Snapshot;
use super::state::AgentState;

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
    /// The agents as they are after the last row of the log, in the order of the seeds.
    fn agents(&self) -> Vec<&AgentState>;
    /// The agent with this place in the order of the seeds, as it goes on from the end of the stage to the next.
    fn leaving(&self, seed: usize) -> AgentState {
        self.agents()[seed].clone()
    }
    /// All that the rest of the stage depends on, of the seed with this place in their order.
    fn snapshot(&self, seed: usize) -> Snapshot;
}

/// Names and values of one log row, named as Stable-Baselines3's logger names them.
pub type Metrics = Vec<(&'static str, f64)>;

/// ‖θ‖₂.
pub(super) fn weight_norm(agent: &AgentState) -> f64 {
    agent.parameters.iter().map(|&p| f64::from(p).powi(2)).sum::<f64>().sqrt()
}
