//! Adam begins anew at each switch of levels (Asadi, Fakoor & Sabach 2023, "Resetting the Optimizer in Deep RL: An
//! Empirical Study").

use super::hooks::Mitigation;
use super::patient::Patient;
use crate::agent::state::AdamState;
use crate::config::{Settings, Visitor};

/// m ← 0, v ← 0 and t ← 0 at every switch.
///
/// The source resets whenever the target network changes, that is when the learning problem does; here it does so with the
/// level.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct AdamReset;

impl Settings for AdamReset {
    fn visit(&mut self, _: &mut dyn Visitor) {}
}

impl Mitigation for AdamReset {
    fn name(&self) -> &'static str {
        "adam-reset"
    }

    fn summary(&self) -> &'static str {
        "at a switch Adam begins anew (Asadi et al. 2023)"
    }

    fn number(&self) -> u16 {
        6
    }

    fn at_switch(&self, patient: &mut Patient<'_>) {
        patient.agent.adam = AdamState::new(patient.agent.parameters.len());
    }

    fn boxed(&self) -> Box<dyn Mitigation> {
        Box::new(self.clone())
    }
}
