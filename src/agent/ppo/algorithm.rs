//! PPO as a choice: its network, its limits, its learner.

use coverage_env::{Action, Level};

use super::learner::Ppo;
use super::settings::PpoConfig;
use crate::agent::algorithm::{Algorithm, Misfit, Setup};
use crate::agent::choice::Behaviour;
use crate::agent::learner::Learner;
use crate::agent::network::{Head, Init, Outputs};
use crate::agent::shared::Shared;
use crate::agent::snapshot::Snapshot;
use crate::agent::stage::Stage;

/// Samples of a rollout; each takes some tens of bytes.
const MAX_ROLLOUT: usize = 1 << 22;

/// Separate towers: a policy `[inputs] → [4]` and a value `[inputs] → [1]`.
const HEADS: [Head; 2] = [
    Head { name: "policy", outputs: Action::COUNT, init: Init::Orthogonal { head: 0.01 } },
    Head { name: "value", outputs: 1, init: Init::Orthogonal { head: 1.0 } },
];

impl Algorithm for PpoConfig {
    fn name(&self) -> &'static str {
        "ppo"
    }

    fn defaults(&self, _shared: &mut Shared) {
        // What algorithms share has PPO's values to begin with.
    }

    fn outputs(&self) -> Outputs {
        Outputs::Logits
    }

    fn behaviour(&self, _when: Option<(&Stage, u64)>) -> Behaviour {
        Behaviour::Sampled
    }

    fn heads(&self) -> &'static [Head] {
        &HEADS
    }

    fn check(&self, shared: &Shared) -> Result<(), Misfit> {
        let samples = self.n_steps * shared.num_envs;
        if samples <= MAX_ROLLOUT {
            return Ok(());
        }
        Err(Misfit {
            keys: &["num_envs", "n_steps"],
            problem: format!(
                "n_steps × num_envs: {} × {} makes {samples} samples in a rollout; at most {MAX_ROLLOUT} are possible",
                self.n_steps, shared.num_envs
            ),
        })
    }

    fn memory(&self, shared: &Shared, level: &Level) -> (String, u64) {
        let cells = level.len();
        let samples = (self.n_steps * shared.num_envs) as u64;
        // A sample lists the agent's cell and the visited ones, 2 bytes each, and holds some ten numbers.
        let visited = (cells as u64).min(u64::from(shared.max_steps) + 1);
        let what = format!("n_steps × num_envs: a rollout of {samples} samples on maps of {cells} cells");
        (what, samples.saturating_mul(2 * visited + 40))
    }

    fn optimizer_steps(&self, shared: &Shared, timesteps: u64) -> u64 {
        let samples = (self.n_steps * shared.num_envs) as u64;
        timesteps.div_ceil(samples) * self.n_epochs as u64 * samples.div_ceil(self.batch_size as u64)
    }

    fn check_snapshot(&self, snapshot: &Snapshot, _shared: &Shared, _level: &Level) -> Result<(), String> {
        if snapshot.buffers.is_empty() { Ok(()) } else { Err("it belongs to another algorithm".to_owned()) }
    }

    fn learner(&self, setup: Setup<'_>) -> Box<dyn Learner> {
        Box::new(Ppo::new(self, setup))
    }

    fn boxed(&self) -> Box<dyn Algorithm> {
        Box::new(self.clone())
    }
}
