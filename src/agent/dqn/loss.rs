//! DQN's loss (Mnih et al. 2015, Algorithm 1; smooth L1 as in Stable-Baselines3), with its derivative.

use coverage_env::Action;

use super::replay::Transitions;
use crate::agent::engine::{Column, Loss, Pass, Statement, Weights};

/// The name of the copy that is the target network.
pub(super) const TARGET: &str = "target";

/// The loss of one seed on a minibatch of transitions.
pub struct DqnLoss<'a> {
    /// γ.
    gamma: f32,
    transitions: &'a Transitions,
    /// The mean smooth L1 loss of the temporal-difference errors, once it is derived.
    pub value: f32,
}

impl<'a> DqnLoss<'a> {
    /// The loss on these transitions.
    pub fn new(gamma: f32, transitions: &'a Transitions) -> Self {
        Self { gamma, transitions, value: 0.0 }
    }
}

impl<'a> Loss<'a> for DqnLoss<'a> {
    fn passes(&self) -> Vec<Pass<'a>> {
        let Transitions { inputs, next, .. } = self.transitions;
        vec![
            Pass { weights: Weights::Own, tower: 0, inputs: inputs.all() },
            Pass { weights: Weights::Copy(TARGET), tower: 0, inputs: next.all() },
        ]
    }

    fn derive(&mut self, outputs: &[&[f32]], gradients: &mut [Vec<f32>]) {
        let &[values, next] = outputs else { unreachable!("DQN's loss has two passes") };
        let share = 1.0 / self.transitions.actions.len() as f32;
        let d_values = &mut gradients[0];
        d_values.resize(values.len(), 0.0);
        self.value = 0.0;
        let samples = values.chunks_exact(Action::COUNT).zip(d_values.chunks_exact_mut(Action::COUNT));
        let targets = self.transitions.targets(next, self.gamma);
        for ((values, d_values), (&action, target)) in samples.zip(self.transitions.actions.iter().zip(targets)) {
            let error = values[usize::from(action)] - target;
            // Smooth L1 with β = 1: half the square within ±1, |error| − ½ beyond; its slope is the error, clipped.
            self.value += share * if error.abs() < 1.0 { 0.5 * error * error } else { error.abs() - 0.5 };
            d_values[usize::from(action)] = share * error.clamp(-1.0, 1.0);
        }
    }

    /// Constant: γ. Columns: actions, rewards, whether the episode terminated.
    fn statement(&self) -> Statement<'a> {
        let Transitions { actions, rewards, terminated, .. } = self.transitions;
        Statement {
            name: "dqn",
            constants: vec![f64::from(self.gamma)],
            columns: vec![Column::Actions(actions, None), Column::Floats(rewards, None), Column::Flags(terminated)],
        }
    }

    fn of_acting(&self) -> f32 {
        self.value
    }

    fn set_terms(&mut self, terms: &[f32]) {
        self.value = terms[0];
    }
}
