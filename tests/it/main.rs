//! The whole program: as a library against recorded and hand-computed numbers, and as a user meets it in a shell.
//!
//! What Stable-Baselines3 computed is under `tests/fixtures/sb3`; its README says how each number was made.

mod advantages;
mod analysis;
mod arbitrary;
mod command_line;
mod dqn_schedule;
mod faults;
mod fixtures;
mod kernels;
mod limits;
mod messages;
mod numbers;
mod plasticity;
mod replay;
mod report;
mod results;
mod resume;
mod runs;
mod runs_command;
mod sandbox;
mod sb3_dqn;
mod sb3_models;
mod sb3_ppo;
mod settings;
mod stops;
mod study;
