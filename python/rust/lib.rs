//! The extension module `cpp_rl_gym._native`: `coverage-env` for Python.
//!
//! It holds what must be fast, stepping above all, and as little else as possible: what users see, its documentation
//! and the checking of most arguments is Python, in `src/cpp_rl_gym`. The types are described once more, for type
//! checkers, in `src/cpp_rl_gym/_native.pyi`.
//!
//! | module | what |
//! |---|---|
//! | `level` | `Level`, with the planners |
//! | `source` | `LevelSource`: which level an episode is played on |
//! | `sensor` | what environments see with |
//! | `runner` | one environment, episode after episode |
//! | `single` | `Env`: a runner behind Gymnasium's `Env` |
//! | `vector` | `VectorEnv`: many runners behind Gymnasium's `VectorEnv` |
//!
//! Nothing may panic on what Python passes in: it raises instead.

#![deny(unsafe_code)]

mod error;
mod level;
mod runner;
mod sensor;
mod single;
mod source;
mod vector;

/// See the crate's documentation.
#[pyo3::pymodule]
mod _native {
    #[pymodule_export]
    use crate::level::PyLevel;
    #[pymodule_export]
    use crate::sensor::sensors;
    #[pymodule_export]
    use crate::single::Env;
    #[pymodule_export]
    use crate::source::LevelSource;
    #[pymodule_export]
    use crate::vector::VectorEnv;

    #[pymodule_export]
    const MAX_STEPS: u32 = coverage_env::MAX_STEPS;

    #[pymodule_export]
    const BUILTIN_LEVELS: [&str; coverage_env::BUILTIN_IDS.len()] = coverage_env::BUILTIN_IDS;

    #[pymodule_export]
    const RENDER_LEGEND: &str = coverage_env::render::LEGEND;
}
