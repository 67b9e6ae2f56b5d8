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
        if stride == columns {
            return self.copy_from_slice(source);
        }
        for (to, from) in self.chunks_exact_mut(stride).zip(source.chunks_exact(columns)) {
            to[..columns].copy_from_slice(from);
            to[columns..].fill(0.0);
        }
    }

    /// Becomes the transpose `[width, padded(rows)]` of `source` `[rows, width]`, with `width` padded.
    pub(crate) fn copy_transposed(&mut self, source: &[f32], width: usize) {
        /// Blocks of four by four become shuffles of registers instead of single loads and stores.
        const BLOCK: usize = 4;
        let rows = source.len() / width;
        let stride = padded(rows);
        self.resize(width * stride);
        let (blocks, _) = self.as_chunks_mut::<BLOCK>();
        let (source, _) = source.as_chunks::<BLOCK>();
        for row in (0..rows).step_by(BLOCK) {
            for column in (0..width).step_by(BLOCK) {
                let mut block = [[0.0; BLOCK]; BLOCK];
                for r in 0..BLOCK.min(rows - row) {
                    let from = source[((row + r) * width + column) / BLOCK];
                    for c in 0..BLOCK {
                        block[c][r] = from[c];
                    }
                }
                for (c, line) in block.into_iter().enumerate() {
                    blocks[((column + c) * stride + row) / BLOCK] = line;
                }
            }
        }
        // Rows that are padding keep what they held: finite numbers, whose products nobody reads.
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
