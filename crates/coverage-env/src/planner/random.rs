//! Uniform actions.

use rand::Rng;

use super::{PlanError, Planner};
use crate::action::Action;
use crate::level::Level;
use crate::random::below;
use crate::state::State;

/// Uniform actions until the episode's end, one [`below`] each: what knowing nothing earns.
///
/// Plans follow each other in the generator's stream, so a plan depends on those made before it.
#[derive(Clone, Debug)]
pub struct Random<R> {
    rng: R,
}

impl<R: Rng> Random<R> {
    /// A planner that draws from `rng`.
    pub fn new(rng: R) -> Random<R> {
        Random { rng }
    }
}

impl<R: Rng> Planner for Random<R> {
    fn name(&self) -> &'static str {
        "random"
    }

    fn plan(&mut self, level: &Level, start: usize, max_steps: u32) -> Result<Vec<Action>, PlanError> {
        let mut state = State::at_start(level, start)?;
        let mut actions = Vec::new();
        loop {
            let action = Action::ALL[below(&mut self.rng, Action::COUNT as u32) as usize];
            actions.push(action);
            if state.advance(level, max_steps, action).is_done() {
                return Ok(actions);
            }
        }
    }
}
