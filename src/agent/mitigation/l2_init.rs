//! L2-Init: the parameters are drawn to where they began, and not to 0 (Kumar, Marklund & Van Roy 2023, "Maintaining
//! Plasticity in Continual Learning via Regenerative Regularization").

use super::hooks::Mitigation;
use super::patient::Patient;
use crate::agent::engine::{Pull, Toward};
use crate::config::{Settings, Visitor, flag, positive};

/// The name of the copy that holds θ₀.
const FIRST: &str = "l2_init";

/// The loss gets λ‖θ − θ₀‖², θ₀ being the agent's first parameters.
///
/// Not squared it is the variant of Juliani & Ash (2024, "A Study of Plasticity Loss in On-Policy Deep Reinforcement
/// Learning"), λ‖θ − θ₀‖: one norm over all parameters.
#[derive(Clone, Debug, PartialEq)]
pub struct L2Init {
    /// λ.
    coefficient: f64,
    is_squared: bool,
}

impl Default for L2Init {
    fn default() -> Self {
        Self { coefficient: 1e-3, is_squared: true }
    }
}

impl Settings for L2Init {
    fn visit(&mut self, v: &mut dyn Visitor) {
        let Self { coefficient, is_squared } = self;
        v.field("l2_init_coef", "coefficient of the distance to the first parameters", &mut positive(coefficient));
        v.field("l2_init_squared", "whether that distance is squared", &mut flag(is_squared));
    }
}

impl Mitigation for L2Init {
    fn name(&self) -> &'static str {
        "l2-init"
    }

    fn summary(&self) -> &'static str {
        "the loss draws the parameters to those with which the agent began (Kumar et al. 2023)"
    }

    fn number(&self) -> u16 {
        1
    }

    /// The paper writes λ‖θ − θ₀‖², without a half; clipping sees it, since it is part of the loss.
    fn pull(&self) -> Option<Pull> {
        let Self { coefficient, is_squared } = *self;
        let coefficient = if is_squared { 2.0 * coefficient } else { coefficient };
        Some(Pull { toward: Toward::Copy { name: FIRST, is_squared }, coefficient, covers_all: true })
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
