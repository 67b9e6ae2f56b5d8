//! The one matrix product that all dense work is made of.

use pulp::{Simd, WithSimd};

/// The left factor of a product: element `[i, k]` is `data[i * row + k * column]`, so a transposed matrix costs nothing.
#[derive(Clone, Copy)]
pub(crate) struct Left<'a> {
    pub(crate) data: &'a [f32],
    pub(crate) row: usize,
    pub(crate) column: usize,
}

/// `out = initial + left · right`, with `out` `[rows, width]`, `right` `[depth, width]` and `initial` `[width]` added to
/// every row (zeros if `None`).
///
/// `width` is padded to whole cache lines. The terms of an element are added in the order of `depth`, whatever the number
/// of rows: a sample's outputs do not depend on the batch it is in.
///
/// A tile of `R` rows by `V` vectors of the result stays in registers while `depth` runs, so that each vector of `right` is
/// loaded once per `R` products and each element of `left` once per `V`.
pub(crate) struct Matmul<'a> {
    pub(crate) left: Left<'a>,
    pub(crate) right: &'a [f32],
    pub(crate) initial: Option<&'a [f32]>,
    pub(crate) depth: usize,
    pub(crate) width: usize,
    pub(crate) out: &'a mut [f32],
}

impl WithSimd for Matmul<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(mut self, simd: S) {
        let vectors = self.width / S::F32_LANES;
        let mut column = 0;
        while column < vectors {
            // 8 to 16 accumulators: enough to hide the latency of a fused multiply-add (4 cycles, 2 at a time), few enough
            // for 16 registers, or 32.
            column += match vectors - column {
                4.. if S::REGISTER_COUNT >= 32 => self.columns::<S, 4, 4>(simd, column),
                2.. => self.columns::<S, 4, 2>(simd, column),
                _ => self.columns::<S, 8, 1>(simd, column),
            };
        }
    }
}

impl Matmul<'_> {
    /// Computes `V` vectors of columns of all rows; returns `V`.
    #[inline(always)]
    fn columns<S: Simd, const R: usize, const V: usize>(&mut self, simd: S, column: usize) -> usize {
        let rows = self.out.len() / self.width;
        let whole = rows - rows % R;
        for row in (0..whole).step_by(R) {
            self.tile::<S, R, V>(simd, row, column);
        }
        for row in whole..rows {
            self.tile::<S, 1, V>(simd, row, column);
        }
        V
    }

    #[inline(always)]
    fn tile<S: Simd, const R: usize, const V: usize>(&mut self, simd: S, row: usize, column: usize) {
        let stride = self.width / S::F32_LANES;
        let right = S::as_simd_f32s(self.right).0;
        let mut sums = [[simd.splat_f32s(0.0); V]; R];
        if let Some(initial) = self.initial {
            let initial: [S::f32s; V] = S::as_simd_f32s(initial).0[column..][..V].try_into().expect("V vectors");
            sums = [initial; R];
        }
        for k in 0..self.depth {
            let right = &right[k * stride + column..][..V];
            for (r, sums) in sums.iter_mut().enumerate() {
                let left = simd.splat_f32s(self.left.data[(row + r) * self.left.row + k * self.left.column]);
                for (sum, &right) in sums.iter_mut().zip(right) {
                    *sum = simd.mul_add_e_f32s(left, right, *sum);
                }
            }
        }
        let out = S::as_mut_simd_f32s(self.out).0;
        for (r, sums) in sums.iter().enumerate() {
            out[(row + r) * stride + column..][..V].copy_from_slice(sums);
        }
    }
}
