//! Environments together behave as each alone.

use std::sync::Arc;

use chacha20::ChaCha8Rng;
use chacha20::rand_core::SeedableRng;
use coverage_env::{CoverageEnv, EpisodeEnd, MAX_STEPS, State, VecEnv};
use proptest::prelude::*;

use crate::support::{actions, builtin, levels};

fn rngs(count: u64) -> Vec<ChaCha8Rng> {
    (0..count).map(ChaCha8Rng::seed_from_u64).collect()
}

proptest! {
    #[test]
    fn equals_single_environments(
        level in levels(3),
        max_steps in 1..40u32,
        rounds in prop::collection::vec(actions(3), 0..120),
    ) {
        let mut together = VecEnv::new(Arc::clone(&level), max_steps, rngs(3));
        let mut alone: Vec<_> = rngs(3)
            .into_iter()
            .map(|mut rng| {
                let mut env = CoverageEnv::new(Arc::clone(&level), max_steps);
                env.reset(&mut rng);
                (env, rng, 0.0)
            })
            .collect();
        for actions in rounds {
            let steps = together.step(&actions).to_vec();
            for (index, (env, rng, rewards)) in alone.iter_mut().enumerate() {
                let step = env.step(actions[index]);
                *rewards += f64::from(step.reward);
                prop_assert_eq!(steps[index].reward, step.reward);
                prop_assert_eq!(steps[index].terminated, step.terminated);
                prop_assert_eq!(steps[index].truncated, step.truncated);
                if step.is_done() {
                    let end = EpisodeEnd { return_: *rewards as i64, length: env.state().steps };
                    prop_assert_eq!(steps[index].episode, Some(end));
                    prop_assert_eq!(&together.final_states()[index], env.state());
                    env.reset(rng);
                    *rewards = 0.0;
                } else {
                    prop_assert_eq!(steps[index].episode, None);
                }
                prop_assert_eq!(&together.states()[index], env.state());
            }
        }
    }

    #[test]
    fn goes_on_after_being_restored(
        level in levels(3),
        before in prop::collection::vec(actions(2), 0..60),
        after in prop::collection::vec(actions(2), 1..60),
    ) {
        let mut original = VecEnv::new(Arc::clone(&level), 20, rngs(2));
        for actions in before {
            original.step(&actions);
        }
        let states = serde_json::to_string(original.states())?;
        let rngs = original.rngs().iter().map(|rng| ChaCha8Rng::deserialize_state(&rng.serialize_state()));
        let mut restored =
            VecEnv::restore(level, 20, serde_json::from_str(&states)?, rngs.collect())?;
        for actions in after {
            prop_assert_eq!(original.step(&actions), restored.step(&actions));
            prop_assert_eq!(original.states(), restored.states());
        }
    }
}

#[test]
fn refuses_states_that_are_not_of_running_episodes() {
    let level = builtin("1");
    let fresh = State::at_start(&level, 0).unwrap();
    let restore = |states: Vec<State>| {
        VecEnv::restore(Arc::clone(&level), MAX_STEPS, states, rngs(1)).map(|_| ()).map_err(|error| error.to_string())
    };
    assert_eq!(restore(vec![fresh.clone()]), Ok(()));
    let mut over = fresh.clone();
    over.steps = MAX_STEPS;
    assert_eq!(restore(vec![over]), Err("not a state of the level: its episode is over".into()));
    assert!(restore(vec![fresh.clone(), fresh]).is_err());
    let elsewhere = State::at_start(&builtin("0"), 27).unwrap();
    assert!(restore(vec![elsewhere]).is_err());
}
