//! One environment as Gymnasium sees it: episode after episode.

use std::sync::Arc;

use chacha20::ChaCha8Rng;
use chacha20::rand_core::SeedableRng;
use coverage_env::{Action, CellSet, CoverageEnv, Scene, State, Step};
use pyo3::prelude::*;

use crate::error::value_error;
use crate::level::{PyLevel, start_cell};
use crate::source::Source;

/// Where an environment stands between two calls.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Phase {
    /// Not reset yet.
    New,
    /// In an episode.
    Running,
    /// After the last step of an episode.
    Over,
}

/// An environment, the source of its levels, and its random numbers.
///
/// Both [`Env`](crate::single::Env) and [`VectorEnv`](crate::vector::VectorEnv) are made of these, so that a vector of
/// environments does what its members would do alone.
#[derive(Clone, Debug)]
pub(crate) struct Runner {
    source: Arc<Source>,
    env: CoverageEnv,
    rng: Stream,
    phase: Phase,
    /// The steps of all episodes so far.
    timesteps: u64,
    /// The cells that the agent has been on in this episode, in order, if pictures are to show them.
    path: Option<Vec<u16>>,
}

/// Random numbers whose position can be copied.
#[derive(Debug)]
struct Stream(ChaCha8Rng);

impl Stream {
    fn from_seed(seed: u64) -> Stream {
        Stream(ChaCha8Rng::seed_from_u64(seed))
    }
}

impl Clone for Stream {
    fn clone(&self) -> Stream {
        Stream(ChaCha8Rng::deserialize_state(&self.0.serialize_state()))
    }
}

/// A runner without its source, as it is pickled: level, agent, visited cells, remaining targets, steps, whether it
/// was ever reset, timesteps, generator, path.
pub(crate) type Saved = (Py<PyLevel>, u16, Vec<u64>, u32, u32, bool, u64, Vec<u8>, Option<Vec<u16>>);

/// What Gymnasium's `info` says of a state.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Info {
    pub(crate) steps: i64,
    pub(crate) remaining: i64,
    /// 1 for each action that moves the agent, 0 for each that a wall or the edge stops.
    pub(crate) action_mask: [i8; Action::COUNT],
}

impl Runner {
    pub(crate) fn new(source: Arc<Source>, max_steps: u32, records_path: bool) -> Runner {
        let env = CoverageEnv::new(source.first(), max_steps);
        let rng = Stream::from_seed(0);
        Runner { source, env, rng, phase: Phase::New, timesteps: 0, path: records_path.then(Vec::new) }
    }

    /// What a sensor may look at.
    #[inline]
    pub(crate) fn scene(&self) -> Scene<'_> {
        Scene::new(self.env.level(), self.env.state())
    }

    pub(crate) fn env(&self) -> &CoverageEnv {
        &self.env
    }

    pub(crate) fn phase(&self) -> Phase {
        self.phase
    }

    pub(crate) fn path(&self) -> Option<&[u16]> {
        self.path.as_deref()
    }

    pub(crate) fn timesteps(&self) -> u64 {
        self.timesteps
    }

    /// From here on, random numbers are those of `seed`.
    pub(crate) fn seed(&mut self, seed: u64) {
        self.rng = Stream::from_seed(seed);
    }

    /// From the next episode on, levels come from `source`.
    pub(crate) fn set_source(&mut self, source: Arc<Source>) {
        self.source = source;
    }

    /// Begins an episode at a start drawn uniformly.
    pub(crate) fn reset(&mut self) {
        self.take_level();
        self.env.reset(&mut self.rng.0);
        self.begin();
    }

    /// Begins an episode at `(row, column)`. If it fails, the runner should not be used on.
    pub(crate) fn reset_at(&mut self, (row, column): (i64, i64)) -> PyResult<()> {
        self.take_level();
        let start = start_cell(self.env.level(), row, column).map_err(value_error)?;
        self.env.reset_at(start).map_err(value_error)?;
        self.begin();
        Ok(())
    }

    fn take_level(&mut self) {
        let level = self.source.draw(self.timesteps, &mut self.rng.0);
        if !Arc::ptr_eq(&level, self.env.level()) {
            self.env = CoverageEnv::new(level, self.env.max_steps());
        }
    }

    fn begin(&mut self) {
        self.phase = Phase::Running;
        if let Some(path) = &mut self.path {
            path.clear();
            path.push(self.env.state().agent);
        }
    }

    /// Makes one step. The phase should be [`Phase::Running`].
    #[inline]
    pub(crate) fn step(&mut self, action: Action) -> Step {
        let step = self.env.step(action);
        self.timesteps += 1;
        if step.is_done() {
            self.phase = Phase::Over;
        }
        if let Some(path) = &mut self.path {
            path.push(self.env.state().agent);
        }
        step
    }

    #[inline]
    pub(crate) fn info(&self) -> Info {
        let (level, state) = (self.env.level(), self.env.state());
        let cell = usize::from(state.agent);
        Info {
            steps: state.steps.into(),
            remaining: state.remaining.into(),
            action_mask: Action::ALL.map(|action| i8::from(level.neighbor(cell, action) != cell)),
        }
    }

    pub(crate) fn save(&self, py: Python<'_>) -> PyResult<Saved> {
        let State { agent, visited, remaining, steps } = self.env.state().clone();
        let level = Py::new(py, PyLevel::from(Arc::clone(self.env.level())))?;
        let was_reset = self.phase != Phase::New;
        let rng = self.rng.0.serialize_state().to_vec();
        Ok((level, agent, visited.into(), remaining, steps, was_reset, self.timesteps, rng, self.path.clone()))
    }

    pub(crate) fn restore(source: Arc<Source>, max_steps: u32, saved: Saved) -> PyResult<Runner> {
        let (level, agent, visited, remaining, steps, was_reset, timesteps, rng, path) = saved;
        // One level that many runners share stays one, where the source still has it.
        let mut level = Arc::clone(&level.get().level);
        if let Source::Fixed(fixed) = &*source
            && *fixed == level
        {
            level = Arc::clone(fixed);
        }
        let cells = level.len();
        if (level.height(), level.width()) != source.shape() {
            return Err(value_error("the saved level has another size than the environment's levels"));
        }
        let mut env = CoverageEnv::new(level, max_steps);
        env.set_state(State { agent, visited: CellSet::from(visited), remaining, steps }).map_err(value_error)?;
        let rng = rng.try_into().map_err(|_| value_error("the saved random generator is damaged"))?;
        if path.iter().flatten().any(|&cell| usize::from(cell) >= cells) {
            return Err(value_error("the saved path leaves the map"));
        }
        let phase = match was_reset {
            false => Phase::New,
            true if env.state().is_over(max_steps) => Phase::Over,
            true => Phase::Running,
        };
        Ok(Runner { source, env, rng: Stream(ChaCha8Rng::deserialize_state(&rng)), phase, timesteps, path })
    }
}
