//! From environments to the batches that engines take.

use bit_mlp::BitBatch;
use coverage_env::{Level, Scene, Sensor, VecEnv};
use rand::Rng;

/// An empty batch for what `sensor` sees on `level`, with what all its observations share.
pub(crate) fn observations(sensor: &dyn Sensor, level: &Level) -> BitBatch {
    let mut batch = BitBatch::default();
    batch.set_constant(&sensor.constant_inputs(level));
    batch
}

/// Writes the current observations of all environments into `batch`, `[N]` samples.
pub(super) fn observe<R: Rng>(sensor: &dyn Sensor, envs: &VecEnv<R>, batch: &mut BitBatch) {
    batch.clear();
    for state in envs.states() {
        batch.push_with(|rows| sensor.push_active(Scene::new(envs.level(), state), rows));
    }
}
