//! The first layer: its inputs are bits, so its product is a sum of rows of the weight.

use pulp::{Simd, WithSimd};

use crate::buffer::padded;

/// `out[b] = initial + Σ weight[i]` over the active inputs `i` of sample `b`; `out` `[B, padded(width)]`, `weight`
/// `[inputs, width]`, `initial` `[padded(width)]`.
pub(crate) struct SumRows<'a, I> {
    pub(crate) weight: &'a [f32],
    pub(crate) width: usize,
    pub(crate) initial: &'a [f32],
    pub(crate) samples: I,
    pub(crate) out: &'a mut [f32],
}

impl<'s, I: Iterator<Item = &'s [u16]>> WithSimd for SumRows<'_, I> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { weight, width, initial, samples, out } = self;
        let whole = width / S::F32_LANES;
        let initial = S::as_simd_f32s(initial).0;
        for (sample, out) in samples.zip(out.chunks_exact_mut(padded(width))) {
            let out = S::as_mut_simd_f32s(out).0;
            let mut column = 0;
            while column < whole {
                column += match whole - column {
                    4.. => sum_columns::<S, 4>(simd, weight, width, sample, initial, out, column),
                    _ => sum_columns::<S, 1>(simd, weight, width, sample, initial, out, column),
                };
            }
            if column * S::F32_LANES < width {
                let mut sum = initial[column];
                for &index in sample {
                    let row = &weight[usize::from(index) * width..][..width];
                    sum = simd.add_f32s(sum, simd.partial_load_f32s(S::as_simd_f32s(row).1));
                }
                out[column] = sum;
            }
        }
    }
}

/// Computes `V` vectors of columns of one sample, in registers; returns `V`.
#[inline(always)]
fn sum_columns<S: Simd, const V: usize>(
    simd: S,
    weight: &[f32],
    width: usize,
    sample: &[u16],
    initial: &[S::f32s],
    out: &mut [S::f32s],
    column: usize,
) -> usize {
    let mut sums: [S::f32s; V] = initial[column..][..V].try_into().expect("V vectors");
    for &index in sample {
        let row = &weight[usize::from(index) * width..][..width];
        let row = &S::as_simd_f32s(row).0[column..][..V];
        for (sum, &weight) in sums.iter_mut().zip(row) {
            *sum = simd.add_f32s(*sum, weight);
        }
    }
    out[column..][..V].copy_from_slice(&sums);
    V
}

/// The gradient of the weight: `gradient[i]` is the sum of `deltas[b]` over the samples `b` in which
/// input `i` is active, which for the `constant` ones is `shared`, the gradient of the bias.
///
/// `gradient` `[inputs, width]`, `deltas` `[B, padded(width)]`, `shared` `[padded(width)]`.
pub(crate) struct WeightGradient<'a, I> {
    pub(crate) deltas: &'a [f32],
    pub(crate) width: usize,
    pub(crate) constant: &'a [u16],
    pub(crate) shared: &'a [f32],
    pub(crate) samples: I,
    pub(crate) gradient: &'a mut [f32],
}

impl<'s, I: Iterator<Item = &'s [u16]>> WithSimd for WeightGradient<'_, I> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { deltas, width, constant, shared, samples, gradient } = self;
        gradient.fill(0.0);
        add_to_rows(simd, gradient, &shared[..width], constant);
        for (sample, delta) in samples.zip(deltas.chunks_exact(padded(width))) {
            add_to_rows(simd, gradient, &delta[..width], sample);
        }
    }
}

/// Adds `delta` `[width]` to the `active` rows of `gradient` `[inputs, width]`.
#[inline(always)]
fn add_to_rows<S: Simd>(simd: S, gradient: &mut [f32], delta: &[f32], active: &[u16]) {
    const V: usize = 4;
    let width = delta.len();
    let (delta, delta_tail) = S::as_simd_f32s(delta);
    let (blocks, rest) = delta.as_chunks::<V>();
    for &index in active {
        let row = &mut gradient[usize::from(index) * width..][..width];
        let (row, tail) = S::as_mut_simd_f32s(row);
        let (row_blocks, row_rest) = row.as_chunks_mut::<V>();
        for (sums, deltas) in row_blocks.iter_mut().zip(blocks) {
            for (sum, &delta) in sums.iter_mut().zip(deltas) {
                *sum = simd.add_f32s(*sum, delta);
            }
        }
        for (sum, &delta) in row_rest.iter_mut().zip(rest) {
            *sum = simd.add_f32s(*sum, delta);
        }
        for (sum, &delta) in tail.iter_mut().zip(delta_tail) {
            *sum += delta;
        }
    }
}
