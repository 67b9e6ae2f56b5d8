//! The settings that all algorithms share.

use bit_mlp::Activation;
use coverage_env::sensor::SENSORS;
use coverage_env::{Level, Sensor};

use super::engine::EngineChoice;
use super::network::Layout;
use super::optimizer::OptimizerConfig;
use crate::config::{
    Choice, Settings, Visitor, at_least, below_one, choice, flag, fraction, integer, list, one_of, positive,
};

/// What every learner needs, whatever its algorithm.
#[derive(Clone, Debug)]
pub struct Shared {
    /// Timesteps per stage and seed.
    pub timesteps: u64,
    /// Step limit of an episode.
    pub max_steps: u32,
    /// Environments per seed, stepped together.
    pub num_envs: usize,
    /// What the agent sees of a state.
    pub sensor: &'static dyn Sensor,
    /// Discount γ.
    pub gamma: f64,
    /// Widths of the hidden layers of each tower.
    pub hidden: Vec<usize>,
    /// Activation of the hidden layers.
    pub activation: Activation,
    /// Whether the sums of the hidden layers are normalised.
    pub layer_norm: bool,
    /// Adam.
    pub optimizer: OptimizerConfig,
    /// Which engine computes updates.
    pub engine: EngineChoice,
}

impl Default for Shared {
    /// The paper's for PPO.
    fn default() -> Self {
        Self {
            timesteps: 500_000,
            max_steps: coverage_env::MAX_STEPS,
            num_envs: 1,
            sensor: Default::default(),
            gamma: 0.99,
            hidden: vec![64, 64],
            activation: Activation::Tanh,
            layer_norm: false,
            optimizer: OptimizerConfig {
                learning_rate: 1e-4,
                adam_beta1: 0.9,
                adam_beta2: 0.999,
                adam_eps: 1e-5,
                max_grad_norm: 0.5,
            },
            engine: EngineChoice::Auto,
        }
    }
}

impl Shared {
    /// What the towers have in common on maps of this level's size.
    pub fn layout(&self, level: &Level) -> Layout {
        let inputs = self.sensor.inputs(level);
        Layout { inputs, hidden: self.hidden.clone(), activation: self.activation, layer_norm: self.layer_norm }
    }
}

impl Settings for Shared {
    /// All but `engine`, which comes last in files, after what algorithm and mitigations declare.
    fn visit(&mut self, v: &mut dyn Visitor) {
        const M: u64 = 1_000_000;
        v.field(
            "timesteps",
            "timesteps per stage and seed (PPO rounds up to whole rollouts)",
            &mut integer(&mut self.timesteps, 1..=1_000_000 * M),
        );
        v.field("max_steps", "step limit of an episode", &mut integer(&mut self.max_steps, 1..=M));
        v.field("num_envs", "environments per seed", &mut integer(&mut self.num_envs, 1..=4096));
        let name = |sensor: &'static dyn Sensor| sensor.name();
        v.field("sensor", "what the agent sees of a state", &mut one_of(&mut self.sensor, SENSORS, name));
        v.field("gamma", "discount", &mut fraction(&mut self.gamma));
        v.field("hidden", "widths of the hidden layers", &mut list(&mut self.hidden, 0..=8, 1..=4096));
        v.field("activation", "activation of the hidden layers", &mut choice(&mut self.activation));
        v.field("layer_norm", "normalise the sums of the hidden layers", &mut flag(&mut self.layer_norm));
        let optimizer = &mut self.optimizer;
        v.field("learning_rate", "step size of Adam", &mut positive(&mut optimizer.learning_rate));
        let (beta1, beta2) = (&mut optimizer.adam_beta1, &mut optimizer.adam_beta2);
        v.field("adam_beta1", "decay of Adam's mean of the gradients", &mut below_one(beta1));
        v.field("adam_beta2", "decay of Adam's mean of the squared gradients", &mut below_one(beta2));
        v.field("adam_eps", "epsilon of Adam's denominator", &mut at_least(&mut optimizer.adam_eps, 1e-12));
        v.field("max_grad_norm", "largest norm of a seed's gradient", &mut positive(&mut optimizer.max_grad_norm));
    }
}

impl Choice for Activation {
    const ALL: &'static [(&'static str, Self)] =
        &[("tanh", Self::Tanh), ("relu", Self::Relu), ("crelu", Self::Crelu), ("fourier", Self::Fourier)];
}
