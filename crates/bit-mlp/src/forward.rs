//! From bits to outputs: for a batch, keeping what the gradient needs, and for one sample, as fast
//! as can be.

use pulp::Arch;

use crate::activation::{Activate, ActivatePair};
use crate::batch::Batch;
use crate::block::{Activation, Block, Form};
use crate::buffer::padded;
use crate::first_layer::SumRows;
use crate::matmul::{Factor, Matmul};
use crate::mlp::Mlp;
use crate::norm::Normalise;
use crate::packed::Packed;
use crate::workspace::{Passed, Trace, Workspace};

impl Packed {
    /// Runs the network on `samples`, `B` of them, and leaves in `trace`, which has the network's
    /// depth, what every layer computed.
    ///
    /// Both ways to an output end here, which is why they agree bit for bit.
    fn run<'a>(
        &self,
        arch: Arch,
        mlp: &Mlp,
        params: &[f32],
        samples: impl ExactSizeIterator<Item = &'a [u16]> + Clone,
        trace: &mut Trace,
    ) {
        let Trace { layers, aside } = trace;
        for (index, block) in mlp.blocks().iter().enumerate() {
            let (before, after) = layers.split_at_mut(index);
            let Passed { leaving, normalised, inverse } = &mut after[0];
            let width = padded(block.width);
            let len = samples.len() * width;
            // The sums go straight to where they leave the layer, unless more leaves it or something comes before the
            // activation.
            let form = block.activation.map(Activation::form);
            let activated = if let Some(Form::Pair(_)) = form { &mut *aside } else { &mut *leaving };
            let out = if block.norm.is_some() { &mut *normalised } else { &mut *activated };
            out.resize(len);
            if let Some(input) = before.last() {
                arch.dispatch(Matmul {
                    left: Factor::new(&input.leaving, padded(block.inputs)),
                    right: self.weight(index, block, params),
                    initial: Some(&self.biases[index]),
                    depth: block.inputs,
                    width,
                    out,
                });
            } else {
                arch.dispatch(SumRows {
                    weight: &params[block.weight.clone()],
                    width: block.width,
                    initial: &self.constant_sum,
                    samples: samples.clone(),
                    out,
                });
            }
            if let Some(norm) = &block.norm {
                activated.resize(len);
                inverse.resize(samples.len(), 0.0);
                arch.dispatch(Normalise {
                    scale: &params[norm.scale.clone()],
                    shift: &params[norm.shift.clone()],
                    values: normalised,
                    inverse,
                    out: activated,
                });
            }
            match form {
                None => {}
                Some(Form::Single(activation)) => arch.dispatch(Activate { activation, values: leaving }),
                Some(Form::Pair(activation)) => {
                    leaving.resize(samples.len() * padded(block.outputs()));
                    arch.dispatch(ActivatePair { activation, values: aside, width: block.width, out: leaving });
                }
            }
        }
    }
}

impl Mlp {
    /// The outputs `[B, outputs]` of the network, row-major, for the samples of `batch`; `params`
    /// is the whole flat slice.
    ///
    /// What [`backward`](Self::backward) needs stays in `workspace`, where [`Workspace::activations`]
    /// reads what left each layer.
    pub fn forward<'w>(&self, params: &[f32], batch: Batch<'_>, workspace: &'w mut Workspace) -> &'w [f32] {
        let Workspace { arch, packed, trace, widths, outputs, .. } = workspace;
        widths.clear();
        widths.extend(self.blocks().iter().map(Block::outputs));
        packed.pack(*arch, self, params, batch.constant());
        trace.layers.resize_with(self.blocks().len(), Passed::default);
        packed.run(*arch, self, params, batch.samples(), trace);
        outputs.resize(batch.len() * self.outputs(), 0.0);
        trace.layers[self.blocks().len() - 1].leaving.copy_unpadded(outputs, self.outputs());
        outputs
    }
}

/// A network made ready to act: one sample at a time, while its parameters and the constant inputs
/// stay the same.
///
/// What depends on those alone is computed once, so that a sample costs a fraction of a
/// microsecond. The outputs are those of [`Mlp::forward`] bit for bit: a policy's log-probabilities
/// of a rollout, computed again in a batch, do not move.
#[derive(Clone, Debug)]
pub struct Prepared {
    mlp: Mlp,
    arch: Arch,
    packed: Packed,
    trace: Trace,
}

impl Prepared {
    /// Prepares the network for these parameters (the whole flat slice) and constant inputs.
    pub fn new(mlp: &Mlp, params: &[f32], constant: &[u16]) -> Self {
        Self::with_arch(Arch::new(), mlp, params, constant)
    }

    fn with_arch(arch: Arch, mlp: &Mlp, params: &[f32], constant: &[u16]) -> Self {
        let mut prepared = Self { mlp: mlp.clone(), arch, packed: Packed::default(), trace: Trace::default() };
        prepared.refresh(params, constant);
        prepared
    }

    /// Prepares the network anew, after an update of the parameters or on another map. Allocates
    /// nothing.
    pub fn refresh(&mut self, params: &[f32], constant: &[u16]) {
        self.packed.pack(self.arch, &self.mlp, params, constant);
        self.trace.layers.resize_with(self.mlp.blocks().len(), Passed::default);
    }

    /// The outputs `[outputs]` for one sample with these active inputs beside the constant ones.
    ///
    /// `params` must be those of the last [`refresh`](Self::refresh): the weights of the first layer
    /// and of wide ones are read from them, the rest from the preparation.
    pub fn forward_one(&mut self, params: &[f32], active: &[u16]) -> &[f32] {
        self.packed.run(self.arch, &self.mlp, params, std::iter::once(active), &mut self.trace);
        &self.trace.layers[self.mlp.blocks().len() - 1].leaving[..self.mlp.outputs()]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::batch::BitBatch;
    use crate::block::Shape;

    /// Plain code, every instruction set of this machine that is supported, and the one
    /// that is chosen.
    fn architectures() -> Vec<Arch> {
        let mut all = vec![Arch::Scalar, Arch::new()];
        #[cfg(target_arch = "x86_64")]
        all.extend(pulp::x86::V3::try_new().map(Arch::V3));
        all
    }

    #[test]
    fn instruction_sets_agree() {
        // The wide one has products in several blocks, packed, read in place, and with a gradient that goes straight
        // to its place.
        let shapes = [(&[37, 64][..], 0.3), (&[37, 272, 256], 0.1)].into_iter().flat_map(|(hidden, scale)| {
            let activations = [Activation::Tanh, Activation::Relu, Activation::Crelu, Activation::Fourier];
            let all = activations.map(|activation| {
                [false, true]
                    .map(|layer_norm| (Shape { inputs: 40, hidden, outputs: 5, activation, layer_norm }, scale))
            });
            all.into_iter().flatten()
        });
        for (shape, scale) in shapes {
            let mlp = Mlp::from_shape(shape, 3);
            let params: Vec<f32> = (0..mlp.range().end).map(|i| (i as f32 * 0.7).sin() * scale).collect();
            let mut batch = BitBatch::default();
            batch.set_constant(&[1, 5, 39]);
            for sample in 0..70 {
                batch.push_with(|active| active.extend((6..39).filter(|i| (i * sample) % 7 == 3)));
            }
            let d_outputs: Vec<f32> = (0..70 * 5).map(|i| (i as f32 * 0.3).cos()).collect();

            let results = architectures().into_iter().map(|arch| {
                let mut workspace = Workspace::with_arch(arch);
                let mut results = mlp.forward(&params, batch.all(), &mut workspace).to_vec();
                let mut prepared = Prepared::with_arch(arch, &mlp, &params, batch.constant());
                let acted = batch.all().samples().flat_map(|sample| prepared.forward_one(&params, sample).to_vec());
                assert_eq!(acted.collect::<Vec<_>>(), results);

                let mut grads = vec![0.0; params.len()];
                mlp.backward(&params, batch.all(), &d_outputs, &mut workspace, &mut grads);
                results.extend(grads);
                results
            });
            let results: Vec<_> = results.collect();
            for other in &results[1..] {
                for (a, b) in results[0].iter().zip(other) {
                    assert!((a - b).abs() <= 1e-5 * (1.0 + a.abs()), "{a} and {b}");
                }
            }
        }
    }
}
