//! `LevelSource`: which level an episode is played on.

use std::sync::Arc;

use chacha20::ChaCha8Rng;
use coverage_env::Level;
use coverage_env::generator::LevelSpec;
use coverage_env::random::below;
use pyo3::prelude::*;
use rand::Rng;

use crate::error::value_error;
use crate::level::PyLevel;

/// A rule that gives each episode its level. All levels of a source have the same height and width.
#[derive(Debug)]
pub(crate) enum Source {
    /// Always the same.
    Fixed(Arc<Level>),
    /// Any of the generated levels with the seeds from `first.seed` on: `count` of them, or 2³² if that is `None`.
    Generated { first: LevelSpec, count: Option<u32> },
    /// Any of these, uniformly.
    OneOf(Vec<Arc<Source>>),
    /// One after the other, each for so many timesteps; the last for ever.
    Stages(Vec<(u64, Arc<Source>)>),
}

impl Source {
    /// The level of the next episode of an environment that has made `timesteps` steps.
    pub(crate) fn draw(&self, timesteps: u64, rng: &mut ChaCha8Rng) -> Arc<Level> {
        match self {
            Source::Fixed(level) => Arc::clone(level),
            Source::Generated { first, count } => {
                let number = match count {
                    Some(count) => below(rng, *count),
                    None => rng.next_u32(),
                };
                generate(LevelSpec { seed: first.seed.wrapping_add(number.into()), ..*first })
            }
            Source::OneOf(sources) => sources[below(rng, sources.len() as u32) as usize].draw(timesteps, rng),
            Source::Stages(stages) => {
                let mut end = 0u64;
                let running = |(length, _): &&(u64, Arc<Source>)| {
                    end = end.saturating_add(*length);
                    timesteps < end
                };
                let stage = stages.iter().find(running).unwrap_or(&stages[stages.len() - 1]);
                stage.1.draw(timesteps, rng)
            }
        }
    }

    /// One of its levels, always the same: what an environment shows before its first episode.
    pub(crate) fn first(&self) -> Arc<Level> {
        match self {
            Source::Fixed(level) => Arc::clone(level),
            Source::Generated { first, .. } => generate(*first),
            Source::OneOf(sources) => sources[0].first(),
            Source::Stages(stages) => stages[0].1.first(),
        }
    }

    /// H and W.
    pub(crate) fn shape(&self) -> (usize, usize) {
        match self {
            Source::Fixed(level) => (level.height(), level.width()),
            Source::Generated { first, .. } => (first.height, first.width),
            Source::OneOf(sources) => sources[0].shape(),
            Source::Stages(stages) => stages[0].1.shape(),
        }
    }
}

/// The level of a specification that has been tried: whether there is one does not depend on the seed.
fn generate(spec: LevelSpec) -> Arc<Level> {
    Arc::new(spec.generate().expect("the first level of this specification could be generated"))
}

/// Refuses sources whose levels differ in height or width, since observations would.
pub(crate) fn check_shapes<'a>(mut shapes: impl Iterator<Item = &'a Source>) -> PyResult<()> {
    let Some((height, width)) = shapes.next().map(Source::shape) else {
        return Err(value_error("no levels; give at least one"));
    };
    match shapes.map(Source::shape).find(|&shape| shape != (height, width)) {
        None => Ok(()),
        Some((other_height, other_width)) => Err(value_error(format_args!(
            "levels of {height} x {width} and of {other_height} x {other_width} cells; \
             the levels of one environment must have the same height and width"
        ))),
    }
}

/// A [`Source`] for Python.
#[pyclass(module = "cpp_rl_gym._native", frozen)]
pub(crate) struct LevelSource {
    pub(crate) source: Arc<Source>,
}

impl From<Source> for LevelSource {
    fn from(source: Source) -> LevelSource {
        LevelSource { source: Arc::new(source) }
    }
}

#[pymethods]
impl LevelSource {
    /// Always `level`.
    #[staticmethod]
    fn fixed(level: &PyLevel) -> LevelSource {
        Source::Fixed(Arc::clone(&level.level)).into()
    }

    /// Generated levels with the seeds `seed`, `seed + 1`, …: `num_levels` of them, or 2³².
    #[staticmethod]
    fn generated(
        height: usize,
        width: usize,
        wall_density: f64,
        num_targets: usize,
        seed: u64,
        num_levels: Option<u32>,
    ) -> PyResult<LevelSource> {
        let first = LevelSpec { height, width, wall_density, num_targets, seed };
        first.generate().map_err(value_error)?;
        Ok(Source::Generated { first, count: num_levels }.into())
    }

    /// Any of `sources`, uniformly, anew for each episode.
    #[staticmethod]
    fn one_of(sources: Vec<PyRef<'_, LevelSource>>) -> PyResult<LevelSource> {
        check_shapes(sources.iter().map(|source| &*source.source))?;
        Ok(Source::OneOf(sources.iter().map(|source| Arc::clone(&source.source)).collect()).into())
    }

    /// One source after the other, each for its number of timesteps.
    #[staticmethod]
    fn stages(stages: Vec<(u64, PyRef<'_, LevelSource>)>) -> PyResult<LevelSource> {
        check_shapes(stages.iter().map(|(_, source)| &*source.source))?;
        let stage = |(timesteps, source): &(u64, PyRef<'_, LevelSource>)| (*timesteps, Arc::clone(&source.source));
        Ok(Source::Stages(stages.iter().map(stage).collect()).into())
    }

    /// Height and width of its levels.
    #[getter]
    fn shape(&self) -> (usize, usize) {
        self.source.shape()
    }

    fn __reduce__<'py>(slf: &Bound<'py, LevelSource>) -> PyResult<(Bound<'py, PyAny>, Bound<'py, PyAny>)> {
        let py = slf.py();
        let wrap = |source: &Arc<Source>| LevelSource { source: Arc::clone(source) };
        let (constructor, arguments) = match &*slf.get().source {
            Source::Fixed(level) => ("fixed", (PyLevel::from(Arc::clone(level)),).into_pyobject(py)?),
            Source::Generated { first, count } => {
                let &LevelSpec { height, width, wall_density, num_targets, seed } = first;
                ("generated", (height, width, wall_density, num_targets, seed, *count).into_pyobject(py)?)
            }
            Source::OneOf(sources) => {
                let sources: Vec<LevelSource> = sources.iter().map(wrap).collect();
                ("one_of", (sources,).into_pyobject(py)?)
            }
            Source::Stages(stages) => {
                let stages: Vec<(u64, LevelSource)> =
                    stages.iter().map(|(length, source)| (*length, wrap(source))).collect();
                ("stages", (stages,).into_pyobject(py)?)
            }
        };
        Ok((slf.get_type().getattr(constructor)?, arguments.into_any()))
    }
}
