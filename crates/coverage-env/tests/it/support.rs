//! Random levels, and what several tests share.

use std::sync::Arc;

use coverage_env::{Action, Level};
use proptest::prelude::*;
use proptest::sample::Index;

/// Maps of 1 to 7 rows and 1 to 9 columns, seldom square, with 1 to `most_targets` targets.
///
/// Walls are scattered, and then whatever the largest open region does not hold is walled in: the
/// shape is as random as a valid level's can be, and owes nothing to the crate's own generator.
pub(crate) fn levels(most_targets: usize) -> impl Strategy<Value = Arc<Level>> {
    (1..=7usize, 1..=9usize, 0.0..0.6f64)
        .prop_flat_map(move |(height, width, density)| {
            let walls = prop::collection::vec(prop::bool::weighted(density), height * width);
            let targets = prop::collection::vec(any::<Index>(), 1..=most_targets);
            (Just(width), walls, targets)
        })
        .prop_filter_map("too little room", |(width, walls, targets)| {
            let mut region = largest_region(&walls, width);
            if region.len() < 2 {
                return None;
            }
            let mut map = vec!['#'; walls.len()];
            region.iter().for_each(|&cell| map[cell] = '.');
            for index in targets {
                if region.len() > 1 {
                    map[region.swap_remove(index.index(region.len()))] = 'T';
                }
            }
            let rows: Vec<String> = map.chunks(width).map(|row| row.iter().collect()).collect();
            Some(Arc::new(Level::from_map("random", &rows.join("\n")).expect("a valid map")))
        })
}

/// The cells of the largest connected open region.
fn largest_region(walls: &[bool], width: usize) -> Vec<usize> {
    let mut seen = walls.to_vec();
    let mut largest = Vec::new();
    for seed in 0..walls.len() {
        let mut region = Vec::new();
        let mut frontier = vec![seed];
        while let Some(cell) = frontier.pop() {
            if std::mem::replace(&mut seen[cell], true) {
                continue;
            }
            region.push(cell);
            let column = cell % width;
            frontier.extend((cell >= width).then(|| cell - width));
            frontier.extend((cell + width < walls.len()).then(|| cell + width));
            frontier.extend((column > 0).then(|| cell - 1));
            frontier.extend((column + 1 < width).then(|| cell + 1));
        }
        if region.len() > largest.len() {
            largest = region;
        }
    }
    largest
}

pub(crate) fn actions(count: impl Into<prop::collection::SizeRange>) -> impl Strategy<Value = Vec<Action>> {
    prop::collection::vec(prop::sample::select(Action::ALL.to_vec()), count)
}

/// A level and one of its starts.
pub(crate) fn levels_with_start(most_targets: usize) -> impl Strategy<Value = (Arc<Level>, usize)> {
    (levels(most_targets), any::<Index>()).prop_map(|(level, index)| {
        let start = level.starts()[index.index(level.starts().len())];
        (level, start)
    })
}

pub(crate) fn builtin(id: &str) -> Arc<Level> {
    Arc::new(Level::builtin(id).expect("a built-in level"))
}
