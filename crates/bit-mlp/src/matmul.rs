//! The one matrix product that all dense work is made of.

use pulp::{Simd, WithSimd};

use crate::buffer::LINE;

/// A factor of a product: element `[i, j]` is `data[i * row + j * column]`, so a transposed matrix
/// costs nothing.
#[derive(Clone, Copy)]
pub(crate) struct Factor<'a> {
    data: &'a [f32],
    row: usize,
    column: usize,
}

impl<'a> Factor<'a> {
    /// A matrix whose rows are `stride` apart.
    pub(crate) fn new(data: &'a [f32], stride: usize) -> Self {
        Self { data, row: stride, column: 1 }
    }

    /// The transpose of a matrix.
    pub(crate) fn transposed(self) -> Self {
        Self { row: self.column, column: self.row, ..self }
    }

    /// A row of ones, as long as is needed: the product sums the rows of the right factor.
    pub(crate) fn ones() -> Self {
        Self { data: &[1.0], row: 0, column: 0 }
    }

    /// Whether all of `[rows, columns]` is there.
    #[inline(always)]
    fn holds(self, rows: usize, columns: usize) -> bool {
        rows == 0 || columns == 0 || self.data.len() > (rows - 1) * self.row + (columns - 1) * self.column
    }

    /// What is right of and below an element that is there.
    #[inline(always)]
    fn from(self, row: usize, column: usize) -> Self {
        Self { data: &self.data[row * self.row + column * self.column..], ..self }
    }
}

/// `out = initial + left · right`, with `out` `[rows, width]`, `left` `[rows, depth]`, `right`
/// `[depth, width]` and `initial` `[width]` added to every row (zeros if `None`).
///
/// `width` is padded to whole cache lines. The terms of an element are added in the order of
/// `depth`, whatever the number of rows: a sample's outputs do not depend on the batch it is in.
///
/// A tile of `R` rows by `V` vectors of the result stays in registers while `depth` runs, so that
/// each vector of `right` is loaded once per `R` products and each element of `left` once per `V`.
/// What all tiles of the same columns read of `right` stays in the first cache: [`BLOCK`] of its
/// rows at a time, packed where they lie across, or far apart with many rows to multiply (Goto & van
/// de Geijn, 2008, <https://doi.org/10.1145/1356052.1356053>, section 4).
pub(crate) struct Matmul<'a> {
    pub(crate) left: Factor<'a>,
    pub(crate) right: Factor<'a>,
    pub(crate) initial: Option<&'a [f32]>,
    pub(crate) depth: usize,
    pub(crate) width: usize,
    pub(crate) out: &'a mut [f32],
}

/// Rows of `right` in use at a time: with the four vectors of a tile 16 kB, half of a first cache.
const BLOCK: usize = 64;

/// When rows of `right` are this far apart, the same columns of [`BLOCK`] of them fall into too few
/// of a cache's sets.
pub(crate) const FAR: usize = 256;

/// With fewer rows than this to multiply, packing what they are multiplied with does not pay.
const MANY: usize = 16;

impl WithSimd for Matmul<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(mut self, simd: S) {
        let Self { left, right, initial, depth, width, ref out } = self;
        let rows = out.len() / width;
        assert!(width.is_multiple_of(LINE) && out.len() == rows * width);
        assert!(left.holds(rows, depth) && right.holds(depth, width));
        // Whole vectors side by side, or across.
        let (along, between) = if right.column == 1 { (right.column, right.row) } else { (right.row, right.column) };
        assert!(along == 1 && between.is_multiple_of(LINE));
        assert!(initial.is_none_or(|row| row.len() >= width));

        if rows == 0 || depth == 0 {
            for row in self.out.chunks_exact_mut(width) {
                match initial {
                    Some(initial) => row.copy_from_slice(&initial[..width]),
                    None => row.fill(0.0),
                }
            }
            return;
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
        let initial: [S::f32s; V] = match self.initial {
            Some(row) => S::as_simd_f32s(row).0[column..][..V].try_into().expect("V vectors"),
            None => [simd.splat_f32s(0.0); V],
        };
        let stride = self.width / S::F32_LANES;
        let (out, _) = S::as_mut_simd_f32s(self.out);
        for begin in (0..self.depth).step_by(BLOCK) {
            let depth = BLOCK.min(self.depth - begin);
            let left = self.left.from(0, begin);
            let right = self.right.from(begin, column * S::F32_LANES);
            let across = right.column != 1;
            let mut panel: Panel<S::f32s, V>;
            let right = if across || (right.row >= FAR && rows >= MANY) {
                panel = Panel([[simd.splat_f32s(0.0); V]; BLOCK]);
                let floats = bytemuck::cast_slice_mut(panel.0.as_flattened_mut());
                let columns = V * S::F32_LANES;
                if across {
                    right.pack_across(depth, columns, floats)
                } else {
                    right.pack(depth, columns, floats)
                }
                Block { vectors: panel.0.as_flattened(), stride: V, depth }
            } else {
                Block { vectors: S::as_simd_f32s(right.data).0, stride: right.row / S::F32_LANES, depth }
            };
            let initial = (begin == 0).then_some(&initial);
            let whole = rows - rows % R;
            for row in (0..whole).step_by(R) {
                tile::<S, R, V>(simd, left.from(row, 0), right, initial, &mut out[row * stride + column..], stride);
            }
            for row in whole..rows {
                tile::<S, 1, V>(simd, left.from(row, 0), right, initial, &mut out[row * stride + column..], stride);
            }
        }
        V
    }
}

/// Packed rows, on whole cache lines.
#[repr(align(64))]
struct Panel<F, const V: usize>([[F; V]; BLOCK]);

// Packing moves memory, which needs no wide instructions, nor to be inlined.
impl Factor<'_> {
    /// Copies `[depth, columns]` of a matrix that is not transposed to `panel`, row after row.
    fn pack(self, depth: usize, columns: usize, panel: &mut [f32]) {
        for (to, from) in panel.chunks_exact_mut(columns).zip(self.data.chunks(self.row)).take(depth) {
            to.copy_from_slice(&from[..columns]);
        }
    }

    /// The same of a transposed matrix whose rows are padded to whole lines.
    fn pack_across(self, depth: usize, columns: usize, panel: &mut [f32]) {
        /// In squares, which end in as many lines as they begin in, rather than each float in
        /// another.
        const SIDE: usize = 4;
        if !columns.is_multiple_of(SIDE) {
            // Without vectors a tile is narrower than a square.
            for (k, to) in panel.chunks_exact_mut(columns).take(depth).enumerate() {
                for (column, to) in to.iter_mut().enumerate() {
                    *to = self.data[column * self.column + k];
                }
            }
            return;
        }
        let (to, _) = panel.as_chunks_mut::<SIDE>();
        for band in 0..columns / SIDE {
            let rows: [_; SIDE] = std::array::from_fn(|r| {
                let row = &self.data[(band * SIDE + r) * self.column..][..depth.next_multiple_of(SIDE)];
                row.as_chunks::<SIDE>().0
            });
            for k in 0..depth.div_ceil(SIDE) {
                let [a, b, c, d] = rows.map(|row| row[k]);
                for i in 0..SIDE {
                    to[(k * SIDE + i) * (columns / SIDE) + band] = [a[i], b[i], c[i], d[i]];
                }
            }
        }
    }
}

/// What a tile reads of the right factor: vector `v` of row `k` is `vectors[k * stride + v]`.
#[derive(Clone, Copy)]
struct Block<'a, V> {
    vectors: &'a [V],
    stride: usize,
    depth: usize,
}

/// Adds the products of the first `R` rows of `left` with `right` to `initial`, or, if that is
/// `None`, to what is there: the tile of `R` rows, `stride` apart, by `V` vectors with which `out`
/// begins.
#[inline(always)]
fn tile<S: Simd, const R: usize, const V: usize>(
    simd: S,
    left: Factor<'_>,
    right: Block<'_, S::f32s>,
    initial: Option<&[S::f32s; V]>,
    out: &mut [S::f32s],
    stride: usize,
) {
    assert!(left.holds(R, right.depth) && right.vectors.len() >= (right.depth - 1) * right.stride + V);
    let mut sums = [[simd.splat_f32s(0.0); V]; R];
    for (r, sums) in sums.iter_mut().enumerate() {
        *sums = match initial {
            Some(initial) => *initial,
            None => out[r * stride..][..V].try_into().expect("V vectors"),
        };
    }
    for k in 0..right.depth {
        for (r, sums) in sums.iter_mut().enumerate() {
            for (v, sum) in sums.iter_mut().enumerate() {
                // SAFETY: both were asserted to hold the tile's last element, and so all before it.
                // The checks would take more time than the products.
                let (x, y) = unsafe {
                    let x = left.data.get_unchecked(r * left.row + k * left.column);
                    (*x, *right.vectors.get_unchecked(k * right.stride + v))
                };
                *sum = simd.mul_add_e_f32s(simd.splat_f32s(x), y, *sum);
            }
        }
    }
    for (r, sums) in sums.iter().enumerate() {
        out[r * stride..][..V].copy_from_slice(sums);
    }
}
