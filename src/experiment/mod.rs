//! What is trained: the stages of one agent's life, the orders in which levels can come, settings that are swept, and the
//! study file that says all of it.
//!
//! [`curriculum`] is what one run trains on. [`sequence`] makes curricula out of orders, cycles and shifts by seed.
//! [`study`] reads a study file; docs/studies.md describes its language.

pub mod curriculum;
pub mod estimate;
mod generate;
mod grid;
mod levels;
mod node;
pub mod orders;
pub mod sequence;
mod sequence_file;
pub mod study;
pub mod timesteps;

pub use curriculum::Curriculum;
pub use study::Study;
pub use timesteps::Timesteps;
