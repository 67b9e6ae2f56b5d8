//! Parseval regularisation (Chung, Cherif, Meger & Precup 2024, "Parseval Regularization for Continual Reinforcement
//! Learning").

use std::sync::Arc;

use bit_mlp::Block;
use nalgebra::{DMatrix, DMatrixView};

use super::hooks::Mitigation;
use super::patient::Patient;
use crate::agent::engine::Penalty;
use crate::agent::network::Network;
use crate::agent::state::AgentState;
use crate::config::{Settings, Visitor, integer, non_negative, positive};

/// The number of gradient steps since a stage began, and the name of the list that holds the penalty's gradient.
const NAME: &str = "parseval";

/// The loss gets λ Σ ‖WWᵀ − sI‖²_F over the hidden layers, W being `[units, inputs]`.
///
/// The source multiplies λ by (64/width)², which is 1 at the default width; here λ is taken as it is written. The penalty's
/// gradient costs more than the rest of a step. So it is computed anew every few gradient steps, and each of them adds the
/// one computed last. With an interval of 1 this is the source's method.
#[derive(Clone, Debug, PartialEq)]
pub struct Parseval {
    /// λ.
    coefficient: f64,
    /// s.
    scale: f64,
    /// Gradient steps from one computation of the penalty's gradient to the next.
    interval: u64,
}

impl Default for Parseval {
    /// s is the square of the gain with which PPO's hidden layers begin.
    fn default() -> Self {
        Self { coefficient: 1e-3, scale: 2.0, interval: 64 }
    }
}

impl Settings for Parseval {
    fn visit(&mut self, v: &mut dyn Visitor) {
        let Self { coefficient, scale, interval } = self;
        v.field("parseval_coef", "coefficient of the distance to orthogonal rows", &mut positive(coefficient));
        v.field("parseval_scale", "squared length that the rows are drawn to", &mut non_negative(scale));
        let doc = "gradient steps between two computations of the penalty's gradient";
        v.field("parseval_interval", doc, &mut integer(interval, 1..=1_000_000));
    }
}

impl Mitigation for Parseval {
    fn name(&self) -> &'static str {
        NAME
    }

    fn summary(&self) -> &'static str {
        "the loss draws the rows of hidden weights to orthogonal ones (Chung et al. 2024)"
    }

    fn number(&self) -> u16 {
        13
    }

    fn penalty(&self, network: &Network) -> Option<Arc<dyn Penalty>> {
        let layers = network.hidden_blocks().cloned().collect();
        Some(Arc::new(ParsevalPenalty { settings: self.clone(), layers }))
    }

    /// What was computed before a switch is of other weights.
    fn begin_stage(&self, patient: &mut Patient<'_>) {
        patient.agent.kept.numbers.insert(NAME.to_owned(), 0);
    }

    fn boxed(&self) -> Box<dyn Mitigation> {
        Box::new(self.clone())
    }
}

/// The penalty of a network.
#[derive(Debug)]
struct ParsevalPenalty {
    settings: Parseval,
    /// Those that it covers.
    layers: Vec<Block>,
}

impl Penalty for ParsevalPenalty {
    fn add_to(&self, gradient: &mut [f32], agent: &mut AgentState) {
        let AgentState { parameters, kept, .. } = agent;
        let steps = kept.numbers.entry(NAME.to_owned()).or_insert(0);
        let kept = kept.lists.entry(NAME.to_owned()).or_default();
        let len = self.layers.iter().map(|layer| layer.weight.len()).sum::<usize>();
        if steps.is_multiple_of(self.settings.interval) || kept.len() != len {
            kept.clear();
            self.layers.iter().for_each(|layer| kept.extend_from_slice(self.gradient(parameters, layer).as_slice()));
        }
        *steps += 1;
        let mut added = kept.as_slice();
        for layer in &self.layers {
            let (own, rest) = added.split_at(layer.weight.len());
            bit_mlp::add(&mut gradient[layer.weight.clone()], own);
            added = rest;
        }
    }
}

impl ParsevalPenalty {
    /// 4λ(WWᵀ − sI)W of a layer, `[units, inputs]` column by column, as our weights lie.
    fn gradient(&self, parameters: &[f32], layer: &Block) -> DMatrix<f32> {
        let weight = DMatrixView::from_slice(&parameters[layer.weight.clone()], layer.width, layer.inputs);
        let mut excess = weight * weight.transpose();
        let scale = self.settings.scale as f32;
        (0..layer.width).for_each(|unit| excess[(unit, unit)] -= scale);
        excess *= 4.0 * self.settings.coefficient as f32;
        excess * weight
    }
}
