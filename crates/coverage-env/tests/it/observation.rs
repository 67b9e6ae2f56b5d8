//! The array against its definition, on maps that are not square.

use std::sync::Arc;

use coverage_env::level::{Cell, MAX_CELLS};
use coverage_env::{CoverageEnv, Level, MAX_STEPS, Observation};
use proptest::prelude::*;

use crate::support::{actions, levels_with_start};

/// The definition, element by element.
fn defined(level: &Level, env: &CoverageEnv) -> Vec<f32> {
    let mut array = Vec::new();
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

fn check(env: &CoverageEnv) -> Result<(), TestCaseError> {
    let level = env.level();
    let expected = defined(level, env);
    let mut written = vec![f32::NAN; Observation::len(level)];
    let observation = Observation::new(level, env.state());
    observation.write(&mut written);
    prop_assert_eq!(&written, &expected);

    let mut active = Vec::new();
    observation.push_active(&mut active);
    prop_assert!(active.is_sorted());
    let constant = Observation::constant_inputs(level);
    prop_assert!(constant.is_sorted());
    let mut ones = [active, constant].concat();
    ones.sort_unstable();
    let expected: Vec<u16> =
        (0..=u16::MAX).zip(&expected).filter(|&(_, &value)| value == 1.0).map(|(input, _)| input).collect();
    prop_assert_eq!(ones, expected);
    Ok(())
}

proptest! {
    #[test]
    fn is_as_defined((level, start) in levels_with_start(6), actions in actions(0..60)) {
        let mut env = CoverageEnv::new(Arc::clone(&level), MAX_STEPS);
        env.reset_at(start)?;
        for action in actions {
            env.step(action);
        }
        check(&env)?;
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
        check(&env).unwrap();
    }
}
