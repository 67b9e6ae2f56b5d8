//! L2-Init: the parameters are drawn to where they began, and not to 0 (Kumar, Marklund & Van Roy 2023, "Maintaining
//! Plasticity in Continual Learning via Regenerative Regularization").

use super::hooks::Mitigation;
use super::patient::Patient;
use crate::agent::engine::{Pull, Toward};
use crate::config::{Settings, Visitor, positive};

/// The name of the copy that holds θ₀.
const FIRST: &str = "l2_init";

/// The loss gets λ‖θ − θ₀‖², θ₀ being the agent's first parameters.
#[derive(Clone, Debug, PartialEq)]
pub struct L2Init {
    /// λ.
    coefficient: f64,
}

impl Default for L2Init {
    fn default() -> Self {
        Self { coefficient: 1e-3 }
    }
}

impl Settings for L2Init {
    fn visit(&mut self, v: &mut dyn Visitor) {
        v.field(
            "l2_init_coef",
            "coefficient of the squared distance to the first parameters",
            &mut positive(&mut self.coefficient),
        );
    }
}

impl Mitigation for L2Init {
    fn name(&self) -> &'static str {
        "l2-init"
    }

    fn number(&self) -> u16 {
        1
    }

    /// The paper writes λ‖θ − θ₀‖², without a half; clipping sees it, since it is part of the loss.
    fn pull(&self) -> Option<Pull> {
        Some(Pull { toward: Toward::Copy(FIRST), coefficient: 2.0 * self.coefficient, covers_all: true })
    }

    /// Notes θ₀ once in an agent's life.
    fn begin_stage(&self, patient: &mut Patient<'_>) {
        let agent = &mut *patient.agent;
        agent.kept.copies.entry(FIRST.to_owned()).or_insert_with(|| agent.parameters.clone());
    }

    fn boxed(&self) -> Box<dyn Mitigation> {
        Box::new(self.clone())
    }
}
