//! Coverage path planning on a grid: levels, the environment, and planners.
//!
//! An agent on a map must visit every target cell in as few moves as it can. This crate holds the
//! rules and nothing else: it knows no tensor, no clock and no file but a level's.
//!
//! | module | what |
//! |---|---|
//! | [`level`] | [`Level`]: a parsed, validated, immutable map |
//! | [`state`] | [`State`]: where an episode stands |
//! | [`env`](mod@env) | the rules, stated once, and [`CoverageEnv`]: reset and step |
//! | [`sensor`] | what an agent sees: a state as a binary array, dense or as the indices of its ones |
//! | [`vec_env`] | [`VecEnv`]: environments stepped together, with automatic resets |
//! | [`planner`] | random, greedy A* and the proved optimum, behind one trait |
//! | [`generator`] | random solvable levels |
//! | [`render`](mod@render) | a state as text |
//! | [`random`] | uniform draws that depend on no library's sampling internals |
//!
//! ```
//! use std::sync::Arc;
//! use chacha20::{ChaCha8Rng, rand_core::SeedableRng};
//! use coverage_env::{Action, CoverageEnv, Level, MAX_STEPS};
//!
//! let level = Arc::new(Level::resolve("0")?);
//! let mut env = CoverageEnv::new(level, MAX_STEPS);
//! env.reset(&mut ChaCha8Rng::seed_from_u64(1));
//! let step = env.step(Action::Right);
//! assert!(!step.terminated && !step.truncated);
//! # Ok::<(), coverage_env::LevelError>(())
//! ```
//!
//! # Words
//! A *cell* is an index into the map in row-major order, `row * width + column`; rows count from the
//! top and columns from the left, both from 0. (Error messages and only they count from 1, as text
//! editors do.)

pub mod action;
pub mod cell_set;
pub mod env;
pub mod generator;
pub mod level;
pub mod planner;
pub mod random;
pub mod render;
pub mod sensor;
pub mod state;
pub mod vec_env;

pub use action::Action;
pub use cell_set::CellSet;
pub use env::{CoverageEnv, MAX_STEPS, Step, worst_return};
pub use level::{BUILTIN_IDS, Cell, Level, LevelDefect, LevelError};
pub use planner::{EpisodeResult, PlanError, Planner, replay};
pub use sensor::{Scene, Sensor};
pub use state::{StartError, State, StateError};
pub use vec_env::{EpisodeEnd, VecEnv, VecStep};
