//! Penalties that pull parameters towards a point, and how strongly they pull.

use pulp::{Arch, Simd, WithSimd};

use crate::adam::{Decayed, SumSquares};

/// The penalty `½ λ ‖θ − θ₀‖²` of a loss, over the covered parameters: its gradient `λ (θ − θ₀)`
/// pulls them towards the anchor θ₀.
///
/// With the initial parameters as the anchor this is L2-Init (Kumar et al., 2023,
/// <https://arxiv.org/abs/2308.11958>).
#[derive(Clone, Copy, Debug)]
pub struct Pull<'a> {
    /// λ.
    pub coefficient: f64,
    /// θ₀, flat like the parameters; `None` stands for zeros.
    pub anchor: Option<&'a [f32]>,
    /// The parameters that are pulled.
    pub covered: Decayed<'a>,
}

/// Norms of the two parts of the gradient of a loss with a penalty.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GradientNorms {
    /// ‖g‖₂ of the gradient of the loss proper.
    pub loss: f32,
    /// ‖λ (θ − θ₀)‖₂ over the covered parameters.
    pub penalty: f32,
}

/// How much of a gradient is the penalty's: the norms of `grads`, without the pull, and of the pull.
///
/// # Panics
/// As [`Pull::norm`].
pub fn gradient_norms(params: &[f32], grads: &[f32], pull: Pull<'_>) -> GradientNorms {
    let loss = Arch::new().dispatch(SumSquares { values: grads, added: None }).sqrt();
    GradientNorms { loss, penalty: pull.norm(params) }
}

impl Pull<'_> {
    /// Adds `λ (θ − θ₀)` to the gradient, as if the loss had the penalty. A clipping that follows
    /// sees both.
    ///
    /// # Panics
    /// If the lengths differ.
    pub fn add_to(&self, grads: &mut [f32], params: &[f32]) {
        self.check_anchor(params);
        assert_eq!(grads.len(), params.len(), "parameters and gradient have one length");
        let arch = Arch::new();
        self.covered.for_each_part(params.len(), |part, covered| {
            if covered {
                arch.dispatch(AddPull {
                    coefficient: self.coefficient as f32,
                    params: &params[part.clone()],
                    anchor: self.anchor.map(|anchor| &anchor[part.clone()]),
                    grads: &mut grads[part],
                });
            }
        });
    }

    /// The norm of what [`add_to`](Self::add_to) adds, `‖λ (θ − θ₀)‖₂`.
    ///
    /// # Panics
    /// If the anchor has another length than the parameters.
    pub fn norm(&self, params: &[f32]) -> f32 {
        self.check_anchor(params);
        let arch = Arch::new();
        let mut sum = 0.0;
        self.covered.for_each_part(params.len(), |part, covered| {
            if covered {
                let added = self.anchor.map(|anchor| (-1.0, &anchor[part.clone()]));
                sum += arch.dispatch(SumSquares { values: &params[part], added });
            }
        });
        self.coefficient as f32 * sum.sqrt()
    }

    fn check_anchor(&self, params: &[f32]) {
        assert!(
            self.anchor.is_none_or(|anchor| anchor.len() == params.len()),
            "parameters and their anchor have one length"
        );
    }
}

/// `grads ← grads + coefficient · (params − anchor)`.
struct AddPull<'a> {
    coefficient: f32,
    params: &'a [f32],
    anchor: Option<&'a [f32]>,
    grads: &'a mut [f32],
}

impl WithSimd for AddPull<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let coefficient = simd.splat_f32s(self.coefficient);
        let (grads, grads_tail) = S::as_mut_simd_f32s(self.grads);
        let (params, params_tail) = S::as_simd_f32s(self.params);
        let (mut param, grad) = (simd.partial_load_f32s(params_tail), simd.partial_load_f32s(grads_tail));
        if let Some(anchor) = self.anchor {
            let (anchors, anchors_tail) = S::as_simd_f32s(anchor);
            for ((grad, &param), &anchor) in grads.iter_mut().zip(params).zip(anchors) {
                *grad = simd.mul_add_e_f32s(coefficient, simd.sub_f32s(param, anchor), *grad);
            }
            param = simd.sub_f32s(param, simd.partial_load_f32s(anchors_tail));
        } else {
            for (grad, &param) in grads.iter_mut().zip(params) {
                *grad = simd.mul_add_e_f32s(coefficient, param, *grad);
            }
        }
        simd.partial_store_f32s(grads_tail, simd.mul_add_e_f32s(coefficient, param, grad));
    }
}
