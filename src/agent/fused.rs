//! The fast implementation's common ground: one agent's parameters, gradient and Adam in plain memory.
//!
//! The arithmetic is `bit-mlp`'s; tests hold it equal to the reference in `stacked`.

use std::ops::Range;

use bit_mlp::{AdamConfig, Decay, Decayed, GradientNorms, Moments, clip_and_adam, gradient_norms};

use super::network::Network;
use super::state::{AdamState, AgentState};
use crate::config::{L2, L2Covers, OptimizerConfig};

/// One agent with its Adam.
pub struct FusedAgent {
    /// θ, `[P]`.
    pub parameters: Vec<f32>,
    /// ∂loss/∂θ, `[P]`.
    pub gradient: Vec<f32>,
    adam: AdamState,
    adam_config: AdamConfig,
    max_grad_norm: f32,
    lambda: f64,
    /// The parameters that an L2 penalty covers, where not all.
    covered: Option<Vec<Range<usize>>>,
}

impl FusedAgent {
    /// An agent as it comes out of the stage before.
    pub fn new(network: &Network, optimizer: &OptimizerConfig, agent: &AgentState) -> Self {
        let decay = match optimizer.l2 {
            L2::None => Decay::None,
            L2::AdamW => Decay::Decoupled(optimizer.l2_coef),
            L2::Adam => Decay::Coupled(optimizer.l2_coef),
            L2::Loss => Decay::InLoss(optimizer.l2_coef),
        };
        Self {
            parameters: agent.parameters.clone(),
            gradient: vec![0.0; agent.parameters.len()],
            adam: agent.adam.clone(),
            adam_config: AdamConfig {
                lr: optimizer.learning_rate,
                eps: optimizer.adam_eps,
                decay,
                ..AdamConfig::default()
            },
            lambda: optimizer.l2_coef,
            max_grad_norm: optimizer.max_grad_norm as f32,
            covered: (optimizer.l2_covers == L2Covers::Weights).then(|| network.weights()),
        }
    }

    /// One step of clipped Adam down `gradient`; returns its norm before clipping.
    ///
    /// A norm that is not finite changes nothing.
    pub fn descend(&mut self) -> f32 {
        let AdamState { exp_avg, exp_avg_sq, step } = &mut self.adam;
        let moments = Moments { exp_avg, exp_avg_sq, step: *step + 1 };
        let decayed = decayed(&self.covered);
        let (parameters, gradient) = (&mut self.parameters, &self.gradient);
        let norm = clip_and_adam(parameters, gradient, moments, self.max_grad_norm, decayed, &self.adam_config);
        *step += u64::from(norm.is_finite());
        norm
    }

    /// Norms of the last gradient, the loss's and the L2 penalty's.
    pub fn norms(&self) -> GradientNorms {
        gradient_norms(&self.parameters, &self.gradient, self.lambda, decayed(&self.covered))
    }

    /// Writes weights and optimiser state into `agent`.
    pub fn save(&self, agent: &mut AgentState) {
        agent.parameters.clone_from(&self.parameters);
        agent.adam.clone_from(&self.adam);
    }
}

/// The covered parameters as the kernel takes them.
fn decayed(covered: &Option<Vec<Range<usize>>>) -> Decayed<'_> {
    covered.as_deref().map_or(Decayed::All, Decayed::Only)
}
