//! Sensors: the laws that all keep, and the full map against its definition, on maps that are not square.

use std::collections::HashSet;
use std::sync::Arc;

use coverage_env::level::{Cell, MAX_CELLS};
use coverage_env::sensor::{SENSORS, by_name};
use coverage_env::{Action, CoverageEnv, Level, MAX_STEPS, Scene, Sensor};
use proptest::prelude::*;

use crate::support::{actions, levels_with_start};

/// What a sensor sees, densely; its constant and active inputs must be the same array.
fn seen(sensor: &dyn Sensor, env: &CoverageEnv) -> Vec<f32> {
    let (level, scene) = (env.level(), Scene::new(env.level(), env.state()));
    let mut written = vec![f32::NAN; sensor.inputs(level)];
    sensor.write(scene, &mut written);

    let mut active = vec![7];
    sensor.push_active(scene, &mut active);
    assert_eq!(active.remove(0), 7, "{} overwrites what was there", sensor.name());
    let constant = sensor.constant_inputs(level);
    assert!(active.is_sorted_by(|a, b| a < b) && constant.is_sorted_by(|a, b| a < b), "{}", sensor.name());
    let mut ones = [active, constant].concat();
    ones.sort_unstable();
    let expected = written.iter().enumerate().filter(|&(_, &value)| value == 1.0).map(|(input, _)| input as u16);
    assert_eq!(ones, expected.collect::<Vec<_>>(), "{}", sensor.name());
    assert!(written.iter().all(|&value| value == 0.0 || value == 1.0), "{}", sensor.name());
    written
}

/// The definition of the full map, element by element.
fn full(env: &CoverageEnv) -> Vec<f32> {
    let (level, mut array) = (env.level(), Vec::new());
    for channel in 0..4 {
        for row in 0..level.height() {
            for column in 0..level.width() {
                let cell = level.index(row, column).expect("on the map");
                let set = match channel {
                    0 => level.cell(cell) != Cell::Wall,
                    1 => usize::from(env.state().agent) == cell,
                    2 => level.cell(cell) == Cell::Target,
                    _ => env.state().visited.contains(cell),
                };
                array.push(f32::from(u8::from(set)));
            }
        }
    }
    array
}

fn check_full(env: &CoverageEnv) {
    assert_eq!(seen(by_name("full").expect("a sensor"), env), full(env));
}

proptest! {
    #[test]
    fn all_keep_the_laws_and_full_is_as_defined((level, start) in levels_with_start(6), actions in actions(0..60)) {
        let mut env = CoverageEnv::new(Arc::clone(&level), MAX_STEPS);
        env.reset_at(start)?;
        for action in actions {
            env.step(action);
        }
        for sensor in SENSORS {
            seen(*sensor, &env);
        }
        check_full(&env);
    }
}

/// The last input of the largest map is the last `u16`.
#[test]
fn the_largest_maps_fit() {
    for width in [128, MAX_CELLS] {
        let mut map: Vec<char> = vec!['.'; MAX_CELLS];
        map[MAX_CELLS - 2] = 'T';
        let rows: Vec<String> = map.chunks(width).map(|row| row.iter().collect()).collect();
        let level = Arc::new(Level::from_map("large", &rows.join("\n")).unwrap());
        let mut env = CoverageEnv::new(level, MAX_STEPS);
        env.reset_at(MAX_CELLS - 1).unwrap();
        for sensor in SENSORS {
            seen(*sensor, &env);
        }
        check_full(&env);
    }
}

/// Around the agent, in a corner, at a wall and after some steps: each array written down by hand.
#[test]
fn local_sees_the_cells_around_the_agent() {
    let mut env = CoverageEnv::new(Arc::new(Level::from_map("small", "..#.\nT.T.\n....").unwrap()), MAX_STEPS);
    env.reset_at(0).unwrap();
    let mut sees = |actions: &[Action], map: [&str; 4]| {
        actions.iter().for_each(|&action| {
            env.step(action);
        });
        let map = map.concat().into_bytes().into_iter().map(|digit| f32::from(digit - b'0'));
        assert_eq!(seen(by_name("local").expect("a sensor"), &env), map.collect::<Vec<_>>());
    };
    // No walls, the agent, targets, visited cells; of each the row above the agent, its own and the one below.
    sees(&[], ["000011011", "000010000", "000000010", "000010000"]);
    sees(&[Action::Right], ["000110111", "000010000", "000000101", "000110000"]);
    sees(&[Action::Down, Action::Right], ["101111111", "000010000", "000010000", "100110000"]);
    sees(&[Action::Down, Action::Right], ["110110000", "000010000", "100000000", "100110000"]);
}

#[test]
fn names_tell_them_apart() {
    let names: HashSet<_> = SENSORS.iter().map(|sensor| sensor.name()).collect();
    assert_eq!(names.len(), SENSORS.len());
    assert_eq!(SENSORS[0].name(), "full");
    for sensor in SENSORS {
        assert_eq!(by_name(sensor.name()).map(Sensor::name), Some(sensor.name()));
    }
    assert!(by_name("none of them").is_none());
}
