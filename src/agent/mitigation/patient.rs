//! What a mitigation may do to an agent, and the surgery on single units that all resets share.

use std::ops::Range;

use crate::agent::engine::LayerUnits;
use crate::agent::network::Network;
use crate::agent::state::AgentState;
use crate::random::{Purpose, Stream};

/// The number under which an agent keeps its gradient steps, where mitigations count them.
pub(super) const STEPS: &str = "mitigation/steps";

/// Gradient steps of an agent's life so far.
pub(super) fn steps(agent: &AgentState) -> u64 {
    agent.kept.numbers.get(STEPS).copied().unwrap_or(0)
}

/// An agent that a mitigation may change.
///
/// `network.towers()[t].mlp.blocks()[l].weight` is where a weight `[inputs, units]` lies in `agent.parameters`, row-major.
/// Whoever writes there leaves Adam's moments as they are; the methods below set those of what they write to 0.
pub struct Patient<'a> {
    /// Where its parameters lie.
    pub network: &'a Network,
    /// The agent.
    pub agent: &'a mut AgentState,
    /// The names of the algorithm's copies of its parameters, such as DQN's target network.
    pub copies: &'a [&'a str],
    /// The stage's number.
    pub stage: u16,
    /// Gradient steps that the agent has made under mitigations which act between steps; 0 at the beginning of a stage.
    pub step: u64,
}

impl Patient<'_> {
    /// Random numbers for the mitigation with this number at this step: nobody else draws from this stream, and nothing
    /// has to be saved. Called twice in one hook it gives the same numbers.
    pub fn stream(&self, number: u16) -> Stream {
        let purpose = Purpose::Mitigation { number, step: self.step as u32 };
        Stream::new(self.agent.seed, self.stage, purpose)
    }

    /// Gives a hidden unit the incoming weights that it has in `new`, `[P]`, a bias of 0 and an untouched norm, all with
    /// moments of 0.
    pub fn renew_incoming(&mut self, tower: usize, layer: usize, unit: usize, new: &[f32]) {
        let block = &self.network.towers()[tower].mlp.blocks()[layer];
        for input in 0..block.inputs {
            let at = block.weight.start + input * block.width + unit;
            self.set(at, new[at]);
        }
        self.set(block.bias.start + unit, 0.0);
        if let Some(norm) = &block.norm {
            self.set(norm.scale.start + unit, 1.0);
            self.set(norm.shift.start + unit, 0.0);
        }
    }

    /// Cuts a hidden unit off from the layer after it: weights and moments of 0.
    pub fn silence_outgoing(&mut self, tower: usize, layer: usize, unit: usize) {
        let blocks = self.network.towers()[tower].mlp.blocks();
        let (block, next) = (&blocks[layer], &blocks[layer + 1]);
        // A unit of CReLU or of Fourier features leaves two values, `width` apart.
        for value in (unit..block.outputs()).step_by(block.width) {
            let row: Range<usize> =
                next.weight.start + value * next.width..next.weight.start + (value + 1) * next.width;
            row.for_each(|at| self.set(at, 0.0));
        }
    }

    fn set(&mut self, at: usize, value: f32) {
        self.agent.parameters[at] = value;
        self.agent.adam.exp_avg[at] = 0.0;
        self.agent.adam.exp_avg_sq[at] = 0.0;
    }
}

impl LayerUnits {
    /// Mean |h| of each unit over the samples, `[units]`; of a unit that leaves two values, the mean of their sum.
    pub fn mean_magnitudes(&self) -> Vec<f64> {
        let samples = (self.activations.len() / self.values.max(1)) as f64;
        let mut sums = vec![0.0; self.units];
        for row in self.activations.chunks_exact(self.values.max(1)) {
            row.iter().enumerate().for_each(|(value, h)| sums[value % self.units] += f64::from(h.abs()));
        }
        sums.into_iter().map(|sum| sum / samples).collect()
    }
}
