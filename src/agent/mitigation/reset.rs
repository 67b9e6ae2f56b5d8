//! Layers begin anew at each switch of levels (Nikishin et al. 2022, "The Primacy Bias in Deep Reinforcement Learning").

use super::hooks::Mitigation;
use super::patient::Patient;
use crate::config::{Settings, Visitor, integer};

/// The last layers of every tower get new parameters, and Adam's moments of 0, at every switch.
///
/// DQN's target network follows. A reset of all layers also sets Adam's count of steps to 0, as a new agent has it. The
/// source resets every so many steps and keeps its replay buffer; here levels say when, as in later studies of changing
/// tasks (Juliani & Ash 2024, "A Study of Plasticity Loss in On-Policy Deep Reinforcement Learning").
#[derive(Clone, Debug, PartialEq)]
pub struct Reset {
    /// Layers of each tower, counted from its end.
    layers: usize,
}

impl Default for Reset {
    fn default() -> Self {
        Self { layers: 1 }
    }
}

impl Settings for Reset {
    fn visit(&mut self, v: &mut dyn Visitor) {
        let doc = "layers of each tower that begin anew at a switch, counted from the last; more than there are: all";
        v.field("reset_layers", doc, &mut integer(&mut self.layers, 1..=64));
    }
}

impl Mitigation for Reset {
    fn name(&self) -> &'static str {
        "reset"
    }

    fn summary(&self) -> &'static str {
        "at a switch the last layers begin anew (Nikishin et al. 2022)"
    }

    fn number(&self) -> u16 {
        4
    }

    fn at_switch(&self, patient: &mut Patient<'_>) {
        let new = patient.network.init(&mut patient.stream(self.number()));
        let network = patient.network;
        let mut resets_all = true;
        for tower in network.towers() {
            let blocks = tower.mlp.blocks();
            let kept = blocks.len().saturating_sub(self.layers);
            resets_all &= kept == 0;
            for block in &blocks[kept..] {
                patient.agent.replace(&block.range(), &new, patient.copies);
                patient.agent.adam.clear_moments(&block.range());
            }
        }
        if resets_all {
            patient.agent.adam.step = 0;
        }
    }

    fn boxed(&self) -> Box<dyn Mitigation> {
        Box::new(self.clone())
    }
}
