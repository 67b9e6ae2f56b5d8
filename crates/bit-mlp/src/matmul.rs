//! The one matrix product that all dense work is made of.

use pulp::{Simd, WithSimd};

use crate::buffer::LINE;

/// The left factor of a product: element `[i, k]` is `data[i * row + k * column]`, so a transposed
/// matrix costs nothing.
#[derive(Clone, Copy)]
pub(crate) struct Left<'a> {
    data: &'a [f32],
    row: usize,
    column: usize,
}

impl<'a> Left<'a> {
    /// A matrix whose rows are `stride` apart.
    pub(crate) fn new(data: &'a [f32], stride: usize) -> Self {
        Self { data, row: stride, column: 1 }
    }

    /// The transpose of a matrix whose rows are `stride` apart.
    pub(crate) fn transposed(data: &'a [f32], stride: usize) -> Self {
        Self { data, row: 1, column: stride }
    }

    /// A row of ones, as long as is needed: the product sums the rows of the right factor.
    pub(crate) fn ones() -> Self {
        Self { data: &[1.0], row: 0, column: 0 }
    }
}

/// `out = initial + left · right`, with `out` `[rows, width]`, `right` `[depth, width]` and
/// `initial` `[width]` added to every row (zeros if `None`).
///
/// `width` is padded to whole cache lines. The terms of an element are added in the order of
/// `depth`, whatever the number of rows: a sample's outputs do not depend on the batch it is in.
///
/// A tile of `R` rows by `V` vectors of the result stays in registers while `depth` runs, so that
/// each vector of `right` is loaded once per `R` products and each element of `left` once per `V`.
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
        let Self { left, right, initial, depth, width, ref out } = self;
        let rows = out.len() / width;
        assert!(width.is_multiple_of(LINE) && out.len() == rows * width);
        assert!(right.len() >= depth * width && initial.is_none_or(|row| row.len() >= width));
        if rows > 0 && depth > 0 {
            assert!(left.data.len() > (rows - 1) * left.row + (depth - 1) * left.column);
        }

        let vectors = width / S::F32_LANES;
        let mut column = 0;
        while column < vectors {
            // 8 to 16 accumulators: enough to hide the latency of a fused multiply-add (4 cycles,
            // 2 at a time), few enough for 16 registers, or 32.
            column += match vectors - column {
                4.. if S::REGISTER_COUNT >= 32 => self.columns::<S, 4, 4>(simd, rows, column),
                2.. => self.columns::<S, 4, 2>(simd, rows, column),
                _ => self.columns::<S, 8, 1>(simd, rows, column),
            };
        }
    }
}

impl Matmul<'_> {
    /// Computes `V` vectors of columns of all rows; returns `V`.
    #[inline(always)]
    fn columns<S: Simd, const R: usize, const V: usize>(&mut self, simd: S, rows: usize, column: usize) -> usize {
        let whole = rows - rows % R;
        for row in (0..whole).step_by(R) {
            self.tile::<S, R, V>(simd, row, column);
        }
        for row in whole..rows {
            self.tile::<S, 1, V>(simd, row, column);
        }
        V
    }

    /// Computes the tile of `R` rows by `V` vectors of columns that begins at `row` and `column`.
    #[inline(always)]
    fn tile<S: Simd, const R: usize, const V: usize>(&mut self, simd: S, row: usize, column: usize) {
        let stride = self.width / S::F32_LANES;
        let right = &S::as_simd_f32s(self.right).0[column..];
        let left = &self.left.data[row * self.left.row..];

        let mut sums = [[simd.splat_f32s(0.0); V]; R];
        if let Some(initial) = self.initial {
            let initial = &S::as_simd_f32s(initial).0[column..][..V];
            sums = [initial.try_into().expect("V vectors"); R];
        }
        for k in 0..self.depth {
            for (r, sums) in sums.iter_mut().enumerate() {
                for (v, sum) in sums.iter_mut().enumerate() {
                    // SAFETY: `with_simd` has asserted that `left` holds all rows by `depth` and
                    // `right` all of `depth` by `width`; the tile is a part of them. The checks
                    // would take more time than the products.
                    let (x, y) = unsafe {
                        let x = left.get_unchecked(r * self.left.row + k * self.left.column);
                        (*x, *right.get_unchecked(k * stride + v))
                    };
                    *sum = simd.mul_add_e_f32s(simd.splat_f32s(x), y, *sum);
                }
            }
        }
        let out = S::as_mut_simd_f32s(self.out).0;
        for (r, sums) in sums.iter().enumerate() {
            out[(row + r) * stride + column..][..V].copy_from_slice(sums);
        }
    }
}
