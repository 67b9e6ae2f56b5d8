//! DQN as a choice: its settings, its network, its limits.

use bit_mlp::Activation;
use coverage_env::{Action, Level};

use super::{Dqn, ReplayState, TARGET};
use crate::agent::algorithm::{Algorithm, Misfit};
use crate::agent::config::Config;
use crate::agent::engine::Engine;
use crate::agent::network::{Head, Init, Outputs};
use crate::agent::snapshot::Snapshot;
use crate::agent::{Learner, Stage};
use crate::config::{Settings, Visitor, fraction, integer};

/// One tower: action values `[inputs] → [4]`.
const HEADS: [Head; 1] = [Head { name: "q", outputs: Action::COUNT, init: Init::Uniform }];

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
    /// ε at the end of its decay, and throughout every later stage.
    pub exploration_final_eps: f64,
    /// Share of the first stage's timesteps over which ε decays linearly.
    pub exploration_fraction: f64,
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
        }
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
    }
}

impl Algorithm for DqnConfig {
    fn name(&self) -> &'static str {
        "dqn"
    }

    fn defaults(&self, config: &mut Config) {
        config.timesteps = 1_000_000;
        config.activation = Activation::Relu;
        config.optimizer.adam_eps = 1e-8;
        config.optimizer.max_grad_norm = 10.0;
    }

    fn outputs(&self) -> Outputs {
        Outputs::Values
    }

    fn heads(&self) -> &'static [Head] {
        &HEADS
    }

    fn copies(&self) -> &'static [&'static str] {
        &[TARGET]
    }

    fn check(&self, config: &Config) -> Result<(), Misfit> {
        if self.buffer_size >= config.num_envs {
            return Ok(());
        }
        Err(Misfit {
            keys: &["num_envs", "buffer_size"],
            problem: format!(
                "buffer_size: expected room for a transition of each environment, {} (num_envs) or more, got {}",
                config.num_envs, self.buffer_size
            ),
        })
    }

    fn memory(&self, _config: &Config, cells: usize) -> (String, u64) {
        // The visited cells before and after, one bit each, and ten bytes more.
        let transition = 2 * (cells as u64).div_ceil(64) * 8 + 10;
        let what = format!("buffer_size: {} transitions on maps of {cells} cells", self.buffer_size);
        (what, (self.buffer_size as u64).saturating_mul(transition))
    }

    fn optimizer_steps(&self, config: &Config, timesteps: u64) -> u64 {
        let interval = self.train_freq * config.num_envs as u64;
        let updates = timesteps.div_ceil(interval).saturating_sub(self.learning_starts / interval);
        updates * self.gradient_steps as u64
    }

    fn begin(&self, snapshot: &mut Snapshot) {
        ReplayState::default().write(&mut snapshot.buffers);
    }

    fn check_snapshot(&self, snapshot: &Snapshot, level: &Level) -> Result<(), String> {
        ReplayState::read(&snapshot.buffers)?.check(self.buffer_size, level).map_err(str::to_owned)
    }

    fn learner(
        &self,
        config: &Config,
        stage: &Stage,
        snapshots: Vec<Snapshot>,
        engine: Box<dyn Engine>,
    ) -> Box<dyn Learner> {
        Box::new(Dqn::new(config, self, stage, snapshots, engine))
    }

    fn boxed(&self) -> Box<dyn Algorithm> {
        Box::new(self.clone())
    }
}
