//! DQN's settings.

use crate::config::{Settings, Visitor, flag, fraction, integer};

/// What only DQN has. Defaults are the paper's.
#[derive(Clone, Debug, PartialEq)]
pub struct DqnConfig {
    /// Transitions in the replay buffer.
    pub buffer_size: usize,
    /// Timesteps of a stage with uniform actions and no update.
    pub learning_starts: u64,
    /// Steps of the environments between updates.
    pub train_freq: u64,
    /// Gradient steps of an update.
    pub gradient_steps: usize,
    /// Transitions in a minibatch.
    pub batch_size: usize,
    /// Timesteps between copies of the network into the target network.
    pub target_update_interval: u64,
    /// ε at the start of the first stage.
    pub exploration_initial_eps: f64,
    /// ε at the end of its decay, and throughout every later stage unless it restarts.
    pub exploration_final_eps: f64,
    /// Share of the first stage's timesteps over which ε decays linearly.
    pub exploration_fraction: f64,
    /// Whether ε decays anew in every stage.
    pub exploration_restarts: bool,
    /// Whether stage checkpoints hold the replay buffer, so that a fork can keep it.
    pub replay_saved: bool,
    /// Whether a stage begins with the replay buffer of the stage before. Its checkpoints then hold it, too.
    pub replay_kept: bool,
}

impl Default for DqnConfig {
    fn default() -> Self {
        Self {
            buffer_size: 100_000,
            learning_starts: 100,
            train_freq: 4,
            gradient_steps: 1,
            batch_size: 32,
            target_update_interval: 10_000,
            exploration_initial_eps: 1.0,
            exploration_final_eps: 0.05,
            exploration_fraction: 0.1,
            exploration_restarts: false,
            replay_saved: false,
            replay_kept: false,
        }
    }
}

impl DqnConfig {
    /// Whether an agent takes its replay buffer along from the end of a stage.
    pub(super) fn saves_replay(&self) -> bool {
        self.replay_saved || self.replay_kept
    }
}

impl Settings for DqnConfig {
    fn visit(&mut self, v: &mut dyn Visitor) {
        const MANY: u64 = 1_000_000_000;
        v.field("buffer_size", "transitions in the replay buffer", &mut integer(&mut self.buffer_size, 1..=10_000_000));
        v.field(
            "learning_starts",
            "timesteps of a stage with uniform actions and no update",
            &mut integer(&mut self.learning_starts, 0..=MANY),
        );
        v.field(
            "train_freq",
            "steps of the environments between updates",
            &mut integer(&mut self.train_freq, 1..=MANY),
        );
        v.field("gradient_steps", "gradient steps of an update", &mut integer(&mut self.gradient_steps, 1..=10_000));
        v.field("batch_size", "transitions in a minibatch", &mut integer(&mut self.batch_size, 1..=1 << 20));
        v.field(
            "target_update_interval",
            "timesteps between copies into the target network",
            &mut integer(&mut self.target_update_interval, 1..=MANY),
        );
        v.field(
            "exploration_initial_eps",
            "epsilon at the start of the first stage",
            &mut fraction(&mut self.exploration_initial_eps),
        );
        v.field(
            "exploration_final_eps",
            "epsilon after its decay and in later stages",
            &mut fraction(&mut self.exploration_final_eps),
        );
        v.field(
            "exploration_fraction",
            "share of the first stage over which epsilon decays",
            &mut fraction(&mut self.exploration_fraction),
        );
        v.field(
            "exploration_restarts",
            "whether epsilon decays anew in every stage",
            &mut flag(&mut self.exploration_restarts),
        );
        v.field(
            "replay_saved",
            "whether stage checkpoints hold the replay buffer, so that a fork can keep it",
            &mut flag(&mut self.replay_saved),
        );
        v.field(
            "replay_kept",
            "whether a stage begins with the replay buffer of the stage before (implies replay_saved)",
            &mut flag(&mut self.replay_kept),
        );
    }
}
