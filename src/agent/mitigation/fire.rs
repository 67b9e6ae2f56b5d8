//! FIRE: weights are made orthogonal at each switch of levels (Han et al. 2026, "FIRE: Frobenius-Isometry
//! Reinitialization for Balancing the Stability-Plasticity Tradeoff").

use nalgebra::{DMatrix, DMatrixView};

use super::hooks::Mitigation;
use super::patient::Patient;
use crate::config::{Settings, Visitor, integer};

/// W ← √(units/inputs) · W(WᵀW)^(−½) in every layer at every switch, by Newton–Schulz iterations.
///
/// W is `[units, inputs]`, or its transpose where that has fewer columns than rows. X = W/‖W‖_F, then
/// X ← 1.5 X − 0.5 X(XᵀX) so many times. As in the authors' code ten iterations are not the limit: singular values
/// much smaller than ‖W‖_F do not reach 1. Biases and norms stay, and so does Adam's state; DQN's target network becomes
/// a copy.
#[derive(Clone, Debug, PartialEq)]
pub struct Fire {
    /// Newton–Schulz iterations.
    iterations: u32,
}

impl Default for Fire {
    fn default() -> Self {
        Self { iterations: 10 }
    }
}

impl Settings for Fire {
    fn visit(&mut self, v: &mut dyn Visitor) {
        let doc = "Newton–Schulz iterations that make the weights orthogonal at a switch";
        v.field("fire_iterations", doc, &mut integer(&mut self.iterations, 1..=1000));
    }
}

impl Mitigation for Fire {
    fn name(&self) -> &'static str {
        "fire"
    }

    fn summary(&self) -> &'static str {
        "at a switch the weights are made orthogonal (Han et al. 2026)"
    }

    fn number(&self) -> u16 {
        17
    }

    fn at_switch(&self, patient: &mut Patient<'_>) {
        let network = patient.network;
        for block in network.towers().iter().flat_map(|tower| tower.mlp.blocks()) {
            let weight = &mut patient.agent.parameters[block.weight.clone()];
            let isometry = self.isometry(DMatrixView::from_slice(weight, block.width, block.inputs).map(f64::from));
            let scale = (block.width as f64 / block.inputs as f64).sqrt();
            weight.iter_mut().zip(isometry.iter()).for_each(|(weight, x)| *weight = (scale * x) as f32);
        }
        patient.agent.renew(patient.copies);
    }

    fn boxed(&self) -> Box<dyn Mitigation> {
        Box::new(self.clone())
    }
}

impl Fire {
    /// What the iterations make of W, `[units, inputs]`. Of zeros it makes zeros.
    fn isometry(&self, weight: DMatrix<f64>) -> DMatrix<f64> {
        let is_wide = weight.ncols() > weight.nrows();
        let norm = weight.norm();
        if norm == 0.0 {
            return weight;
        }
        let mut x = if is_wide { weight.transpose() } else { weight } / norm;
        for _ in 0..self.iterations {
            let gram = x.tr_mul(&x);
            x = &x * 1.5 - &x * gram * 0.5;
        }
        if is_wide { x.transpose() } else { x }
    }
}
