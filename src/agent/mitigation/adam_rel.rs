//! Adam counts its steps anew at each switch of levels (Ellis et al. 2024, "Adam on Local Time: Addressing Nonstationarity
//! in RL with Relative Adam Timesteps").

use super::hooks::Mitigation;
use super::patient::Patient;
use crate::config::{Settings, Visitor};

/// t ← 0 at every switch; the moments m and v go on.
///
/// The source does this whenever the target of learning changes, for PPO with each rollout; here it does so with the level.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct AdamRel;

impl Settings for AdamRel {
    fn visit(&mut self, _: &mut dyn Visitor) {}
}

impl Mitigation for AdamRel {
    fn name(&self) -> &'static str {
        "adam-rel"
    }

    fn summary(&self) -> &'static str {
        "at a switch Adam counts its steps anew (Ellis et al. 2024)"
    }

    fn number(&self) -> u16 {
        7
    }

    fn at_switch(&self, patient: &mut Patient<'_>) {
        patient.agent.adam.step = 0;
    }

    fn boxed(&self) -> Box<dyn Mitigation> {
        Box::new(self.clone())
    }
}
