//! L2: the weights are drawn to 0.

use super::hooks::Mitigation;
use crate::agent::engine::{Entry, GradientNorms, Pull, Toward};
use crate::agent::learner::Metrics;
use crate::agent::optimizer::OptimizerConfig;
use crate::agent::shared::Shared;
use crate::config::{Choice, Settings, Visitor, choice, non_negative};

/// How an L2 penalty acts on the parameters θ.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum L2 {
    /// Not at all.
    None,
    /// AdamW (Loshchilov & Hutter 2019): θ ← θ − αλθ beside the Adam step.
    AdamW,
    /// Coupled: λθ is added to the clipped gradient inside Adam (PyTorch's `Adam(weight_decay)`, Dohare et al. 2024).
    Adam,
    /// ½λ‖θ‖² is part of the loss, so that its gradient is clipped with the rest.
    Loss,
}

impl Choice for L2 {
    const ALL: &'static [(&'static str, Self)] =
        &[("none", Self::None), ("adamw", Self::AdamW), ("adam", Self::Adam), ("loss", Self::Loss)];
}

/// The parameters an L2 penalty acts on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum L2Covers {
    /// Weights and biases, as PyTorch's optimisers do by default.
    All,
    /// Weights only.
    Weights,
}

impl Choice for L2Covers {
    const ALL: &'static [(&'static str, Self)] = &[("all", Self::All), ("weights", Self::Weights)];
}

/// An L2 penalty ½λ‖θ‖².
#[derive(Clone, Debug, PartialEq)]
pub struct L2Penalty {
    /// How it acts.
    pub kind: L2,
    /// λ.
    pub coefficient: f64,
    /// What it acts on.
    pub covers: L2Covers,
}

impl Default for L2Penalty {
    fn default() -> Self {
        Self { kind: L2::None, coefficient: 0.0, covers: L2Covers::All }
    }
}

impl Settings for L2Penalty {
    fn visit(&mut self, v: &mut dyn Visitor) {
        v.field("l2", "how the L2 penalty acts", &mut choice(&mut self.kind));
        v.field("l2_coef", "its coefficient", &mut non_negative(&mut self.coefficient));
        v.field("l2_covers", "the parameters it acts on", &mut choice(&mut self.covers));
    }
}

impl Mitigation for L2Penalty {
    fn name(&self) -> &'static str {
        "l2"
    }

    fn summary(&self) -> &'static str {
        "the parameters are drawn to 0; the setting l2 says how"
    }

    fn number(&self) -> u16 {
        0
    }

    /// The arms of the paper have its settings, whether it acts or not.
    fn is_always_listed(&self) -> bool {
        true
    }

    fn check(&self, _shared: &Shared) -> Result<(), (&'static str, String)> {
        if self.kind != L2::None || self.coefficient == 0.0 {
            return Ok(());
        }
        let problem = "l2_coef has no effect while l2 is none: choose l2=adamw, adam or loss, or drop it";
        Err(("l2_coef", problem.to_owned()))
    }

    fn pull(&self) -> Option<Pull> {
        let entry = match self.kind {
            L2::None => return None,
            L2::AdamW => Entry::Decoupled,
            L2::Adam => Entry::InAdam,
            L2::Loss => Entry::InLoss,
        };
        let covers_all = self.covers == L2Covers::All;
        Some(Pull { toward: Toward::Zero(entry), coefficient: self.coefficient, covers_all })
    }

    /// Where the penalty has a gradient, the ratio of its norm to that of the loss's gradient where the two are added, in
    /// the update's last minibatch.
    fn metrics(&self, optimizer: &OptimizerConfig, norms: &dyn Fn() -> GradientNorms) -> Metrics {
        let norms = match self.kind {
            L2::None | L2::AdamW => return Metrics::new(),
            L2::Adam | L2::Loss => norms(),
        };
        let loss = f64::from(norms.loss);
        let beside = if self.kind == L2::Adam { loss.min(optimizer.max_grad_norm) } else { loss };
        vec![("train/l2_ratio", f64::from(norms.penalty) / beside)]
    }

    fn boxed(&self) -> Box<dyn Mitigation> {
        Box::new(self.clone())
    }
}
