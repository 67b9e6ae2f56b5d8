//! The learners: networks, optimiser, PPO and DQN over an axis of seeds. Nothing here touches a file or a terminal.

pub mod algorithm;
pub mod buffers;
pub mod config;
pub mod dqn;
pub mod engine;
pub mod keys;
pub mod mitigation;
pub mod network;
pub mod optimizer;
pub mod ppo;
pub mod registry;
pub mod shared;
pub mod snapshot;
pub mod state;
pub mod treatment;

mod begin;
mod choice;
mod episodes;
mod learner;
mod observe;
mod stage;

pub use begin::{learner, resume};
pub use choice::{Behaviour, greedy};
pub use episodes::EpisodeWindow;
pub use learner::{Learner, Metrics};
pub(crate) use observe::observations;
pub use stage::Stage;
