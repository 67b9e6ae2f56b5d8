//! DQN as a choice: its network, its limits, its learner.

use bit_mlp::Activation;
use coverage_env::{Action, Level};

use super::exploration::Exploration;
use super::learner::Dqn;
use super::loss::TARGET;
use super::replay::ReplayState;
use super::settings::DqnConfig;
use crate::agent::algorithm::{Algorithm, Misfit, Setup};
use crate::agent::choice::Behaviour;
use crate::agent::learner::Learner;
use crate::agent::network::{Head, Init, Outputs};
use crate::agent::shared::Shared;
use crate::agent::snapshot::Snapshot;
use crate::agent::stage::Stage;

/// One tower: action values `[inputs] → [4]`.
const HEADS: [Head; 1] = [Head { name: "q", outputs: Action::COUNT, init: Init::Uniform }];

impl Algorithm for DqnConfig {
    fn name(&self) -> &'static str {
        "dqn"
    }

    fn defaults(&self, shared: &mut Shared) {
        shared.timesteps = 1_000_000;
        shared.activation = Activation::Relu;
        shared.optimizer.adam_eps = 1e-8;
        shared.optimizer.max_grad_norm = 10.0;
    }

    fn outputs(&self) -> Outputs {
        Outputs::Values
    }

    fn behaviour(&self, when: Option<(&Stage, u64)>) -> Behaviour {
        let epsilon = |(stage, timesteps)| Exploration::new(self, stage).epsilon(timesteps);
        Behaviour::EpsilonGreedy(when.map_or(self.exploration_final_eps, epsilon))
    }

    fn heads(&self) -> &'static [Head] {
        &HEADS
    }

    fn copies(&self) -> &'static [&'static str] {
        &[TARGET]
    }

    fn check(&self, shared: &Shared) -> Result<(), Misfit> {
        if self.buffer_size >= shared.num_envs {
            return Ok(());
        }
        Err(Misfit {
            keys: &["num_envs", "buffer_size"],
            problem: format!(
                "buffer_size: expected room for a transition of each environment, {} (num_envs) or more, got {}",
                shared.num_envs, self.buffer_size
            ),
        })
    }

    fn memory(&self, _shared: &Shared, cells: usize) -> (String, u64) {
        // The visited cells before and after, one bit each, and ten bytes more.
        let transition = 2 * (cells as u64).div_ceil(64) * 8 + 10;
        let what = format!("buffer_size: {} transitions on maps of {cells} cells", self.buffer_size);
        (what, (self.buffer_size as u64).saturating_mul(transition))
    }

    fn optimizer_steps(&self, shared: &Shared, timesteps: u64) -> u64 {
        let interval = self.train_freq * shared.num_envs as u64;
        let updates = timesteps.div_ceil(interval).saturating_sub(self.learning_starts / interval);
        updates * self.gradient_steps as u64
    }

    fn begin(&self, snapshot: &mut Snapshot) {
        ReplayState::default().write(&mut snapshot.buffers);
    }

    fn check_snapshot(&self, snapshot: &Snapshot, level: &Level) -> Result<(), String> {
        ReplayState::read(&snapshot.buffers)?.check(self.buffer_size, level).map_err(str::to_owned)
    }

    fn learner(&self, setup: Setup<'_>) -> Box<dyn Learner> {
        Box::new(Dqn::new(self, setup))
    }

    fn boxed(&self) -> Box<dyn Algorithm> {
        Box::new(self.clone())
    }
}
