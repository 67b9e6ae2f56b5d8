//! The memory of a forward and a backward pass, and what can be read of it.

use pulp::Arch;

use crate::buffer::{Buffer, padded};
use crate::packed::Packed;

/// Memory for [`Mlp::forward`](crate::Mlp::forward) and [`Mlp::backward`](crate::Mlp::backward).
///
/// It grows to the largest network and batch it has seen, and can serve any. Between a forward pass
/// and its backward pass it must serve no other.
#[derive(Clone, Debug)]
pub struct Workspace {
    pub(crate) arch: Arch,
    pub(crate) packed: Packed,
    pub(crate) trace: Trace,
    /// Per layer the number of its outputs, in the last forward pass.
    pub(crate) widths: Vec<usize>,
    /// `[B, outputs]`
    pub(crate) outputs: Vec<f32>,
    /// Per layer `[B, padded(width)]`: the loss gradient of the layer's sums.
    pub(crate) deltas: Vec<Buffer>,
    /// The weight gradient of the layer at hand, `[padded(inputs), padded(width)]` or, where most
    /// of that would be padding, `[width, padded(inputs)]`.
    pub(crate) gradient: Buffer,
    /// `[padded(width)]`: the bias gradient of the layer at hand.
    pub(crate) bias: Buffer,
    /// `[inputs]`: in which of 64 samples an input is active, bit by bit.
    pub(crate) active_in: Vec<u64>,
}

/// What a forward pass leaves for the backward pass.
#[derive(Clone, Debug, Default)]
pub(crate) struct Trace {
    /// From the inputs to the outputs.
    pub(crate) layers: Vec<Passed>,
    /// Of the layer at hand, if two values leave each of its units: `[B, padded(width)]` what they
    /// are computed from, and `[B, padded(outputs)]` their loss gradient on the way back.
    pub(crate) aside: Buffer,
}

/// What a layer computed.
#[derive(Clone, Debug, Default)]
pub(crate) struct Passed {
    /// `[B, padded(outputs)]`: what leaves the layer, activated unless it is the last.
    pub(crate) leaving: Buffer,
    /// `[B, padded(width)]`: the normalised sums, before scale and shift. Stale where nothing is
    /// normalised.
    pub(crate) normalised: Buffer,
    /// `[B]`: what the centred sums were multiplied with to normalise them. Stale likewise.
    pub(crate) inverse: Vec<f32>,
}

impl Default for Workspace {
    fn default() -> Self {
        Self::with_arch(Arch::new())
    }
}

impl Workspace {
    pub(crate) fn with_arch(arch: Arch) -> Self {
        Self {
            arch,
            packed: Packed::default(),
            trace: Trace::default(),
            widths: Vec::new(),
            outputs: Vec::new(),
            deltas: Vec::new(),
            gradient: Buffer::default(),
            bias: Buffer::default(),
            active_in: Vec::new(),
        }
    }
    /// What left layer `index` in the last forward pass, a row per sample: activated values, or the
    /// outputs if the layer is the last.
    ///
    /// # Panics
    /// If that network had no such layer, or there was no forward pass yet.
    pub fn activations(&self, index: usize) -> Activations<'_> {
        let layers = self.widths.len();
        assert!(index < layers, "the last forward pass had {layers} layers, and none with index {index}");
        Activations { values: &self.trace.layers[index].leaving, width: self.widths[index] }
    }
}

/// What left a layer, `[B, K]`: a view of a [`Workspace`] after a forward pass.
#[derive(Clone, Copy, Debug)]
pub struct Activations<'a> {
    /// `[B, padded(K)]`
    values: &'a [f32],
    width: usize,
}

impl<'a> Activations<'a> {
    /// Number of samples, B.
    pub fn len(&self) -> usize {
        self.values.len() / self.stride()
    }

    /// Whether there is no sample.
    pub fn is_empty(&self) -> bool {
        self.values.is_empty()
    }

    /// Number of values per sample, K.
    pub fn width(&self) -> usize {
        self.width
    }

    /// The values of sample `index`, `[K]`.
    ///
    /// # Panics
    /// If there is no such sample.
    pub fn row(&self, index: usize) -> &'a [f32] {
        &self.values[index * self.stride()..][..self.width]
    }

    /// The values of every sample, in order, `[K]` each.
    pub fn rows(self) -> impl ExactSizeIterator<Item = &'a [f32]> + Clone {
        self.values.chunks_exact(self.stride()).map(move |row| &row[..self.width])
    }

    /// How far rows are apart: they are padded to whole cache lines.
    fn stride(&self) -> usize {
        padded(self.width)
    }
}
