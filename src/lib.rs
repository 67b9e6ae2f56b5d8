//! Loss of plasticity in reinforcement learning on coverage path planning.

pub mod agent;
pub mod config;
pub mod curriculum;
pub mod error;
pub mod evaluate;
pub mod run;
