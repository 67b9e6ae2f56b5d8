//! Planners: from a level and a start cell to the actions of an episode.
//!
//! | planner | what |
//! |---|---|
//! | [`Random`] | uniform actions |
//! | [`AStar`] | the paper's "gold standard": greedily to the nearest target |
//! | [`Optimal`] | the best return there is, proved |

mod astar;
mod optimal;
mod random;

pub use astar::AStar;
pub use optimal::{MAX_TARGETS, Optimal, Optimum};
pub use random::Random;

use std::sync::Arc;

use crate::action::Action;
use crate::env::CoverageEnv;
use crate::level::Level;
use crate::state::StartError;

/// Plans whole episodes.
pub trait Planner {
    /// What the planner is called on the command line and in results.
    fn name(&self) -> &'static str;

    /// The actions of an episode on `level` from the cell `start`, under a limit of `max_steps`.
    ///
    /// They last to the episode's end: until it is solved, or else for `max_steps` actions.
    /// Actions beyond the end are allowed and mean nothing.
    ///
    /// # Errors
    /// [`PlanError`] if no episode can start there, or if the planner cannot serve the level.
    fn plan(&mut self, level: &Level, start: usize, max_steps: u32) -> Result<Vec<Action>, PlanError>;
}

/// Why there is no plan.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum PlanError {
    /// No episode can start on the cell.
    #[error(transparent)]
    Start(#[from] StartError),
    /// More targets than [`MAX_TARGETS`].
    #[error(
        "the level has {targets} targets and proved optima are limited to {MAX_TARGETS}, since memory and time \
         double with each; use the planner astar, or a level with fewer targets"
    )]
    TooManyTargets {
        /// How many targets the level has.
        targets: usize,
    },
}

/// An episode that was played.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct EpisodeResult {
    /// The cell it started on.
    pub start: usize,
    /// The sum of its rewards.
    pub return_: i64,
    /// The number of its steps.
    pub length: u32,
    /// Whether every target was visited.
    pub solved: bool,
}

/// Plays `actions` in the environment, from `start` to the episode's end; later actions are left.
///
/// Should the actions run out first, the result is that of the episode so far.
///
/// # Errors
/// [`StartError`] if no episode can start on `start`.
pub fn replay(
    level: &Arc<Level>,
    start: usize,
    max_steps: u32,
    actions: &[Action],
) -> Result<EpisodeResult, StartError> {
    let mut env = CoverageEnv::new(Arc::clone(level), max_steps);
    env.reset_at(start)?;
    for &action in actions {
        if env.step(action).is_done() {
            break;
        }
    }
    let state = env.state();
    Ok(EpisodeResult { start, return_: state.return_so_far(level), length: state.steps, solved: state.is_solved() })
}
