//! Sensors: what an agent sees of a state, as a binary array.
//!
//! A sensor is one file here and two lines in this one: its module, and its entry in [`SENSORS`]. From there on its name
//! is a value of the setting `sensor`, and of `sensor=` in Python. It sees a [`Scene`] and nothing else, so that a stored
//! transition, which keeps no more, can be observed again.

mod full;
mod local;

pub use full::Full;

use crate::level::Level;
use crate::state::State;

/// Every sensor there is, the default first.
#[rustfmt::skip] // a line for each
pub static SENSORS: &[&dyn Sensor] = &[
    &full::Full,
    &local::Local,
];

/// The sensor of this name.
pub fn by_name(name: &str) -> Option<&'static dyn Sensor> {
    SENSORS.iter().copied().find(|sensor| sensor.name() == name)
}

impl Default for &dyn Sensor {
    /// The first of [`SENSORS`].
    fn default() -> Self {
        SENSORS[0]
    }
}

/// What a sensor may look at.
#[derive(Clone, Copy, Debug)]
pub struct Scene<'a> {
    /// The level.
    pub level: &'a Level,
    /// The cell that the agent is on.
    pub agent: u16,
    /// The cells that it has been on, this one included; words as [`CellSet::words`](crate::CellSet::words) gives them.
    pub visited: &'a [u64],
}

impl<'a> Scene<'a> {
    /// The scene of `state`, which must be a state of `level`.
    #[inline]
    pub fn new(level: &'a Level, state: &'a State) -> Scene<'a> {
        Scene { level, agent: state.agent, visited: state.visited.words() }
    }
}

/// What an agent sees: a scene as a binary array `[C, H, W]`, row-major.
///
/// An *input* is an index into the flattened array, `(channel * H + row) * W + column`. It fits `u16`.
pub trait Sensor: std::fmt::Debug + Send + Sync {
    /// What settings and checkpoints call it.
    fn name(&self) -> &'static str;

    /// `[C, H, W]`: channels, rows and columns of the array on maps of so many rows and columns.
    fn shape(&self, height: usize, width: usize) -> [usize; 3];

    /// The inputs that are 1 in every scene of `level`, ascending.
    fn constant_inputs(&self, level: &Level) -> Vec<u16>;

    /// Appends all other inputs that are 1, ascending.
    fn push_active(&self, scene: Scene<'_>, out: &mut Vec<u16>);

    /// The number of inputs on `level`, C · H · W.
    fn inputs(&self, level: &Level) -> usize {
        self.shape(level.height(), level.width()).into_iter().product()
    }

    /// Writes the array to `out`, `[C * H * W]`; every element is overwritten.
    ///
    /// # Panics
    /// If `out` is not [`inputs`](Sensor::inputs) long.
    fn write(&self, scene: Scene<'_>, out: &mut [f32]) {
        assert_eq!(out.len(), self.inputs(scene.level), "length of the observation's buffer");
        let mut ones = self.constant_inputs(scene.level);
        self.push_active(scene, &mut ones);
        out.fill(0.0);
        for input in ones {
            out[usize::from(input)] = 1.0;
        }
    }
}
