//! Activations and their derivatives, on whole slices.

use pulp::{Arch, Simd, WithSimd};

use crate::block::Activation;
use crate::buffer::padded;

/// Replaces every value by its hyperbolic tangent, to within 3 units in the last place; NaN stays
/// NaN.
pub fn tanh_in_place(values: &mut [f32]) {
    Arch::new().dispatch(Activate { activation: Activation::Tanh, values });
}

/// tanh |x| = t / (t + 2) with t = e^(2 |x|) − 1.
///
/// The form keeps every digit: for small x since t is computed without its 1, for large x since an
/// error of t cancels in the quotient, which never exceeds 1. With 2 |x| = n ln 2 + r and |r| ≤ ½
/// ln 2, t = 2ⁿ (eʳ − 1) + (2ⁿ − 1).
#[inline(always)]
fn tanh<S: Simd>(simd: S, x: S::f32s) -> S::f32s {
    let magnitude = simd.abs_f32s(x);
    // Not `min`, which loses NaN on some machines.
    let limit = simd.splat_f32s(SATURATION);
    let saturated = simd.greater_than_f32s(magnitude, limit);
    let magnitude = simd.select_f32s(saturated, limit, magnitude);
    let y = simd.add_f32s(magnitude, magnitude);

    // The sum rounds y / ln 2 to the integer n, and has n plus a float's exponent bias in its
    // lowest bits.
    let round = simd.splat_f32s(ROUND);
    let shifted = simd.mul_add_e_f32s(y, simd.splat_f32s(std::f32::consts::LOG2_E), round);
    let n = simd.sub_f32s(shifted, round);
    let power = simd.wrapping_dyn_shl_u32s(simd.transmute_u32s_f32s(shifted), simd.splat_u32s(23));
    let power = simd.transmute_f32s_u32s(power);
    let r = simd.negate_mul_add_e_f32s(n, simd.splat_f32s(LN_2_HIGH), y);
    let r = simd.negate_mul_add_e_f32s(n, simd.splat_f32s(LN_2_LOW), r);

    let [lower @ .., highest] = EXP_M1;
    let mut polynomial = simd.splat_f32s(highest);
    for coefficient in lower.into_iter().rev() {
        polynomial = simd.mul_add_e_f32s(polynomial, r, simd.splat_f32s(coefficient));
    }
    let exp_m1 = simd.mul_add_e_f32s(simd.mul_f32s(r, r), polynomial, r);
    let t = simd.mul_add_e_f32s(power, exp_m1, simd.sub_f32s(power, simd.splat_f32s(1.0)));
    let quotient = simd.div_f32s(t, simd.add_f32s(t, simd.splat_f32s(2.0)));
    simd.or_f32s(quotient, simd.and_f32s(x, simd.splat_f32s(-0.0)))
}

/// Beyond it tanh is 1 in `f32`: 1 − tanh(13 ln 2) ≈ 2⁻²⁵, half the distance from 1 to its
/// neighbour below.
const SATURATION: f32 = 9.1;

/// Numbers near 1.5 · 2²³ have no fractional bits; 127 is the bias of a float's exponent.
const ROUND: f32 = 12_582_912.0 + 127.0;

/// ln 2 in two parts; the products of the first, which has few bits, with n ≤ 27 are exact.
const LN_2_HIGH: f32 = 355.0 / 512.0;
const LN_2_LOW: f32 = -2.121_944_4e-4;

/// eʳ − 1 ≈ r + r² · Σ c_k rᵏ on |r| ≤ ½ ln 2, with the least relative error, 2⁻²⁶: an iteratively
/// reweighted least-squares fit in 40 digits.
const EXP_M1: [f32; 5] = [0.499_999_98, 0.166_665_44, 0.041_667_2, 8.366_514e-3, 1.388_252e-3];

#[inline(always)]
fn relu<S: Simd>(simd: S, x: S::f32s) -> S::f32s {
    // Not `max`, which turns NaN into 0 on some machines.
    let zero = simd.splat_f32s(0.0);
    simd.select_f32s(simd.less_than_f32s(x, zero), zero, x)
}

/// Replaces every value by its activation: CReLU is ReLU of what [`Mirror`] makes.
pub(crate) struct Activate<'a> {
    pub(crate) activation: Activation,
    pub(crate) values: &'a mut [f32],
}

impl WithSimd for Activate<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let (vectors, tail) = S::as_mut_simd_f32s(self.values);
        for vector in vectors {
            *vector = activate(simd, self.activation, *vector);
        }
        let last = activate(simd, self.activation, simd.partial_load_f32s(tail));
        simd.partial_store_f32s(tail, last);
    }
}

#[inline(always)]
fn activate<S: Simd>(simd: S, activation: Activation, x: S::f32s) -> S::f32s {
    match activation {
        Activation::Tanh => tanh(simd, x),
        Activation::Relu | Activation::Crelu => relu(simd, x),
    }
}

/// Writes `[x, −x]` to `out` for every row `x` of `values`; `values` `[B, padded(width)]`, `out` `[B,
/// padded(2 · width)]`.
pub(crate) struct Mirror<'a> {
    pub(crate) values: &'a [f32],
    pub(crate) width: usize,
    pub(crate) out: &'a mut [f32],
}

impl WithSimd for Mirror<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let width = self.width;
        let rows = self.values.chunks_exact(padded(width)).zip(self.out.chunks_exact_mut(padded(2 * width)));
        for (values, out) in rows {
            let (same, rest) = out.split_at_mut(width);
            same.copy_from_slice(&values[..width]);
            let (from, from_tail) = S::as_simd_f32s(&values[..width]);
            let (to, to_tail) = S::as_mut_simd_f32s(&mut rest[..width]);
            for (to, &x) in to.iter_mut().zip(from) {
                *to = simd.neg_f32s(x);
            }
            simd.partial_store_f32s(to_tail, simd.neg_f32s(simd.partial_load_f32s(from_tail)));
        }
    }
}

/// The gradient of [`Mirror`]: `out = a − b` for every row `[a, b]` of `gradients`; `gradients` `[B,
/// padded(2 · width)]`, `out` `[B, padded(width)]`.
pub(crate) struct MirrorGradient<'a> {
    pub(crate) gradients: &'a [f32],
    pub(crate) width: usize,
    pub(crate) out: &'a mut [f32],
}

impl WithSimd for MirrorGradient<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let width = self.width;
        let rows = self.gradients.chunks_exact(padded(2 * width)).zip(self.out.chunks_exact_mut(padded(width)));
        for (gradients, out) in rows {
            let (a, a_tail) = S::as_simd_f32s(&gradients[..width]);
            let (b, b_tail) = S::as_simd_f32s(&gradients[width..2 * width]);
            let (out, out_tail) = S::as_mut_simd_f32s(&mut out[..width]);
            for ((out, &a), &b) in out.iter_mut().zip(a).zip(b) {
                *out = simd.sub_f32s(a, b);
            }
            let last = simd.sub_f32s(simd.partial_load_f32s(a_tail), simd.partial_load_f32s(b_tail));
            simd.partial_store_f32s(out_tail, last);
        }
    }
}

/// Multiplies the loss gradients of activated values by the activation's derivative: the gradients
/// before activation.
///
/// The derivative is taken from the activated values: 1 − tanh², and 1 where ReLU let something
/// through.
pub(crate) struct Differentiate<'a> {
    pub(crate) activation: Activation,
    pub(crate) activated: &'a [f32],
    pub(crate) gradients: &'a mut [f32],
}

impl WithSimd for Differentiate<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let (gradients, _) = S::as_mut_simd_f32s(self.gradients);
        let (activated, _) = S::as_simd_f32s(self.activated);
        let zero = simd.splat_f32s(0.0);
        for (gradient, &y) in gradients.iter_mut().zip(activated) {
            *gradient = match self.activation {
                Activation::Tanh => {
                    let slope = simd.negate_mul_add_e_f32s(y, y, simd.splat_f32s(1.0));
                    simd.mul_f32s(*gradient, slope)
                }
                Activation::Relu | Activation::Crelu => {
                    simd.select_f32s(simd.greater_than_f32s(y, zero), *gradient, zero)
                }
            };
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Error in units of the last place of the result.
    fn ulps(x: f32, ours: f32) -> f64 {
        let exact = f64::from(x).tanh();
        let rounded = (exact as f32).abs();
        let unit = f64::from(rounded.next_up()) - f64::from(rounded);
        (f64::from(ours) - exact).abs() / unit
    }

    /// Every 397th float, so that all exponents and the subnormal numbers occur.
    fn sweep(arch: Arch) -> f64 {
        let mut worst = 0.0_f64;
        let mut bits = (0..=f32::INFINITY.to_bits()).step_by(397).map(f32::from_bits);
        loop {
            let inputs: Vec<f32> = bits.by_ref().take(4096).flat_map(|x| [x, -x]).collect();
            if inputs.is_empty() {
                return worst;
            }
            let mut values = inputs.clone();
            arch.dispatch(Activate { activation: Activation::Tanh, values: &mut values });
            for (&x, &y) in inputs.iter().zip(&values) {
                assert!(y.abs() <= 1.0, "tanh({x}) = {y}");
                worst = worst.max(ulps(x, y));
            }
        }
    }

    #[test]
    fn tanh_is_accurate_everywhere() {
        for arch in [Arch::new(), Arch::Scalar] {
            let worst = sweep(arch);
            println!("{worst:.2} ulp");
            assert!(worst <= 3.0, "{worst} ulp");
        }
    }

    #[test]
    fn tanh_of_the_extremes() {
        let mut values = [0.0, -0.0, 1e-45, -3e-39, 1e-20, 9.5, -9.5, f32::MAX, f32::INFINITY, f32::NEG_INFINITY];
        tanh_in_place(&mut values);
        assert_eq!(values, [0.0, -0.0, 1e-45, -3e-39, 1e-20, 1.0, -1.0, 1.0, 1.0, -1.0]);
        assert!(values[1].is_sign_negative());
        let mut values = [f32::NAN; 21];
        tanh_in_place(&mut values);
        assert!(values.iter().all(|value| value.is_nan()));
    }
}
