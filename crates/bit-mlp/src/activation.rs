//! Activations and their derivatives, on whole slices.

use pulp::{Arch, Simd, WithSimd};

use crate::block::{Pair, Single};
use crate::buffer::padded;

/// Replaces every value by its hyperbolic tangent, to within 3 units in the last place; NaN stays
/// NaN.
pub fn tanh_in_place(values: &mut [f32]) {
    Arch::new().dispatch(Activate { activation: Single::Tanh, values });
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
    let round = simd.splat_f32s(ROUND + 127.0);
    let shifted = simd.mul_add_e_f32s(y, simd.splat_f32s(std::f32::consts::LOG2_E), round);
    let n = simd.sub_f32s(shifted, round);
    let power = simd.wrapping_dyn_shl_u32s(simd.transmute_u32s_f32s(shifted), simd.splat_u32s(23));
    let power = simd.transmute_f32s_u32s(power);
    let r = simd.negate_mul_add_e_f32s(n, simd.splat_f32s(LN_2_HIGH), y);
    let r = simd.negate_mul_add_e_f32s(n, simd.splat_f32s(LN_2_LOW), r);

    let exp_m1 = simd.mul_add_e_f32s(simd.mul_f32s(r, r), polynomial(simd, &EXP_M1, r), r);
    let t = simd.mul_add_e_f32s(power, exp_m1, simd.sub_f32s(power, simd.splat_f32s(1.0)));
    let quotient = simd.div_f32s(t, simd.add_f32s(t, simd.splat_f32s(2.0)));
    simd.or_f32s(quotient, simd.and_f32s(x, simd.splat_f32s(-0.0)))
}

/// Beyond it tanh is 1 in `f32`: 1 − tanh(13 ln 2) ≈ 2⁻²⁵, half the distance from 1 to its
/// neighbour below.
const SATURATION: f32 = 9.1;

/// Numbers near 1.5 · 2²³ have no fractional bits.
const ROUND: f32 = 12_582_912.0;

/// ln 2 in two parts; the products of the first, which has few bits, with n ≤ 27 are exact.
const LN_2_HIGH: f32 = 355.0 / 512.0;
const LN_2_LOW: f32 = -2.121_944_4e-4;

/// eʳ − 1 ≈ r + r² · Σ c_k rᵏ on |r| ≤ ½ ln 2, with the least relative error, 2⁻²⁶: an iteratively
/// reweighted least-squares fit in 40 digits.
const EXP_M1: [f32; 5] = [0.499_999_98, 0.166_665_44, 0.041_667_2, 8.366_514e-3, 1.388_252e-3];

/// Σ c_k xᵏ, by Horner's rule.
#[inline(always)]
fn polynomial<S: Simd, const N: usize>(simd: S, coefficients: &[f32; N], x: S::f32s) -> S::f32s {
    let mut sum = simd.splat_f32s(coefficients[N - 1]);
    for &coefficient in coefficients[..N - 1].iter().rev() {
        sum = simd.mul_add_e_f32s(sum, x, simd.splat_f32s(coefficient));
    }
    sum
}

/// `[sin x, cos x]`, to within 3 units in the last place.
///
/// With x = n π/2 + r and |r| ≤ π/4 they are, but for their signs, sin r and cos r where n is even, and cos r and sin r
/// where it is odd (Cody & Waite, 1980, "Software Manual for the Elementary Functions").
#[inline(always)]
fn sin_cos<S: Simd>(simd: S, x: S::f32s) -> [S::f32s; 2] {
    // The sum rounds x / (π/2) to the integer n, and has n in its lowest bits.
    let round = simd.splat_f32s(ROUND);
    let shifted = simd.mul_add_e_f32s(x, simd.splat_f32s(std::f32::consts::FRAC_2_PI), round);
    let n = simd.sub_f32s(shifted, round);
    let quarters = simd.transmute_u32s_f32s(shifted);
    let mut r = x;
    for part in HALF_PI {
        r = simd.negate_mul_add_e_f32s(n, simd.splat_f32s(part), r);
    }

    let square = simd.mul_f32s(r, r);
    let sin_r = simd.mul_add_e_f32s(simd.mul_f32s(r, square), polynomial(simd, &SIN, square), r);
    let cos_r = simd.negate_mul_add_e_f32s(square, simd.splat_f32s(0.5), simd.splat_f32s(1.0));
    let cos_r = simd.mul_add_e_f32s(simd.mul_f32s(square, square), polynomial(simd, &COS, square), cos_r);

    let one = simd.splat_u32s(1);
    let odd = simd.equal_u32s(simd.and_u32s(quarters, one), one);
    let mut sin = negate_in_third_and_fourth(simd, quarters, simd.select_f32s(odd, cos_r, sin_r));
    let ahead = simd.add_u32s(quarters, one);
    let mut cos = negate_in_third_and_fourth(simd, ahead, simd.select_f32s(odd, sin_r, cos_r));

    let far = simd.greater_than_f32s(simd.abs_f32s(x), simd.splat_f32s(FAR));
    if simd.first_true_m32s(far) < S::F32_LANES {
        let (sin, cos) = (std::slice::from_mut(&mut sin), std::slice::from_mut(&mut cos));
        let x = bytemuck::cast_slice(std::slice::from_ref(&x));
        sin_cos_of_the_far(x, bytemuck::cast_slice_mut(sin), bytemuck::cast_slice_mut(cos));
    }
    [sin, cos]
}

/// −y in the third and the fourth of every four quarters of a turn.
#[inline(always)]
fn negate_in_third_and_fourth<S: Simd>(simd: S, quarters: S::u32s, y: S::f32s) -> S::f32s {
    let second_bit = simd.and_u32s(quarters, simd.splat_u32s(2));
    let sign = simd.wrapping_dyn_shl_u32s(second_bit, simd.splat_u32s(30));
    simd.xor_f32s(y, simd.transmute_f32s_u32s(sign))
}

/// Writes the sine and the cosine of every x beyond [`FAR`], of which an infinity has none: NaN.
#[cold]
fn sin_cos_of_the_far(x: &[f32], sin: &mut [f32], cos: &mut [f32]) {
    for ((&x, sin), cos) in x.iter().zip(sin).zip(cos) {
        if x.abs() > FAR {
            let exact = f64::from(x).sin_cos();
            (*sin, *cos) = (exact.0 as f32, exact.1 as f32);
        }
    }
}

/// As far as the products of n and the first parts of π/2 are exact: there n < 2¹³.
const FAR: f32 = 1e4;

/// π/2 in four parts, of which the first three have 11 bits each.
const HALF_PI: [f32; 4] = [1.570_312_5, 4.837_513e-4, 7.549_533_6e-8, 2.563_344e-12];

/// sin r ≈ r + r³ · Σ c_k r²ᵏ on |r| ≤ π/4, with a relative error of 2⁻²⁶·⁹ (Moshier, Cephes, `sinf`).
const SIN: [f32; 3] = [-0.166_666_55, 8.332_161e-3, -1.951_529_6e-4];

/// cos r ≈ 1 − ½ r² + r⁴ · Σ c_k r²ᵏ on |r| ≤ π/4, with an error of 2⁻³²·⁹ (Moshier, Cephes, `cosf`).
const COS: [f32; 3] = [4.166_664_6e-2, -1.388_731_6e-3, 2.443_315_7e-5];

#[inline(always)]
fn relu<S: Simd>(simd: S, x: S::f32s) -> S::f32s {
    // Not `max`, which turns NaN into 0 on some machines.
    let zero = simd.splat_f32s(0.0);
    simd.select_f32s(simd.less_than_f32s(x, zero), zero, x)
}

/// The gradient where ReLU let something through, given what it left.
#[inline(always)]
fn relu_gradient<S: Simd>(simd: S, activated: S::f32s, gradient: S::f32s) -> S::f32s {
    let zero = simd.splat_f32s(0.0);
    simd.select_f32s(simd.greater_than_f32s(activated, zero), gradient, zero)
}

/// Replaces every value by its activation.
pub(crate) struct Activate<'a> {
    pub(crate) activation: Single,
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
fn activate<S: Simd>(simd: S, activation: Single, x: S::f32s) -> S::f32s {
    match activation {
        Single::Tanh => tanh(simd, x),
        Single::Relu => relu(simd, x),
    }
}

/// Writes the two values of every unit to `out`: for each row of `values` all the first ones, then all the second ones.
/// `values` `[B, padded(width)]`, `out` `[B, padded(2 · width)]`.
pub(crate) struct ActivatePair<'a> {
    pub(crate) activation: Pair,
    pub(crate) values: &'a [f32],
    pub(crate) width: usize,
    pub(crate) out: &'a mut [f32],
}

impl WithSimd for ActivatePair<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let width = self.width;
        let rows = self.values.chunks_exact(padded(width)).zip(self.out.chunks_exact_mut(padded(2 * width)));
        for (values, out) in rows {
            let (first, second) = out.split_at_mut(width);
            let (x, x_tail) = S::as_simd_f32s(&values[..width]);
            let (first, first_tail) = S::as_mut_simd_f32s(first);
            let (second, second_tail) = S::as_mut_simd_f32s(&mut second[..width]);
            for ((&x, first), second) in x.iter().zip(first).zip(second) {
                [*first, *second] = activate_pair(simd, self.activation, x);
            }
            let [first, second] = activate_pair(simd, self.activation, simd.partial_load_f32s(x_tail));
            simd.partial_store_f32s(first_tail, first);
            simd.partial_store_f32s(second_tail, second);
        }
    }
}

#[inline(always)]
fn activate_pair<S: Simd>(simd: S, activation: Pair, x: S::f32s) -> [S::f32s; 2] {
    match activation {
        Pair::Crelu => [relu(simd, x), relu(simd, simd.neg_f32s(x))],
        Pair::Fourier => sin_cos(simd, x),
    }
}

/// The gradients before an activation that left two values: `out` `[B, padded(width)]` from the loss gradients of what
/// left it, `gradients`, and from that, `activated`, both `[B, padded(2 · width)]`.
pub(crate) struct DifferentiatePair<'a> {
    pub(crate) activation: Pair,
    pub(crate) activated: &'a [f32],
    pub(crate) gradients: &'a [f32],
    pub(crate) width: usize,
    pub(crate) out: &'a mut [f32],
}

impl WithSimd for DifferentiatePair<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let width = self.width;
        let both = self.activated.chunks_exact(padded(2 * width)).zip(self.gradients.chunks_exact(padded(2 * width)));
        for ((activated, gradients), out) in both.zip(self.out.chunks_exact_mut(padded(width))) {
            let (y, y_tail) = S::as_simd_f32s(&activated[..width]);
            let (z, z_tail) = S::as_simd_f32s(&activated[width..2 * width]);
            let (dy, dy_tail) = S::as_simd_f32s(&gradients[..width]);
            let (dz, dz_tail) = S::as_simd_f32s(&gradients[width..2 * width]);
            let (out, out_tail) = S::as_mut_simd_f32s(&mut out[..width]);
            for ((out, (&y, &z)), (&dy, &dz)) in out.iter_mut().zip(y.iter().zip(z)).zip(dy.iter().zip(dz)) {
                *out = differentiate_pair(simd, self.activation, [y, z], [dy, dz]);
            }
            let activated = [simd.partial_load_f32s(y_tail), simd.partial_load_f32s(z_tail)];
            let gradients = [simd.partial_load_f32s(dy_tail), simd.partial_load_f32s(dz_tail)];
            simd.partial_store_f32s(out_tail, differentiate_pair(simd, self.activation, activated, gradients));
        }
    }
}

#[inline(always)]
fn differentiate_pair<S: Simd>(simd: S, activation: Pair, [y, z]: [S::f32s; 2], [dy, dz]: [S::f32s; 2]) -> S::f32s {
    match activation {
        Pair::Crelu => simd.sub_f32s(relu_gradient(simd, y, dy), relu_gradient(simd, z, dz)),
        // The derivatives of y = sin x and z = cos x are z and −y.
        Pair::Fourier => simd.negate_mul_add_e_f32s(dz, y, simd.mul_f32s(dy, z)),
    }
}

/// Multiplies the loss gradients of activated values by the activation's derivative: the gradients
/// before activation.
///
/// The derivative is taken from the activated values: 1 − tanh², and 1 where ReLU let something
/// through.
pub(crate) struct Differentiate<'a> {
    pub(crate) activation: Single,
    pub(crate) activated: &'a [f32],
    pub(crate) gradients: &'a mut [f32],
}

impl WithSimd for Differentiate<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let (gradients, _) = S::as_mut_simd_f32s(self.gradients);
        let (activated, _) = S::as_simd_f32s(self.activated);
        for (gradient, &y) in gradients.iter_mut().zip(activated) {
            *gradient = match self.activation {
                Single::Tanh => {
                    let slope = simd.negate_mul_add_e_f32s(y, y, simd.splat_f32s(1.0));
                    simd.mul_f32s(*gradient, slope)
                }
                Single::Relu => relu_gradient(simd, y, *gradient),
            };
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Error in units of the last place of the result.
    fn ulps(exact: f64, ours: f32) -> f64 {
        let rounded = (exact as f32).abs();
        let unit = f64::from(rounded.next_up()) - f64::from(rounded);
        (f64::from(ours) - exact).abs() / unit
    }

    /// The largest error of `ours` against `exact` at these numbers and their negatives, for each of the K values.
    fn sweep<const K: usize>(
        inputs: impl Iterator<Item = f32>,
        exact: impl Fn(f64) -> [f64; K],
        ours: impl Fn(&[f32]) -> [Vec<f32>; K],
    ) -> [f64; K] {
        let mut worst = [0.0_f64; K];
        let mut inputs = inputs.flat_map(|x| [x, -x]);
        loop {
            let inputs: Vec<f32> = inputs.by_ref().take(8192).collect();
            if inputs.is_empty() {
                return worst;
            }
            let values = ours(&inputs);
            for (i, &x) in inputs.iter().enumerate() {
                for ((worst, exact), ours) in worst.iter_mut().zip(exact(f64::from(x))).zip(&values) {
                    assert!(ours[i].abs() <= 1.0, "{} instead of {exact} at {x}", ours[i]);
                    *worst = worst.max(ulps(exact, ours[i]));
                }
            }
        }
    }

    /// Every 397th number below this one, so that all exponents and the subnormal numbers occur.
    fn numbers_below(end: f32) -> impl Iterator<Item = f32> {
        (0..end.to_bits()).step_by(397).map(f32::from_bits)
    }

    /// Sines and cosines by these instructions.
    fn fourier(arch: Arch, values: &[f32]) -> [Vec<f32>; 2] {
        let width = values.len();
        let (mut row, mut out) = (values.to_vec(), vec![0.0; padded(2 * width)]);
        row.resize(padded(width), 0.0);
        arch.dispatch(ActivatePair { activation: Pair::Fourier, values: &row, width, out: &mut out });
        [out[..width].to_vec(), out[width..2 * width].to_vec()]
    }

    #[test]
    fn tanh_is_accurate_everywhere() {
        for arch in [Arch::new(), Arch::Scalar] {
            let ours = |inputs: &[f32]| {
                let mut values = inputs.to_vec();
                arch.dispatch(Activate { activation: Single::Tanh, values: &mut values });
                [values]
            };
            let [worst] = sweep(numbers_below(f32::INFINITY), |x| [x.tanh()], ours);
            println!("{worst:.2} ulp");
            assert!(worst <= 3.0, "{worst} ulp");
        }
    }

    #[test]
    fn sin_and_cos_are_accurate_everywhere() {
        for arch in [Arch::new(), Arch::Scalar] {
            let exact = |x: f64| [x.sin(), x.cos()];
            let worst = sweep(numbers_below(f32::INFINITY), exact, |inputs| fourier(arch, inputs));
            println!("{worst:.2?} ulp");
            assert!(worst.iter().all(|&worst| worst <= 3.0), "{worst:?} ulp");
            // Where one of the two is nearly 0, and where the fast way ends.
            let zeros = (1..7000).map(|n| (f64::from(n) * std::f64::consts::FRAC_PI_2) as f32);
            let near = zeros.flat_map(|x| [x.next_down(), x, x.next_up()]).chain([FAR, FAR.next_up()]);
            let worst = sweep(near, exact, |inputs| fourier(arch, inputs));
            println!("{worst:.2?} ulp near zeros");
            assert!(worst.iter().all(|&worst| worst <= 3.0), "{worst:?} ulp near zeros");
        }
    }

    #[test]
    fn sin_and_cos_of_the_extremes() {
        for arch in [Arch::new(), Arch::Scalar] {
            let [sin, cos] = fourier(arch, &[0.0, -0.0, 1e-45, -3e-39, 1e-20]);
            assert_eq!((sin, cos), (vec![0.0, -0.0, 1e-45, -3e-39, 1e-20], vec![1.0; 5]));
            for none in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
                let values = fourier(arch, &[none; 21]).concat();
                assert!(values.iter().all(|value| value.is_nan()), "{none}: {values:?}");
            }
            // Neighbours do not change what a number gives.
            let [alone, beside] = [vec![2.5], vec![1e30, 2.5, f32::NAN]].map(|values| fourier(arch, &values));
            assert_eq!([alone[0][0], alone[1][0]], [beside[0][1], beside[1][1]]);
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
