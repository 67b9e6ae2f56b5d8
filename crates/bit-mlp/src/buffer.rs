//! Memory on cache lines, and the padding that frees products from tails.

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

/// A growing, cache-aligned array of floats. What [`resize`](Self::resize) leaves in it is finite
/// but unspecified.
#[derive(Clone, Debug, Default)]
pub(crate) struct Buffer {
    /// As many as were ever needed: to shrink and grow again costs nothing.
    lines: Vec<Line>,
    used: usize,
}

impl Buffer {
    /// Makes the length `len` floats, rounded up to whole lines. Allocates only if it was never as
    /// long before.
    pub(crate) fn resize(&mut self, len: usize) {
        self.used = len.div_ceil(LINE);
        if self.lines.len() < self.used {
            self.lines.resize(self.used, Line::zeroed());
        }
    }

    /// Becomes the matrix `source` `[rows, columns]` with its rows padded to whole lines by zeros.
    pub(crate) fn copy_padded(&mut self, source: &[f32], columns: usize) {
        let stride = padded(columns);
        self.resize(source.len() / columns * stride);
        if stride == columns {
            return self.copy_from_slice(source);
        }
        for (to, from) in self.chunks_exact_mut(stride).zip(source.chunks_exact(columns)) {
            to[..columns].copy_from_slice(from);
            to[columns..].fill(0.0);
        }
    }

    /// Writes the matrix without its padding to `target` `[rows, columns]`.
    pub(crate) fn copy_unpadded(&self, target: &mut [f32], columns: usize) {
        let stride = padded(columns);
        if stride == columns {
            return target.copy_from_slice(&self[..target.len()]);
        }
        for (to, from) in target.chunks_exact_mut(columns).zip(self.chunks_exact(stride)) {
            to.copy_from_slice(&from[..columns]);
        }
    }
}

impl std::ops::Deref for Buffer {
    type Target = [f32];

    fn deref(&self) -> &[f32] {
        bytemuck::cast_slice(&self.lines[..self.used])
    }
}

impl std::ops::DerefMut for Buffer {
    fn deref_mut(&mut self) -> &mut [f32] {
        bytemuck::cast_slice_mut(&mut self.lines[..self.used])
    }
}
