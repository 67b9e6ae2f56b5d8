//! Memory on cache lines, and the padding that frees the kernels from tails.

use bytemuck::{Pod, Zeroable};

/// Floats in a cache line, and in the widest vector register.
pub(crate) const LINE: usize = 16;

/// `size` rounded up to whole cache lines.
pub(crate) fn padded(size: usize) -> usize {
    size.next_multiple_of(LINE)
}

/// One cache line. A vector load that straddles two costs twice.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C, align(64))]
struct Line([f32; LINE]);

/// A growing, cache-aligned array of floats. What is in it after [`resize`](Self::resize) is finite but unspecified.
#[derive(Clone, Debug, Default)]
pub(crate) struct Buffer(Vec<Line>);

impl Buffer {
    /// Makes the length `len` floats, rounded up to whole lines. Allocates only if it was never as long before.
    pub(crate) fn resize(&mut self, len: usize) {
        self.0.resize(len.div_ceil(LINE), Line::zeroed());
    }

    /// Becomes the matrix `source` `[rows, columns]` with its rows padded to whole lines by zeros.
    pub(crate) fn copy_padded(&mut self, source: &[f32], columns: usize) {
        let stride = padded(columns);
        self.resize(source.len() / columns * stride);
        for (to, from) in self.chunks_exact_mut(stride).zip(source.chunks_exact(columns)) {
            to[..columns].copy_from_slice(from);
            to[columns..].fill(0.0);
        }
    }

    /// Becomes the transpose of the matrix `source` `[rows, columns]`: `[columns, padded(rows)]`, padded by zeros.
    pub(crate) fn copy_transposed(&mut self, source: &[f32], columns: usize) {
        let rows = source.len() / columns;
        let stride = padded(rows);
        self.resize(columns * stride);
        for (column, to) in self.chunks_exact_mut(stride).enumerate() {
            for (to, from) in to.iter_mut().zip(source[column..].iter().step_by(columns)) {
                *to = *from;
            }
            to[rows..].fill(0.0);
        }
    }
}

impl std::ops::Deref for Buffer {
    type Target = [f32];

    fn deref(&self) -> &[f32] {
        bytemuck::cast_slice(&self.0)
    }
}

impl std::ops::DerefMut for Buffer {
    fn deref_mut(&mut self) -> &mut [f32] {
        bytemuck::cast_slice_mut(&mut self.0)
    }
}
