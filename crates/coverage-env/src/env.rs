//! The rules, stated once: what a step does and earns, and when an episode ends; and [`CoverageEnv`], which plays by
//! them.
//!
//! The paper is "Reinforcement Learning and Loss of Plasticity Phenomenon in Coverage Path Planning Environments: An
//! Exploratory Study".

use std::sync::Arc;

use rand::Rng;

use crate::action::Action;
use crate::cell_set::CellSet;
use crate::level::Level;
use crate::random;
use crate::state::{StartError, State, StateError};

/// The paper's step limit of an episode.
pub const MAX_STEPS: u32 = 200;

/// The reward of a step that visits no new target.
pub const STEP_REWARD: i32 = -1;
/// The reward of a step to a target not visited before, in place of [`STEP_REWARD`].
pub const TARGET_REWARD: i32 = 2;
/// What the step to the last target earns beyond [`TARGET_REWARD`].
pub const COMPLETION_REWARD: i32 = 30;

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

/// What a step did, as far as it is paid.
#[derive(Clone, Copy)]
enum Gain {
    /// It visited no new target.
    Nothing,
    /// It visited a new target, and others are left.
    Target,
    /// It visited the last target.
    LastTarget,
}

/// What a step earns. All returns are sums of this.
#[inline]
const fn reward(gain: Gain) -> i32 {
    match gain {
        Gain::Nothing => STEP_REWARD,
        Gain::Target => TARGET_REWARD,
        Gain::LastTarget => TARGET_REWARD + COMPLETION_REWARD,
    }
}

/// The return of `steps` steps of which `visited` went to new targets, the last one if `solved`.
pub(crate) fn episode_return(steps: u32, visited: u32, solved: bool) -> i64 {
    let (steps, visited, last) = (i64::from(steps), i64::from(visited), i64::from(solved));
    let counts = [(Gain::Nothing, steps - visited), (Gain::Target, visited - last), (Gain::LastTarget, last)];
    counts.into_iter().map(|(gain, count)| i64::from(reward(gain)) * count).sum()
}

/// The lowest return of an episode of at most `max_steps` steps: all of them, and no target.
pub fn worst_return(max_steps: u32) -> i64 {
    const { assert!(STEP_REWARD < 0 && TARGET_REWARD >= STEP_REWARD && COMPLETION_REWARD >= 0) };
    episode_return(step_limit(max_steps), 0, false)
}

/// An episode has at least one step: a `max_steps` of 0 means 1.
#[inline]
pub(crate) fn step_limit(max_steps: u32) -> u32 {
    max_steps.max(1)
}

/// The rules: when an episode ends, and what a step does.
impl State {
    /// Whether every target is visited: the episode is *terminated*.
    #[inline]
    pub fn is_solved(&self) -> bool {
        self.remaining == 0
    }

    /// Whether the step limit is reached: the episode is *truncated*, unless it is terminated.
    #[inline]
    pub fn is_at_limit(&self, max_steps: u32) -> bool {
        self.steps >= step_limit(max_steps)
    }

    /// Whether the episode is over, for either reason.
    #[inline]
    pub fn is_over(&self, max_steps: u32) -> bool {
        self.is_solved() || self.is_at_limit(max_steps)
    }

    /// Moves the agent and says what that brought.
    ///
    /// The state must be one of `level`. After the end of an episode the same rules go on:
    /// −1 per step, the flags staying set.
    #[inline]
    pub(crate) fn advance(&mut self, level: &Level, max_steps: u32, action: Action) -> Step {
        let cell = level.neighbor(usize::from(self.agent), action);
        let is_new = self.visited.insert(cell);
        self.agent = cell as u16;
        self.steps = self.steps.saturating_add(1);

        let mut gain = Gain::Nothing;
        if is_new && level.is_target(cell) {
            self.remaining -= 1;
            gain = if self.is_solved() { Gain::LastTarget } else { Gain::Target };
        }
        Step { reward: reward(gain) as f32, terminated: self.is_solved(), truncated: self.is_at_limit(max_steps) }
    }

    /// The sum of the rewards since the start, up to and including the end of the episode.
    ///
    /// No one has to keep count: an episode's steps and targets tell it.
    pub fn return_so_far(&self, level: &Level) -> i64 {
        let visited = level.targets().len() as u32 - self.remaining;
        episode_return(self.steps, visited, self.is_solved())
    }
}

/// The environment: an agent on a level, which must visit every target.
///
/// - **Actions**: [`Action`]. A move into a wall or off the map leaves the agent where it is, and
///   is a step like any other.
/// - **Start**: uniform over the level's [starts](Level::starts), and visited from the outset.
/// - **Reward** of a step: −1; +2 instead on the first visit of a target; +30 more on the last.
/// - **End**: *terminated* when every target is visited, *truncated* at `max_steps`; see [`Step`].
///
/// What an agent sees of it is a [sensor](crate::sensor)'s matter.
///
/// From the paper and its published environment.
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

/// A start of `level`, uniformly.
#[inline]
pub(crate) fn draw_start(level: &Level, rng: &mut (impl Rng + ?Sized)) -> usize {
    level.starts()[random::below(rng, level.starts().len() as u32) as usize]
}
