//! `VectorEnv`: many environments behind Gymnasium's `VectorEnv`, stepped by one call.

use std::sync::Arc;

use coverage_env::Action;
use coverage_env::render::render;
use numpy::{
    PyArray1, PyArray2, PyArrayDyn, PyArrayMethods, PyReadonlyArray1, PyReadwriteArrayDyn, PyUntypedArrayMethods,
};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyTuple};

use crate::error::{InvalidAction, ResetNeeded, not_reset, value_error};
use crate::level::PyLevel;
use crate::runner::{Info, Phase, Runner, Saved};
use crate::sensor::{Seen, SeenBy};
use crate::source::{LevelSource, Source, check_shapes};

/// What happens to an environment whose episode is over; Gymnasium's `AutoresetMode`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Autoreset {
    /// The next step resets it, whatever its action.
    NextStep,
    /// It is reset at once; the last observation and info of its episode are in `final_obs` and `final_info`.
    SameStep,
    /// The caller resets it.
    Disabled,
}

impl Autoreset {
    const NAMES: [(&str, Autoreset); 3] =
        [("NextStep", Autoreset::NextStep), ("SameStep", Autoreset::SameStep), ("Disabled", Autoreset::Disabled)];

    fn from_name(name: &str) -> PyResult<Autoreset> {
        let mode = Autoreset::NAMES.into_iter().find(|(known, _)| *known == name);
        mode.map(|(_, mode)| mode).ok_or_else(|| value_error(format_args!("no autoreset mode {name:?}")))
    }

    fn name(self) -> &'static str {
        Autoreset::NAMES.into_iter().find(|(_, mode)| *mode == self).map_or("", |(name, _)| name)
    }
}

/// Many environments: what `reset` and `step` return is what those of Gymnasium's `SyncVectorEnv` do.
#[pyclass(module = "cpp_rl_gym._native")]
pub(crate) struct VectorEnv {
    /// Of each environment, `[n]`.
    sources: Vec<Py<LevelSource>>,
    /// `[n]`
    runners: Vec<Runner>,
    autoreset: Autoreset,
    /// What all of them see with.
    seen: Seen,
    /// The one array of observations that is always returned, if each call is not to have its own.
    shared: Option<Py<PyArrayDyn<f32>>>,
}

/// Observations and infos.
type Reset<'py> = (Bound<'py, PyArrayDyn<f32>>, Bound<'py, PyDict>);
/// Observations, rewards, terminations, truncations and infos.
type Stepped<'py> = (
    Bound<'py, PyArrayDyn<f32>>,
    Bound<'py, PyArray1<f64>>,
    Bound<'py, PyArray1<bool>>,
    Bound<'py, PyArray1<bool>>,
    Bound<'py, PyDict>,
);
type Reduced<'py> = (Bound<'py, PyAny>, (Vec<Py<LevelSource>>, u32, &'static str, SeenBy, bool, Vec<Saved>));

#[pymethods]
impl VectorEnv {
    #[new]
    #[pyo3(signature = (sources, *, max_steps, autoreset, seen, shares_memory, records_path))]
    fn new(
        py: Python<'_>,
        sources: Vec<Py<LevelSource>>,
        max_steps: u32,
        autoreset: &str,
        seen: SeenBy,
        shares_memory: bool,
        records_path: bool,
    ) -> PyResult<VectorEnv> {
        let runner = |source| Runner::new(source, max_steps, records_path);
        let runners = rules(py, &sources).map(runner).collect();
        let seen = Seen::new(&seen)?;
        VectorEnv::with(py, sources, runners, Autoreset::from_name(autoreset)?, seen, shares_memory)
    }

    /// From the next episodes on, the levels of each environment come from its entry of `sources`.
    fn set_sources(&mut self, py: Python<'_>, sources: Vec<Py<LevelSource>>) -> PyResult<()> {
        if sources.len() != self.runners.len() {
            return Err(value_error(format_args!("{} levels for {} environments", sources.len(), self.runners.len())));
        }
        check_sources(py, self.sources.iter().take(1).chain(&sources))?;
        for (runner, rule) in self.runners.iter_mut().zip(rules(py, &sources)) {
            runner.set_source(rule);
        }
        self.sources = sources;
        Ok(())
    }

    /// Begins episodes: in the environments of `mask`, or in all; with new random numbers where `seeds` has a seed; at
    /// the start that `starts` has, or at a random one. If it fails, nothing changes.
    #[pyo3(signature = (seeds, starts = None, mask = None))]
    fn reset<'py>(
        &mut self,
        py: Python<'py>,
        seeds: Vec<Option<u64>>,
        starts: Option<Vec<(i64, i64)>>,
        mask: Option<Vec<bool>>,
    ) -> PyResult<Reset<'py>> {
        let count = self.runners.len();
        let lengths = [Some(seeds.len()), starts.as_ref().map(Vec::len), mask.as_ref().map(Vec::len)];
        if lengths.into_iter().flatten().any(|length| length != count) {
            return Err(value_error(format_args!("seeds, starts and masks must be {count} each")));
        }
        let mask = mask.unwrap_or_else(|| vec![true; count]);
        let mut runners = self.runners.clone();
        py.detach(|| {
            for (index, runner) in runners.iter_mut().enumerate().filter(|(index, _)| mask[*index]) {
                if let Some(seed) = seeds[index] {
                    runner.seed(seed);
                }
                match &starts {
                    None => runner.reset(),
                    Some(starts) => runner.reset_at(starts[index])?,
                }
            }
            Ok::<(), PyErr>(())
        })?;
        if runners.iter().any(|runner| runner.phase() == Phase::New) {
            return Err(ResetNeeded::new_err("the first reset must be of all environments, without a reset_mask"));
        }
        self.runners = runners;

        let observations = self.observations(py)?;
        let mut batch = observations.try_readwrite().map_err(value_error)?;
        let out = batch.as_slice_mut().map_err(value_error)?;
        let mut infos = Infos::new(count);
        let seen = self.seen;
        py.detach(|| {
            for ((index, runner), out) in self.runners.iter().enumerate().zip(chunks(out, &self.runners)) {
                seen.write(runner, out);
                if mask[index] {
                    infos.set(index, runner.info());
                }
            }
        });
        drop(batch);
        let dict = infos.into_dict(py, &mask)?;
        self.add_levels(&dict, &mask)?;
        Ok((observations, dict))
    }

    /// Makes one step in every environment. If an action is invalid, nothing changes.
    fn step<'py>(&mut self, py: Python<'py>, actions: PyReadonlyArray1<'py, i64>) -> PyResult<Stepped<'py>> {
        let actions = self.check_actions(&actions)?;
        self.check_phases()?;
        let count = self.runners.len();
        let observations = self.observations(py)?;
        let rewards = PyArray1::<f64>::zeros(py, count, false);
        let terminated = PyArray1::<bool>::zeros(py, count, false);
        let truncated = PyArray1::<bool>::zeros(py, count, false);
        let mut report = Report::new(count);
        {
            // No one else knows these arrays yet, and a shared one is lent to one call at a time.
            let mut observations: PyReadwriteArrayDyn<'_, f32> = observations.try_readwrite().map_err(value_error)?;
            let (mut rewards, mut terminated, mut truncated) =
                (rewards.readwrite(), terminated.readwrite(), truncated.readwrite());
            let batch = Batch {
                observations: observations.as_slice_mut().map_err(value_error)?,
                rewards: rewards.as_slice_mut().map_err(value_error)?,
                terminated: terminated.as_slice_mut().map_err(value_error)?,
                truncated: truncated.as_slice_mut().map_err(value_error)?,
            };
            let (runners, autoreset, seen) = (&mut self.runners, self.autoreset, self.seen);
            py.detach(|| step_all(runners, autoreset, seen, &actions, batch, &mut report));
        }
        let infos = report.infos.into_dict(py, &vec![true; count])?;
        if !report.finals.is_empty() {
            self.add_finals(&infos, &report.finals)?;
        }
        if report.was_reset.contains(&true) {
            self.add_levels(&infos, &report.was_reset)?;
        }
        Ok((observations, rewards, terminated, truncated, infos))
    }

    /// The states as text.
    fn texts(&self) -> Vec<String> {
        self.runners.iter().map(|runner| render(runner.env().level(), runner.env().state())).collect()
    }

    /// Whether there have been episodes.
    #[getter]
    fn was_reset(&self) -> bool {
        self.runners.iter().all(|runner| runner.phase() != Phase::New)
    }

    /// The shape of one observation.
    #[getter]
    fn single_shape<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyTuple>> {
        PyTuple::new(py, self.seen.shape(&self.runners[0]))
    }

    /// The levels of the current episodes.
    #[getter]
    fn levels(&self) -> Vec<PyLevel> {
        self.runners.iter().map(|runner| Arc::clone(runner.env().level()).into()).collect()
    }

    /// The cells that each agent has been on, `(row, column)` in order; empty unless they are recorded.
    #[getter]
    fn paths(&self) -> Vec<Vec<(usize, usize)>> {
        let path = |runner: &Runner| {
            let level = runner.env().level();
            runner.path().unwrap_or_default().iter().map(|&cell| level.position(cell.into())).collect()
        };
        self.runners.iter().map(path).collect()
    }

    fn __reduce__<'py>(slf: &Bound<'py, VectorEnv>) -> PyResult<Reduced<'py>> {
        let (py, restore) = (slf.py(), slf.get_type().getattr("restore")?);
        let env = slf.try_borrow()?;
        let sources = env.sources.iter().map(|source| source.clone_ref(py)).collect();
        let saved: Vec<Saved> = env.runners.iter().map(|runner| runner.save(py)).collect::<PyResult<_>>()?;
        let (max_steps, mode) = (env.runners[0].env().max_steps(), env.autoreset.name());
        Ok((restore, (sources, max_steps, mode, env.seen.by(), env.shared.is_some(), saved)))
    }

    /// The environments that were pickled.
    #[staticmethod]
    fn restore(
        py: Python<'_>,
        sources: Vec<Py<LevelSource>>,
        max_steps: u32,
        autoreset: &str,
        seen: SeenBy,
        shares_memory: bool,
        saved: Vec<Saved>,
    ) -> PyResult<VectorEnv> {
        if saved.len() != sources.len() {
            return Err(value_error("not as many saved environments as levels"));
        }
        let restored = rules(py, &sources).zip(saved).map(|(rule, saved)| Runner::restore(rule, max_steps, saved));
        let runners = restored.collect::<PyResult<_>>()?;
        let seen = Seen::new(&seen)?;
        VectorEnv::with(py, sources, runners, Autoreset::from_name(autoreset)?, seen, shares_memory)
    }
}

impl VectorEnv {
    fn with(
        py: Python<'_>,
        sources: Vec<Py<LevelSource>>,
        runners: Vec<Runner>,
        autoreset: Autoreset,
        seen: Seen,
        shares_memory: bool,
    ) -> PyResult<VectorEnv> {
        check_sources(py, sources.iter())?;
        let mut env = VectorEnv { sources, runners, autoreset, seen, shared: None };
        if shares_memory {
            env.shared = Some(env.observations(py)?.unbind());
        }
        Ok(env)
    }

    /// The array for the next observations.
    fn observations<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArrayDyn<f32>>> {
        if let Some(shared) = &self.shared {
            return Ok(shared.bind(py).clone());
        }
        Ok(PyArrayDyn::zeros(py, self.shape(self.runners.len()), false))
    }

    /// The shape of `count` observations.
    fn shape(&self, count: usize) -> Vec<usize> {
        let mut shape = self.seen.shape(&self.runners[0]);
        shape.insert(0, count);
        shape
    }

    fn check_actions(&self, actions: &PyReadonlyArray1<'_, i64>) -> PyResult<Vec<Action>> {
        let count = self.runners.len();
        if actions.len() != count {
            return Err(InvalidAction::new_err(format!("{} actions for {count} environments", actions.len())));
        }
        let taken = actions.as_array();
        let action = |(index, &action): (usize, &i64)| {
            u8::try_from(action).ok().and_then(Action::from_index).ok_or_else(|| {
                InvalidAction::new_err(format!(
                    "{action}, for environment {index}, is not an action; pass 0 down, 1 up, 2 right or 3 left"
                ))
            })
        };
        taken.iter().enumerate().map(action).collect()
    }

    fn check_phases(&self) -> PyResult<()> {
        let find = |phase| self.runners.iter().position(|runner| runner.phase() == phase);
        if find(Phase::New).is_some() {
            return Err(not_reset());
        }
        match find(Phase::Over) {
            Some(index) if self.autoreset == Autoreset::Disabled => Err(ResetNeeded::new_err(format!(
                "the episode of environment {index} is over; reset it with reset(options={{\"reset_mask\": …}})"
            ))),
            _ => Ok(()),
        }
    }

    /// Adds the names of the levels of the environments that were reset.
    fn add_levels(&self, infos: &Bound<'_, PyDict>, was_reset: &[bool]) -> PyResult<()> {
        let py = infos.py();
        let name = |(runner, reset): (&Runner, &bool)| match reset {
            true => Ok(runner.env().level().name().into_pyobject(py)?.into_any().unbind()),
            false => Ok(py.None()),
        };
        let names: Vec<Py<PyAny>> = self.runners.iter().zip(was_reset).map(name).collect::<PyResult<_>>()?;
        infos.set_item("level", PyArray1::from_vec(py, names))?;
        infos.set_item("_level", PyArray1::from_slice(py, was_reset))
    }

    /// Adds the last observations and infos of the episodes that ended.
    fn add_finals(&self, infos: &Bound<'_, PyDict>, finals: &[Final]) -> PyResult<()> {
        let (py, count) = (infos.py(), self.runners.len());
        let shape = &self.shape(1)[1..];
        let mut observations: Vec<Py<PyAny>> = (0..count).map(|_| py.None()).collect();
        let mut final_infos = Infos::new(count);
        let mut mask = vec![false; count];
        for last in finals {
            let observation = PyArray1::from_slice(py, &last.observation).reshape(shape)?;
            observations[last.index] = observation.into_any().unbind();
            final_infos.set(last.index, last.info);
            mask[last.index] = true;
        }
        infos.set_item("final_obs", PyArray1::from_vec(py, observations))?;
        infos.set_item("_final_obs", PyArray1::from_slice(py, &mask))?;
        infos.set_item("final_info", final_infos.into_dict(py, &mask)?)?;
        infos.set_item("_final_info", PyArray1::from_slice(py, &mask))
    }
}

/// What a step returns, to be filled in; one environment after the other.
struct Batch<'a> {
    /// `[n * C * H * W]`
    observations: &'a mut [f32],
    /// `[n]`, as are the next.
    rewards: &'a mut [f64],
    terminated: &'a mut [bool],
    truncated: &'a mut [bool],
}

/// The end of an episode whose environment was reset at once.
struct Final {
    index: usize,
    observation: Vec<f32>,
    info: Info,
}

/// What a step says beyond its batch.
struct Report {
    infos: Infos,
    /// Which environments began an episode, `[n]`.
    was_reset: Vec<bool>,
    finals: Vec<Final>,
}

impl Report {
    fn new(count: usize) -> Report {
        Report { infos: Infos::new(count), was_reset: vec![false; count], finals: Vec::new() }
    }
}

fn step_all(
    runners: &mut [Runner],
    autoreset: Autoreset,
    seen: Seen,
    actions: &[Action],
    batch: Batch<'_>,
    report: &mut Report,
) {
    let length = batch.observations.len() / runners.len();
    let observations = batch.observations.chunks_exact_mut(length);
    for (index, (runner, out)) in runners.iter_mut().zip(observations).enumerate() {
        if runner.phase() == Phase::Over {
            // Only with Autoreset::NextStep; the action is ignored, the reward is 0 and no flag is set.
            runner.reset();
            report.was_reset[index] = true;
        } else {
            let step = runner.step(actions[index]);
            batch.rewards[index] = step.reward.into();
            batch.terminated[index] = step.terminated;
            batch.truncated[index] = step.truncated;
            if step.is_done() && autoreset == Autoreset::SameStep {
                let mut observation = vec![0.0; length];
                seen.write(runner, &mut observation);
                report.finals.push(Final { index, observation, info: runner.info() });
                runner.reset();
                report.was_reset[index] = true;
            }
        }
        seen.write(runner, out);
        report.infos.set(index, runner.info());
    }
}

/// The infos of all environments, an array for each key.
struct Infos {
    /// `[n]`
    steps: Vec<i64>,
    /// `[n]`
    remaining: Vec<i64>,
    /// `[n * 4]`
    action_masks: Vec<i8>,
}

impl Infos {
    fn new(count: usize) -> Infos {
        Infos { steps: vec![0; count], remaining: vec![0; count], action_masks: vec![0; count * Action::COUNT] }
    }

    #[inline]
    fn set(&mut self, index: usize, info: Info) {
        self.steps[index] = info.steps;
        self.remaining[index] = info.remaining;
        self.action_masks[index * Action::COUNT..][..Action::COUNT].copy_from_slice(&info.action_mask);
    }

    /// Gymnasium's form: for each key also `_key`, which says for which environments it holds.
    fn into_dict<'py>(self, py: Python<'py>, mask: &[bool]) -> PyResult<Bound<'py, PyDict>> {
        let count = self.steps.len();
        let masks: Bound<'py, PyArray2<i8>> =
            PyArray1::from_vec(py, self.action_masks).reshape([count, Action::COUNT])?;
        let dict = PyDict::new(py);
        dict.set_item("steps", PyArray1::from_vec(py, self.steps))?;
        dict.set_item("remaining_targets", PyArray1::from_vec(py, self.remaining))?;
        dict.set_item("action_mask", masks)?;
        for key in ["_steps", "_remaining_targets", "_action_mask"] {
            dict.set_item(key, PyArray1::from_slice(py, mask))?;
        }
        Ok(dict)
    }
}

/// `out` cut into one observation for each runner.
fn chunks<'a>(out: &'a mut [f32], runners: &[Runner]) -> impl Iterator<Item = &'a mut [f32]> {
    let length = out.len() / runners.len();
    out.chunks_exact_mut(length)
}

fn rules(py: Python<'_>, sources: &[Py<LevelSource>]) -> impl Iterator<Item = Arc<Source>> {
    sources.iter().map(move |source| Arc::clone(&source.bind(py).get().source))
}

fn check_sources<'a>(py: Python<'a>, sources: impl Iterator<Item = &'a Py<LevelSource>>) -> PyResult<()> {
    check_shapes(sources.map(|source| &*source.bind(py).get().source))
}
