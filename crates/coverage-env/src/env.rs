//! The rules: [`State`], [`CoverageEnv`], rewards and ends of episodes.

use std::sync::Arc;

use rand::Rng;
use serde::{Deserialize, Serialize};

use crate::action::Action;
use crate::cell_set::CellSet;
use crate::level::{Cell, Level};
use crate::observation::Observation;
use crate::random;

/// The study's step limit of an episode.
pub const MAX_STEPS: u32 = 200;

/// The reward of a step that visits no new target.
pub const STEP_REWARD: i32 = -1;
/// The reward of a step to a target not visited before, in place of [`STEP_REWARD`].
pub const TARGET_REWARD: i32 = 2;
/// What the step to the last target earns beyond [`TARGET_REWARD`].
pub const COMPLETION_REWARD: i32 = 30;

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

/// What one step brought.
///
/// Both ends may hold at once, when the last target is visited on the last allowed step. The episode
/// is then *terminated*: learners must look at `terminated` first and not bootstrap.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Step {
    /// [`STEP_REWARD`], [`TARGET_REWARD`], or [`TARGET_REWARD`] + [`COMPLETION_REWARD`].
    pub reward: f32,
    /// Every target is visited: the episode is solved.
    pub terminated: bool,
    /// The step limit is reached.
    pub truncated: bool,
}

impl Step {
    /// Whether the episode is over, for either reason.
    pub fn is_done(self) -> bool {
        self.terminated || self.truncated
    }
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

    /// Moves the agent and says what that brought: the rules of the environment.
    ///
    /// The state must be one of `level`. After the end of an episode the same rules go on:
    /// −1 per step, the flags staying set.
    #[inline]
    pub(crate) fn advance(&mut self, level: &Level, max_steps: u32, action: Action) -> Step {
        let cell = level.neighbor(usize::from(self.agent), action);
        let is_new = self.visited.insert(cell);
        self.agent = cell as u16;
        self.steps = self.steps.saturating_add(1);

        let mut reward = STEP_REWARD;
        if is_new && level.is_target(cell) {
            self.remaining -= 1;
            reward = TARGET_REWARD;
            if self.remaining == 0 {
                reward += COMPLETION_REWARD;
            }
        }
        Step { reward: reward as f32, terminated: self.remaining == 0, truncated: self.steps >= max_steps }
    }

    /// The sum of the rewards since the start, up to and including the end of the episode.
    ///
    /// No one has to keep count: an episode's steps and targets tell it.
    pub fn return_so_far(&self, level: &Level) -> i64 {
        let visited = level.targets().len() as u32 - self.remaining;
        episode_return(self.steps, visited, self.remaining == 0)
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

/// The environment: an agent on a level, which must visit every target.
///
/// - **Actions**: [`Action`]. A move into a wall or off the map leaves the agent where it is, and
///   is a step like any other.
/// - **Start**: uniform over the level's [starts](Level::starts), and visited from the outset.
/// - **Reward** of a step: −1; +2 instead on the first visit of a target; +30 more on the last.
/// - **End**: *terminated* when every target is visited, *truncated* at `max_steps`; see [`Step`].
/// - **Observation**: `[4, H, W]`, see [`Observation`].
///
/// From the study and its published environment.
#[derive(Clone, Debug)]
pub struct CoverageEnv {
    level: Arc<Level>,
    max_steps: u32,
    state: State,
}

impl CoverageEnv {
    /// An environment at the level's first start; [`reset`](CoverageEnv::reset) draws one.
    ///
    /// An episode has at least one step: a `max_steps` of 0 means 1.
    pub fn new(level: Arc<Level>, max_steps: u32) -> CoverageEnv {
        let mut state = State { agent: 0, visited: CellSet::new(level.len()), remaining: 0, steps: 0 };
        // A validated level has a start.
        state.restart(&level, level.starts()[0]);
        CoverageEnv { level, max_steps, state }
    }

    /// The level.
    pub fn level(&self) -> &Arc<Level> {
        &self.level
    }

    /// The step limit of an episode.
    pub fn max_steps(&self) -> u32 {
        self.max_steps
    }

    /// Where the episode stands.
    pub fn state(&self) -> &State {
        &self.state
    }

    /// What the agent sees.
    pub fn observation(&self) -> Observation<'_> {
        Observation::new(&self.level, &self.state)
    }

    /// Puts the episode where it stood before, from a state that need not be trusted.
    ///
    /// # Errors
    /// [`StateError`], and nothing changes, if the state [cannot be](State::check) one of this
    /// level and step limit.
    pub fn set_state(&mut self, state: State) -> Result<(), StateError> {
        state.check(&self.level, self.max_steps)?;
        self.state = state;
        Ok(())
    }

    /// Begins an episode at a start drawn uniformly, with one [`random::below`].
    pub fn reset(&mut self, rng: &mut (impl Rng + ?Sized)) {
        self.state.restart(&self.level, draw_start(&self.level, rng));
    }

    /// Begins an episode at `start`.
    ///
    /// # Errors
    /// [`StartError`], and nothing changes, if no episode can start there.
    pub fn reset_at(&mut self, start: usize) -> Result<(), StartError> {
        self.state = State::at_start(&self.level, start)?;
        Ok(())
    }

    /// Makes one step; O(1), without allocating.
    ///
    /// An episode that is over should be reset first. Stepping on is harmless: −1 per step, with
    /// the flags staying set.
    #[inline]
    pub fn step(&mut self, action: Action) -> Step {
        self.state.advance(&self.level, self.max_steps, action)
    }
}

/// The return of `steps` steps of which `visited` went to new targets, the last one if `solved`.
pub(crate) fn episode_return(steps: u32, visited: u32, solved: bool) -> i64 {
    let (steps, visited) = (i64::from(steps), i64::from(visited));
    let completion = if solved { COMPLETION_REWARD } else { 0 };
    i64::from(STEP_REWARD) * (steps - visited) + i64::from(TARGET_REWARD) * visited + i64::from(completion)
}

/// A start of `level`, uniformly.
#[inline]
pub(crate) fn draw_start(level: &Level, rng: &mut (impl Rng + ?Sized)) -> usize {
    level.starts()[random::below(rng, level.starts().len() as u32) as usize]
}
