//! Layer normalisation (Ba, Kiros & Hinton, 2016, <https://arxiv.org/abs/1607.06450>) and its
//! gradient, as PyTorch's `nn.LayerNorm`.

use pulp::{Simd, WithSimd};

use crate::block::Norm;
use crate::buffer::padded;

/// With the mean and the biased variance of a sample's sums over its units:
/// `normalised = (sum − mean) · inverse`, with `inverse = 1 / √(variance + ε)`, and
/// `out = normalised · scale + shift`.
///
/// `values` `[B, padded(width)]` are the sums before and normalised after; `out` has their shape,
/// `inverse` is `[B]`, `scale` and `shift` are `[width]`. Padding takes no part.
pub(crate) struct Normalise<'a> {
    pub(crate) scale: &'a [f32],
    pub(crate) shift: &'a [f32],
    pub(crate) values: &'a mut [f32],
    pub(crate) inverse: &'a mut [f32],
    pub(crate) out: &'a mut [f32],
}

impl WithSimd for Normalise<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let width = self.scale.len();
        let stride = padded(width);
        let rows = self.values.chunks_exact_mut(stride).zip(self.out.chunks_exact_mut(stride));
        for ((values, out), inverse) in rows.zip(self.inverse) {
            let values = &mut values[..width];
            let mean = sum(simd, values) / width as f32;
            let variance = centre(simd, values, mean) / width as f32;
            *inverse = 1.0 / (variance + Norm::EPSILON).sqrt();
            scale_and_shift(simd, values, *inverse, self.scale, self.shift, &mut out[..width]);
        }
    }
}

#[inline(always)]
fn sum<S: Simd>(simd: S, values: &[f32]) -> f32 {
    let (vectors, tail) = S::as_simd_f32s(values);
    let mut sum = simd.partial_load_f32s(tail);
    for &x in vectors {
        sum = simd.add_f32s(sum, x);
    }
    simd.reduce_sum_f32s(sum)
}

/// Subtracts the mean; returns the sum of the squares.
#[inline(always)]
fn centre<S: Simd>(simd: S, values: &mut [f32], mean: f32) -> f32 {
    let mean = simd.splat_f32s(mean);
    let (vectors, tail) = S::as_mut_simd_f32s(values);
    let last = simd.sub_f32s(simd.partial_load_f32s(tail), mean);
    simd.partial_store_f32s(tail, last);
    // Loaded again, since lanes beyond the tail held −mean.
    let last = simd.partial_load_f32s(tail);
    let mut squares = simd.mul_f32s(last, last);
    for x in vectors {
        *x = simd.sub_f32s(*x, mean);
        squares = simd.mul_add_e_f32s(*x, *x, squares);
    }
    simd.reduce_sum_f32s(squares)
}

/// `values ← values · inverse` and `out = values · scale + shift`.
#[inline(always)]
fn scale_and_shift<S: Simd>(simd: S, values: &mut [f32], inverse: f32, scale: &[f32], shift: &[f32], out: &mut [f32]) {
    let inverse = simd.splat_f32s(inverse);
    let (values, values_tail) = S::as_mut_simd_f32s(values);
    let (scale, scale_tail) = S::as_simd_f32s(scale);
    let (shift, shift_tail) = S::as_simd_f32s(shift);
    let (out, out_tail) = S::as_mut_simd_f32s(out);
    for (((x, &scale), &shift), out) in values.iter_mut().zip(scale).zip(shift).zip(out) {
        *x = simd.mul_f32s(*x, inverse);
        *out = simd.mul_add_e_f32s(*x, scale, shift);
    }
    let last = simd.mul_f32s(simd.partial_load_f32s(values_tail), inverse);
    simd.partial_store_f32s(values_tail, last);
    let (scale, shift) = (simd.partial_load_f32s(scale_tail), simd.partial_load_f32s(shift_tail));
    simd.partial_store_f32s(out_tail, simd.mul_add_e_f32s(last, scale, shift));
}

/// The gradients of [`Normalise`]. With `g` the loss gradient of `out` and `h = g ⊙ scale`:
/// `∂scale = Σ_b g ⊙ normalised`, `∂shift = Σ_b g`, and of the sums
/// `inverse · (h − mean(h) − normalised · mean(h ⊙ normalised))`, with means over the units.
///
/// `gradients` `[B, padded(width)]` are of `out` before and of the sums after; `d_scale` and
/// `d_shift` `[width]` are written over.
pub(crate) struct NormGradient<'a> {
    pub(crate) scale: &'a [f32],
    pub(crate) normalised: &'a [f32],
    pub(crate) inverse: &'a [f32],
    pub(crate) gradients: &'a mut [f32],
    pub(crate) d_scale: &'a mut [f32],
    pub(crate) d_shift: &'a mut [f32],
}

impl WithSimd for NormGradient<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { scale, normalised, inverse, gradients, d_scale, d_shift } = self;
        let width = scale.len();
        let stride = padded(width);
        d_scale.fill(0.0);
        d_shift.fill(0.0);
        let rows = gradients.chunks_exact_mut(stride).zip(normalised.chunks_exact(stride));
        for ((gradients, normalised), &inverse) in rows.zip(inverse) {
            let (gradients, normalised) = (&mut gradients[..width], &normalised[..width]);
            let [sum, product] = through_scale(simd, gradients, normalised, scale, d_scale, d_shift);
            through_mean(simd, gradients, normalised, sum / width as f32, product / width as f32, inverse);
        }
    }
}

/// Makes `gradients` those of the normalised values, `h`, and adds the sample's part of `∂scale` and
/// `∂shift`. Returns `Σ h` and `Σ h ⊙ normalised`.
#[inline(always)]
fn through_scale<S: Simd>(
    simd: S,
    gradients: &mut [f32],
    normalised: &[f32],
    scale: &[f32],
    d_scale: &mut [f32],
    d_shift: &mut [f32],
) -> [f32; 2] {
    let (gradients, gradients_tail) = S::as_mut_simd_f32s(gradients);
    let (normalised, normalised_tail) = S::as_simd_f32s(normalised);
    let (scale, scale_tail) = S::as_simd_f32s(scale);
    let (d_scale, d_scale_tail) = S::as_mut_simd_f32s(d_scale);
    let (d_shift, d_shift_tail) = S::as_mut_simd_f32s(d_shift);

    let (g, x) = (simd.partial_load_f32s(gradients_tail), simd.partial_load_f32s(normalised_tail));
    let before = simd.partial_load_f32s(d_scale_tail);
    simd.partial_store_f32s(d_scale_tail, simd.mul_add_e_f32s(g, x, before));
    let before = simd.partial_load_f32s(d_shift_tail);
    simd.partial_store_f32s(d_shift_tail, simd.add_f32s(g, before));
    let h = simd.mul_f32s(g, simd.partial_load_f32s(scale_tail));
    simd.partial_store_f32s(gradients_tail, h);
    let (mut sum, mut product) = (h, simd.mul_f32s(h, x));

    let parameters = scale.iter().zip(d_scale).zip(d_shift);
    for ((g, &x), ((&scale, d_scale), d_shift)) in gradients.iter_mut().zip(normalised).zip(parameters) {
        *d_scale = simd.mul_add_e_f32s(*g, x, *d_scale);
        *d_shift = simd.add_f32s(*g, *d_shift);
        *g = simd.mul_f32s(*g, scale);
        sum = simd.add_f32s(sum, *g);
        product = simd.mul_add_e_f32s(*g, x, product);
    }
    [simd.reduce_sum_f32s(sum), simd.reduce_sum_f32s(product)]
}

/// `gradients ← inverse · (gradients − mean − normalised · product)`.
#[inline(always)]
fn through_mean<S: Simd>(simd: S, gradients: &mut [f32], normalised: &[f32], mean: f32, product: f32, inverse: f32) {
    let [mean, product, inverse] = [simd.splat_f32s(mean), simd.splat_f32s(product), simd.splat_f32s(inverse)];
    let (gradients, gradients_tail) = S::as_mut_simd_f32s(gradients);
    let (normalised, normalised_tail) = S::as_simd_f32s(normalised);
    for (h, &x) in gradients.iter_mut().zip(normalised) {
        let centred = simd.negate_mul_add_e_f32s(x, product, simd.sub_f32s(*h, mean));
        *h = simd.mul_f32s(inverse, centred);
    }
    let (h, x) = (simd.partial_load_f32s(gradients_tail), simd.partial_load_f32s(normalised_tail));
    let centred = simd.negate_mul_add_e_f32s(x, product, simd.sub_f32s(h, mean));
    simd.partial_store_f32s(gradients_tail, simd.mul_f32s(inverse, centred));
}
