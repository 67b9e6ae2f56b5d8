//! Many environments on one level, stepped together.

use std::sync::Arc;

use rand::Rng;

use crate::action::Action;
use crate::env::{Step, draw_start, step_limit};
use crate::level::Level;
use crate::state::{State, StateError};

/// The end of an episode.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct EpisodeEnd {
    /// The sum of the episode's rewards; exact, since rewards are whole numbers.
    pub return_: i64,
    /// The number of its steps.
    pub length: u32,
}

/// What one step of one environment brought.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct VecStep {
    /// As in [`Step`].
    pub reward: f32,
    /// As in [`Step`].
    pub terminated: bool,
    /// As in [`Step`]; look at `terminated` first, both may hold.
    pub truncated: bool,
    /// The episode that this step ended, if it did.
    pub episode: Option<EpisodeEnd>,
}

/// Environments on one level, stepped together, each with random numbers of its own for its starts.
///
/// An environment whose episode ends is reset within the same step:
/// [`states`](VecEnv::states) already holds the next episode's first state, and
/// [`final_states`](VecEnv::final_states) the last one's, from which truncated episodes bootstrap.
#[derive(Clone, Debug)]
pub struct VecEnv<R> {
    level: Arc<Level>,
    max_steps: u32,
    states: Vec<State>,
    final_states: Vec<State>,
    rngs: Vec<R>,
    steps: Vec<VecStep>,
}

impl<R: Rng> VecEnv<R> {
    /// One environment for each generator, each reset with its own. A `max_steps` of 0 means 1.
    pub fn new(level: Arc<Level>, max_steps: u32, mut rngs: Vec<R>) -> VecEnv<R> {
        let mut env = crate::CoverageEnv::new(Arc::clone(&level), max_steps);
        let states = (rngs.iter_mut())
            .map(|rng| {
                env.reset(rng);
                env.state().clone()
            })
            .collect();
        VecEnv::assemble(level, step_limit(max_steps), states, rngs)
    }

    /// Environments that go on where others stood, given their [`states`](VecEnv::states) and
    /// [`rngs`](VecEnv::rngs): the two are all there is to save.
    ///
    /// # Errors
    /// [`StateError`] if there are not as many states as generators, or if a state
    /// [cannot be](State::check) one of a running episode.
    pub fn restore(
        level: Arc<Level>,
        max_steps: u32,
        states: Vec<State>,
        rngs: Vec<R>,
    ) -> Result<VecEnv<R>, StateError> {
        let max_steps = step_limit(max_steps);
        if states.len() != rngs.len() {
            return Err(StateError::COUNT);
        }
        for state in &states {
            state.check(&level, max_steps)?;
            // An episode that is over would have been reset.
            if state.is_over(max_steps) {
                return Err(StateError::OVER);
            }
        }
        Ok(VecEnv::assemble(level, max_steps, states, rngs))
    }

    fn assemble(level: Arc<Level>, max_steps: u32, states: Vec<State>, rngs: Vec<R>) -> VecEnv<R> {
        let final_states = states.clone();
        let steps = Vec::with_capacity(states.len());
        VecEnv { level, max_steps, states, final_states, rngs, steps }
    }

    /// How many environments there are.
    pub fn len(&self) -> usize {
        self.states.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.states.is_empty()
    }

    /// The level.
    pub fn level(&self) -> &Arc<Level> {
        &self.level
    }

    /// The step limit of an episode.
    pub fn max_steps(&self) -> u32 {
        self.max_steps
    }

    /// Where each running episode stands.
    pub fn states(&self) -> &[State] {
        &self.states
    }

    /// The generators, as they stand after the resets so far.
    pub fn rngs(&self) -> &[R] {
        &self.rngs
    }

    /// What the last [`step`](VecEnv::step) brought, per environment; empty before the first.
    pub fn steps(&self) -> &[VecStep] {
        &self.steps
    }

    /// Where each environment's last episode ended; meaningful where the last step ended one.
    pub fn final_states(&self) -> &[State] {
        &self.final_states
    }

    /// Makes one step in every environment; returns what each brought.
    ///
    /// O(1) per environment, without allocating.
    ///
    /// # Panics
    /// If there are not as many actions as environments.
    pub fn step(&mut self, actions: &[Action]) -> &[VecStep] {
        assert_eq!(actions.len(), self.len(), "one action for each environment");
        self.steps.clear();
        for (index, &action) in actions.iter().enumerate() {
            let state = &mut self.states[index];
            let step = state.advance(&self.level, self.max_steps, action);
            let mut episode = None;
            if step.is_done() {
                let return_ = state.return_so_far(&self.level);
                episode = Some(EpisodeEnd { return_, length: state.steps });
                // The old final state's memory serves the new episode.
                std::mem::swap(state, &mut self.final_states[index]);
                state.restart(&self.level, draw_start(&self.level, &mut self.rngs[index]));
            }
            let Step { reward, terminated, truncated } = step;
            self.steps.push(VecStep { reward, terminated, truncated, episode });
        }
        &self.steps
    }
}
