//! The layers of all seeds as views into their parameters.

use bit_mlp::{Activation, Block};
use cpp_rl::agent::network::Network;
use tch::Tensor;

/// ε of a layer's norm, PyTorch's default.
const NORM_EPS: f64 = 1e-5;

/// The layers of one tower for all seeds.
pub struct TowerViews(Vec<LayerViews>);

/// One layer for all seeds.
struct LayerViews {
    /// `[S, in, units]`.
    weight: Tensor,
    /// `[S, 1, units]`.
    bias: Tensor,
    /// Scale and shift of a norm, `[S, 1, units]` each.
    norm: Option<[Tensor; 2]>,
    activation: Option<Activation>,
}

impl TowerViews {
    /// The towers of `network` as views into `parameters`, `[S, P]`.
    ///
    /// One split for all of them: its gradient is one concatenation, where a slice each would give a full `[S, P]`
    /// tensor each.
    pub fn all(network: &Network, parameters: &Tensor) -> Vec<Self> {
        let places = network.tensors();
        let sizes: Vec<i64> = places.iter().map(|place| place.range.len() as i64).collect();
        let mut parts = parameters.split_with_sizes(sizes, 1).into_iter();
        let mut view = |rows: usize, columns: usize| {
            let Some(part) = parts.next() else { unreachable!("there are as many parts as tensors") };
            part.view([-1, rows as i64, columns as i64])
        };
        let mut layer = |block: &Block| LayerViews {
            weight: view(block.inputs, block.width),
            bias: view(1, block.width),
            norm: block.norm.as_ref().map(|_| [view(1, block.width), view(1, block.width)]),
            activation: block.activation,
        };
        network.towers().iter().map(|tower| Self(tower.mlp.blocks().iter().map(&mut layer).collect())).collect()
    }

    /// What leaves each layer on `inputs` `[S, B, in]`, `[S, B, out]` each: activated in all but the last.
    pub fn activations(&self, inputs: &Tensor) -> Vec<Tensor> {
        let mut activations: Vec<Tensor> = Vec::with_capacity(self.0.len());
        for layer in &self.0 {
            let sums = layer.bias.baddbmm(activations.last().unwrap_or(inputs), &layer.weight, 1.0, 1.0);
            activations.push(layer.leave(sums));
        }
        activations
    }
}

impl LayerViews {
    /// What leaves the layer, given its sums `[S, B, units]`.
    fn leave(&self, sums: Tensor) -> Tensor {
        let sums = match &self.norm {
            Some([scale, shift]) => {
                let units = scale.size()[2];
                sums.layer_norm([units], None::<&Tensor>, None::<&Tensor>, NORM_EPS, false) * scale + shift
            }
            None => sums,
        };
        match self.activation {
            None => sums,
            Some(Activation::Tanh) => sums.tanh(),
            Some(Activation::Relu) => sums.relu(),
            Some(Activation::Crelu) => Tensor::cat(&[sums.relu(), (-sums).relu()], -1),
            Some(Activation::Fourier) => Tensor::cat(&[sums.sin(), sums.cos()], -1),
        }
    }
}
