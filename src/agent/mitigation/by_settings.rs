//! Mitigations that are nothing but settings: of the network, the optimiser, the loss.

use super::hooks::{Brought, Mitigation};
use crate::agent::shared::Shared;
use crate::config::{Settings, Visitor};

/// A method that other settings carry out. Listed, it brings them; its dose is theirs.
#[derive(Clone, Debug, PartialEq)]
pub struct BySettings {
    name: &'static str,
    summary: &'static str,
    number: u16,
    brings: &'static [Brought],
}

/// A setting without which it is not this method.
const fn is(key: &'static str, value: &'static str) -> Brought {
    Brought { key, value, is_dose: false }
}

/// A setting whose value is the dose.
const fn dose(key: &'static str, value: &'static str) -> Brought {
    Brought { key, value, is_dose: true }
}

/// A bonus on entropy ten times the paper's: a control of this project.
pub const ENTROPY_BONUS: BySettings = BySettings {
    name: "entropy-bonus",
    summary: "a bonus on entropy ten times the paper's: a control of this project",
    number: 20,
    brings: &[dose("ent_coef", "0.1")],
};

/// β₁ = β₂ (Dohare et al. 2024, "Loss of Plasticity in Deep Continual Learning").
pub const EQUAL_BETAS: BySettings = BySettings {
    name: "equal-betas",
    summary: "Adam with β₁ = β₂ (Dohare et al. 2024)",
    number: 21,
    brings: &[dose("adam_beta1", "0.99"), dose("adam_beta2", "0.99")],
};

/// L2 inside Adam, as `torch.optim.Adam(weight_decay)`.
pub const L2_ADAM: BySettings = BySettings {
    name: "l2-adam",
    summary: "L2 inside Adam (Dohare et al. 2024)",
    number: 22,
    brings: &[is("l2", "adam"), dose("l2_coef", "0.001")],
};

/// Decoupled weight decay (Loshchilov & Hutter 2019, "Decoupled Weight Decay Regularization").
pub const ADAMW: BySettings = BySettings {
    name: "adamw",
    summary: "decoupled weight decay (Loshchilov & Hutter 2019)",
    number: 23,
    brings: &[is("l2", "adamw"), dose("l2_coef", "0.01")],
};

/// Layer normalisation before the activation (Ba, Kiros & Hinton 2016; Lyle et al. 2023, "Understanding Plasticity in
/// Neural Networks").
pub const LAYER_NORM: BySettings = BySettings {
    name: "layer-norm",
    summary: "layer normalisation before each activation (Lyle et al. 2023)",
    number: 24,
    brings: &[is("layer_norm", "true")],
};

/// Concatenated ReLUs (Abbas et al. 2023, "Loss of Plasticity in Continual Deep Reinforcement Learning"), with half the
/// width, so that as many values leave a layer.
pub const CRELU: BySettings = BySettings {
    name: "crelu",
    summary: "concatenated ReLUs, at half the width (Abbas et al. 2023)",
    number: 25,
    brings: &[is("activation", "crelu"), dose("hidden", "[32, 32]")],
};

/// Deep Fourier features (Lewandowski et al. 2024, "Plastic Learning with Deep Fourier Features"), with half the width.
pub const FOURIER: BySettings = BySettings {
    name: "fourier",
    summary: "deep Fourier features, at half the width (Lewandowski et al. 2024)",
    number: 26,
    brings: &[is("activation", "fourier"), dose("hidden", "[32, 32]")],
};

impl Settings for BySettings {
    fn visit(&mut self, _: &mut dyn Visitor) {}
}

impl Mitigation for BySettings {
    fn name(&self) -> &'static str {
        self.name
    }

    fn summary(&self) -> &'static str {
        self.summary
    }

    fn number(&self) -> u16 {
        self.number
    }

    fn brings(&self) -> &'static [Brought] {
        self.brings
    }

    fn check(&self, shared: &Shared) -> Result<(), (&'static str, String)> {
        let (beta1, beta2) = (shared.optimizer.adam_beta1, shared.optimizer.adam_beta2);
        if *self != EQUAL_BETAS || beta1 == beta2 {
            return Ok(());
        }
        Err(("mitigations", format!("equal-betas: adam_beta1={beta1} and adam_beta2={beta2} differ")))
    }

    fn boxed(&self) -> Box<dyn Mitigation> {
        Box::new(self.clone())
    }
}
