//! PPO's settings.

use crate::config::{Settings, Visitor, flag, fraction, integer, non_negative, positive};

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
