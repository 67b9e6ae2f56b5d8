//! Takes samples of agents while they train, on the reference states of a level and on those that the agent visits.
//!
//! Nothing here is part of training: a [`Probe`] reads an agent's parameters before and after an update and draws from
//! streams of its own, so that a run is the same with it and without.

mod monitor;
mod reference;
mod visited;

pub use monitor::{Monitor, Pending};
pub use reference::{NUM_STATES, reference_batch};

use bit_mlp::{Activation, BitBatch, Block, Workspace};
use coverage_env::Action;

use super::{Acting, Head, Hidden, Layer, Sample, States, Units, Update, columns};
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

/// Measures networks of one architecture.
#[derive(Debug)]
pub struct Probe {
    network: Network,
    /// What those of its acting tower mean.
    outputs: Outputs,
}

/// An update of an agent, beside the parameters that it led to.
#[derive(Clone, Copy, Debug)]
pub struct Change<'a> {
    /// The parameters before it, `[P]`.
    pub before: &'a [f32],
    /// Its gradient steps.
    pub steps: u64,
    /// Its `train/grad_norm`, which the parameters do not tell.
    pub grad_norm: f64,
}

impl Probe {
    /// One for networks like this.
    pub fn new(network: Network, outputs: Outputs) -> Self {
        Self { network, outputs }
    }

    /// An agent with these parameters, `[P]`, on N states; `change` is the update that led to them, if one did.
    pub fn sample<'a>(
        &self,
        parameters: &'a [f32],
        change: Option<Change<'a>>,
        states: States,
        batch: &BitBatch,
    ) -> Sample<'a> {
        let mut workspace = Workspace::default();
        let outputs = self.act(parameters, batch, &mut workspace);
        let update = change.map(|Change { before, steps, grad_norm }| Update {
            before,
            after: parameters,
            greedy_before: greedy_actions(&self.act(before, batch, &mut workspace)),
            greedy_after: greedy_actions(&outputs),
            steps,
            grad_norm,
        });
        let acting = Acting { outputs, actions: Action::COUNT, head: head(self.outputs) };
        let mut layers = Vec::new();
        for tower in self.network.towers() {
            tower.mlp.forward(parameters, batch.all(), &mut workspace);
            layers.extend(read(tower, parameters, &workspace));
        }
        Sample { states, update, acting, layers }
    }

    /// What leaves the acting tower, `[N, A]`.
    fn act(&self, parameters: &[f32], batch: &BitBatch, workspace: &mut Workspace) -> Vec<f32> {
        self.network.acting().forward(parameters, batch.all(), workspace).to_vec()
    }
}

impl Measurement {
    /// That of one agent on both kinds of states.
    fn new(reference: &Sample, visited: &Sample) -> Self {
        let mut distributions = Vec::new();
        for Layer { name, weights, hidden } in &reference.layers {
            distributions.push((format!("weights/{name}"), weights.to_vec()));
            if let Some(hidden) = hidden {
                let narrow = hidden.activations().iter().map(|&h| h as f32).collect();
                distributions.push((format!("activations/{name}"), narrow));
            }
        }
        Self { measures: [reference, visited].map(columns).concat(), distributions }
    }
}

/// Every layer of a tower after a forward pass; of the last, which has no units to wear out, only its weights.
fn read<'a>(tower: &Tower, parameters: &'a [f32], workspace: &Workspace) -> Vec<Layer<'a>> {
    let last = tower.mlp.blocks().len() - 1;
    let layer = |(i, block): (usize, &Block)| {
        let hidden = (i < last).then(|| {
            let activations = workspace.activations(i);
            let mut values = Vec::with_capacity(activations.len() * activations.width());
            activations.rows().for_each(|row| values.extend(row.iter().copied().map(f64::from)));
            Hidden::new(values, activations.width(), units(tower.mlp.activation()))
        });
        Layer { name: format!("{}.{i}", tower.name), weights: &parameters[block.weight.clone()], hidden }
    };
    tower.mlp.blocks().iter().enumerate().map(layer).collect()
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
        Activation::Fourier => Units::Fourier,
    }
}
