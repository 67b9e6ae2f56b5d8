//! What a state is: where an episode stands, and which states there can be.

use serde::{Deserialize, Serialize};

use crate::cell_set::CellSet;
use crate::level::{Cell, Level};

/// Everything that changes during an episode.
#[derive(Clone, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub struct State {
    /// The cell that the agent is on.
    pub agent: u16,
    /// The cells that it has been on, the start included.
    pub visited: CellSet,
    /// How many targets it has not visited yet.
    pub remaining: u32,
    /// How many steps it has made.
    pub steps: u32,
}

/// A cell where no episode can start.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum StartError {
    /// The cell is not on the map.
    #[error("start cell {start} lies outside the map of {cells} cells (0 to {})", .cells - 1)]
    Outside {
        /// The cell asked for.
        start: usize,
        /// The number of cells on the map.
        cells: usize,
    },
    /// The cell is a wall.
    #[error("start cell {start} is a wall; start on a free cell")]
    Wall {
        /// The cell asked for.
        start: usize,
    },
    /// The cell is a target.
    #[error("start cell {start} is a target; start on a free cell")]
    Target {
        /// The cell asked for.
        start: usize,
    },
}

/// A state that no episode on this level can be in, as read from a damaged or foreign file.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("not a state of the level: {0}")]
pub struct StateError(&'static str);

impl StateError {
    pub(crate) const COUNT: StateError = StateError("the numbers of states and of random generators differ");
    pub(crate) const OVER: StateError = StateError("its episode is over");
}

impl State {
    /// The state at the beginning of an episode.
    ///
    /// # Errors
    /// [`StartError`] if `start` is a wall, a target, or outside the map.
    pub fn at_start(level: &Level, start: usize) -> Result<State, StartError> {
        match level.cells().get(start) {
            None => Err(StartError::Outside { start, cells: level.len() }),
            Some(Cell::Wall) => Err(StartError::Wall { start }),
            Some(Cell::Target) => Err(StartError::Target { start }),
            Some(Cell::Free) => {
                let visited = CellSet::new(level.len());
                let mut state = State { agent: 0, visited, remaining: 0, steps: 0 };
                state.restart(level, start);
                Ok(state)
            }
        }
    }

    /// Begins a new episode in place. `start` must be a start of `level`, and the state one of it.
    #[inline]
    pub(crate) fn restart(&mut self, level: &Level, start: usize) {
        debug_assert!(level.is_start(start));
        self.agent = start as u16;
        self.visited.clear();
        self.visited.insert(start);
        self.remaining = level.targets().len() as u32;
        self.steps = 0;
    }

    /// Checks that this can be a state of an episode on `level` of at most `max_steps` steps.
    ///
    /// # Errors
    /// [`StateError`] says which rule is broken.
    pub fn check(&self, level: &Level, max_steps: u32) -> Result<(), StateError> {
        let agent = usize::from(self.agent);
        let words = self.visited.words();
        let (open, targets) = (level.open_cells().words(), level.target_cells().words());
        let outside = |(word, open): (&u64, &u64)| word & !open != 0;
        let free = |(word, target): (&u64, &u64)| word & !target != 0;
        let unvisited = |(word, target): (&u64, &u64)| (target & !word).count_ones();
        let rules = [
            (agent < level.len(), "the agent is outside the map"),
            (words.len() == open.len(), "its visited cells belong to a map of another size"),
            (!words.iter().zip(open).any(outside), "a visited cell is a wall or outside the map"),
            (
                words.get(agent / 64).is_some_and(|word| word >> (agent % 64) & 1 == 1),
                "the agent's own cell is not visited",
            ),
            (words.iter().zip(targets).any(free), "no cell is visited that it can have started on"),
            (
                words.iter().zip(targets).map(unvisited).sum::<u32>() == self.remaining,
                "the number of remaining targets contradicts the visited cells",
            ),
            (self.steps <= max_steps, "it has more steps than the step limit allows"),
            (
                self.visited.count() as u64 <= u64::from(self.steps) + 1,
                "it has visited more cells than its steps allow",
            ),
        ];
        match rules.into_iter().find(|(holds, _)| !holds) {
            Some((_, broken)) => Err(StateError(broken)),
            None => Ok(()),
        }
    }
}
