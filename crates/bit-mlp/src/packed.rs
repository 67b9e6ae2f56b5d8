//! The parameters as a forward pass reads them.

use pulp::Arch;

use crate::block::Block;
use crate::buffer::{Buffer, LINE, padded};
use crate::first_layer::SumRows;
use crate::matmul::{FAR, Factor};
use crate::mlp::Mlp;

/// What a forward pass needs of the parameters, apart from the weights that are read where they lie:
/// rows padded to whole lines, so that products have no tails and their loads straddle no lines.
#[derive(Clone, Debug, Default)]
pub(crate) struct Packed {
    /// `[padded(width)]` of the first layer: its bias plus the weights of the constant inputs.
    pub(crate) constant_sum: Buffer,
    /// Per layer `[padded(width)]`.
    pub(crate) biases: Vec<Buffer>,
    /// Per layer `[padded(inputs), padded(width)]`; nothing for the first, and where
    /// [`reads_in_place`].
    pub(crate) weights: Vec<Buffer>,
}

/// Whether a dense layer's weight is read where it lies: if it needs no padding, and products with a
/// batch pack it for the cache anyway. Those with one sample wait for the memory, aligned or not.
fn reads_in_place(block: &Block) -> bool {
    block.width >= FAR && [block.inputs, block.width].iter().all(|size| size.is_multiple_of(LINE))
}

impl Packed {
    pub(crate) fn pack(&mut self, arch: Arch, mlp: &Mlp, params: &[f32], constant: &[u16]) {
        self.biases.resize_with(mlp.blocks().len(), Buffer::default);
        self.weights.resize_with(mlp.blocks().len(), Buffer::default);
        for (index, block) in mlp.blocks().iter().enumerate() {
            let in_place = reads_in_place(block);
            self.biases[index].copy_padded(&params[block.bias.clone()], block.width);
            if index == 0 {
                // The constant inputs are one sample, whose sum starts from the bias.
                self.constant_sum.resize(padded(block.width));
                arch.dispatch(SumRows {
                    weight: &params[block.weight.clone()],
                    width: block.width,
                    initial: &self.biases[0],
                    samples: std::iter::once(constant),
                    out: &mut self.constant_sum,
                });
            } else if !in_place {
                let weight = &mut self.weights[index];
                weight.copy_padded(&params[block.weight.clone()], block.width);
                weight.resize(padded(block.inputs) * padded(block.width));
            }
        }
    }

    /// The weight of a layer but the first, with rows padded to whole lines.
    pub(crate) fn weight<'a>(&'a self, index: usize, block: &Block, params: &'a [f32]) -> Factor<'a> {
        if reads_in_place(block) {
            Factor::new(&params[block.weight.clone()], block.width)
        } else {
            Factor::new(&self.weights[index], padded(block.width))
        }
    }
}
