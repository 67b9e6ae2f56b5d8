//! One layout of a layer, for all who compute, count, store or read its parameters.

use std::ops::Range;

/// What follows the sums of a hidden layer. The last layer has none.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Activation {
    /// Hyperbolic tangent, as Stable-Baselines3's PPO.
    Tanh,
    /// `max(x, 0)`, as Stable-Baselines3's DQN. Its derivative at 0 is taken as 0.
    Relu,
}

/// A layer and where its parameters lie in the flat slice: `y = activation(x · weight + bias)`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Block {
    /// Number of inputs.
    pub inputs: usize,
    /// Number of units, each with its sum.
    pub width: usize,
    /// Where the weight `[inputs, width]` lies, row-major.
    pub weight: Range<usize>,
    /// Where the bias `[width]` lies.
    pub bias: Range<usize>,
    /// What follows the sums; `None` in the last layer.
    pub activation: Option<Activation>,
}

/// A tensor of a block and where it lies in the flat slice.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Place {
    /// `weight` or `bias`.
    pub name: &'static str,
    /// Its shape, row-major.
    pub shape: Vec<usize>,
    /// Where it lies.
    pub range: Range<usize>,
}

impl Block {
    /// A block whose first parameter is `params[offset]`.
    fn new(inputs: usize, width: usize, activation: Option<Activation>, offset: usize) -> Self {
        let mut end = offset;
        let mut next = |len: usize| {
            let start = end;
            end += len;
            start..end
        };
        Self { inputs, width, weight: next(inputs * width), bias: next(width), activation }
    }

    /// Number of values that leave the block for each sample.
    pub fn outputs(&self) -> usize {
        self.width
    }

    /// The block's tensors in the order in which they lie, one after the other.
    pub fn places(&self) -> Vec<Place> {
        vec![
            Place { name: "weight", shape: vec![self.inputs, self.width], range: self.weight.clone() },
            Place { name: "bias", shape: vec![self.width], range: self.bias.clone() },
        ]
    }

    /// Where all parameters of the block lie.
    pub fn range(&self) -> Range<usize> {
        self.weight.start..self.bias.end
    }
}

/// What a network looks like. It owns nothing, so that it can be counted before anything is made.
///
/// ```
/// use bit_mlp::{Activation, Shape};
///
/// let shape = Shape { inputs: 256, hidden: &[64, 64], outputs: 4, activation: Activation::Tanh };
/// assert_eq!(shape.num_parameters(), (256 + 1) * 64 + (64 + 1) * 64 + (64 + 1) * 4);
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Shape<'a> {
    /// Number of inputs.
    pub inputs: usize,
    /// Number of units of every hidden layer.
    pub hidden: &'a [usize],
    /// Number of outputs.
    pub outputs: usize,
    /// What follows the sums of every hidden layer.
    pub activation: Activation,
}

impl Shape<'_> {
    /// Number of parameters of such a network; `u64::MAX` if there are more than that.
    pub fn num_parameters(&self) -> u64 {
        let mut inputs = self.inputs as u64;
        let mut sum = 0_u64;
        for width in self.widths() {
            let width = width as u64;
            sum = sum.saturating_add(inputs.saturating_add(1).saturating_mul(width));
            inputs = width;
        }
        sum
    }

    /// The blocks of a network whose first parameter is `params[offset]`, from the inputs to the
    /// outputs.
    ///
    /// # Panics
    /// If there are more parameters than a slice can have.
    pub(crate) fn blocks(&self, offset: usize) -> Vec<Block> {
        let end = usize::try_from(self.num_parameters()).ok().and_then(|len| len.checked_add(offset));
        assert!(end.is_some_and(|end| end <= isize::MAX as usize), "{self:?} has too many parameters");
        let (mut inputs, mut offset) = (self.inputs, offset);
        let block = |(index, width)| {
            let activation = (index < self.hidden.len()).then_some(self.activation);
            let block = Block::new(inputs, width, activation, offset);
            (inputs, offset) = (block.outputs(), block.range().end);
            block
        };
        self.widths().enumerate().map(block).collect()
    }

    /// Number of units of every layer, the last included.
    pub(crate) fn widths(&self) -> impl Iterator<Item = usize> {
        self.hidden.iter().copied().chain([self.outputs])
    }
}
