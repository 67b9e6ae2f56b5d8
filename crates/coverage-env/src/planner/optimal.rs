//! The best return from every start cell, proved.

mod tours;

use super::{PlanError, Planner};
use crate::action::Action;
use crate::cell_set::CellSet;
use crate::env::{COMPLETION_REWARD, STEP_REWARD, TARGET_REWARD, episode_return, step_limit};
use crate::level::{Cell, Level};
use crate::state::State;
use tours::Tours;

/// The most targets for which [`Optimal`] plans.
///
/// Its table has 2ⁿ · n entries of two bytes for n targets: 2 MiB for 16, 40 MiB for 20 and 176 MiB
/// for 22, which take about a second to fill. Each further target would double both.
pub const MAX_TARGETS: usize = 22;

/// What the method below takes for granted about the rules: every step costs, and no target does.
const _: () = assert!(STEP_REWARD < 0 && TARGET_REWARD > STEP_REWARD && COMPLETION_REWARD >= 0);

/// The best return there is, from every start cell, with the actions that earn it.
///
/// # Method
/// Within the step limit, a solved episode earns more the fewer steps it has, and more than any that
/// is not solved. So the best is a shortest walk through all targets. Between targets such a walk
/// follows shortest paths, whose lengths come from a breadth-first search from each target; the
/// order of the targets comes from dynamic programming over their subsets (Held and Karp, "A Dynamic
/// Programming Approach to Sequencing Problems", 1962). Paths that happen to cross further targets
/// do no harm: distances obey the triangle inequality, so a target is never gained by detour.
///
/// Where the shortest such walk exceeds the limit, every episode lasts as long as the limit, and the
/// best visits as many targets as can be visited in that time. The same table tells how many.
///
/// The table serves every start of a level and is kept until another level comes.
///
/// # Limits
/// More targets than [`MAX_TARGETS`] are refused with [`PlanError::TooManyTargets`]: it never
/// answers with anything but an optimum. The size of the map hardly matters.
#[derive(Clone, Debug, Default)]
pub struct Optimal {
    solution: Option<Solution>,
}

/// The best that an episode from some start can bring.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Optimum {
    /// Its return.
    pub return_: i64,
    /// The number of its steps.
    pub length: u32,
    /// How many targets it visits.
    pub visited: u32,
    /// Whether these are all targets.
    pub solved: bool,
}

impl Optimal {
    /// A planner that has not seen a level yet.
    pub fn new() -> Optimal {
        Optimal::default()
    }

    /// The best that an episode on `level` from `start` can bring under a limit of `max_steps`.
    ///
    /// # Errors
    /// [`PlanError`] if no episode can start there, or for more than [`MAX_TARGETS`] targets.
    pub fn optimum(&mut self, level: &Level, start: usize, max_steps: u32) -> Result<Optimum, PlanError> {
        State::at_start(level, start)?;
        let solution = self.solution(level)?;
        let limit = step_limit(max_steps);
        let walk = solution.best_walk(start, limit);
        let visited = walk.map_or(0, |walk| walk.targets) as u32;
        let (solved, length) = match walk {
            Some(walk) if walk.targets == level.targets().len() => (true, walk.length),
            _ => (false, limit),
        };
        let return_ = episode_return(length, visited, solved);
        Ok(Optimum { return_, length, visited, solved })
    }

    /// The solution of `level`, kept from the last call or else computed.
    fn solution(&mut self, level: &Level) -> Result<&Solution, PlanError> {
        let targets = level.targets().len();
        if targets > MAX_TARGETS {
            return Err(PlanError::TooManyTargets { targets });
        }
        let kept = self.solution.take().filter(|solution| solution.is_of(level));
        Ok(self.solution.insert(kept.unwrap_or_else(|| Solution::new(level))))
    }
}

impl Planner for Optimal {
    fn name(&self) -> &'static str {
        "optimal"
    }

    fn plan(&mut self, level: &Level, start: usize, max_steps: u32) -> Result<Vec<Action>, PlanError> {
        let optimum = self.optimum(level, start, max_steps)?;
        let mut actions = self.solution(level)?.walk(level, start, step_limit(max_steps));
        // What cannot be solved lasts as long as the limit. No further target is within reach, so
        // any action will do.
        actions.resize(optimum.length as usize, Action::Down);
        Ok(actions)
    }
}

/// What is known about one level, for all starts and limits.
#[derive(Clone, Debug)]
struct Solution {
    width: usize,
    cells: Box<[Cell]>,
    /// Steps from each target to each cell, `[n][H * W]`; [`UNREACHABLE`] for walls.
    distances: Vec<Vec<u16>>,
    tours: Tours,
}

/// A walk from a start to some targets: how many, which one first, and its steps.
#[derive(Clone, Copy, Debug)]
struct Walk {
    targets: usize,
    first: usize,
    length: u32,
}

/// The distance of cells that cannot be reached; paths are shorter than the largest map.
const UNREACHABLE: u16 = u16::MAX;

impl Solution {
    fn new(level: &Level) -> Solution {
        let targets = level.targets();
        let distances: Vec<Vec<u16>> = targets.iter().map(|&target| distances_from(level, target)).collect();
        let legs: Vec<u16> =
            distances.iter().flat_map(|distances| targets.iter().map(|&target| distances[target])).collect();
        let tours = Tours::new(targets.len(), legs);
        Solution { width: level.width(), cells: level.cells().into(), distances, tours }
    }

    fn is_of(&self, level: &Level) -> bool {
        self.width == level.width() && *self.cells == *level.cells()
    }

    /// The shortest walk from `start` to as many targets as `limit` steps allow.
    fn best_walk(&self, start: usize, limit: u32) -> Option<Walk> {
        let count = self.distances.len();
        (1..=count).rev().find_map(|targets| {
            let walks = (0..count).map(|first| {
                let approach = u32::from(self.distances[first][start]);
                let length = approach + u32::from(self.tours.shortest(targets, first).length);
                Walk { targets, first, length }
            });
            walks.min_by_key(|walk| walk.length).filter(|walk| walk.length <= limit)
        })
    }

    /// The actions of [`best_walk`](Solution::best_walk).
    fn walk(&self, level: &Level, start: usize, limit: u32) -> Vec<Action> {
        let Some(walk) = self.best_walk(start, limit) else {
            return Vec::new();
        };
        let mut actions = Vec::with_capacity(walk.length as usize);
        let mut cell = start;
        for target in self.tours.order(walk.targets, walk.first) {
            let distances = &self.distances[target];
            let closer = |cell: usize| {
                let nearer = |&action: &Action| distances[level.neighbor(cell, action)] < distances[cell];
                Action::ALL.into_iter().find(nearer)
            };
            while let Some(action) = closer(cell) {
                actions.push(action);
                cell = level.neighbor(cell, action);
            }
        }
        actions
    }
}

/// Steps from `source` to every cell, by breadth-first search. Moves can be undone, so they are
/// also the steps from every cell to `source`.
fn distances_from(level: &Level, source: usize) -> Vec<u16> {
    let mut distances = vec![UNREACHABLE; level.len()];
    distances[source] = 0;
    let mut seen = CellSet::new(level.len());
    seen.insert(source);
    let mut frontier = std::collections::VecDeque::from([source]);
    while let Some(cell) = frontier.pop_front() {
        for action in Action::ALL {
            let next = level.neighbor(cell, action);
            if seen.insert(next) {
                distances[next] = distances[cell] + 1;
                frontier.push_back(next);
            }
        }
    }
    distances
}
