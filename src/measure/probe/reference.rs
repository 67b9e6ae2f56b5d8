//! The reference batch: the states on which a network is measured.

use std::sync::Arc;

use bit_mlp::BitBatch;
use coverage_env::random::below;
use coverage_env::{Action, CoverageEnv, Level, Scene, Sensor};

use crate::agent::observations;
use crate::random::{Purpose, Stream};

/// N, the states of a batch.
pub const NUM_STATES: usize = 512;
/// Timesteps from one state of a batch to the next. Neighbours are nearly the same state; and having no divisor in
/// common with the usual step limit, it meets every phase of an episode.
const STRIDE: usize = 23;

/// States of `level` that a uniformly random policy visits, every 23rd timestep over many episodes, as `sensor` sees them.
///
/// They depend on the map and the step limit alone, not on a seed, an arm or a curriculum, so that runs are measured on
/// the same states wherever they meet the level.
pub fn reference_batch(sensor: &dyn Sensor, level: &Arc<Level>, max_steps: u32) -> BitBatch {
    let mut batch = observations(sensor, level);
    let mut stream = Stream::new(0, 0, Purpose::ReferenceStates);
    let mut env = CoverageEnv::new(level.clone(), max_steps);
    env.reset(&mut stream);
    while batch.len() < NUM_STATES {
        batch.push_with(|active| sensor.push_active(Scene::new(env.level(), env.state()), active));
        for _ in 0..STRIDE {
            if env.step(Action::ALL[below(&mut stream, Action::COUNT as u32) as usize]).is_done() {
                env.reset(&mut stream);
            }
        }
    }
    batch
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use coverage_env::sensor::Full;

    use super::*;

    #[test]
    fn a_batch_depends_on_the_map_and_the_step_limit_alone() {
        let level = |name: &str, id| {
            let map = Level::builtin(id).expect("built in").to_map();
            Arc::new(Level::from_map(name, &map).expect("a valid map"))
        };
        let samples = |level: &Arc<Level>, max_steps| {
            let batch = reference_batch(&Full, level, max_steps);
            batch.all().samples().map(<[u16]>::to_vec).collect::<Vec<_>>()
        };
        let first = samples(&level("one", "0"), 200);
        assert_eq!(first, samples(&level("another", "0"), 200));
        assert!(first != samples(&level("one", "0"), 100) && first != samples(&level("one", "1"), 200));
    }

    #[test]
    fn a_batch_covers_the_level_and_the_phases_of_an_episode() {
        let level = Arc::new(Level::builtin("3").expect("built in"));
        let batch = reference_batch(&Full, &level, 200);
        assert_eq!(batch.len(), NUM_STATES);
        let states: BTreeSet<&[u16]> = batch.all().samples().collect();
        assert!(states.len() > NUM_STATES * 9 / 10, "only {} different states", states.len());
        let agents: BTreeSet<u16> = batch.all().samples().map(|active| active[0]).collect();
        let open = level.to_map().chars().filter(|&cell| cell == '.' || cell == 'T').count();
        assert!(agents.len() > open * 3 / 4, "the agent is in {} of {open} cells", agents.len());
        // The agent, and the cells it has visited: few at the beginning of an episode, half of the map at its end.
        let visited = |active: &[u16]| active.len() - 1;
        let [least, most] = [Iterator::min, Iterator::max].map(|of: fn(_) -> _| of(batch.all().samples().map(visited)));
        assert!(least < Some(4) && most > Some(25), "{least:?} to {most:?} cells visited");
    }
}
