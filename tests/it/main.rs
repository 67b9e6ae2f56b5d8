//! The whole program: as a library against recorded and hand-computed numbers, and as a user meets it in a shell.
//!
//! What Stable-Baselines3 computed is under `tests/fixtures/sb3`; its README says how each number was made.

mod advantages;
mod analysis;
mod analysis_of_logs;
mod arbitrary;
mod beside;
mod command_line;
mod config_command;
mod controls;
mod dqn_schedule;
mod fakes;
mod faults;
mod fixtures;
mod fork_reports;
mod forks;
mod house;
mod learning;
mod limits;
mod lines;
mod long;
mod messages;
mod mitigations;
mod numbers;
mod plasticity;
mod prose;
mod recomputed;
mod replay;
mod replay_kept;
mod report;
mod results;
mod resume;
mod runs;
mod runs_command;
mod sandbox;
mod sb3_dqn;
mod sb3_models;
mod sb3_ppo;
mod sensors;
mod sequences;
mod settings;
mod stops;
mod studies;
mod study;
mod why;

use cpp_rl::agent::engine::{Engine, EngineKind, FusedEngine, Parts};

/// The repository.
const ROOT: &str = env!("CARGO_MANIFEST_DIR");
/// The engines that recorded updates are followed with; the tests of torch-engine have libtorch's here.
const ENGINES: [fn(Parts) -> Box<dyn Engine>; 1] = [|parts| Box::new(FusedEngine::new(parts))];
/// The engine that agents are trained with where the tests of torch-engine have libtorch's.
const KIND: fn() -> EngineKind = || EngineKind::Fused;
