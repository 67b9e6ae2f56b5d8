//! Deep Q-learning (Mnih et al. 2015), as Stable-Baselines3 2.9 has it.
//!
//! Its loop is `Dqn::step`: every environment makes a step, and every `train_freq` of them an update follows. The
//! networks' arithmetic is behind [`Engine`](super::engine::Engine); what is minimised is in [`DqnLoss`].

mod algorithm;
mod carried;
mod exploration;
mod learner;
mod loss;
mod replay;
mod settings;

pub use carried::{Observed, Past};
pub use exploration::Exploration;
pub use learner::Dqn;
pub use loss::DqnLoss;
pub use replay::{Replay, ReplayState, Transitions};
pub use settings::DqnConfig;
