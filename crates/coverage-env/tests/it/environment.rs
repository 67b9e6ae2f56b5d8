//! The rules, against a model written from their text: characters, rows and columns.

use std::collections::HashSet;
use std::sync::Arc;

use chacha20::ChaCha8Rng;
use chacha20::rand_core::SeedableRng;
use coverage_env::sensor::SENSORS;
use coverage_env::{Action, CoverageEnv, Level, MAX_STEPS, Scene, StartError, State, Step, worst_return};
use proptest::prelude::*;

use crate::support::{actions, builtin, levels_with_start};

/// The rules of the environment in the plainest form.
struct Model {
    map: Vec<Vec<char>>,
    agent: (usize, usize),
    visited: HashSet<(usize, usize)>,
    steps: u32,
}

impl Model {
    fn new(level: &Level, start: usize) -> Model {
        let map = level.to_map().lines().map(|row| row.chars().collect()).collect();
        let agent = level.position(start);
        Model { map, agent, visited: HashSet::from([agent]), steps: 0 }
    }

    fn targets_left(&self) -> usize {
        let cells = (0..self.map.len()).flat_map(|row| (0..self.map[0].len()).map(move |column| (row, column)));
        cells.filter(|&(row, column)| self.map[row][column] == 'T' && !self.visited.contains(&(row, column))).count()
    }

    fn step(&mut self, action: u8, max_steps: u32) -> Step {
        let (row, column) = self.agent;
        let ahead = match action {
            0 => (row + 1, column),
            1 => (row.wrapping_sub(1), column),
            2 => (row, column + 1),
            _ => (row, column.wrapping_sub(1)),
        };
        let on_map = self.map.get(ahead.0).and_then(|row| row.get(ahead.1));
        let mut reward = -1.0;
        if on_map.is_some_and(|&cell| cell != '#') {
            self.agent = ahead;
            let is_new = self.visited.insert(ahead);
            if is_new && on_map == Some(&'T') {
                reward = if self.targets_left() == 0 { 32.0 } else { 2.0 };
            }
        }
        self.steps += 1;
        Step { reward, terminated: self.targets_left() == 0, truncated: self.steps >= max_steps }
    }
}

proptest! {
    #[test]
    fn follows_the_model(
        (level, start) in levels_with_start(6),
        actions in actions(0..120),
        max_steps in 1..100u32,
    ) {
        let mut env = CoverageEnv::new(Arc::clone(&level), max_steps);
        env.reset_at(start)?;
        let mut model = Model::new(&level, start);
        let mut rewards = 0.0;
        for action in actions {
            let step = env.step(action);
            prop_assert_eq!(step, model.step(action as u8, max_steps));
            rewards += f64::from(step.reward);

            let state = env.state();
            let visited: HashSet<_> = state.visited.iter().map(|cell| level.position(cell)).collect();
            prop_assert_eq!(level.position(state.agent.into()), model.agent);
            prop_assert_eq!(&visited, &model.visited);
            prop_assert_eq!(state.remaining as usize, model.targets_left());
            prop_assert_eq!(state.steps, model.steps);
            prop_assert_eq!(state.return_so_far(&level) as f64, rewards);
            prop_assert_eq!(state.check(&level, max_steps), Ok(()));
            if step.is_done() {
                break;
            }
        }
    }

    #[test]
    fn a_saved_state_goes_on_as_the_original(
        (level, start) in levels_with_start(6),
        (before, after) in (actions(0..30), actions(1..30)),
    ) {
        let mut env = CoverageEnv::new(Arc::clone(&level), MAX_STEPS);
        env.reset_at(start)?;
        before.iter().for_each(|&action| {
            env.step(action);
        });
        let saved = serde_json::to_string(env.state())?;
        let mut resumed = CoverageEnv::new(level, MAX_STEPS);
        resumed.set_state(serde_json::from_str(&saved)?)?;
        for action in after {
            prop_assert_eq!(resumed.step(action), env.step(action));
            prop_assert_eq!(resumed.state(), env.state());
        }
    }

    /// Whatever a file says, a state that is let in can be stepped and observed.
    #[test]
    fn no_state_from_a_file_is_harmful(
        (level, _) in levels_with_start(3),
        agent in 0..80u16,
        words in prop::collection::vec(prop_oneof![0..8u64, any::<u64>()], 0..3),
        (remaining, steps) in (0..4u32, 0..250u32),
        actions in actions(20),
    ) {
        let state = State { agent, visited: words.into(), remaining, steps };
        let mut env = CoverageEnv::new(Arc::clone(&level), MAX_STEPS);
        if env.set_state(state).is_ok() {
            for sensor in SENSORS {
                sensor.write(Scene::new(&level, env.state()), &mut vec![0.0; sensor.inputs(&level)]);
            }
            actions.into_iter().for_each(|action| {
                env.step(action);
            });
        }
    }
}

/// One corridor, each number written down by hand.
#[test]
fn rewards_of_a_corridor() {
    let level = Arc::new(Level::from_map("corridor", ".TT#.").unwrap_err().to_string());
    assert!(level.contains("row 1, column 5"), "{level}");

    let level = Arc::new(Level::from_map("corridor", ".TT").unwrap());
    let mut env = CoverageEnv::new(level, 4);
    let mut step = |action| {
        let Step { reward, terminated, truncated } = env.step(action);
        (reward, terminated, truncated)
    };
    assert_eq!(step(Action::Left), (-1.0, false, false));
    assert_eq!(step(Action::Right), (2.0, false, false));
    assert_eq!(step(Action::Up), (-1.0, false, false));
    // The last target on the last allowed step: both, and learners take it as terminated.
    assert_eq!(step(Action::Right), (32.0, true, true));
    // Stepping on is harmless.
    assert_eq!(step(Action::Left), (-1.0, true, true));
    assert_eq!(env.state().return_so_far(env.level()), 31);
}

/// What normalised returns count from: the return of an agent that never finds a target.
#[test]
fn the_worst_return_is_that_of_standing_still() {
    for max_steps in [0, 1, 7, MAX_STEPS] {
        let mut env = CoverageEnv::new(builtin("0"), max_steps);
        env.reset_at(0).unwrap();
        while !env.step(Action::Up).is_done() {}
        assert_eq!(env.state().return_so_far(env.level()), worst_return(max_steps));
    }
    assert_eq!(worst_return(MAX_STEPS), -200);
}

#[test]
fn episodes_start_only_on_free_cells() {
    let level = Arc::new(Level::from_map("small", "..#\n.T.").unwrap());
    let mut env = CoverageEnv::new(Arc::clone(&level), MAX_STEPS);
    assert_eq!(env.reset_at(2), Err(StartError::Wall { start: 2 }));
    assert_eq!(env.reset_at(4), Err(StartError::Target { start: 4 }));
    assert_eq!(env.reset_at(6), Err(StartError::Outside { start: 6, cells: 6 }));
    assert_eq!(env.reset_at(6).unwrap_err().to_string(), "start cell 6 lies outside the map of 6 cells (0 to 5)");
    assert_eq!(env.reset_at(5), Ok(()));
}

#[test]
fn states_that_cannot_be_are_refused() {
    let level = Arc::new(Level::from_map("small", "..#\n.TT").unwrap());
    let mut env = CoverageEnv::new(Arc::clone(&level), MAX_STEPS);
    let good = State { agent: 4, visited: vec![0b010010].into(), remaining: 1, steps: 3 };
    assert_eq!(env.set_state(good.clone()), Ok(()));
    let mut refused = |change: &dyn Fn(&mut State)| {
        let mut state = good.clone();
        change(&mut state);
        let error = env.set_state(state).unwrap_err().to_string();
        assert_eq!(env.state(), &good);
        error.strip_prefix("not a state of the level: ").unwrap().to_owned()
    };
    assert_eq!(refused(&|state| state.agent = 6), "the agent is outside the map");
    assert_eq!(
        refused(&|state| state.visited = vec![0b010010, 0].into()),
        "its visited cells belong to a map of another size"
    );
    for bits in [0b010110, 0b1010010] {
        assert_eq!(refused(&|state| state.visited = vec![bits].into()), "a visited cell is a wall or outside the map");
    }
    assert_eq!(refused(&|state| state.agent = 3), "the agent's own cell is not visited");
    assert_eq!(
        refused(&|state| state.visited = vec![0b010000].into()),
        "no cell is visited that it can have started on"
    );
    assert_eq!(refused(&|state| state.remaining = 2), "the number of remaining targets contradicts the visited cells");
    assert_eq!(refused(&|state| state.steps = 201), "it has more steps than the step limit allows");
    assert_eq!(refused(&|state| state.steps = 0), "it has visited more cells than its steps allow");
}

#[test]
fn starts_are_uniform() {
    let level = builtin("4");
    let mut env = CoverageEnv::new(Arc::clone(&level), MAX_STEPS);
    let mut rng = ChaCha8Rng::seed_from_u64(0);
    let mut counts = vec![0u32; level.len()];
    let episodes = 41_000;
    for _ in 0..episodes {
        env.reset(&mut rng);
        counts[usize::from(env.state().agent)] += 1;
    }
    assert_eq!(level.starts().len(), 41);
    // Six standard deviations of a binomial(41 000, 1/41) are 188.
    assert!(level.starts().iter().all(|&start| counts[start].abs_diff(1000) < 188), "{counts:?}");
    assert_eq!(level.starts().iter().map(|&start| counts[start]).sum::<u32>(), episodes);
}
