//! What a minibatch minimises, as an engine sees it.

use bit_mlp::Batch;

/// The loss of one seed on one minibatch, as a function of its networks' outputs.
///
/// It says which forward passes it needs, and derives the gradient with respect to their outputs by hand. It also states
/// itself as data, for an engine that has the same formula in a language of its own and differentiates it itself.
pub trait Loss<'a> {
    /// The forward passes, in the order in which [`derive`](Self::derive) gets their outputs. The first one of a tower with the
    /// agent's own weights is of the minibatch; later ones add to its gradient.
    fn passes(&self) -> Vec<Pass<'a>>;
    /// Computes the terms, and writes ∂loss/∂outputs of each pass of the agent's own weights.
    ///
    /// `outputs` are `[B, outputs]` each; `gradients` come in empty, one for each pass.
    fn derive(&mut self, outputs: &[&[f32]], gradients: &mut [Vec<f32>]);
    /// The same loss as data.
    fn statement(&self) -> Statement<'a>;
    /// The part of it that the acting tower descends, once its terms are there.
    fn of_acting(&self) -> f32;
    /// Takes terms that an engine computed from the statement, in the order in which it documents them.
    fn set_terms(&mut self, terms: &[f32]);
}

/// One forward pass.
#[derive(Clone, Copy, Debug)]
pub struct Pass<'a> {
    /// Of which weights.
    pub weights: Weights,
    /// Of which tower.
    pub tower: usize,
    /// On these samples.
    pub inputs: Batch<'a>,
}

/// The weights of a forward pass.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Weights {
    /// The agent's own: the gradient is with respect to them.
    Own,
    /// The copy of this name.
    Copy(&'static str),
}

/// A loss as data: its name, its constants and its columns, `[B]` each.
#[derive(Clone, Debug)]
pub struct Statement<'a> {
    /// Which formula it is.
    pub name: &'static str,
    /// Its constants, in the order in which the formula documents them.
    pub constants: Vec<f64>,
    /// Its columns, likewise.
    pub columns: Vec<Column<'a>>,
}

/// One value per sample, `[B]`.
#[derive(Clone, Debug)]
pub enum Column<'a> {
    /// Numbers; picked by these indices, where there are any.
    Floats(&'a [f32], Option<&'a [u32]>),
    /// Actions, likewise.
    Actions(&'a [u8], Option<&'a [u32]>),
    /// Flags.
    Flags(&'a [bool]),
}

impl Column<'_> {
    /// The values as floats, `[B]`.
    pub fn to_floats(&self) -> Vec<f32> {
        match *self {
            Self::Floats(values, None) => values.to_vec(),
            Self::Floats(values, Some(indices)) => indices.iter().map(|&i| values[i as usize]).collect(),
            Self::Actions(values, None) => values.iter().map(|&v| f32::from(v)).collect(),
            Self::Actions(values, Some(indices)) => indices.iter().map(|&i| f32::from(values[i as usize])).collect(),
            Self::Flags(values) => values.iter().map(|&v| f32::from(v)).collect(),
        }
    }
}
