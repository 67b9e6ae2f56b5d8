//! Weight clipping (Elsayed, Lan, Lyle & Mahmood 2024, "Weight Clipping for Deep Continual and Reinforcement Learning").

use super::hooks::Mitigation;
use super::patient::Patient;
use crate::agent::engine::Units;
use crate::config::{Settings, Visitor, positive};

/// After every gradient step each weight and bias of a layer is brought into ±κ/√inputs.
///
/// The source writes κ·s, s being the bound of the layer's first weights: 1/√inputs where they begin uniformly, as DQN's do
/// here. PPO's begin orthogonally; they have the same bound.
#[derive(Clone, Debug, PartialEq)]
pub struct WeightClipping {
    /// κ.
    kappa: f64,
}

impl Default for WeightClipping {
    fn default() -> Self {
        Self { kappa: 1.0 }
    }
}

impl Settings for WeightClipping {
    fn visit(&mut self, v: &mut dyn Visitor) {
        let doc = "largest weight of a layer, as a multiple of 1/√inputs";
        v.field("weight_clipping_kappa", doc, &mut positive(&mut self.kappa));
    }
}

impl Mitigation for WeightClipping {
    fn name(&self) -> &'static str {
        "weight-clipping"
    }

    fn summary(&self) -> &'static str {
        "after each step weights and biases are brought within a bound (Elsayed et al. 2024)"
    }

    fn number(&self) -> u16 {
        15
    }

    fn acts_between_steps(&self) -> bool {
        true
    }

    fn after_step(&self, patient: &mut Patient<'_>, _: &Units) {
        for block in patient.network.towers().iter().flat_map(|tower| tower.mlp.blocks()) {
            let bound = (self.kappa / (block.inputs as f64).sqrt()) as f32;
            for range in [&block.weight, &block.bias] {
                let parameters = &mut patient.agent.parameters[range.clone()];
                parameters.iter_mut().for_each(|p| *p = p.clamp(-bound, bound));
            }
        }
    }

    fn boxed(&self) -> Box<dyn Mitigation> {
        Box::new(self.clone())
    }
}
