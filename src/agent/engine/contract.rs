//! What an engine does, and what it is made of.

use std::fmt::Debug;
use std::sync::Arc;

use bit_mlp::BitBatch;

pub use bit_mlp::GradientNorms;

use super::loss::Loss;
use crate::agent::network::Network;
use crate::agent::optimizer::OptimizerConfig;
use crate::agent::state::AgentState;

/// S agents of one architecture, with their Adam.
pub trait Engine: Send {
    /// Outputs of the acting tower for the N current observations of each seed, `[S, N, outputs]`.
    fn act(&mut self, inputs: &[BitBatch], outputs: &mut [f32]);
    /// Outputs of one tower for all samples of each seed, `[B, outputs]` each; seeds may have unequally many.
    fn forward(&mut self, tower: usize, inputs: &[&BitBatch]) -> Vec<Vec<f32>>;
    /// One step of clipped Adam per seed down its loss, on equally many samples for each; the losses get their terms.
    ///
    /// Returns the norms of the gradients before clipping, `[S]`.
    fn descend<'a>(&mut self, losses: &mut [&mut dyn Loss<'a>]) -> Vec<f32>;
    /// Norms of a seed's last gradient: of all but a pull to 0, and of that.
    fn norms(&self, seed: usize) -> GradientNorms;
    /// The activations of a seed's hidden units in its last step.
    fn units(&self, seed: usize) -> Units;
    /// Writes every agent's parameters into its copy of this name.
    fn copy(&mut self, name: &str);
    /// Changes an agent: parameters, moments, whatever it keeps.
    fn edit(&mut self, seed: usize, change: &mut dyn FnMut(&mut AgentState));
    /// Writes parameters, optimiser state and what is kept of a seed into `agent`; its counters stay.
    fn save(&self, seed: usize, agent: &mut AgentState);
}

/// What an engine is made of.
#[derive(Clone, Debug)]
pub struct Parts {
    /// The architecture.
    pub network: Network,
    /// Adam.
    pub optimizer: OptimizerConfig,
    /// What draws the parameters beside the loss.
    pub pull: Option<Pull>,
    /// What else is added to the loss's gradient before it is clipped.
    pub penalties: Vec<Arc<dyn Penalty>>,
    /// The agents as they come out of the stage before; equally many Adam steps old.
    pub agents: Vec<AgentState>,
}

/// A penalty on the distance of the parameters to a point c: ½λ‖θ − c‖², or λ‖θ − c‖.
#[derive(Clone, Debug, PartialEq)]
pub struct Pull {
    /// What c is.
    pub toward: Toward,
    /// λ.
    pub coefficient: f64,
    /// Whether biases and the parameters of norms are drawn, too.
    pub covers_all: bool,
}

/// A penalty on the parameters that is no [`Pull`], by its gradient.
pub trait Penalty: Debug + Send + Sync {
    /// Adds its gradient at the agent's parameters to `gradient`, `[P]`. Called once for each gradient step; what it must
    /// remember from one to the next it keeps in the agent.
    fn add_to(&self, gradient: &mut [f32], agent: &mut AgentState);
}

/// Where a pull draws to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Toward {
    /// To 0, entering here.
    Zero(Entry),
    /// To a [copy](crate::agent::state::Kept::copies), as part of the loss. Every agent must have it.
    Copy {
        /// Its name.
        name: &'static str,
        /// Whether the distance is squared, and halved.
        is_squared: bool,
    },
}

/// Where a penalty enters.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Entry {
    /// Beside the step: θ ← θ − αλθ (AdamW, Loshchilov & Hutter 2019).
    Decoupled,
    /// Added to the clipped gradient, before the moments.
    InAdam,
    /// Part of the loss, so that it is clipped with the rest.
    InLoss,
}

/// The activations of one agent's hidden layers on a minibatch of B samples.
#[derive(Clone, Debug, Default)]
pub struct Units {
    /// By tower and hidden layer.
    pub towers: Vec<Vec<LayerUnits>>,
}

/// What left the units of one hidden layer.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct LayerUnits {
    /// How many units there are.
    pub units: usize,
    /// K, how many values leave them: two for each unit of CReLU and of Fourier features.
    pub values: usize,
    /// `[B, K]`, row-major.
    pub activations: Vec<f32>,
}
