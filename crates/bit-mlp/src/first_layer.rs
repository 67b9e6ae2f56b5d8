//! The first layer: its inputs are bits, so its product is a sum of rows of the weight.

use pulp::{Simd, WithSimd};

use crate::buffer::padded;

/// `out[b] = initial + Σ weight[i]` over the active inputs `i` of sample `b`; `out` `[B,
/// padded(width)]`, `weight` `[inputs, width]`, `initial` `[padded(width)]`.
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

/// The gradient of the weight: `gradient[i]` is the sum of `deltas[b]` over the samples `b` in
/// which input `i` is active, which for the `constant` ones is `shared`, the gradient of the bias.
///
/// `gradient` `[inputs, width]`, `deltas` `[B, padded(width)]`, `shared` `[padded(width)]`. The
/// samples are first turned around, 64 at a time, into `active_in` `[inputs]`, whose bit `b` tells
/// whether the input is active in sample `b`: then a row is summed in registers, and written once.
pub(crate) struct WeightGradient<'a, I> {
    pub(crate) deltas: &'a [f32],
    pub(crate) width: usize,
    pub(crate) constant: &'a [u16],
    pub(crate) shared: &'a [f32],
    pub(crate) samples: I,
    pub(crate) active_in: &'a mut [u64],
    pub(crate) gradient: &'a mut [f32],
}

impl<'s, I: Iterator<Item = &'s [u16]>> WithSimd for WeightGradient<'_, I> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { deltas, width, constant, shared, mut samples, active_in, gradient } = self;
        if deltas.is_empty() {
            gradient.fill(0.0);
        }
        let mut begun = false;
        for deltas in deltas.chunks(u64::BITS as usize * padded(width)) {
            active_in.fill(0);
            for (b, sample) in samples.by_ref().take(deltas.len() / padded(width)).enumerate() {
                for &index in sample {
                    active_in[usize::from(index)] |= 1 << b;
                }
            }
            let deltas = S::as_simd_f32s(deltas).0;
            for (row, &active_in) in gradient.chunks_exact_mut(width).zip(&*active_in) {
                if active_in != 0 || !begun {
                    add_samples(simd, row, begun, deltas, active_in);
                }
            }
            begun = true;
        }
        for &index in constant {
            let row = &mut gradient[usize::from(index) * width..][..width];
            row.copy_from_slice(&shared[..width]);
        }
    }
}

/// Adds the `deltas` `[64, padded(width)]` of the samples whose bit is set to `row` `[width]`, or to
/// zeros if the row has not `begun`: to clear all rows beforehand would take them through the cache
/// once more.
#[inline(always)]
fn add_samples<S: Simd>(simd: S, row: &mut [f32], begun: bool, deltas: &[S::f32s], samples: u64) {
    const V: usize = 4;
    let zero = simd.splat_f32s(0.0);
    let stride = padded(row.len()) / S::F32_LANES;
    let (row, tail) = S::as_mut_simd_f32s(row);
    let (blocks, rest) = row.as_chunks_mut::<V>();
    let mut column = 0;
    for sums in blocks {
        let before = if begun { *sums } else { [zero; V] };
        *sums = add_columns(simd, before, deltas, stride, column, samples);
        column += V;
    }
    for sum in rest {
        let before = if begun { *sum } else { zero };
        [*sum] = add_columns(simd, [before], deltas, stride, column, samples);
        column += 1;
    }
    if !tail.is_empty() {
        let before = if begun { simd.partial_load_f32s(tail) } else { zero };
        let [sum] = add_columns(simd, [before], deltas, stride, column, samples);
        simd.partial_store_f32s(tail, sum);
    }
}

#[inline(always)]
fn add_columns<S: Simd, const V: usize>(
    simd: S,
    mut sums: [S::f32s; V],
    deltas: &[S::f32s],
    stride: usize,
    column: usize,
    mut samples: u64,
) -> [S::f32s; V] {
    while samples != 0 {
        let delta = &deltas[samples.trailing_zeros() as usize * stride + column..][..V];
        for (sum, &delta) in sums.iter_mut().zip(delta) {
            *sum = simd.add_f32s(*sum, delta);
        }
        samples &= samples - 1;
    }
    sums
}
