//! Measures of plasticity while agents train, on a reference batch of each level.
//!
//! Nothing here is part of training: a [`Probe`] reads an agent's parameters before and after an update and draws from
//! a stream of its own, so that a run is the same with it and without.

pub mod measures;
mod monitor;
mod reference;

pub use monitor::{Monitor, Pending};
pub use reference::{NUM_STATES, reference_batch};

use bit_mlp::{BitBatch, Workspace};
use coverage_env::Action;
use tch::Tensor;

use crate::agent::greedy;
use crate::agent::network::{Network, Tower};
use crate::agent::stacked::{TowerViews, dense, to_vec};

/// Columns of `plasticity.csv` and their values; docs/metrics.md defines them.
pub type Measures = Vec<(String, f64)>;

/// What one measurement tells of an agent.
#[derive(Debug, Default)]
pub struct Measurement {
    /// Its numbers.
    pub measures: Measures,
    /// `weights/<tower>.<layer>` and, of hidden layers, `activations/<tower>.<layer>` on the reference batch.
    pub distributions: Vec<(String, Vec<f32>)>,
}

/// Measures networks of one architecture on fixed states.
#[derive(Debug)]
pub struct Probe {
    network: Network,
    /// The reference batch of N states.
    states: BitBatch,
    /// The same as floats, `[1, N, inputs]`.
    inputs: Tensor,
}

impl Probe {
    /// One for networks like this, on these states.
    pub fn new(network: Network, states: BitBatch) -> Self {
        Self { inputs: dense(network.num_inputs(), &[states.all()]), network, states }
    }

    /// Measures an agent whose update took its parameters from `before` to `after`, `[P]` each.
    ///
    /// `grad_norm` is the update's own, which the parameters do not tell.
    pub fn measure(&self, before: &[f32], after: &[f32], grad_norm: f64) -> Measurement {
        let measures = vec![
            ("plasticity/grad_norm".to_owned(), grad_norm),
            ("plasticity/update_norm".to_owned(), distance(before, after)),
            ("plasticity/policy_churn".to_owned(), self.policy_churn(before, after)),
        ];
        let mut measurement = Measurement { measures, ..Measurement::default() };
        let theta = Tensor::from_slice(after).unsqueeze(0);
        for (tower, views) in self.network.towers().iter().zip(TowerViews::all(&self.network, &theta)) {
            self.of_tower(tower, &views, after, &mut measurement);
        }
        measurement
    }

    /// Measures every layer; of the last, which has no units to wear out, only its weights.
    fn of_tower(&self, tower: &Tower, views: &TowerViews, parameters: &[f32], into: &mut Measurement) {
        let last = tower.mlp.num_layers() - 1;
        for (i, (layer, activations)) in tower.mlp.layers().zip(views.activations(&self.inputs)).enumerate() {
            let column = |measure: &str| format!("plasticity/{}.{i}/{measure}", tower.name);
            let weights = &parameters[layer.weight];
            into.measures.push((column("weight_magnitude"), mean_magnitude(weights)));
            into.distributions.push((format!("weights/{}.{i}", tower.name), weights.to_vec()));
            if i < last {
                let of_layer = measures::of_layer(&activations.squeeze_dim(0), self.network.activation());
                into.measures.extend(of_layer.into_iter().map(|(measure, value)| (column(measure), value)));
                into.distributions.push((format!("activations/{}.{i}", tower.name), to_vec(&activations)));
            }
        }
    }

    /// Share of the states whose greedy action is another with `after` than with `before` (Schaul et al. 2022).
    fn policy_churn(&self, before: &[f32], after: &[f32]) -> f64 {
        let [before, after] = [before, after].map(|parameters| {
            let mut workspace = Workspace::default();
            let outputs = self.network.acting().forward(parameters, self.states.all(), &mut workspace);
            outputs.chunks_exact(Action::COUNT).map(greedy).collect::<Vec<Action>>()
        });
        before.iter().zip(&after).filter(|(before, after)| before != after).count() as f64 / before.len() as f64
    }
}

/// ‖after − before‖₂.
fn distance(before: &[f32], after: &[f32]) -> f64 {
    let square = |(b, a): (&f32, &f32)| (f64::from(*a) - f64::from(*b)).powi(2);
    before.iter().zip(after).map(square).sum::<f64>().sqrt()
}

/// Mean |w|.
fn mean_magnitude(weights: &[f32]) -> f64 {
    weights.iter().map(|w| f64::from(w.abs())).sum::<f64>() / weights.len() as f64
}
