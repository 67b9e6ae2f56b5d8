//! DQN's replay buffer.

use std::sync::Arc;

use bit_mlp::BitBatch;
use coverage_env::sensor::{Full, SENSORS};
use coverage_env::{Action, Level, Scene, Sensor, State, VecEnv};
use cpp_rl::agent::dqn::{Past, Replay, ReplayState, Transitions};
use cpp_rl::random::{Purpose, Stream};

/// Not square; Right enters a target from each of the two starts.
const MAP: &str = ".T#\n#.T";

fn environments(map: &str, count: u32, max_steps: u32) -> VecEnv<Stream> {
    let level = Arc::new(Level::from_map("map", map).expect("a valid map"));
    VecEnv::new(level, max_steps, (0..count).map(|i| Stream::new(1, 0, Purpose::Environment(i))).collect())
}

/// Steps every environment and stores the transitions.
fn step(replay: &mut Replay, envs: &mut VecEnv<Stream>, action: Action) {
    let actions = vec![action; envs.len()];
    replay.begin(envs.states(), &actions);
    envs.step(&actions);
    replay.end(envs);
}

/// Many draws from the buffer.
fn draw(replay: &Replay, level: &Level, count: usize) -> Transitions {
    let mut drawn = Transitions::new(&Full, level);
    replay.sample(count, &mut Stream::new(2, 0, Purpose::Minibatches), &mut drawn);
    drawn
}

/// The inputs beyond the constant ones of a state of the level.
fn active(level: &Level, state: &State) -> Vec<u16> {
    let mut rows = Vec::new();
    Full.push_active(Scene::new(level, state), &mut rows);
    rows
}

#[test]
fn what_is_stored_comes_back() {
    let mut envs = environments(MAP, 1, 100);
    let level = envs.level().clone();
    let mut replay = Replay::new(10, &level);
    let before = active(&level, &envs.states()[0]);
    step(&mut replay, &mut envs, Action::Right);
    let drawn = draw(&replay, &level, 3);
    let after = active(&level, &envs.states()[0]);
    assert_ne!(before, after);
    let samples = |batch: &BitBatch| (0..batch.len()).map(|i| batch.sample(i).to_vec()).collect::<Vec<_>>();
    assert_eq!(samples(&drawn.inputs), vec![before; 3]);
    assert_eq!(samples(&drawn.next), vec![after; 3]);
    assert_eq!(drawn.inputs.constant(), Full.constant_inputs(&level));
    assert_eq!((drawn.actions, drawn.terminated), (vec![Action::Right as u8; 3], vec![false; 3]));
}

#[test]
fn the_oldest_is_overwritten_first() {
    let mut envs = environments(MAP, 2, 1000);
    let level = envs.level().clone();
    let mut replay = Replay::new(5, &level);
    assert!(replay.is_empty());
    // Two transitions a step; five fit. The last five are one of the second step's, and the third's and fourth's.
    let actions = [Action::Down, Action::Up, Action::Right, Action::Left];
    for (i, action) in actions.into_iter().enumerate() {
        step(&mut replay, &mut envs, action);
        assert_eq!(replay.len(), 5.min(2 * (i + 1)));
    }
    let drawn = draw(&replay, &level, 1000);
    let count = |action: Action| drawn.actions.iter().filter(|a| **a == action as u8).count();
    let counts = actions.map(count);
    assert_eq!(counts[0], 0, "the first step's are gone");
    // Expected 200, 400 and 400 of 1000; standard deviations are below 16.
    assert!(counts[1].abs_diff(200) < 65 && counts[2].abs_diff(400) < 80 && counts[3].abs_diff(400) < 80, "{counts:?}");
}

#[test]
fn draws_are_uniform_with_replacement() {
    let mut envs = environments(MAP, 1, 1000);
    let level = envs.level().clone();
    let mut replay = Replay::new(100, &level);
    Action::ALL.into_iter().for_each(|action| step(&mut replay, &mut envs, action));
    let drawn = draw(&replay, &level, 4000);
    for action in Action::ALL {
        let count = drawn.actions.iter().filter(|a| **a == action as u8).count();
        // Binomial with p = ¼: standard deviation 27.4.
        assert!(count.abs_diff(1000) < 140, "{action:?}: {count}");
    }
}

#[test]
fn an_episode_cut_off_is_not_terminal_and_keeps_its_last_observation() {
    let mut envs = environments(".TT", 1, 1);
    let level = envs.level().clone();
    let mut replay = Replay::new(4, &level);
    step(&mut replay, &mut envs, Action::Right);
    assert!(envs.steps()[0].truncated && !envs.steps()[0].terminated);
    let drawn = draw(&replay, &level, 1);
    assert_eq!((drawn.terminated[0], drawn.rewards[0]), (false, 2.0));
    // The agent on cell 1 (inputs from 3), cells 0 and 1 visited (inputs from 9): not the next episode's first.
    assert_eq!(drawn.next.sample(0), [4, 9, 10]);
    // It bootstraps: r + γ·max Q.
    assert_eq!(drawn.targets(&[1.0, 7.0, 3.0, 5.0], 0.5).collect::<Vec<_>>(), [2.0 + 0.5 * 7.0]);
}

#[test]
fn an_episode_that_terminates_at_the_limit_is_terminal() {
    let mut envs = environments(".T", 1, 1);
    let level = envs.level().clone();
    let mut replay = Replay::new(4, &level);
    step(&mut replay, &mut envs, Action::Right);
    assert!(envs.steps()[0].truncated && envs.steps()[0].terminated);
    let drawn = draw(&replay, &level, 1);
    assert_eq!((drawn.terminated[0], drawn.rewards[0]), (true, 32.0));
    assert_eq!(drawn.next.sample(0), [3, 6, 7]);
    assert_eq!(drawn.targets(&[1.0, 7.0, 3.0, 5.0], 0.5).collect::<Vec<_>>(), [32.0]);
}

#[test]
fn a_full_buffer_fits_into_16_megabytes() {
    let level = Arc::new(Level::builtin("0").expect("built in"));
    let bytes = Replay::new(100_000, &level).bytes();
    assert_eq!(bytes, 100_000 * (2 * 2 + 2 * 8 + 1 + 4 + 1));
    assert!(bytes <= 16_000_000);
}

/// Another level of the size of [`MAP`].
const OTHER: &str = "T..\n.#T";
const WALK: [Action; 7] =
    [Action::Right, Action::Down, Action::Left, Action::Up, Action::Right, Action::Right, Action::Down];

/// A buffer on `map` after a walk in which no transition is overwritten.
fn walked(map: &str, count: u32) -> Replay {
    let mut envs = environments(map, count, 5);
    let mut replay = Replay::new(50, &envs.level().clone());
    WALK.into_iter().for_each(|action| step(&mut replay, &mut envs, action));
    replay
}

/// All inputs of every sample, ascending, constant ones among them.
fn inputs(batch: &BitBatch) -> Vec<Vec<u16>> {
    let all = |i| {
        let mut all: Vec<u16> = batch.constant().iter().chain(batch.sample(i)).copied().collect();
        all.sort_unstable();
        all
    };
    (0..batch.len()).map(all).collect()
}

#[test]
fn a_transition_of_an_earlier_level_is_seen_as_on_its_own() {
    for &sensor in SENSORS {
        let (level, other) = (Level::from_map("a", MAP).expect("a map"), Level::from_map("b", OTHER).expect("a map"));
        let before = walked(MAP, 2);
        let state = ReplayState::beginning(before.past(sensor), 50, &other);
        let after = Replay::restore(50, &Arc::new(other.clone()), sensor, &state);
        let draw = |replay: &Replay, level: &Level| {
            let mut drawn = Transitions::new(sensor, level);
            replay.sample(500, &mut Stream::new(2, 0, Purpose::Minibatches), &mut drawn);
            drawn
        };
        let (expected, drawn) = (draw(&before, &level), draw(&after, &other));
        assert!(!expected.inputs.constant().is_empty() && drawn.inputs.constant().is_empty(), "{}", sensor.name());
        assert_eq!(inputs(&drawn.inputs), inputs(&expected.inputs), "{}", sensor.name());
        assert_eq!(inputs(&drawn.next), inputs(&expected.next), "{}", sensor.name());
        assert_eq!((drawn.actions, drawn.rewards), (expected.actions, expected.rewards));
        assert_eq!(drawn.terminated, expected.terminated);
        assert_eq!(after.past(sensor), before.past(sensor), "it goes on to a third level");
    }
}

/// One after the other.
fn joined(one: &Past, other: &Past) -> Past {
    let mut all = one.clone();
    for place in 0..2 * other.actions.len() {
        all.observed.push(&other.observed.inputs(place).collect::<Vec<u16>>());
    }
    all.actions.extend(&other.actions);
    all.rewards.extend(&other.rewards);
    all.terminated.extend(&other.terminated);
    all
}

#[test]
fn the_oldest_of_all_stages_are_overwritten_first() {
    for count in [1, 2] {
        let past = walked(MAP, count).past(&Full);
        let brought = past.actions.len();
        // Smaller than what is brought, as large, with some room, and with more room than is used.
        for capacity in [brought - 2, brought, brought + 3, 3 * brought] {
            let mut envs = environments(OTHER, count, 5);
            let level = envs.level().clone();
            let state = ReplayState::beginning(past.clone(), capacity, &level);
            let mut replay = Replay::restore(capacity, &level, &Full, &state);
            assert_eq!(replay.state(), state);
            let mut own = Replay::new(50, &level);
            for (i, action) in WALK.into_iter().enumerate() {
                let mut expected = joined(&past, &own.past(&Full));
                expected.keep_newest(capacity);
                assert_eq!(replay.past(&Full), expected, "{count} environments, {capacity} slots, after {i} steps");
                let left = (brought + own.len()).min(capacity) - own.len().min(capacity);
                assert_eq!(replay.state().carried.len(), left);

                let restored = Replay::restore(capacity, &level, &Full, &replay.state());
                assert_eq!(restored.state(), replay.state());
                let (drawn, again) = (draw(&replay, &level, 200), draw(&restored, &level, 200));
                assert_eq!(inputs(&drawn.inputs), inputs(&again.inputs));
                assert_eq!(drawn.inputs.constant(), again.inputs.constant());
                assert_eq!(drawn.inputs.constant().is_empty(), left > 0, "as soon as all are of one level");

                step(&mut replay, &mut envs, action);
                // The same transitions: a walk has no chance in it but the starts, which the seed says.
                own = replay_of_first(i + 1, count);
            }
        }
    }
}

/// A buffer on [`OTHER`] after the first steps of the walk.
fn replay_of_first(steps: usize, count: u32) -> Replay {
    let mut envs = environments(OTHER, count, 5);
    let mut replay = Replay::new(50, &envs.level().clone());
    WALK.into_iter().take(steps).for_each(|action| step(&mut replay, &mut envs, action));
    replay
}
