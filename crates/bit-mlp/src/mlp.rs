//! A network and its place in the flat parameters.

use std::ops::Range;

use crate::block::{Activation, Block, Shape};

/// One multilayer perceptron: its blocks, which say where its parameters lie in the flat slice.
///
/// This is a description and holds no numbers; several networks (policy and value, or online and
/// target) can describe parts of one slice, or the same parts of two slices.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Mlp {
    blocks: Vec<Block>,
    activation: Activation,
}

impl Mlp {
    /// A plain network of `sizes` `[inputs, hidden…, outputs]` whose first parameter is
    /// `params[offset]`: the [`Shape`] of these sizes.
    ///
    /// # Panics
    /// If there are fewer than two sizes, and as [`from_shape`](Self::from_shape).
    pub fn new(sizes: &[usize], activation: Activation, offset: usize) -> Self {
        let [inputs, hidden @ .., outputs] = sizes else {
            panic!("an MLP has at least inputs and outputs, got sizes {sizes:?}")
        };
        let shape = Shape { inputs: *inputs, hidden, outputs: *outputs, activation, layer_norm: false };
        Self::from_shape(shape, offset)
    }

    /// A network of this shape whose first parameter is `params[offset]`.
    ///
    /// An offset that is a multiple of 16 keeps the rows of a 64-wide first layer on cache lines if
    /// the slice itself begins on one, which makes a gradient step about 2% faster.
    ///
    /// # Panics
    /// If a size is 0, there are more inputs than a `u16` can index, or more parameters than a slice
    /// can have.
    pub fn from_shape(shape: Shape<'_>, offset: usize) -> Self {
        assert!(shape.inputs > 0 && shape.widths().all(|width| width > 0), "every size must be at least 1: {shape:?}");
        assert!(shape.inputs <= 1 << 16, "inputs are indexed by u16, got {} of them", shape.inputs);
        Self { blocks: shape.blocks(offset), activation: shape.activation }
    }

    /// Number of inputs.
    pub fn inputs(&self) -> usize {
        self.blocks[0].inputs
    }

    /// Number of outputs.
    pub fn outputs(&self) -> usize {
        self.blocks[self.blocks.len() - 1].width
    }

    /// What follows the sums of every hidden layer.
    pub fn activation(&self) -> Activation {
        self.activation
    }

    /// Number of parameters.
    pub fn num_parameters(&self) -> usize {
        self.range().len()
    }

    /// Where the parameters lie in the flat slice.
    pub fn range(&self) -> Range<usize> {
        self.blocks[0].range().start..self.blocks[self.blocks.len() - 1].range().end
    }

    /// The layers, from the inputs to the outputs; the hidden ones are all but the last.
    pub fn blocks(&self) -> &[Block] {
        &self.blocks
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn blocks_tile_the_parameters() {
        for activation in [Activation::Tanh, Activation::Relu, Activation::Crelu, Activation::Fourier] {
            for layer_norm in [false, true] {
                check_tiling(Shape { inputs: 256, hidden: &[64, 48], outputs: 4, activation, layer_norm });
            }
        }
        let activation = Activation::Tanh;
        let shape = Shape { inputs: 256, hidden: &[64, 48], outputs: 4, activation, layer_norm: false };
        assert_eq!(Mlp::from_shape(shape, 10), Mlp::new(&[256, 64, 48, 4], activation, 10));
    }

    fn check_tiling(shape: Shape<'_>) {
        let mlp = Mlp::from_shape(shape, 10);
        assert_eq!(mlp.num_parameters() as u64, shape.num_parameters());
        let (mut inputs, mut next) = (256, 10);
        for block in mlp.blocks() {
            assert_eq!((block.inputs, block.range().start), (inputs, next));
            for place in block.places() {
                assert_eq!(place.range.start, next, "{place:?}");
                assert_eq!(place.range.len(), place.shape.iter().product::<usize>(), "{place:?}");
                next = place.range.end;
            }
            assert_eq!(block.range().end, next);
            inputs = block.outputs();
        }
        assert_eq!(mlp.range(), 10..next);
    }

    #[test]
    fn counting_saturates() {
        let shape =
            Shape { inputs: 256, hidden: &[usize::MAX, 3], outputs: 4, activation: Activation::Relu, layer_norm: true };
        assert_eq!(shape.num_parameters(), u64::MAX);
        assert!(std::panic::catch_unwind(|| Mlp::from_shape(shape, 0)).is_err());
    }
}
