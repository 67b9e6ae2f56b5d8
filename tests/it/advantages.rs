//! Generalised advantage estimation and the ends of episodes.

use std::sync::Arc;

use coverage_env::sensor::Full;
use coverage_env::{Action, Level, Scene, Sensor, VecEnv};
use cpp_rl::agent::ppo::Rollout;
use cpp_rl::random::{Purpose, Stream};

use crate::fixtures::{self, Tensors};
use crate::numbers::assert_close;

/// From the upper start, Down and Right reach the target.
const CORRIDOR: &str = ".#\n.T";

#[test]
fn as_stable_baselines3_estimates() {
    let (tensors, json) = (Tensors::read("gae"), fixtures::json("gae"));
    let (terminated, truncated) = (tensors.flags("terminated"), tensors.flags("truncated"));
    let bootstraps: Vec<usize> = (0..64).filter(|&i| truncated[i] && !terminated[i]).collect();
    let terminal_values = tensors.floats("terminal_values");
    let mut rollout = Rollout::new(2, &Full, &Level::builtin("0").expect("built in"));
    rollout.rewards = tensors.floats("rewards");
    rollout.dones = terminated.iter().zip(&truncated).map(|(a, b)| *a || *b).collect();
    rollout.truncated = bootstraps.clone();
    let mut beyond = tensors.floats("last_values");
    beyond.extend(bootstraps.iter().map(|&i| terminal_values[i]));
    let number = |key: &str| json[key].as_f64().expect("a number");
    rollout.estimate(&[], tensors.floats("values"), &beyond, number("gamma"), number("gae_lambda"));

    assert!(bootstraps.len() > 1 && truncated.iter().zip(&terminated).any(|(a, b)| *a && *b));
    // One multiplication and addition per reward; then sums over up to 32 timesteps.
    assert_close("rewards", &rollout.rewards, &tensors.floats("bootstrapped_rewards"), 1e-6);
    assert_close("advantages", &rollout.advantages, &tensors.floats("advantages"), 1e-5);
    assert_close("returns", &rollout.returns, &tensors.floats("returns"), 1e-5);
}

#[test]
fn by_hand() {
    // Two environments, three timesteps; the first ends its episode at timestep 1, truncated there; the second never.
    let mut rollout = Rollout::new(2, &Full, &Level::builtin("0").expect("built in"));
    rollout.actions = vec![0, 1, 2, 3, 0, 1];
    rollout.rewards = vec![1.0, 10.0, 2.0, 20.0, 3.0, 30.0];
    rollout.dones = vec![false, false, true, false, false, false];
    rollout.truncated = vec![2];
    let values = vec![4.0, 1.0, 6.0, 2.0, 8.0, 3.0];
    // V after the last timestep of both, then V of the final observation.
    rollout.estimate(&[0.0; 24], values, &[16.0, 4.0, 32.0], 0.5, 0.5);
    // First: δ₂ = 3 + 8 − 8 = 3; δ₁ = (2 + 16) − 6 = 12; δ₀ = 1 + 3 − 4 = 0; A₀ = 0 + ¼·12.
    // Second: δ₂ = 30 + 2 − 3 = 29; δ₁ = 20 + 1.5 − 2 = 19.5; δ₀ = 10 + 1 − 1 = 10.
    assert_eq!(rollout.rewards, [1.0, 10.0, 18.0, 20.0, 3.0, 30.0]);
    assert_eq!(rollout.advantages, [3.0, 10.0 + 0.25 * 26.75, 12.0, 26.75, 3.0, 29.0]);
    assert_eq!(rollout.returns, [7.0, 11.0 + 0.25 * 26.75, 18.0, 28.75, 11.0, 32.0]);
    assert_eq!(rollout.log_probs, [0.25_f32.ln(); 6]);
}

#[test]
fn an_episode_that_terminates_at_the_limit_is_not_bootstrapped() {
    let rollout = collect(2, &[Action::Down, Action::Right]);
    assert_eq!((rollout.dones.as_slice(), rollout.truncated.as_slice()), (&[false, true][..], &[][..]));
    assert_eq!(rollout.rewards, [-1.0, 32.0]);
    assert_eq!(rollout.beyond.len(), 1, "only what follows the last step");
}

#[test]
fn an_episode_that_is_cut_off_is_bootstrapped_from_its_last_observation() {
    let mut rollout = collect(2, &[Action::Down, Action::Left]);
    assert_eq!((rollout.dones.as_slice(), rollout.truncated.as_slice()), (&[false, true][..], &[1][..]));
    assert_eq!(rollout.beyond.len(), 2);
    // Inputs: channel 1 (the agent) from 4, channel 3 (visited) from 12. The next episode's first observation, then
    // the last one of this episode.
    assert!([[4, 12].as_slice(), &[6, 14]].contains(&rollout.beyond.sample(0)));
    assert_eq!(rollout.beyond.sample(1), [6, 12, 14]);
    rollout.estimate(&[0.0; 8], vec![0.0; 2], &[100.0, 8.0], 0.5, 1.0);
    assert_eq!(rollout.rewards, [-1.0, 3.0]);
    assert_eq!(rollout.advantages, [0.5, 3.0]);
}

/// A rollout of these actions from the upper left of [`CORRIDOR`].
fn collect(max_steps: u32, actions: &[Action]) -> Rollout {
    let level = Arc::new(Level::from_map("corridor", CORRIDOR).expect("a valid map"));
    let starts_above = |seed: &u64| {
        let stream = Stream::new(*seed, 0, Purpose::Environment(0));
        VecEnv::new(level.clone(), max_steps, vec![stream]).states()[0].agent == 0
    };
    let seed = (0..).find(starts_above).expect("one of two starts");
    let mut envs = VecEnv::new(level.clone(), max_steps, vec![Stream::new(seed, 0, Purpose::Environment(0))]);
    let mut rollout = Rollout::new(1, &Full, &level);
    for action in actions {
        let mut current = rollout.inputs.clone();
        current.clear();
        current.push_with(|rows| Full.push_active(Scene::new(&level, &envs.states()[0]), rows));
        rollout.push_observations(&current, &[*action]);
        envs.step(&[*action]);
        rollout.push_steps(&envs);
    }
    rollout.finish(&envs);
    rollout
}
