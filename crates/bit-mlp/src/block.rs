//! Where the parameters of a layer lie: one layout to compute with, count, store and read.

use std::ops::Range;

/// What follows the sums of a hidden layer. The last layer has none.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Activation {
    /// Hyperbolic tangent, as Stable-Baselines3's PPO.
    Tanh,
    /// `max(x, 0)`, as Stable-Baselines3's DQN. Its derivative at 0 is taken as 0.
    Relu,
    /// `[max(x, 0), max(−x, 0)]`: two values per unit, so that one of them always passes a
    /// gradient (Abbas et al., 2023, <https://arxiv.org/abs/2303.07507>). Both derivatives at 0 are taken as 0.
    Crelu,
    /// `[sin x, cos x]`: two values per unit, of which one is always nearly linear (deep Fourier features, Lewandowski,
    /// Schuurmans & Machado, 2024, <https://arxiv.org/abs/2410.20634>).
    Fourier,
}

/// How values leave a unit: one in the place of its sum, or two.
#[derive(Clone, Copy)]
pub(crate) enum Form {
    Single(Single),
    Pair(Pair),
}

/// An activation that leaves one value.
#[derive(Clone, Copy)]
pub(crate) enum Single {
    Tanh,
    Relu,
}

/// An activation that leaves two values.
#[derive(Clone, Copy)]
pub(crate) enum Pair {
    Crelu,
    Fourier,
}

impl Activation {
    /// Number of values that leave a unit for each sample.
    pub const fn outputs_per_unit(self) -> usize {
        match self.form() {
            Form::Single(_) => 1,
            Form::Pair(_) => 2,
        }
    }

    pub(crate) const fn form(self) -> Form {
        match self {
            Activation::Tanh => Form::Single(Single::Tanh),
            Activation::Relu => Form::Single(Single::Relu),
            Activation::Crelu => Form::Pair(Pair::Crelu),
            Activation::Fourier => Form::Pair(Pair::Fourier),
        }
    }
}

/// A layer and where its parameters lie in the flat slice: `y = activation(norm(x · weight + bias))`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Block {
    /// Number of inputs.
    pub inputs: usize,
    /// Number of units, each with its sum; [`outputs`](Self::outputs) says how many values leave them.
    pub width: usize,
    /// Where the weight `[inputs, width]` lies, row-major.
    pub weight: Range<usize>,
    /// Where the bias `[width]` lies.
    pub bias: Range<usize>,
    /// What normalises the sums, if anything does; never in the last layer.
    pub norm: Option<Norm>,
    /// What comes after that; `None` in the last layer.
    pub activation: Option<Activation>,
}

/// A layer normalisation, and where its parameters lie in the flat slice.
///
/// The sums of a sample are brought to mean 0 and variance 1 over the units, as by PyTorch's
/// `nn.LayerNorm`: `(sum − mean) / √(variance + ε) · scale + shift`, with the biased variance.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Norm {
    /// Where the scale `[width]` lies; it is 1 at first.
    pub scale: Range<usize>,
    /// Where the shift `[width]` lies; it is 0 at first.
    pub shift: Range<usize>,
}

impl Norm {
    /// ε.
    pub const EPSILON: f32 = 1e-5;
}

/// A tensor of a block and where it lies in the flat slice.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Place {
    /// `weight`, `bias`, `scale` or `shift`.
    pub name: &'static str,
    /// Its shape, row-major.
    pub shape: Vec<usize>,
    /// Where it lies.
    pub range: Range<usize>,
}

impl Block {
    /// A block whose first parameter is `params[offset]`.
    fn new(inputs: usize, width: usize, layer_norm: bool, activation: Option<Activation>, offset: usize) -> Self {
        let mut end = offset;
        let mut next = |len: usize| {
            let start = end;
            end += len;
            start..end
        };
        let (weight, bias) = (next(inputs * width), next(width));
        let norm = layer_norm.then(|| Norm { scale: next(width), shift: next(width) });
        Self { inputs, width, weight, bias, norm, activation }
    }

    /// Number of values that leave the block for each sample. With an activation that leaves two
    /// values per unit these are the first ones of all `width` units, then the second ones.
    pub fn outputs(&self) -> usize {
        self.width * self.activation.map_or(1, Activation::outputs_per_unit)
    }

    /// The block's tensors in the order in which they lie, one after the other.
    pub fn places(&self) -> Vec<Place> {
        let vector = |name, range: &Range<usize>| Place { name, shape: vec![self.width], range: range.clone() };
        let weight = Place { name: "weight", shape: vec![self.inputs, self.width], range: self.weight.clone() };
        let mut places = vec![weight, vector("bias", &self.bias)];
        if let Some(Norm { scale, shift }) = &self.norm {
            places.extend([vector("scale", scale), vector("shift", shift)]);
        }
        places
    }

    /// Where all parameters of the block lie.
    pub fn range(&self) -> Range<usize> {
        self.weight.start..self.norm.as_ref().map_or(self.bias.end, |norm| norm.shift.end)
    }
}

/// What a network looks like. It owns nothing, so that it can be counted before anything is made.
///
/// ```
/// use bit_mlp::{Activation, Shape};
///
/// let activation = Activation::Tanh;
/// let shape = Shape { inputs: 256, hidden: &[64, 64], outputs: 4, activation, layer_norm: false };
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
    /// Whether the sums of every hidden layer are normalised.
    pub layer_norm: bool,
}

impl Shape<'_> {
    /// Number of parameters of such a network; `u64::MAX` if there are more than that.
    pub fn num_parameters(&self) -> u64 {
        let mut inputs = self.inputs as u64;
        let mut sum = 0_u64;
        let per_unit = self.activation.outputs_per_unit() as u64;
        for &width in self.hidden {
            let width = width as u64;
            let vectors = if self.layer_norm { 3 } else { 1 }; // bias, scale, shift
            sum = sum.saturating_add(inputs.saturating_add(vectors).saturating_mul(width));
            inputs = width.saturating_mul(per_unit);
        }
        sum.saturating_add(inputs.saturating_add(1).saturating_mul(self.outputs as u64))
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
            let hidden = index < self.hidden.len();
            let activation = hidden.then_some(self.activation);
            let block = Block::new(inputs, width, hidden && self.layer_norm, activation, offset);
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
