//! The paper's greedy baseline.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use super::{PlanError, Planner};
use crate::action::Action;
use crate::level::Level;
use crate::state::State;

/// The paper's "gold standard": it goes to the unvisited target that is nearest in Manhattan distance,
/// along a shortest path, and repeats this until none is left.
///
/// Paths are found by A* with the Manhattan heuristic over the four neighbours. Targets crossed on
/// the way count as visited. Among equally near targets the first in row-major order is taken (the
/// paper's own order is that of a Python set). Neither choice is always best; see
/// [`Optimal`](super::Optimal).
#[derive(Clone, Copy, Debug, Default)]
pub struct AStar;

impl Planner for AStar {
    fn name(&self) -> &'static str {
        "astar"
    }

    fn plan(&mut self, level: &Level, start: usize, max_steps: u32) -> Result<Vec<Action>, PlanError> {
        let mut state = State::at_start(level, start)?;
        let mut actions = Vec::new();
        while let Some(target) = nearest_target(level, &state) {
            for action in shortest_path(level, usize::from(state.agent), target) {
                actions.push(action);
                if state.advance(level, max_steps, action).is_done() {
                    return Ok(actions);
                }
            }
        }
        Ok(actions)
    }
}

/// The unvisited target nearest to the agent; the first such in row-major order.
fn nearest_target(level: &Level, state: &State) -> Option<usize> {
    let unvisited = level.targets().iter().copied().filter(|&cell| !state.visited.contains(cell));
    unvisited.min_by_key(|&target| manhattan(level, usize::from(state.agent), target))
}

fn manhattan(level: &Level, from: usize, to: usize) -> usize {
    let ((row, column), (to_row, to_column)) = (level.position(from), level.position(to));
    row.abs_diff(to_row) + column.abs_diff(to_column)
}

/// The actions of a shortest path, by A*; empty if there is none.
///
/// Among paths of equal estimate, the one that has come closest to `goal` is followed first, then
/// the one at the lowest cell: the result depends on the map alone.
fn shortest_path(level: &Level, from: usize, goal: usize) -> Vec<Action> {
    /// How a cell was reached at its least cost so far.
    #[derive(Clone, Copy)]
    struct Arrival {
        cost: usize,
        /// The cell before and the action taken there.
        via: Option<(usize, Action)>,
    }
    let mut arrivals: Vec<Option<Arrival>> = vec![None; level.len()];
    arrivals[from] = Some(Arrival { cost: 0, via: None });
    let estimate = manhattan(level, from, goal);
    let mut open = BinaryHeap::from([Reverse((estimate, estimate, from))]);
    while let Some(Reverse((total, estimate, cell))) = open.pop() {
        if cell == goal {
            break;
        }
        let cost = total - estimate + 1;
        for action in Action::ALL {
            let next = level.neighbor(cell, action);
            // The heuristic is consistent, so a cell's first expansion is at its least cost, and
            // only cheaper arrivals are worth another look. A barred way leads back to `cell`.
            if arrivals[next].is_none_or(|arrival| cost < arrival.cost) {
                arrivals[next] = Some(Arrival { cost, via: Some((cell, action)) });
                let estimate = manhattan(level, next, goal);
                open.push(Reverse((cost + estimate, estimate, next)));
            }
        }
    }
    let step_to = |cell: usize| arrivals[cell].and_then(|arrival| arrival.via);
    let mut path: Vec<Action> =
        std::iter::successors(step_to(goal), |&(before, _)| step_to(before)).map(|(_, action)| action).collect();
    path.reverse();
    path
}
