//! Shrink-and-perturb (Ash & Adams 2020, "On Warm-Starting Neural Network Training"), at each switch of levels.

use super::hooks::Mitigation;
use super::patient::Patient;
use crate::config::{Settings, Visitor, fraction, non_negative};

/// θ ← α·θ + β·θ′ at the beginning of every stage but the first, θ′ being parameters drawn as those of a new agent.
///
/// The source adds noise of a fixed deviation; noise with the distribution of the first parameters is the variant that
/// later work uses (D'Oro et al. 2023). Adam's state goes on.
#[derive(Clone, Debug, PartialEq)]
pub struct ShrinkPerturb {
    /// α.
    shrink: f64,
    /// β.
    perturb: f64,
}

impl Default for ShrinkPerturb {
    fn default() -> Self {
        Self { shrink: 0.5, perturb: 0.5 }
    }
}

impl Settings for ShrinkPerturb {
    fn visit(&mut self, v: &mut dyn Visitor) {
        v.field("shrink_perturb_alpha", "what is left of the parameters at a switch", &mut fraction(&mut self.shrink));
        v.field(
            "shrink_perturb_beta",
            "share of new parameters added at a switch",
            &mut non_negative(&mut self.perturb),
        );
    }
}

impl Mitigation for ShrinkPerturb {
    fn name(&self) -> &'static str {
        "shrink-perturb"
    }

    fn summary(&self) -> &'static str {
        "at a switch all parameters are made smaller, and new ones are added (Ash & Adams 2020)"
    }

    fn number(&self) -> u16 {
        2
    }

    fn at_switch(&self, patient: &mut Patient<'_>) {
        let new = patient.network.init(&mut patient.stream(self.number()));
        let (shrink, perturb) = (self.shrink as f32, self.perturb as f32);
        for (parameter, new) in patient.agent.parameters.iter_mut().zip(new) {
            *parameter = shrink * *parameter + perturb * new;
        }
    }

    fn boxed(&self) -> Box<dyn Mitigation> {
        Box::new(self.clone())
    }
}
