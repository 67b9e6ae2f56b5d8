//! Research on loss of plasticity in reinforcement learning, on coverage path planning: an agent on a grid visits every
//! target in as few moves as it can, and is trained on one level after another.
//!
//! This is the library under the program `cpp-rl`. README.md shows the program, and ARCHITECTURE.md the rooms of the code.
//!
//! # Where to begin
//!
//! | to read | begin with |
//! |---|---|
//! | how an agent is trained | [`training::train`], which trains [`training::Experiment`]s; then [`agent`] |
//! | what is trained | [`agent::config::resolve`] for the settings, [`experiment`] for sequences of levels and studies |
//! | what a run leaves on disk | [`run::RunDir`]; [`run::checkpoint`] for an agent, [`run::manifest`] for what ran |
//! | what is measured | [`evaluate`] for returns, [`measure`] for networks |
//! | what runs say | [`report`] |
//! | the command line | [`cli`]: one module for each subcommand |
//!
//! The environment is the crate `coverage_env`. The arithmetic of the fused engine is `bit_mlp`, statistics are `rl_stats`,
//! TensorBoard's files are `event_file`, and figures are `charts`. None of them knows this crate.
//!
//! # Rules
//!
//! - Dependencies point downwards only: `cli` → `training`, `report` → `run` → `measure`, `experiment`,
//!   `evaluate` → `agent` → `config`, [`random`] → the crates. The crate `torch_engine` stands above: it brings libtorch.
//! - Only [`run`] writes below `runs/`, and only [`agent`] knows how networks are computed.
//! - Random numbers come from one stream for each seed, stage and purpose. With the fused engine a seed's results are the
//!   same bytes, whatever runs beside it.

pub mod agent;
pub mod cli;
pub mod config;
pub mod dose;
pub mod error;
pub mod evaluate;
pub mod experiment;
pub mod measure;
pub mod messages;
pub mod random;
pub mod report;
pub mod results;
pub mod run;
pub mod shell;
pub mod text_file;
pub mod training;
