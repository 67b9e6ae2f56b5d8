//! What a mitigation may do to an agent, and the surgery on single units that all resets share.

use std::ops::Range;

use crate::agent::engine::{LayerUnits, Units};
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

/// A hidden unit.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Place {
    /// Which tower.
    pub tower: usize,
    /// Which of its hidden layers.
    pub layer: usize,
    /// Which unit of that.
    pub unit: usize,
}

impl Patient<'_> {
    /// Random numbers for the mitigation with this number at this step: nobody else draws from this stream, and nothing
    /// has to be saved. Called twice in one hook it gives the same numbers.
    pub fn stream(&self, number: u16) -> Stream {
        let purpose = Purpose::Mitigation { number, step: self.step as u32 };
        Stream::new(self.agent.seed, self.stage, purpose)
    }

    /// Gives a hidden unit incoming weights as a new agent has them, a bias of 0 and an untouched norm, all with moments of
    /// 0.
    pub fn renew_incoming(&mut self, unit: Place, stream: &mut Stream) {
        let Place { tower, layer, unit } = unit;
        let tower = &self.network.towers()[tower];
        let block = &tower.mlp.blocks()[layer];
        for (input, weight) in tower.new_unit(layer, stream).into_iter().enumerate() {
            self.set(block.weight.start + input * block.width + unit, weight);
        }
        self.set(block.bias.start + unit, 0.0);
        if let Some(norm) = &block.norm {
            self.set(norm.scale.start + unit, 1.0);
            self.set(norm.shift.start + unit, 0.0);
        }
    }

    /// Cuts a hidden unit off from the layer after it: weights and moments of 0.
    pub fn silence_outgoing(&mut self, unit: Place) {
        for value in self.values_of(unit) {
            self.outgoing(unit, value).for_each(|at| self.set(at, 0.0));
        }
    }

    /// The values that leave a hidden unit, by their place among those of its layer: a unit of CReLU or of
    /// Fourier features leaves two, `width` apart.
    pub fn values_of(&self, unit: Place) -> impl Iterator<Item = usize> + use<> {
        let block = &self.network.towers()[unit.tower].mlp.blocks()[unit.layer];
        (unit.unit..block.outputs()).step_by(block.width)
    }

    /// Where the weights lie that multiply a value in the next layer.
    pub fn outgoing(&self, unit: Place, value: usize) -> Range<usize> {
        let next = &self.network.towers()[unit.tower].mlp.blocks()[unit.layer + 1];
        next.weight.start + value * next.width..next.weight.start + (value + 1) * next.width
    }

    /// Mean |w| of the weights that multiply a value in the next layer.
    pub fn outgoing_magnitude(&self, unit: Place, value: usize) -> f32 {
        let weights = &self.agent.parameters[self.outgoing(unit, value)];
        weights.iter().map(|weight| weight.abs()).sum::<f32>() / weights.len() as f32
    }

    /// Adds to the biases of the next layer what a value gives to its sums when it is `mean`.
    pub fn move_into_next_bias(&mut self, unit: Place, value: usize, mean: f32) {
        let next = &self.network.towers()[unit.tower].mlp.blocks()[unit.layer + 1];
        for (at, bias) in self.outgoing(unit, value).zip(next.bias.clone()) {
            self.agent.parameters[bias] += mean * self.agent.parameters[at];
        }
    }

    /// Recycles hidden units as ReDo does: new incoming weights for all of them, then outgoing weights of 0.
    pub fn recycle(&mut self, units: &[Place], number: u16) {
        let mut stream = self.stream(number);
        units.iter().for_each(|&unit| self.renew_incoming(unit, &mut stream));
        units.iter().for_each(|&unit| self.silence_outgoing(unit));
    }

    fn set(&mut self, at: usize, value: f32) {
        self.agent.parameters[at] = value;
        self.agent.adam.exp_avg[at] = 0.0;
        self.agent.adam.exp_avg_sq[at] = 0.0;
    }
}

impl Units {
    /// The places of the units that `choose` finds in each layer.
    pub fn chosen(&self, choose: impl Fn(&LayerUnits) -> Vec<usize>) -> Vec<Place> {
        let layers = self
            .towers
            .iter()
            .enumerate()
            .flat_map(|(t, layers)| layers.iter().enumerate().map(move |(l, units)| (t, l, units)));
        let places = layers
            .flat_map(|(tower, layer, units)| choose(units).into_iter().map(move |unit| Place { tower, layer, unit }));
        places.collect()
    }
}

impl LayerUnits {
    /// Mean |h| of each unit over the samples, `[units]`; of a unit that leaves two values, the mean of their sum.
    pub fn mean_magnitudes(&self) -> Vec<f64> {
        let (of_values, _) = self.means();
        let of_unit = |unit: usize| of_values[unit..].iter().step_by(self.units).map(|&m| f64::from(m)).sum();
        (0..self.units).map(of_unit).collect()
    }

    /// Means of |h| and of h of each value over the samples, `[K]` each.
    pub fn means(&self) -> (Vec<f32>, Vec<f32>) {
        let (mut magnitudes, mut means) = (vec![0.0_f32; self.values], vec![0.0_f32; self.values]);
        let rows = self.activations.chunks_exact(self.values.max(1));
        let share = 1.0 / rows.len() as f32;
        for row in rows {
            for ((magnitude, mean), h) in magnitudes.iter_mut().zip(&mut means).zip(row) {
                *magnitude += h.abs();
                *mean += h;
            }
        }
        magnitudes.iter_mut().chain(&mut means).for_each(|sum| *sum *= share);
        (magnitudes, means)
    }
}
