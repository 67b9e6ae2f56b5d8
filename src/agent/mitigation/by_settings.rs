//! Mitigations that are nothing but settings: of the network, the optimiser, the loss.

use super::hooks::{Brought, Mitigation};
use crate::agent::shared::Shared;
use crate::config::{Settings, Visitor};

/// A method that other settings carry out. Listed, it brings them; its dose is theirs.
#[derive(Clone, Debug)]
pub struct BySettings {
    name: &'static str,
    summary: &'static str,
    number: u16,
    brings: &'static [Brought],
    /// Refuses settings with which it is not this method.
    check: fn(&Shared) -> Result<(), (&'static str, String)>,
}

impl BySettings {
    const fn new(name: &'static str, number: u16, summary: &'static str, brings: &'static [Brought]) -> Self {
        Self { name, summary, number, brings, check: |_| Ok(()) }
    }
}

/// A bonus on entropy ten times the paper's.
pub const ENTROPY_BONUS: BySettings = BySettings::new(
    "entropy-bonus",
    20,
    "a bonus on entropy ten times the paper's: a control of this project",
    &[Brought::dose("ent_coef", "0.1")],
);

/// β₁ = β₂ ("Loss of Plasticity in Deep Continual Learning").
pub const EQUAL_BETAS: BySettings = BySettings {
    check: |shared| {
        let (beta1, beta2) = (shared.optimizer.adam_beta1, shared.optimizer.adam_beta2);
        if beta1 == beta2 {
            return Ok(());
        }
        Err(("mitigations", format!("equal-betas: adam_beta1={beta1} and adam_beta2={beta2} differ")))
    },
    ..BySettings::new(
        "equal-betas",
        21,
        "Adam with β₁ = β₂ (Dohare et al. 2024)",
        &[Brought::dose("adam_beta1", "0.99"), Brought::dose("adam_beta2", "0.99")],
    )
};

/// L2 as `torch.optim.Adam(weight_decay)` has it.
pub const L2_ADAM: BySettings = BySettings::new(
    "l2-adam",
    22,
    "L2 inside Adam (Dohare et al. 2024)",
    &[Brought::fixed("l2", "adam"), Brought::dose("l2_coef", "0.001")],
);

/// As `torch.optim.AdamW` has it ("Decoupled Weight Decay Regularization").
pub const ADAMW: BySettings = BySettings::new(
    "adamw",
    23,
    "decoupled weight decay (Loshchilov & Hutter 2019)",
    &[Brought::fixed("l2", "adamw"), Brought::dose("l2_coef", "0.01")],
);

/// Ba, Kiros & Hinton 2016; as a mitigation "Understanding Plasticity in Neural Networks".
pub const LAYER_NORM: BySettings = BySettings::new(
    "layer-norm",
    24,
    "layer normalisation before each activation (Lyle et al. 2023)",
    &[Brought::fixed("layer_norm", "true")],
);

/// "Loss of Plasticity in Continual Deep Reinforcement Learning". As many values leave a layer as without it.
pub const CRELU: BySettings = BySettings::new(
    "crelu",
    25,
    "concatenated ReLUs, at half the width (Abbas et al. 2023)",
    &[Brought::fixed("activation", "crelu"), Brought::dose("hidden", "[32, 32]")],
);

/// "Plastic Learning with Deep Fourier Features". As many values leave a layer as without it.
pub const FOURIER: BySettings = BySettings::new(
    "fourier",
    26,
    "deep Fourier features, at half the width (Lewandowski et al. 2024)",
    &[Brought::fixed("activation", "fourier"), Brought::dose("hidden", "[32, 32]")],
);

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
        (self.check)(shared)
    }

    fn boxed(&self) -> Box<dyn Mitigation> {
        Box::new(self.clone())
    }
}
