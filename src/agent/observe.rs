//! From environments to the batches that engines take.

use bit_mlp::BitBatch;
use coverage_env::{Level, Observation, VecEnv};
use rand::Rng;

/// An empty batch for observations of `level`, with what all of them share.
pub(super) fn observations(level: &Level) -> BitBatch {
    let mut batch = BitBatch::default();
    batch.set_constant(&Observation::constant_inputs(level));
    batch
}

/// Writes the current observations of all environments into `batch`, `[N]` samples.
pub(super) fn observe<R: Rng>(envs: &VecEnv<R>, batch: &mut BitBatch) {
    batch.clear();
    for state in envs.states() {
        batch.push_with(|rows| Observation::new(envs.level(), state).push_active(rows));
    }
}
