//! PPO as a choice: its settings, its network, its limits.

use coverage_env::{Action, Level};

use super::Ppo;
use crate::agent::algorithm::{Algorithm, Misfit};
use crate::agent::config::Config;
use crate::agent::engine::Engine;
use crate::agent::network::{Head, Init, Outputs};
use crate::agent::snapshot::Snapshot;
use crate::agent::{Learner, Stage};
use crate::config::{Settings, Visitor, flag, fraction, integer, non_negative, positive};

/// Samples of a rollout; each takes some tens of bytes.
const MAX_ROLLOUT: usize = 1 << 22;

/// Separate towers: a policy `[inputs] → [4]` and a value `[inputs] → [1]`.
const HEADS: [Head; 2] = [
    Head { name: "policy", outputs: Action::COUNT, init: Init::Orthogonal { head: 0.01 } },
    Head { name: "value", outputs: 1, init: Init::Orthogonal { head: 1.0 } },
];

/// What only PPO has. Defaults are the paper's.
#[derive(Clone, Debug, PartialEq)]
pub struct PpoConfig {
    /// Timesteps per environment in a rollout.
    pub n_steps: usize,
    /// Samples in a minibatch.
    pub batch_size: usize,
    /// Passes over a rollout in an update.
    pub n_epochs: usize,
    /// λ of generalised advantage estimation (Schulman et al. 2016).
    pub gae_lambda: f64,
    /// Clip range of the probability ratio.
    pub clip_range: f64,
    /// Coefficient of the entropy bonus.
    pub ent_coef: f64,
    /// Coefficient of the value loss.
    pub vf_coef: f64,
    /// Whether advantages are normalised minibatch by minibatch.
    pub normalize_advantage: bool,
}

impl Default for PpoConfig {
    fn default() -> Self {
        Self {
            n_steps: 2048,
            batch_size: 64,
            n_epochs: 10,
            gae_lambda: 0.95,
            clip_range: 0.2,
            ent_coef: 0.01,
            vf_coef: 0.5,
            normalize_advantage: true,
        }
    }
}

impl Settings for PpoConfig {
    fn visit(&mut self, v: &mut dyn Visitor) {
        v.field("n_steps", "timesteps per environment in a rollout", &mut integer(&mut self.n_steps, 1..=1 << 20));
        v.field("batch_size", "samples in a minibatch", &mut integer(&mut self.batch_size, 1..=1 << 20));
        v.field("n_epochs", "passes over a rollout in an update", &mut integer(&mut self.n_epochs, 1..=1000));
        v.field("gae_lambda", "lambda of generalised advantage estimation", &mut fraction(&mut self.gae_lambda));
        v.field("clip_range", "clip range of the probability ratio", &mut positive(&mut self.clip_range));
        v.field("ent_coef", "coefficient of the entropy bonus", &mut non_negative(&mut self.ent_coef));
        v.field("vf_coef", "coefficient of the value loss", &mut non_negative(&mut self.vf_coef));
        v.field(
            "normalize_advantage",
            "normalise advantages minibatch by minibatch",
            &mut flag(&mut self.normalize_advantage),
        );
    }
}

impl Algorithm for PpoConfig {
    fn name(&self) -> &'static str {
        "ppo"
    }

    fn defaults(&self, _config: &mut Config) {
        // What algorithms share has PPO's values to begin with.
    }

    fn outputs(&self) -> Outputs {
        Outputs::Logits
    }

    fn heads(&self) -> &'static [Head] {
        &HEADS
    }

    fn check(&self, config: &Config) -> Result<(), Misfit> {
        let samples = self.n_steps * config.num_envs;
        if samples <= MAX_ROLLOUT {
            return Ok(());
        }
        Err(Misfit {
            keys: &["num_envs", "n_steps"],
            problem: format!(
                "n_steps × num_envs: {} × {} makes {samples} samples in a rollout; at most {MAX_ROLLOUT} are possible",
                self.n_steps, config.num_envs
            ),
        })
    }

    fn memory(&self, config: &Config, cells: usize) -> (String, u64) {
        let samples = (self.n_steps * config.num_envs) as u64;
        // A sample lists the agent's cell and the visited ones, 2 bytes each, and holds some ten numbers.
        let visited = (cells as u64).min(u64::from(config.max_steps) + 1);
        let what = format!("n_steps × num_envs: a rollout of {samples} samples on maps of {cells} cells");
        (what, samples.saturating_mul(2 * visited + 40))
    }

    fn optimizer_steps(&self, config: &Config, timesteps: u64) -> u64 {
        let samples = (self.n_steps * config.num_envs) as u64;
        timesteps.div_ceil(samples) * self.n_epochs as u64 * samples.div_ceil(self.batch_size as u64)
    }

    fn check_snapshot(&self, snapshot: &Snapshot, _level: &Level) -> Result<(), String> {
        if snapshot.buffers.is_empty() { Ok(()) } else { Err("it belongs to another algorithm".to_owned()) }
    }

    fn learner(
        &self,
        config: &Config,
        stage: &Stage,
        snapshots: Vec<Snapshot>,
        engine: Box<dyn Engine>,
    ) -> Box<dyn Learner> {
        Box::new(Ppo::new(config, self, stage, snapshots, engine))
    }

    fn boxed(&self) -> Box<dyn Algorithm> {
        Box::new(self.clone())
    }
}
