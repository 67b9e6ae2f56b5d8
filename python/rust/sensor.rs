//! What environments see with.

use coverage_env::Sensor;
use coverage_env::sensor::{SENSORS, by_name};
use pyo3::prelude::*;

use crate::error::value_error;
use crate::runner::Runner;

/// The names of all sensors, the default first.
#[pyfunction]
pub(crate) fn sensors() -> Vec<&'static str> {
    SENSORS.iter().map(|sensor| sensor.name()).collect()
}

/// A sensor, and the form in which Python gets what it sees.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Seen {
    pub(crate) sensor: &'static dyn Sensor,
    /// Whether observations are `[C, H, W]` rather than `[C * H * W]`.
    pub(crate) grid: bool,
}

/// As Python passes it: the sensor's name, and whether observations are grids.
pub(crate) type SeenBy = (String, bool);

impl Seen {
    pub(crate) fn new((name, grid): &SeenBy) -> PyResult<Seen> {
        let sensor = by_name(name).ok_or_else(|| value_error(format_args!("no sensor {name:?}")))?;
        Ok(Seen { sensor, grid: *grid })
    }

    /// What [`new`](Seen::new) makes it of.
    pub(crate) fn by(self) -> SeenBy {
        (self.sensor.name().to_owned(), self.grid)
    }

    /// The number of inputs of an observation.
    pub(crate) fn inputs(self, runner: &Runner) -> usize {
        self.sensor.inputs(runner.env().level())
    }

    /// The shape of an observation, as Python gets it.
    pub(crate) fn shape(self, runner: &Runner) -> Vec<usize> {
        if self.grid { self.grid_shape(runner).to_vec() } else { vec![self.inputs(runner)] }
    }

    /// `[C, H, W]`: the shape of an observation as a grid.
    pub(crate) fn grid_shape(self, runner: &Runner) -> [usize; 3] {
        let level = runner.env().level();
        self.sensor.shape(level.height(), level.width())
    }

    /// Writes what the agent sees to `out`.
    #[inline]
    pub(crate) fn write(self, runner: &Runner, out: &mut [f32]) {
        self.sensor.write(runner.scene(), out);
    }
}
