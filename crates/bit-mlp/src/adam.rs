//! Clipping by the global norm and Adam, as PyTorch computes them, in two passes over the flat
//! parameters.

use std::ops::Range;

use pulp::{Arch, Simd, WithSimd};

/// Hyperparameters of Adam (Kingma & Ba, 2015, <https://arxiv.org/abs/1412.6980>), with PyTorch's
/// names and defaults.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AdamConfig {
    /// Learning rate.
    pub lr: f64,
    /// Decay of the mean of the gradients.
    pub beta1: f64,
    /// Decay of the mean of the squared gradients.
    pub beta2: f64,
    /// Added to the root in the denominator; at least 10⁻¹².
    pub eps: f64,
    /// How weights decay.
    pub decay: Decay,
}

impl Default for AdamConfig {
    fn default() -> Self {
        Self { lr: 1e-3, beta1: 0.9, beta2: 0.999, eps: 1e-8, decay: Decay::None }
    }
}

/// Where a decay of strength λ enters a step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Decay {
    /// Nowhere.
    None,
    /// `θ ← (1 − lr λ) θ` before the step, outside of the gradient: `torch.optim.AdamW` (Loshchilov
    /// & Hutter, 2019).
    Decoupled(f64),
    /// `λθ` is added to the gradient after clipping: `torch.optim.Adam(weight_decay=λ)`.
    Coupled(f64),
    /// `λθ` is added to the gradient before clipping, as if the loss had the term `½ λ ‖θ‖²`; the
    /// norm includes it.
    InLoss(f64),
}

/// Which parameters decay, or are [pulled](crate::Pull).
#[derive(Clone, Copy, Debug)]
pub enum Decayed<'a> {
    /// All, as PyTorch's optimisers do unless they are given groups.
    All,
    /// Those in these ranges of the flat slice, ascending and apart; of weights only, say.
    Only(&'a [Range<usize>]),
}

/// Adam's state: two flat slices as long as the parameters, zeros before the first step, and the
/// number of the step.
#[derive(Debug)]
pub struct Moments<'a> {
    /// Running mean of the gradients.
    pub exp_avg: &'a mut [f32],
    /// Running mean of the squared gradients.
    pub exp_avg_sq: &'a mut [f32],
    /// The number of the step to make, 1 for the first.
    pub step: u64,
}

/// Clips the gradient to a norm and makes one step of Adam. Returns the norm before clipping.
///
/// With `g` the gradient, all of one length:
/// ```text
/// g ← g · min(1, max_grad_norm / (‖g‖₂ + 10⁻⁶))       torch.nn.utils.clip_grad_norm_; f32::INFINITY: no clipping
/// m ← β₁ m + (1 − β₁) g                               exp_avg
/// v ← β₂ v + (1 − β₂) g²                              exp_avg_sq
/// θ ← θ − lr / (1 − β₁ᵗ) · m / (√v / √(1 − β₂ᵗ) + ε)  t = step
/// ```
/// and the decay where [`Decay`] says. One deviation from PyTorch: moments below 10⁻³⁶ become 0.
/// Those of an input that is no longer active would otherwise fade into subnormal numbers, with
/// which processors are many times slower.
///
/// If the norm is not finite, **nothing is changed**: the caller is told by the result, and still
/// has its last good state.
///
/// # Panics
/// If the lengths differ or the step is 0.
pub fn clip_and_adam(
    params: &mut [f32],
    grads: &[f32],
    moments: Moments<'_>,
    max_grad_norm: f32,
    decayed: Decayed<'_>,
    config: &AdamConfig,
) -> f32 {
    let Moments { exp_avg, exp_avg_sq, step } = moments;
    assert!(step > 0, "Adam counts its steps from 1");
    assert!(
        [grads.len(), exp_avg.len(), exp_avg_sq.len()].iter().all(|&len| len == params.len()),
        "parameters, gradient and moments have one length"
    );
    let arch = Arch::new();

    let in_loss = if let Decay::InLoss(lambda) = config.decay { lambda as f32 } else { 0.0 };
    let mut sum = 0.0;
    decayed.for_each_part(params.len(), |part, decays| {
        let added = (decays && in_loss != 0.0).then_some((in_loss, &params[part.clone()]));
        sum += arch.dispatch(SumSquares { values: &grads[part], added });
    });
    let norm = sum.sqrt();
    if !norm.is_finite() {
        return norm;
    }

    let coefficient = (max_grad_norm / (norm + 1e-6)).min(1.0);
    let plain = Constants::new(config, step, coefficient);
    let decaying = plain.with(config, coefficient);
    decayed.for_each_part(params.len(), |part, decays| {
        arch.dispatch(Step {
            constants: if decays { decaying } else { plain },
            params: &mut params[part.clone()],
            grads: &grads[part.clone()],
            exp_avg: &mut exp_avg[part.clone()],
            exp_avg_sq: &mut exp_avg_sq[part],
        });
    });
    norm
}

impl Decayed<'_> {
    /// Calls `f` with consecutive parts of `0..len`, and whether the part decays.
    pub(crate) fn for_each_part(self, len: usize, mut f: impl FnMut(Range<usize>, bool)) {
        let ranges = match self {
            Decayed::All => return f(0..len, true),
            Decayed::Only(ranges) => ranges,
        };
        let mut next = 0;
        for range in ranges {
            assert!(
                next <= range.start,
                "the ranges of decayed parameters must be ascending and apart, got {ranges:?}"
            );
            f(next..range.start, false);
            f(range.clone(), true);
            next = range.end;
        }
        f(next..len, false);
    }
}

/// `Σ (values + scale · other)²`, with `(scale, other)` = `added`.
pub(crate) struct SumSquares<'a> {
    pub(crate) values: &'a [f32],
    pub(crate) added: Option<(f32, &'a [f32])>,
}

impl WithSimd for SumSquares<'_> {
    type Output = f32;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> f32 {
        // Independent partial sums, to hide the latency of an addition.
        const PARTS: usize = 4;
        let mut sums = [simd.splat_f32s(0.0); PARTS];
        let (vectors, tail) = S::as_simd_f32s(self.values);
        let tail = simd.partial_load_f32s(tail);
        if let Some((scale, other)) = self.added {
            let scale = simd.splat_f32s(scale);
            let (others, other_tail) = S::as_simd_f32s(other);
            for (index, (&x, &y)) in vectors.iter().zip(others).enumerate() {
                let x = simd.mul_add_e_f32s(scale, y, x);
                sums[index % PARTS] = simd.mul_add_e_f32s(x, x, sums[index % PARTS]);
            }
            let x = simd.mul_add_e_f32s(scale, simd.partial_load_f32s(other_tail), tail);
            sums[0] = simd.mul_add_e_f32s(x, x, sums[0]);
        } else {
            let (blocks, rest) = vectors.as_chunks::<PARTS>();
            for block in blocks {
                for (sum, &x) in sums.iter_mut().zip(block) {
                    *sum = simd.mul_add_e_f32s(x, x, *sum);
                }
            }
            for &x in rest.iter().chain([&tail]) {
                sums[0] = simd.mul_add_e_f32s(x, x, sums[0]);
            }
        }
        let [a, b, c, d] = sums;
        simd.reduce_sum_f32s(simd.add_f32s(simd.add_f32s(a, b), simd.add_f32s(c, d)))
    }
}

/// The numbers that a step has in common for all parameters.
#[derive(Clone, Copy)]
struct Constants {
    /// The gradient of a parameter is `gradient · g + penalty · θ`.
    gradient: f32,
    penalty: f32,
    /// What decoupled decay leaves of a parameter.
    keep: f32,
    /// 1 − β₁
    one_minus_beta1: f32,
    beta2: f32,
    /// 1 − β₂
    one_minus_beta2: f32,
    /// 1 / √(1 − β₂ᵗ)
    root_scale: f32,
    eps: f32,
    /// lr / (1 − β₁ᵗ)
    step_size: f32,
}

impl Constants {
    /// Those of a parameter that does not decay. In `f64`, as PyTorch: 1 − 0.999 has few digits
    /// left in `f32`.
    fn new(config: &AdamConfig, step: u64, coefficient: f32) -> Self {
        let AdamConfig { lr, beta1, beta2, eps, .. } = *config;
        Self {
            gradient: coefficient,
            penalty: 0.0,
            keep: 1.0,
            one_minus_beta1: (1.0 - beta1) as f32,
            beta2: beta2 as f32,
            one_minus_beta2: (1.0 - beta2) as f32,
            root_scale: (1.0 / (1.0 - beta2.powf(step as f64)).sqrt()) as f32,
            eps: eps as f32,
            step_size: (lr / (1.0 - beta1.powf(step as f64))) as f32,
        }
    }

    /// The same for a parameter that decays.
    fn with(self, config: &AdamConfig, coefficient: f32) -> Self {
        match config.decay {
            Decay::None => self,
            Decay::Decoupled(lambda) => Self { keep: (1.0 - config.lr * lambda) as f32, ..self },
            Decay::Coupled(lambda) => Self { penalty: lambda as f32, ..self },
            Decay::InLoss(lambda) => Self { penalty: coefficient * lambda as f32, ..self },
        }
    }
}

/// Moments below this become 0.
const NEGLIGIBLE: f32 = 1e-36;

struct Step<'a> {
    constants: Constants,
    params: &'a mut [f32],
    grads: &'a [f32],
    exp_avg: &'a mut [f32],
    exp_avg_sq: &'a mut [f32],
}

impl WithSimd for Step<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let (params, params_tail) = S::as_mut_simd_f32s(self.params);
        let (grads, grads_tail) = S::as_simd_f32s(self.grads);
        let (means, means_tail) = S::as_mut_simd_f32s(self.exp_avg);
        let (squares, squares_tail) = S::as_mut_simd_f32s(self.exp_avg_sq);
        for (((param, &grad), mean), square) in params.iter_mut().zip(grads).zip(means).zip(squares) {
            self.constants.step(simd, param, grad, mean, square);
        }
        let mut param = simd.partial_load_f32s(params_tail);
        let mut mean = simd.partial_load_f32s(means_tail);
        let mut square = simd.partial_load_f32s(squares_tail);
        let grad = simd.partial_load_f32s(grads_tail);
        self.constants.step(simd, &mut param, grad, &mut mean, &mut square);
        simd.partial_store_f32s(params_tail, param);
        simd.partial_store_f32s(means_tail, mean);
        simd.partial_store_f32s(squares_tail, square);
    }
}

impl Constants {
    /// The step of one vector of parameters.
    #[inline(always)]
    fn step<S: Simd>(&self, simd: S, param: &mut S::f32s, grad: S::f32s, mean: &mut S::f32s, square: &mut S::f32s) {
        let penalty = simd.mul_f32s(simd.splat_f32s(self.penalty), *param);
        let grad = simd.mul_add_e_f32s(simd.splat_f32s(self.gradient), grad, penalty);

        let change = simd.sub_f32s(grad, *mean);
        let new_mean = simd.mul_add_e_f32s(simd.splat_f32s(self.one_minus_beta1), change, *mean);
        let grad_sq = simd.mul_f32s(grad, grad);
        let kept_square = simd.mul_f32s(simd.splat_f32s(self.beta2), *square);
        let one_minus_beta2 = simd.splat_f32s(self.one_minus_beta2);
        let new_square = simd.mul_add_e_f32s(one_minus_beta2, grad_sq, kept_square);
        let kept = simd.mul_f32s(simd.splat_f32s(self.keep), *param);

        *mean = flush(simd, new_mean);
        *square = flush(simd, new_square);

        // Most inputs are inactive on most maps; the root and the quotient are what takes time.
        let still = simd.equal_f32s(*mean, simd.splat_f32s(0.0));
        if simd.first_true_m32s(simd.not_m32s(still)) == S::F32_LANES {
            *param = kept;
            return;
        }
        let root = simd.sqrt_f32s(*square);
        let scale = simd.splat_f32s(self.root_scale);
        let denominator = simd.mul_add_e_f32s(root, scale, simd.splat_f32s(self.eps));
        let ratio = simd.div_f32s(*mean, denominator);
        *param = simd.negate_mul_add_e_f32s(simd.splat_f32s(self.step_size), ratio, kept);
    }
}

/// `moment`, or 0 where it is negligible.
#[inline(always)]
fn flush<S: Simd>(simd: S, moment: S::f32s) -> S::f32s {
    let negligible = simd.less_than_f32s(simd.abs_f32s(moment), simd.splat_f32s(NEGLIGIBLE));
    simd.select_f32s(negligible, simd.splat_f32s(0.0), moment)
}
