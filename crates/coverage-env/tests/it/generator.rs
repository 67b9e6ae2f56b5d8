//! Generated levels are as asked for, solvable, and always the same.

use coverage_env::generator::{LevelSpec, SpecError};
use coverage_env::level::MAX_CELLS;
use coverage_env::{Cell, Level};
use proptest::prelude::*;

fn walls(level: &Level) -> usize {
    level.cells().iter().filter(|&&cell| cell == Cell::Wall).count()
}

proptest! {
    #[test]
    fn levels_are_as_asked_for(
        (height, width) in (1..=12usize, 1..=12usize),
        wall_density in 0.0..1.0f64,
        num_targets in 1..=10usize,
        seed: u64,
    ) {
        let spec = LevelSpec { height, width, wall_density, num_targets, seed };
        let expected_walls = (wall_density * (height * width) as f64).round() as usize;
        match spec.generate() {
            Ok(level) => {
                prop_assert_eq!((level.height(), level.width()), (height, width));
                prop_assert_eq!((walls(&level), level.targets().len()), (expected_walls, num_targets));
                prop_assert_eq!(&level, &spec.generate()?);
                // Reading it back validates it: every start reaches every target.
                prop_assert_eq!(&level, &Level::from_map(level.name(), &level.to_map())?);
            }
            Err(error) => {
                let full = expected_walls + num_targets >= height * width;
                prop_assert!(full && matches!(error, SpecError::NoRoom { .. }), "{}", error);
            }
        }
    }

    #[test]
    fn any_specification_is_a_level_or_an_error(
        (height, width) in (any::<u8>(), any::<usize>()),
        wall_density: f64,
        num_targets: usize,
        seed: u64,
    ) {
        let height = height.into();
        let _ = LevelSpec { height, width, wall_density, num_targets, seed }.generate();
    }
}

/// Numbers in papers refer to generated levels by their specification.
#[test]
fn a_specification_means_one_level_for_ever() {
    let spec = LevelSpec { height: 5, width: 9, wall_density: 0.3, num_targets: 5, seed: 1 };
    let level = spec.generate().unwrap();
    assert_eq!(level.name(), "generated-5x9-w14-t5-s1");
    assert_eq!(level.to_map(), "T.#..##..\n#.T.#.T..\n.##.....T\n.......##\n####.#..T\n");
    assert_ne!(LevelSpec { seed: 2, ..spec }.generate().unwrap().to_map(), level.to_map());
}

#[test]
fn the_largest_levels_can_be_generated() {
    for wall_density in [0.0, 0.4] {
        let spec = LevelSpec { height: 64, width: 256, wall_density, num_targets: 20, seed: 0 };
        assert_eq!(spec.generate().unwrap().len(), MAX_CELLS);
    }
}

#[test]
fn impossible_specifications_are_refused_with_advice() {
    let spec = LevelSpec { height: 2, width: 3, wall_density: 0.5, num_targets: 2, seed: 0 };
    assert!(spec.generate().is_ok());
    let error = |spec: LevelSpec| spec.generate().unwrap_err().to_string();
    assert_eq!(
        error(LevelSpec { num_targets: 3, ..spec }),
        "3 walls and 3 targets leave no start cell on a map of 6 cells; \
         ask for fewer of them or for a larger map"
    );
    assert_eq!(error(LevelSpec { num_targets: 0, ..spec }), "no targets; ask for at least 1");
    for density in [-0.1, 1.0, f64::NAN] {
        assert!(error(LevelSpec { wall_density: density, ..spec }).contains("at least 0 and below 1"));
    }
    for (height, width) in [(0, 3), (usize::MAX, 2), (129, 128)] {
        assert!(error(LevelSpec { height, width, ..spec }).contains("at most 16384"));
    }
}
