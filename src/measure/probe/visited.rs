//! The states that an agent visits while it behaves as it does in training.

use std::sync::Arc;

use bit_mlp::BitBatch;
use coverage_env::{Action, CoverageEnv, Level, Scene, Sensor};

use crate::agent::{Behaviour, observations};
use crate::random::Stream;

/// Runs of the agent for one batch, each from the beginning of an episode.
const RUNS: usize = 32;
/// States of each run.
const STATES_EACH: usize = 8;
/// Timesteps between two states of one run, at most: beyond 1,024 timesteps in all a run would cost too much.
const MAX_STRIDE: usize = 128;

/// 256 states of `level` that an agent visits, as `sensor` sees them.
///
/// The agent acts in 32 runs of about one step limit each, and every run gives 8 states at equal distances, here `d`
/// timesteps. Run i begins with timestep i modulo d, so that all phases of an episode are met alike. `act` gives the
/// outputs by which the agent chooses in a state with these active inputs.
pub(super) fn visited_batch(
    sensor: &dyn Sensor,
    level: &Arc<Level>,
    max_steps: u32,
    behaviour: Behaviour,
    mut act: impl FnMut(&[u16]) -> [f32; Action::COUNT],
    stream: &mut Stream,
) -> BitBatch {
    let stride = (max_steps as usize).div_ceil(STATES_EACH).clamp(1, MAX_STRIDE);
    let mut batch = observations(sensor, level);
    let mut env = CoverageEnv::new(level.clone(), max_steps);
    let mut active = Vec::new();
    for run in 0..RUNS {
        env.reset(stream);
        for timestep in 0..STATES_EACH * stride {
            active.clear();
            sensor.push_active(Scene::new(env.level(), env.state()), &mut active);
            if timestep % stride == run % stride {
                batch.push_sample(&active);
            }
            if env.step(behaviour.choose(&act(&active), stream)).is_done() {
                env.reset(stream);
            }
        }
    }
    batch
}

#[cfg(test)]
mod tests {
    use coverage_env::sensor::Full;

    use super::*;
    use crate::random::Purpose;

    /// The states of an agent that always says this, and of one that says the opposite.
    fn states(behaviour: Behaviour, outputs: [f32; 4], timesteps: u32, max_steps: u32) -> Vec<Vec<u16>> {
        let level = Arc::new(Level::builtin("3").expect("built in"));
        let mut stream = Stream::new(5, 1, Purpose::VisitedStates { timesteps });
        let batch = visited_batch(&Full, &level, max_steps, behaviour, |_| outputs, &mut stream);
        batch.all().samples().map(<[u16]>::to_vec).collect()
    }

    #[test]
    fn there_are_as_many_whatever_the_step_limit() {
        for max_steps in [1, 10, 50, 200, 5000] {
            assert_eq!(states(Behaviour::Sampled, [0.0; 4], 0, max_steps).len(), 256, "{max_steps}");
        }
    }

    #[test]
    fn they_depend_on_the_stream_and_the_agent_alone() {
        let of = |timesteps, outputs| states(Behaviour::Sampled, outputs, timesteps, 200);
        let first = of(64, [0.0; 4]);
        assert_eq!(first, of(64, [0.0; 4]));
        assert!(first != of(128, [0.0; 4]) && first != of(64, [1.0, 0.0, 0.0, 0.0]));
    }

    #[test]
    fn an_agent_visits_what_it_chooses() {
        // Always downwards: it is soon at a wall and has seen no more than a column.
        let cells = |states: &[Vec<u16>]| states.iter().map(|active| active.len() - 1).max().unwrap_or_default();
        let down = [1.0, 0.0, 0.0, 0.0];
        let greedy = states(Behaviour::EpsilonGreedy(0.0), down, 0, 200);
        let random = states(Behaviour::EpsilonGreedy(1.0), down, 0, 200);
        assert!(cells(&greedy) <= 8 && cells(&random) > 16, "{} and {} cells", cells(&greedy), cells(&random));
    }
}
