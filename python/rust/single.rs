//! `Env`: one environment behind Gymnasium's `Env`.

use std::sync::Arc;

use coverage_env::Action;
use coverage_env::render::render;
use numpy::{PyArray1, PyArrayMethods};
use pyo3::intern;
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyTuple};

use crate::error::{InvalidAction, ResetNeeded, not_reset};
use crate::level::PyLevel;
use crate::runner::{Phase, Runner, Saved};
use crate::sensor::{Seen, SeenBy};
use crate::source::{LevelSource, check_shapes};

/// One environment: what `reset` and `step` return is what Gymnasium's do.
#[pyclass(module = "cpp_rl_gym._native")]
pub(crate) struct Env {
    source: Py<LevelSource>,
    runner: Runner,
    seen: Seen,
    /// The latest observation, `[C * H * W]`: memory to write it to before it is handed over.
    scratch: Vec<f32>,
}

type Reset<'py> = (Bound<'py, PyAny>, Bound<'py, PyDict>);
type Stepped<'py> = (Bound<'py, PyAny>, f32, bool, bool, Bound<'py, PyDict>);
type Reduced<'py> = (Bound<'py, PyAny>, (Py<LevelSource>, u32, SeenBy, Saved));

#[pymethods]
impl Env {
    #[new]
    #[pyo3(signature = (source, *, max_steps, seen, records_path))]
    fn new(py: Python<'_>, source: Py<LevelSource>, max_steps: u32, seen: SeenBy, records_path: bool) -> PyResult<Env> {
        let runner = Runner::new(Arc::clone(&source.bind(py).get().source), max_steps, records_path);
        Ok(Env::with(source, runner, Seen::new(&seen)?))
    }

    /// The shape of its observations.
    #[getter]
    fn shape<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyTuple>> {
        PyTuple::new(py, self.seen.shape(&self.runner))
    }

    /// From here on, random numbers are those of `seed`.
    fn seed(&mut self, seed: u64) {
        self.runner.seed(seed);
    }

    /// From the next episode on, levels come from `source`.
    fn set_source(&mut self, py: Python<'_>, source: Py<LevelSource>) -> PyResult<()> {
        check_shapes([&self.source, &source].map(|source| &*source.bind(py).get().source).into_iter())?;
        self.runner.set_source(Arc::clone(&source.bind(py).get().source));
        self.source = source;
        Ok(())
    }

    /// Begins an episode, at `start` if it is given.
    #[pyo3(signature = (start = None))]
    fn reset<'py>(&mut self, py: Python<'py>, start: Option<(i64, i64)>) -> PyResult<Reset<'py>> {
        match start {
            None => self.runner.reset(),
            Some(start) => {
                let mut runner = self.runner.clone();
                runner.reset_at(start)?;
                self.runner = runner;
            }
        }
        let info = self.info(py)?;
        info.set_item(intern!(py, "level"), self.runner.env().level().name())?;
        Ok((self.observation(py)?, info))
    }

    /// Makes one step.
    fn step<'py>(&mut self, py: Python<'py>, action: &Bound<'py, PyAny>) -> PyResult<Stepped<'py>> {
        let index = action.extract::<i64>().ok().and_then(|index| u8::try_from(index).ok());
        let Some(taken) = index.and_then(Action::from_index) else {
            return Err(invalid_action(action));
        };
        match self.runner.phase() {
            Phase::Running => {}
            Phase::New => return Err(not_reset()),
            Phase::Over => return Err(ResetNeeded::new_err("the episode is over; call reset() to begin another")),
        }
        let step = self.runner.step(taken);
        Ok((self.observation(py)?, step.reward, step.terminated, step.truncated, self.info(py)?))
    }

    /// The state as text.
    fn text(&self) -> String {
        render(self.runner.env().level(), self.runner.env().state())
    }

    /// Whether there has been an episode.
    #[getter]
    fn was_reset(&self) -> bool {
        self.runner.phase() != Phase::New
    }

    /// The level of the current episode.
    #[getter]
    fn level(&self) -> PyLevel {
        Arc::clone(self.runner.env().level()).into()
    }

    /// The number of steps in all episodes.
    #[getter]
    fn timesteps(&self) -> u64 {
        self.runner.timesteps()
    }

    /// The cells that the agent has been on, `(row, column)` in order; empty unless they are recorded.
    #[getter]
    fn path(&self) -> Vec<(usize, usize)> {
        let level = self.runner.env().level();
        let path = self.runner.path().unwrap_or_default();
        path.iter().map(|&cell| level.position(cell.into())).collect()
    }

    fn __reduce__<'py>(slf: &Bound<'py, Env>) -> PyResult<Reduced<'py>> {
        let (py, restore) = (slf.py(), slf.get_type().getattr("restore")?);
        let env = slf.try_borrow()?;
        let (source, max_steps) = (env.source.clone_ref(py), env.runner.env().max_steps());
        Ok((restore, (source, max_steps, env.seen.by(), env.runner.save(py)?)))
    }

    /// The environment that was pickled.
    #[staticmethod]
    fn restore(py: Python<'_>, source: Py<LevelSource>, max_steps: u32, seen: SeenBy, saved: Saved) -> PyResult<Env> {
        let runner = Runner::restore(Arc::clone(&source.bind(py).get().source), max_steps, saved)?;
        Ok(Env::with(source, runner, Seen::new(&seen)?))
    }
}

impl Env {
    fn with(source: Py<LevelSource>, runner: Runner, seen: Seen) -> Env {
        let scratch = vec![0.0; seen.inputs(&runner)];
        Env { source, runner, seen, scratch }
    }

    fn observation<'py>(&mut self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        self.seen.write(&self.runner, &mut self.scratch);
        let array = PyArray1::from_slice(py, &self.scratch);
        if self.seen.grid {
            return Ok(array.reshape(self.seen.grid_shape(&self.runner))?.into_any());
        }
        Ok(array.into_any())
    }

    fn info<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let info = self.runner.info();
        let dict = PyDict::new(py);
        dict.set_item(intern!(py, "steps"), info.steps)?;
        dict.set_item(intern!(py, "remaining_targets"), info.remaining)?;
        dict.set_item(intern!(py, "action_mask"), PyArray1::from_slice(py, &info.action_mask))?;
        Ok(dict)
    }
}

fn invalid_action(action: &Bound<'_, PyAny>) -> PyErr {
    let kind = action.get_type();
    InvalidAction::new_err(format!(
        "{action:?} ({kind:?}) is not an action; pass an integer: 0 down, 1 up, 2 right or 3 left"
    ))
}
