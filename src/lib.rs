//! Loss of plasticity in reinforcement learning on coverage path planning.
//!
//! Dependencies point downwards only: `cli` → `study`, `training`, `report` → `run` → `measure`, `curriculum`,
//! `evaluate` → `agent` → `config` → the crates that know nothing of this one.

pub mod agent;
pub mod cli;
pub mod config;
pub mod curriculum;
pub mod dose;
pub mod error;
pub mod evaluate;
pub mod measure;
pub mod messages;
pub mod random;
pub mod report;
pub mod results;
pub mod run;
pub mod study;
pub mod text_file;
pub mod training;
