//! ε over the timesteps of a stage.

use super::settings::DqnConfig;
use crate::agent::stage::Stage;

/// ε over the timesteps of a stage.
///
/// Linear from `exploration_initial_eps` to `exploration_final_eps` over the first `exploration_fraction` of the first
/// stage; a later stage has the final value throughout ("without exploration" in the paper), unless
/// `exploration_restarts`.
#[derive(Clone, Copy, Debug)]
pub struct Exploration {
    initial: f64,
    last: f64,
    /// Timesteps of the decay; 0 where there is none.
    decay: f64,
}

impl Exploration {
    /// The schedule of a stage.
    pub fn new(config: &DqnConfig, stage: &Stage) -> Self {
        let decays = stage.index == 0 || config.exploration_restarts;
        let decay = if decays { config.exploration_fraction * stage.horizon as f64 } else { 0.0 };
        Self { initial: config.exploration_initial_eps, last: config.exploration_final_eps, decay }
    }

    /// ε after this many timesteps.
    pub fn epsilon(&self, timesteps: u64) -> f64 {
        let timesteps = timesteps as f64;
        if timesteps > self.decay || self.decay == 0.0 {
            return self.last;
        }
        self.initial + (self.last - self.initial) * timesteps / self.decay
    }
}
