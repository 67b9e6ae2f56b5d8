//! The gradient of the parameters, derived by hand.

use crate::activation::{Differentiate, DifferentiatePair};
use crate::batch::Batch;
use crate::block::Form;
use crate::buffer::{Buffer, padded};
use crate::first_layer::WeightGradient;
use crate::matmul::{Factor, Matmul};
use crate::mlp::Mlp;
use crate::norm::NormGradient;
use crate::workspace::{Passed, Trace, Workspace};

impl Mlp {
    /// The gradient of the loss with respect to this network's parameters, written over
    /// `grads[self.range()]`.
    ///
    /// `d_outputs` `[B, outputs]` is the gradient of the loss with respect to the outputs of the
    /// [`forward`](Self::forward) pass that went before, with the same `params`, `batch` and
    /// `workspace`. `grads` is flat like the parameters, and nothing of it outside of the network's
    /// range is touched.
    ///
    /// With `x` what enters a layer, `δ` the gradient at its sums, and `b` the samples: `∂bias = Σ_b
    /// δ_b`, `∂weight = xᵀ δ`, and one layer down `δ' = (δ weightᵀ) ⊙ activation'`, taken further
    /// through a normalisation. In the first layer `x` is bits: `δ_b` is added to the rows of sample `b`'s
    /// active inputs, and the rows of the constant inputs all equal `∂bias`.
    ///
    /// # Panics
    /// If the shapes do not fit, or `workspace` did not just serve a forward pass of as many
    /// samples.
    pub fn backward(
        &self,
        params: &[f32],
        batch: Batch<'_>,
        d_outputs: &[f32],
        workspace: &mut Workspace,
        grads: &mut [f32],
    ) {
        let Workspace { arch, packed, trace, deltas, gradient, bias, active_in, .. } = workspace;
        let Trace { layers, aside } = trace;
        let last = self.blocks().len() - 1;
        assert_eq!(d_outputs.len(), batch.len() * self.outputs(), "d_outputs is [B, outputs]");
        assert_eq!(
            layers[last].leaving.len(),
            batch.len() * padded(self.outputs()),
            "the forward pass had another shape"
        );

        deltas.resize_with(self.blocks().len(), Buffer::default);
        deltas[last].copy_padded(d_outputs, self.outputs());
        for (index, block) in self.blocks().iter().enumerate().rev() {
            let (inputs, width) = (padded(block.inputs), padded(block.width));
            let (lower, upper) = deltas.split_at_mut(index);
            let delta = &*upper[0];

            // ∂bias = Σ_b δ_b
            bias.resize(width);
            arch.dispatch(Matmul {
                left: Factor::ones(),
                right: Factor::new(delta, width),
                initial: None,
                depth: batch.len(),
                width,
                out: bias,
            });
            grads[block.bias.clone()].copy_from_slice(&bias[..block.width]);

            let Some(lower) = lower.last_mut() else {
                active_in.resize(block.inputs, 0);
                arch.dispatch(WeightGradient {
                    deltas: delta,
                    width: block.width,
                    constant: batch.constant(),
                    shared: bias,
                    samples: batch.samples(),
                    active_in,
                    gradient: &mut grads[block.weight.clone()],
                });
                continue;
            };
            let Passed { leaving, normalised, inverse } = &layers[index - 1];
            let input = &**leaving;

            // ∂weight = xᵀ δ, or δᵀ x where most of δ is padding: the same products in the same order
            let narrow = block.width <= width / 2;
            let (left, left_width, right, right_width) =
                if narrow { (delta, width, input, inputs) } else { (input, inputs, delta, width) };
            let weight = &mut grads[block.weight.clone()];
            // Straight to where it belongs, if that is as wide as what is computed.
            let direct = !narrow && block.width == width;
            if !direct {
                gradient.resize(if narrow { block.width } else { inputs } * right_width);
            }
            arch.dispatch(Matmul {
                left: Factor::new(left, left_width).transposed(),
                right: Factor::new(right, right_width),
                initial: None,
                depth: batch.len(),
                width: right_width,
                out: if direct { weight } else { gradient },
            });
            if narrow {
                for (i, row) in weight.chunks_exact_mut(block.width).enumerate() {
                    for (o, element) in row.iter_mut().enumerate() {
                        *element = gradient[o * inputs + i];
                    }
                }
            } else if !direct {
                gradient.copy_unpadded(weight, block.width);
            }

            // δ' = (δ weightᵀ) ⊙ activation'
            let below = &self.blocks()[index - 1];
            let form = self.activation().form();
            let d_leaving = if let Form::Pair(_) = form { &mut *aside } else { &mut *lower };
            d_leaving.resize(batch.len() * inputs);
            arch.dispatch(Matmul {
                left: Factor::new(delta, width),
                right: packed.weight(index, block, params).transposed(),
                initial: None,
                depth: block.width,
                width: inputs,
                out: d_leaving,
            });
            match form {
                Form::Single(activation) => {
                    arch.dispatch(Differentiate { activation, activated: input, gradients: lower });
                }
                Form::Pair(activation) => {
                    let width = below.width;
                    lower.resize(batch.len() * padded(width));
                    arch.dispatch(DifferentiatePair {
                        activation,
                        activated: input,
                        gradients: aside,
                        width,
                        out: lower,
                    });
                }
            }
            if let Some(norm) = &below.norm {
                let (d_scale, d_shift) = grads[norm.scale.start..norm.shift.end].split_at_mut(norm.scale.len());
                arch.dispatch(NormGradient {
                    scale: &params[norm.scale.clone()],
                    normalised,
                    inverse,
                    gradients: lower,
                    d_scale,
                    d_shift,
                });
            }
        }
    }
}
