//! Proximal policy optimisation (Schulman et al. 2017), as Stable-Baselines3 2.9 has it.
//!
//! `Ppo::advance` is one iteration: collect a rollout, estimate advantages, update over minibatches. The networks'
//! arithmetic is behind [`Engine`](super::engine::Engine); what is minimised is in [`PpoLoss`].

mod algorithm;
mod learner;
mod loss;
mod rollout;
mod settings;

pub use learner::Ppo;
pub use loss::{PpoLoss, PpoTerms};
pub use rollout::Rollout;
pub use settings::PpoConfig;
