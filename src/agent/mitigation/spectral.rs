//! Spectral regularisation (Lewandowski et al. 2024, "Learning Continually by Spectral Regularization").

use std::sync::Arc;

use bit_mlp::{Block, norm};

use super::hooks::Mitigation;
use crate::agent::engine::Penalty;
use crate::agent::network::Network;
use crate::agent::state::AgentState;
use crate::config::{Settings, Visitor, integer, positive};

/// The list that holds u of every layer, `[units]` each.
const VECTORS: &str = "spectral";

/// The loss gets λ Σ (σᵏ − 1)² + ‖b‖²ᵏ over all layers, σ being the largest singular value of the weights.
///
/// σ = uᵀWv comes from one power iteration in each gradient step: v ← Wᵀu and u ← Wv, both normalised, with the u of the
/// step before; ∂σ/∂W = uvᵀ. Scales and shifts of norms are left alone; the source draws them to 1 and 0. Its power of
/// the biases is given differently by those who write of it; this one is the same form as that of σ, drawn to 0.
#[derive(Clone, Debug, PartialEq)]
pub struct Spectral {
    /// λ.
    coefficient: f64,
    /// k.
    power: u32,
}

impl Default for Spectral {
    fn default() -> Self {
        Self { coefficient: 1e-3, power: 2 }
    }
}

impl Settings for Spectral {
    fn visit(&mut self, v: &mut dyn Visitor) {
        let Self { coefficient, power } = self;
        v.field("spectral_coef", "coefficient of the distance of spectral norms to 1", &mut positive(coefficient));
        v.field("spectral_power", "power of the spectral norm in it", &mut integer(power, 1..=8));
    }
}

impl Mitigation for Spectral {
    fn name(&self) -> &'static str {
        "spectral"
    }

    fn summary(&self) -> &'static str {
        "the loss draws the largest singular values to 1 (Lewandowski et al. 2024)"
    }

    fn number(&self) -> u16 {
        14
    }

    fn penalty(&self, network: &Network) -> Option<Arc<dyn Penalty>> {
        let layers = network.towers().iter().flat_map(|tower| tower.mlp.blocks()).cloned().collect();
        Some(Arc::new(SpectralPenalty { settings: self.clone(), layers }))
    }

    fn boxed(&self) -> Box<dyn Mitigation> {
        Box::new(self.clone())
    }
}

/// The penalty of a network.
#[derive(Debug)]
struct SpectralPenalty {
    settings: Spectral,
    layers: Vec<Block>,
}

impl Penalty for SpectralPenalty {
    fn add_to(&self, gradient: &mut [f32], agent: &mut AgentState) {
        let AgentState { parameters, kept, .. } = agent;
        let vectors = kept.lists.entry(VECTORS.to_owned()).or_default();
        if vectors.len() != self.layers.iter().map(|layer| layer.width).sum::<usize>() {
            let begin = |layer: &Block| vec![1.0 / (layer.width as f32).sqrt(); layer.width];
            *vectors = self.layers.iter().flat_map(begin).collect();
        }
        let mut rest = vectors.as_mut_slice();
        for layer in &self.layers {
            let u = rest.split_off_mut(..layer.width).unwrap_or_default();
            self.add_of_weight(&parameters[layer.weight.clone()], u, &mut gradient[layer.weight.clone()]);
            self.add_of_bias(&parameters[layer.bias.clone()], &mut gradient[layer.bias.clone()]);
        }
    }
}

impl SpectralPenalty {
    /// Adds 2λk(σᵏ − 1)σᵏ⁻¹ uvᵀ, after one power iteration. Weight and gradient are `[inputs, units]`, u is `[units]`.
    fn add_of_weight(&self, weight: &[f32], u: &mut [f32], gradient: &mut [f32]) {
        let (mut v, mut product) = (vec![0.0; weight.len() / u.len()], vec![0.0; u.len()]);
        bit_mlp::there_and_back(weight, u, &mut v, &mut product);
        let length = norm(&v);
        let sigma = norm(&product) / length;
        if !(sigma.is_finite() && sigma > 0.0) {
            return;
        }
        u.iter_mut().zip(&product).for_each(|(u, p)| *u = p / (length * sigma));
        let (k, power) = (self.settings.power as f32, self.settings.power as i32);
        let slope = 2.0 * k * (sigma.powi(power) - 1.0) * sigma.powi(power - 1);
        bit_mlp::add_outer(gradient, self.settings.coefficient as f32 * slope / length, &v, u);
    }

    /// Adds 2λk‖b‖²ᵏ⁻² b.
    fn add_of_bias(&self, bias: &[f32], gradient: &mut [f32]) {
        let power = self.settings.power as i32;
        let factor = 2.0 * (self.settings.coefficient * f64::from(power)) as f32 * norm(bias).powi(2 * power - 2);
        gradient.iter_mut().zip(bias).for_each(|(g, b)| *g += factor * b);
    }
}
