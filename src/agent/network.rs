//! The networks: which towers there are, where their parameters lie in one flat slice, and how they begin.

use std::ops::Range;

use bit_mlp::{Activation, Block, Mlp, Shape};
use coverage_env::random::unit_f64;

use crate::random::Stream;

/// The towers of one agent over one flat slice of P parameters.
#[derive(Clone, Debug)]
pub struct Network {
    layout: Layout,
    towers: Vec<Tower>,
}

/// What all towers of a network have in common.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Layout {
    /// Number of inputs.
    pub inputs: usize,
    /// Units of each hidden layer.
    pub hidden: Vec<usize>,
    /// What follows the sums of the hidden layers.
    pub activation: Activation,
    /// Whether the sums of the hidden layers are normalised.
    pub layer_norm: bool,
}

/// What the outputs of the acting tower mean, one for each action.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Outputs {
    /// Logits of a policy, which can be sampled from.
    Logits,
    /// Action values.
    Values,
}

/// One tower as an algorithm wants it.
#[derive(Clone, Copy, Debug)]
pub struct Head {
    /// The prefix of its tensors' names.
    pub name: &'static str,
    /// How many outputs it has.
    pub outputs: usize,
    /// How its weights begin.
    pub init: Init,
}

/// One named multilayer perceptron.
#[derive(Clone, Debug)]
pub struct Tower {
    /// The prefix of its tensors' names.
    pub name: &'static str,
    /// `[inputs, hidden…, outputs]`: the units of each layer.
    pub sizes: Vec<usize>,
    /// Its place in the flat slice.
    pub mlp: Mlp,
    /// How its weights begin.
    init: Init,
}

/// How the weights of a tower begin.
#[derive(Clone, Copy, Debug)]
pub enum Init {
    /// Orthogonal with gain √2 in hidden layers and this gain in the last; biases 0 (Stable-Baselines3's PPO).
    Orthogonal {
        /// Gain of the last layer.
        head: f64,
    },
    /// PyTorch's `nn.Linear`: weights and biases uniform in ±1/√inputs.
    Uniform,
}

impl Layout {
    /// The shape of a tower with so many outputs.
    pub fn shape(&self, outputs: usize) -> Shape<'_> {
        let Self { inputs, ref hidden, activation, layer_norm } = *self;
        Shape { inputs, hidden, outputs, activation, layer_norm }
    }
}

/// A layer's tensor within the flat slice.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct TensorPlace {
    /// `<tower>.<layer>.<tensor>`: `weight`, `bias` and, of a norm, `scale` and `shift`.
    pub name: String,
    /// `[inputs, units]` of a weight, `[units]` of the others.
    pub shape: Vec<usize>,
    /// Where it lies.
    pub range: Range<usize>,
}

impl Network {
    /// A tower for each head, over the same inputs, with hidden layers alike.
    pub fn new(layout: Layout, heads: &[Head]) -> Self {
        let mut offset = 0;
        let towers = heads.iter().map(|&Head { name, outputs, init }| {
            let Layout { inputs, ref hidden, .. } = layout;
            let sizes = [inputs].into_iter().chain(hidden.iter().copied()).chain([outputs]).collect();
            let mlp = Mlp::from_shape(layout.shape(outputs), offset);
            offset += mlp.num_parameters();
            Tower { name, sizes, mlp, init }
        });
        Self { towers: towers.collect(), layout }
    }

    /// What its towers have in common.
    pub fn layout(&self) -> &Layout {
        &self.layout
    }

    /// The towers in the order of their parameters.
    pub fn towers(&self) -> &[Tower] {
        &self.towers
    }

    /// The tower that chooses actions.
    pub fn acting(&self) -> &Mlp {
        &self.towers[0].mlp
    }

    /// The hidden layers of all towers.
    pub fn hidden_blocks(&self) -> impl Iterator<Item = &Block> {
        self.towers.iter().flat_map(|tower| tower.mlp.blocks().split_last().map_or(&[][..], |(_, hidden)| hidden))
    }

    /// Activation of the hidden layers.
    pub fn activation(&self) -> Activation {
        self.layout.activation
    }

    /// P.
    pub fn num_parameters(&self) -> usize {
        self.towers.iter().map(|tower| tower.mlp.num_parameters()).sum()
    }

    /// Number of inputs: as many as the arm's sensor has on the maps.
    pub fn num_inputs(&self) -> usize {
        self.layout.inputs
    }

    /// Every tensor in the order of the flat slice.
    pub fn tensors(&self) -> Vec<TensorPlace> {
        let of_tower = |tower: &Tower| {
            let name = tower.name;
            let of_block = |(i, block): (usize, &Block)| {
                let place = |place: bit_mlp::Place| TensorPlace {
                    name: format!("{name}.{i}.{}", place.name),
                    shape: place.shape,
                    range: place.range,
                };
                block.places().into_iter().map(place).collect::<Vec<_>>()
            };
            tower.mlp.blocks().iter().enumerate().flat_map(of_block).collect::<Vec<_>>()
        };
        self.towers.iter().flat_map(of_tower).collect()
    }

    /// The ranges of all weights, ascending; biases and norms are left out.
    pub fn weights(&self) -> Vec<Range<usize>> {
        let weights = self.tensors().into_iter().filter(|tensor| tensor.shape.len() == 2);
        weights.map(|tensor| tensor.range).collect()
    }

    /// Initial parameters `[P]`.
    pub fn init(&self, stream: &mut Stream) -> Vec<f32> {
        let mut parameters = vec![0.0; self.num_parameters()];
        for tower in &self.towers {
            let last = tower.sizes.len() - 2;
            for (i, layer) in tower.mlp.blocks().iter().enumerate() {
                if let Some(norm) = &layer.norm {
                    parameters[norm.scale.clone()].fill(1.0);
                }
                match tower.init {
                    Init::Orthogonal { head } => {
                        let gain = if i == last { head } else { std::f64::consts::SQRT_2 };
                        let weight = &mut parameters[layer.weight.clone()];
                        orthogonal(weight, layer.inputs, layer.width, gain, stream);
                    }
                    Init::Uniform => {
                        let bound = uniform_bound(layer);
                        let draw = |p: &mut f32| *p = ((2.0 * unit_f64(stream) - 1.0) * bound) as f32;
                        parameters[layer.weight.start..layer.bias.end].iter_mut().for_each(draw);
                    }
                }
            }
        }
        parameters
    }
}

impl Tower {
    /// Weights that go into one unit of a hidden layer, `[inputs]`, distributed as a unit's of a new agent.
    ///
    /// A column of a random (semi-)orthogonal matrix is part of a random direction as long as the matrix's longer side.
    pub fn new_unit(&self, layer: usize, stream: &mut Stream) -> Vec<f32> {
        let block = &self.mlp.blocks()[layer];
        match self.init {
            Init::Orthogonal { head: _ } => {
                let direction: Vec<f64> =
                    std::iter::repeat_with(|| stream.normal_pair().0).take(block.inputs.max(block.width)).collect();
                let norm = direction.iter().map(|v| v * v).sum::<f64>().sqrt();
                direction[..block.inputs].iter().map(|v| (std::f64::consts::SQRT_2 * v / norm) as f32).collect()
            }
            Init::Uniform => {
                let bound = uniform_bound(block);
                std::iter::repeat_with(|| ((2.0 * unit_f64(stream) - 1.0) * bound) as f32).take(block.inputs).collect()
            }
        }
    }
}

/// The largest weight of a layer that begins uniformly.
fn uniform_bound(block: &Block) -> f64 {
    1.0 / (block.inputs as f64).sqrt()
}

/// Fills `weight`, `[rows, columns]` row-major, with `gain` times a uniformly random (semi-)orthogonal matrix.
///
/// The orthonormalised columns of a normal matrix, or its rows where they are fewer (Saxe et al. 2014; what PyTorch's
/// `orthogonal_` draws). Gram–Schmidt keeps the diagonal of R positive, which makes the distribution uniform (Mezzadri
/// 2007); a second pass makes it as accurate as f64 allows.
fn orthogonal(weight: &mut [f32], rows: usize, columns: usize, gain: f64, stream: &mut Stream) {
    let (count, length) = (rows.min(columns), rows.max(columns));
    let mut basis: Vec<Vec<f64>> = Vec::with_capacity(count);
    while basis.len() < count {
        let mut vector: Vec<f64> = std::iter::repeat_with(|| stream.normal_pair().0).take(length).collect();
        for _ in 0..2 {
            for unit in &basis {
                let along: f64 = vector.iter().zip(unit).map(|(v, u)| v * u).sum();
                vector.iter_mut().zip(unit).for_each(|(v, u)| *v -= along * u);
            }
        }
        let norm = vector.iter().map(|v| v * v).sum::<f64>().sqrt();
        basis.push(vector.into_iter().map(|v| v / norm).collect());
    }
    for (row, out) in weight.chunks_exact_mut(columns).enumerate() {
        for (column, w) in out.iter_mut().enumerate() {
            let unit = if rows >= columns { basis[column][row] } else { basis[row][column] };
            *w = (gain * unit) as f32;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::agent::registry;
    use crate::random::Purpose;

    fn network(algorithm: &str, inputs: usize, hidden: &[usize], activation: Activation) -> Network {
        let layout = Layout { inputs, hidden: hidden.to_vec(), activation, layer_norm: false };
        Network::new(layout, registry::by_name(algorithm).unwrap().heads())
    }

    #[test]
    fn orthogonal_weights_have_their_gain() {
        for (inputs, hidden) in [(60, vec![16, 16]), (4, vec![16, 7])] {
            let network = network("ppo", inputs, &hidden, Activation::Tanh);
            let parameters = network.init(&mut Stream::new(1, 0, Purpose::Weights));
            for tower in network.towers() {
                for (i, layer) in tower.mlp.blocks().iter().enumerate() {
                    let head = if tower.name == "policy" { 0.01_f64 } else { 1.0 };
                    let gain = if i == hidden.len() { head * head } else { 2.0 };
                    let w = &parameters[layer.weight.clone()];
                    let at = |r: usize, c: usize| f64::from(w[r * layer.width + c]);
                    let (count, by_column) = (layer.inputs.min(layer.width), layer.inputs >= layer.width);
                    let length = layer.inputs.max(layer.width);
                    for a in 0..count {
                        for b in 0..count {
                            let entry = |k, v| if by_column { at(k, v) } else { at(v, k) };
                            let dot: f64 = (0..length).map(|k| entry(k, a) * entry(k, b)).sum();
                            let expected = if a == b { gain } else { 0.0 };
                            assert!((dot - expected).abs() < 1e-6 * gain.max(1e-4), "{} {i}: {dot}", tower.name);
                        }
                    }
                    assert!(parameters[layer.bias.clone()].iter().all(|&b| b == 0.0));
                }
            }
        }
    }

    #[test]
    fn uniform_weights_fill_their_interval() {
        let network = network("dqn", 256, &[64, 64], Activation::Relu);
        let parameters = network.init(&mut Stream::new(1, 0, Purpose::Weights));
        for layer in network.acting().blocks() {
            let bound = 1.0 / (layer.inputs as f32).sqrt();
            let weight = &parameters[layer.weight.clone()];
            let largest = weight.iter().fold(0.0_f32, |m, w| m.max(w.abs()));
            assert!(largest <= bound && largest > 0.98 * bound);
            assert!(parameters[layer.bias.clone()].iter().all(|b| b.abs() <= bound && *b != 0.0));
            let mean_square = weight.iter().map(|w| f64::from(w * w)).sum::<f64>() / weight.len() as f64;
            let expected = f64::from(bound * bound) / 3.0;
            assert!((mean_square / expected - 1.0).abs() < 0.2);
        }
    }

    #[test]
    fn norms_begin_as_the_identity() {
        let layout = Layout { inputs: 60, hidden: vec![7, 5], activation: Activation::Crelu, layer_norm: true };
        let network = Network::new(layout, registry::by_name("dqn").unwrap().heads());
        let parameters = network.init(&mut Stream::new(1, 0, Purpose::Weights));
        for tensor in network.tensors().into_iter().filter(|tensor| tensor.shape.len() == 1) {
            let values = &parameters[tensor.range];
            match tensor.name.rsplit('.').next() {
                Some("scale") => assert!(values.iter().all(|&v| v == 1.0)),
                Some("shift") => assert!(values.iter().all(|&v| v == 0.0)),
                _ => assert!(values.iter().all(|&v| v != 0.0), "{}", tensor.name),
            }
        }
    }

    #[test]
    fn tensors_tile_the_flat_slice() {
        let network = network("ppo", 256, &[64, 64], Activation::Tanh);
        let mut end = 0;
        for tensor in network.tensors() {
            assert_eq!(tensor.range.start, end);
            assert_eq!(tensor.range.len(), tensor.shape.iter().product::<usize>());
            end = tensor.range.end;
        }
        assert_eq!(end, network.num_parameters());
        assert_eq!(end, 2 * (256 * 64 + 64 + 64 * 64 + 64) + 65 * 4 + 65);
    }
}
