//! Takes samples of agents while they train, on a reference batch of each level.
//!
//! Nothing here is part of training: a [`Probe`] reads an agent's parameters before and after an update and draws from
//! a stream of its own, so that a run is the same with it and without.

mod monitor;
mod reference;

pub use monitor::{Monitor, Pending};
pub use reference::{NUM_STATES, reference_batch};

use bit_mlp::{Activation, BitBatch, Workspace};
use coverage_env::Action;

use super::{Head, Hidden, Layer, Sample, Units, Update, columns};
use crate::agent::greedy;
use crate::agent::network::{Network, Outputs, Tower};

/// What one measurement tells of an agent.
#[derive(Debug, Default)]
pub struct Measurement {
    /// Columns of `plasticity.csv` and their values; docs/metrics.md defines them.
    pub measures: Vec<(String, f64)>,
    /// `weights/<tower>.<layer>` and, of hidden layers, `activations/<tower>.<layer>` on the reference batch.
    pub distributions: Vec<(String, Vec<f32>)>,
}

/// Measures networks of one architecture on fixed states.
#[derive(Debug)]
pub struct Probe {
    network: Network,
    /// What those of its acting tower mean.
    outputs: Outputs,
    /// The reference batch of N states.
    states: BitBatch,
}

impl Probe {
    /// One for networks like this, on these states.
    pub fn new(network: Network, outputs: Outputs, states: BitBatch) -> Self {
        Self { network, outputs, states }
    }

    /// Measures an agent whose update took its parameters from `before` to `after`, `[P]` each.
    ///
    /// `grad_norm` is the update's own, which the parameters do not tell.
    pub fn measure(&self, before: &[f32], after: &[f32], grad_norm: f64) -> Measurement {
        let mut workspace = Workspace::default();
        let mut outputs =
            |parameters| self.network.acting().forward(parameters, self.states.all(), &mut workspace).to_vec();
        let [outputs_before, outputs] = [before, after].map(&mut outputs);
        let update = Update {
            before,
            after,
            greedy_before: greedy_actions(&outputs_before),
            greedy_after: greedy_actions(&outputs),
            outputs,
            actions: Action::COUNT,
            head: head(self.outputs),
            grad_norm,
        };
        let (mut layers, mut distributions) = (Vec::new(), Vec::new());
        for tower in self.network.towers() {
            self.read(tower, after, &mut workspace, &mut layers, &mut distributions);
        }
        Measurement { measures: columns(&Sample { update, layers }), distributions }
    }

    /// Reads every layer of a tower; of the last, which has no units to wear out, only its weights.
    fn read<'a>(
        &self,
        tower: &Tower,
        parameters: &'a [f32],
        workspace: &mut Workspace,
        layers: &mut Vec<Layer<'a>>,
        distributions: &mut Vec<(String, Vec<f32>)>,
    ) {
        tower.mlp.forward(parameters, self.states.all(), workspace);
        let last = tower.mlp.blocks().len() - 1;
        for (i, layer) in tower.mlp.blocks().iter().enumerate() {
            let name = format!("{}.{i}", tower.name);
            let weights = &parameters[layer.weight.clone()];
            distributions.push((format!("weights/{name}"), weights.to_vec()));
            let hidden = (i < last).then(|| {
                let activations = workspace.activations(i);
                let values: Vec<f32> = activations.rows().flatten().copied().collect();
                let wide = values.iter().copied().map(f64::from).collect();
                distributions.push((format!("activations/{name}"), values));
                Hidden::new(wide, activations.width(), units(tower.mlp.activation()))
            });
            layers.push(Layer { name, weights, hidden });
        }
    }
}

/// The greedy action in each state by these outputs `[N, A]`, `[N]`.
fn greedy_actions(outputs: &[f32]) -> Vec<usize> {
    outputs.chunks_exact(Action::COUNT).map(|values| greedy(values).index()).collect()
}

/// What measures call the outputs of a network.
fn head(outputs: Outputs) -> Head {
    match outputs {
        Outputs::Logits => Head::Logits,
        Outputs::Values => Head::Values,
    }
}

/// What measures call an activation.
fn units(activation: Activation) -> Units {
    match activation {
        Activation::Tanh => Units::Tanh,
        // Each unit of CReLU leaves two values, both as those of ReLU.
        Activation::Relu | Activation::Crelu => Units::Relu,
    }
}
