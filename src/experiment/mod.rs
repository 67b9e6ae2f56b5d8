//! What is trained: the stages of one agent's life, the orders in which levels can come, settings that are swept, and the
//! study file that says all of it.
//!
//! [`curriculum`] is what one run trains on. [`sequence`] makes curricula out of orders, cycles and shifts by seed.
//! [`fork`] is an agent that goes on otherwise from the end of a stage. [`study`] reads a study file; docs/studies.md describes its language.

pub mod curriculum;
pub mod estimate;
pub mod fork;
mod generate;
mod grid;
mod levels;
mod node;
pub mod orders;
pub mod sequence;
mod sequence_file;
pub mod study;
pub mod timesteps;
mod treatment_file;

pub use curriculum::Curriculum;
pub use fork::Fork;
pub use study::Study;
pub use timesteps::Timesteps;
pub use treatment_file::parse_treatment;
