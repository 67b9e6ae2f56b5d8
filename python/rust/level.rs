//! `Level`, with the planners.

use std::hash::{Hash, Hasher};
use std::path::PathBuf;
use std::sync::{Arc, Mutex, PoisonError};

use coverage_env::generator::LevelSpec;
use coverage_env::planner::{AStar, Optimal};
use coverage_env::{Action, EpisodeResult, Level, PlanError, Planner, replay};
use numpy::PyArray1;
use pyo3::prelude::*;

use crate::error::value_error;

/// A map of free cells, walls and targets, checked and immutable.
#[pyclass(name = "Level", module = "cpp_rl_gym._native", frozen, eq, hash)]
pub(crate) struct PyLevel {
    pub(crate) level: Arc<Level>,
    /// Kept since its table serves every start of the level.
    optimal: Mutex<Optimal>,
}

impl PartialEq for PyLevel {
    fn eq(&self, other: &PyLevel) -> bool {
        self.level == other.level
    }
}

impl Hash for PyLevel {
    fn hash<H: Hasher>(&self, state: &mut H) {
        (self.level.name(), self.level.width(), self.level.cells()).hash(state);
    }
}

impl From<Arc<Level>> for PyLevel {
    fn from(level: Arc<Level>) -> PyLevel {
        PyLevel { level, optimal: Mutex::default() }
    }
}

/// Actions, the return that they earn, their number, and whether they solve the episode.
type Plan<'py> = (Bound<'py, PyArray1<i64>>, f64, u32, bool);

#[pymethods]
impl PyLevel {
    /// The built-in level of that id, or else the level in the file at that path.
    #[staticmethod]
    fn resolve(id_or_path: &str) -> PyResult<PyLevel> {
        Level::resolve(id_or_path).map(PyLevel::new).map_err(value_error)
    }

    /// The level in a YAML file.
    #[staticmethod]
    fn from_path(path: PathBuf) -> PyResult<PyLevel> {
        Level::from_path(&path).map(PyLevel::new).map_err(value_error)
    }

    /// The level drawn with the characters `.`, `#` and `T`, a line per row.
    #[staticmethod]
    #[pyo3(signature = (map, name = "map"))]
    fn from_map(map: &str, name: &str) -> PyResult<PyLevel> {
        Level::from_map(name, map).map(PyLevel::new).map_err(value_error)
    }

    /// The generated level number `seed` of this description.
    #[staticmethod]
    #[pyo3(signature = (*, height, width, wall_density, num_targets, seed))]
    fn generate(
        py: Python<'_>,
        height: usize,
        width: usize,
        wall_density: f64,
        num_targets: usize,
        seed: u64,
    ) -> PyResult<PyLevel> {
        let spec = LevelSpec { height, width, wall_density, num_targets, seed };
        py.detach(|| spec.generate()).map(PyLevel::new).map_err(value_error)
    }

    /// What the level is called.
    #[getter]
    fn name(&self) -> &str {
        self.level.name()
    }

    /// The number of rows.
    #[getter]
    fn height(&self) -> usize {
        self.level.height()
    }

    /// The number of columns.
    #[getter]
    fn width(&self) -> usize {
        self.level.width()
    }

    /// The map as text, a line per row.
    #[getter]
    fn map(&self) -> String {
        self.level.to_map()
    }

    /// The target cells, `(row, column)`, row by row.
    #[getter]
    fn targets(&self) -> Vec<(usize, usize)> {
        self.positions(self.level.targets())
    }

    /// The cells where an episode may start, `(row, column)`, row by row.
    #[getter]
    fn starts(&self) -> Vec<(usize, usize)> {
        self.positions(self.level.starts())
    }

    /// The actions of an episode, to its end.
    #[pyo3(signature = (planner, row, column, max_steps))]
    fn plan<'py>(&self, py: Python<'py>, planner: &str, row: i64, column: i64, max_steps: u32) -> PyResult<Plan<'py>> {
        let start = start_cell(&self.level, row, column).map_err(value_error)?;
        let plan = || -> Result<(Vec<Action>, EpisodeResult), PlanError> {
            let actions = if planner == "astar" {
                AStar.plan(&self.level, start, max_steps)?
            } else {
                let mut optimal = self.optimal.lock().unwrap_or_else(PoisonError::into_inner);
                optimal.plan(&self.level, start, max_steps)?
            };
            let result = replay(&self.level, start, max_steps, &actions)?;
            Ok((actions, result))
        };
        if !matches!(planner, "astar" | "optimal") {
            return Err(value_error(format_args!("no planner {planner:?}; there are \"optimal\" and \"astar\"")));
        }
        let (mut actions, result) = py.detach(plan).map_err(value_error)?;
        actions.truncate(result.length as usize);
        let actions = PyArray1::from_iter(py, actions.into_iter().map(|action| action.index() as i64));
        Ok((actions, result.return_ as f64, result.length, result.solved))
    }

    fn __reduce__(slf: &Bound<'_, PyLevel>) -> PyResult<(Py<PyAny>, (String, String))> {
        let level = &slf.get().level;
        let from_map = slf.get_type().getattr("from_map")?;
        Ok((from_map.unbind(), (level.to_map(), level.name().to_owned())))
    }

    fn __repr__(&self) -> String {
        let (level, targets) = (&self.level, self.level.targets().len());
        format!("Level({:?}, {} x {}, {targets} targets)", level.name(), level.height(), level.width())
    }

    fn __str__(&self) -> String {
        self.level.to_map()
    }
}

impl PyLevel {
    fn new(level: Level) -> PyLevel {
        Arc::new(level).into()
    }

    fn positions(&self, cells: &[usize]) -> Vec<(usize, usize)> {
        cells.iter().map(|&cell| self.level.position(cell)).collect()
    }
}

/// The cell at `(row, column)` if an episode can start there, or else why not.
pub(crate) fn start_cell(level: &Level, row: i64, column: i64) -> Result<usize, String> {
    let index = |row: i64, column: i64| level.index(row.try_into().ok()?, column.try_into().ok()?);
    let (name, height, width) = (level.name(), level.height(), level.width());
    let what = match index(row, column) {
        Some(cell) if level.is_start(cell) => return Ok(cell),
        Some(cell) if level.is_target(cell) => format!("is a target of level {name}"),
        Some(_) => format!("is a wall of level {name}"),
        None => format!("lies outside level {name}, which has {height} rows and {width} columns counted from 0"),
    };
    Err(format!("no episode can start at row {row}, column {column}: it {what}; choose a free cell ('.')"))
}
