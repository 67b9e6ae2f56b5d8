//! The cells around the agent.

use super::{Scene, Sensor};
use crate::level::{Cell, Level};

/// Channels, which mean what those of the [full map](super::Full) mean.
const CHANNELS: usize = 4;
/// Rows and columns: one cell on each side of the agent.
const SIDE: usize = 3;
/// The number of cells seen.
const CELLS: usize = SIDE * SIDE;
/// The agent's own place among them.
const CENTRE: usize = CELLS / 2;

/// The 3 × 3 cells around the agent, `[4, 3, 3]`, the agent in the middle. What lies off the map is a wall.
#[derive(Clone, Copy, Debug)]
pub struct Local;

impl Sensor for Local {
    fn name(&self) -> &'static str {
        "local"
    }

    fn shape(&self, _: usize, _: usize) -> [usize; 3] {
        [CHANNELS, SIDE, SIDE]
    }

    /// The agent's own cell is never a wall, and always visited.
    fn constant_inputs(&self, _: &Level) -> Vec<u16> {
        [0, 1, 3].map(|channel| (channel * CELLS + CENTRE) as u16).to_vec()
    }

    fn push_active(&self, scene: Scene<'_>, out: &mut Vec<u16>) {
        let (row, column) = scene.level.position(usize::from(scene.agent));
        let cells: [Option<usize>; CELLS] = std::array::from_fn(|place| {
            let (row, column) = ((row + place / SIDE).checked_sub(1)?, (column + place % SIDE).checked_sub(1)?);
            scene.level.index(row, column)
        });
        let mut push = |channel: usize, is_set: &dyn Fn(usize) -> bool| {
            let set = cells.iter().enumerate().filter(|(_, cell)| cell.is_some_and(is_set));
            out.extend(set.map(|(place, _)| (channel * CELLS + place) as u16));
        };
        let agent = usize::from(scene.agent);
        push(0, &|cell| cell != agent && scene.level.cell(cell) != Cell::Wall);
        push(2, &|cell| scene.level.is_target(cell));
        push(3, &|cell| cell != agent && scene.visited[cell / 64] >> (cell % 64) & 1 == 1);
    }
}
