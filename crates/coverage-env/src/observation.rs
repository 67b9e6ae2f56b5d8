//! [`Observation`]: what the [full](Full) sensor sees, for callers that use no other.

use crate::level::Level;
use crate::sensor::{Full, Scene, Sensor};
use crate::state::State;

/// A state as the [full](Full) sensor sees it: a binary array of shape `[4, H, W]`, row-major.
#[derive(Clone, Copy, Debug)]
pub struct Observation<'a>(Scene<'a>);

impl<'a> Observation<'a> {
    /// How many channels there are.
    pub const CHANNELS: usize = crate::sensor::CHANNELS;

    /// What the agent sees in `state`, which must be a state of `level`.
    pub fn new(level: &'a Level, state: &'a State) -> Observation<'a> {
        Observation(Scene::new(level, state))
    }

    /// What the agent sees from cell `agent` when it has been on the cells of `visited`; as in [`Scene`].
    pub fn packed(level: &'a Level, agent: u16, visited: &'a [u64]) -> Observation<'a> {
        Observation(Scene { level, agent, visited })
    }

    /// As [`Sensor::inputs`].
    pub fn len(level: &Level) -> usize {
        Full.inputs(level)
    }

    /// As [`Sensor::write`].
    pub fn write(&self, out: &mut [f32]) {
        Full.write(self.0, out);
    }

    /// As [`Sensor::constant_inputs`].
    pub fn constant_inputs(level: &Level) -> Vec<u16> {
        Full.constant_inputs(level)
    }

    /// As [`Sensor::push_active`].
    pub fn push_active(&self, out: &mut Vec<u16>) {
        Full.push_active(self.0, out);
    }
}
