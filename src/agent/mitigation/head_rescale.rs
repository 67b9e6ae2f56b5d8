//! Head rescale: the layer that acts is made small at each switch of levels. A control, and no published method: it gives
//! back a policy's entropy and leaves what the network has learned (docs/results/why).

use super::hooks::Mitigation;
use super::patient::Patient;
use crate::agent::shared::Shared;
use crate::config::{Settings, Visitor, positive};

/// W ← c·W and b ← c·b in the last layer of the network that acts, at every switch.
///
/// It moves no greedy action and no hidden weight. DQN's target network follows; Adam's state goes on.
#[derive(Clone, Debug, PartialEq)]
pub struct HeadRescale {
    /// c.
    factor: f64,
}

impl Default for HeadRescale {
    fn default() -> Self {
        Self { factor: 0.02 }
    }
}

impl Settings for HeadRescale {
    fn visit(&mut self, v: &mut dyn Visitor) {
        let doc = "what the last layer of the network that acts is multiplied by at a switch";
        v.field("head_rescale_factor", doc, &mut positive(&mut self.factor));
    }
}

impl Mitigation for HeadRescale {
    fn name(&self) -> &'static str {
        "head-rescale"
    }

    fn summary(&self) -> &'static str {
        "at a switch the last layer that acts is made small: a control of this project"
    }

    fn number(&self) -> u16 {
        5
    }

    fn check(&self, _shared: &Shared) -> Result<(), (&'static str, String)> {
        if (f64::from(f32::MIN_POSITIVE)..=1e6).contains(&self.factor) {
            return Ok(());
        }
        Err(("head_rescale_factor", format!("expected a number above 0, and at most 1e6, got {:e}", self.factor)))
    }

    fn at_switch(&self, patient: &mut Patient<'_>) {
        if let Some(head) = patient.network.acting().blocks().last() {
            for range in [&head.weight, &head.bias] {
                patient.agent.scale(range, self.factor as f32, patient.copies);
            }
        }
    }

    fn boxed(&self) -> Box<dyn Mitigation> {
        Box::new(self.clone())
    }
}
