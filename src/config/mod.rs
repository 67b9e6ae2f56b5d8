//! One [`Config`] per run: a preset, then a file, then `--set` flags, resolved once and written into the run.
//!
//! Every setting is declared in exactly one place, [`Config::visit`]: its key, its meaning and the values it allows.
//! Reading, writing, `--help` texts and the comparison of arms all go through that declaration.

mod field;
mod presets;
mod settings;
mod size;

use bit_mlp::Activation;
use serde_json::{Map, Value};

pub use field::{Choice, Field};
use field::{at_least, choice, flag, fraction, integer, list, non_negative, positive};
pub use presets::{PRESETS, preset_names};
pub use settings::{ConfigError, check_name, resolve};

/// The settings of one run, complete and validated.
#[derive(Clone, Debug, PartialEq)]
pub struct Config {
    /// The arm's name; also the name of its folder.
    pub name: String,
    /// Timesteps per stage and seed.
    pub timesteps: u64,
    /// Step limit of an episode.
    pub max_steps: u32,
    /// Environments per seed, stepped together.
    pub num_envs: usize,
    /// Discount γ.
    pub gamma: f64,
    /// Widths of the hidden layers of each tower.
    pub hidden: Vec<usize>,
    /// Activation of the hidden layers.
    pub activation: Activation,
    /// Optimiser and regularisation.
    pub optimizer: OptimizerConfig,
    /// The algorithm and what only it has.
    pub algorithm: Algorithm,
    /// Which implementation computes updates.
    pub kernel: Kernel,
}

/// Adam and its L2 variants.
#[derive(Clone, Debug, PartialEq)]
pub struct OptimizerConfig {
    /// Step size α.
    pub learning_rate: f64,
    /// ε of Adam's denominator.
    pub adam_eps: f64,
    /// Gradients of one seed are scaled down to this Euclidean norm.
    pub max_grad_norm: f64,
    /// How the L2 penalty acts.
    pub l2: L2,
    /// Its coefficient λ.
    pub l2_coef: f64,
    /// The parameters it acts on.
    pub l2_covers: L2Covers,
}

impl OptimizerConfig {
    /// What decoupled decay multiplies weights by at each step, 1 − αλ, as PyTorch computes it: rounded to `f32`.
    pub fn decoupled_factor(&self) -> f32 {
        (1.0 - self.learning_rate * self.l2_coef) as f32
    }
}

/// How an L2 penalty acts on the parameters θ.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum L2 {
    /// Not at all.
    None,
    /// AdamW (Loshchilov & Hutter 2019): θ ← θ − αλθ beside the Adam step.
    AdamW,
    /// Coupled: λθ is added to the clipped gradient inside Adam (PyTorch's `Adam(weight_decay)`, Dohare et al. 2024).
    Adam,
    /// ½λ‖θ‖² is part of the loss, so that its gradient is clipped with the rest.
    Loss,
}

/// The parameters an L2 penalty acts on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum L2Covers {
    /// Weights and biases, as PyTorch's optimisers do by default.
    All,
    /// Weights only.
    Weights,
}

/// Which implementation computes forward passes and updates.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kernel {
    /// `fused` on a CPU, `autograd` elsewhere.
    Auto,
    /// Hand-derived gradients on the CPU.
    Fused,
    /// libtorch with autograd, the seeds stacked.
    Autograd,
}

/// The learning algorithm with its own settings.
#[derive(Clone, Debug, PartialEq)]
pub enum Algorithm {
    /// Proximal policy optimisation (Schulman et al. 2017).
    Ppo(PpoConfig),
    /// Deep Q-network (Mnih et al. 2015).
    Dqn(DqnConfig),
}

/// What only PPO has. Defaults are the study's.
#[derive(Clone, Debug, PartialEq)]
pub struct PpoConfig {
    /// Timesteps per environment in a rollout.
    pub n_steps: usize,
    /// Samples in a minibatch.
    pub batch_size: usize,
    /// Passes over a rollout in an update.
    pub n_epochs: usize,
    /// λ of generalised advantage estimation (Schulman et al. 2016).
    pub gae_lambda: f64,
    /// Clip range of the probability ratio.
    pub clip_range: f64,
    /// Coefficient of the entropy bonus.
    pub ent_coef: f64,
    /// Coefficient of the value loss.
    pub vf_coef: f64,
    /// Whether advantages are normalised minibatch by minibatch.
    pub normalize_advantage: bool,
}

/// What only DQN has. Defaults are the study's.
#[derive(Clone, Debug, PartialEq)]
pub struct DqnConfig {
    /// Transitions in the replay buffer.
    pub buffer_size: usize,
    /// Timesteps of a stage with uniform actions and no update.
    pub learning_starts: u64,
    /// Steps of the environments between updates.
    pub train_freq: u64,
    /// Gradient steps of an update.
    pub gradient_steps: usize,
    /// Transitions in a minibatch.
    pub batch_size: usize,
    /// Timesteps between copies of the network into the target network.
    pub target_update_interval: u64,
    /// ε at the start of the first stage.
    pub exploration_initial_eps: f64,
    /// ε at the end of its decay, and throughout every later stage.
    pub exploration_final_eps: f64,
    /// Share of the first stage's timesteps over which ε decays linearly.
    pub exploration_fraction: f64,
}

impl Default for PpoConfig {
    fn default() -> Self {
        Self {
            n_steps: 2048,
            batch_size: 64,
            n_epochs: 10,
            gae_lambda: 0.95,
            clip_range: 0.2,
            ent_coef: 0.01,
            vf_coef: 0.5,
            normalize_advantage: true,
        }
    }
}

impl Default for DqnConfig {
    fn default() -> Self {
        Self {
            buffer_size: 100_000,
            learning_starts: 100,
            train_freq: 4,
            gradient_steps: 1,
            batch_size: 32,
            target_update_interval: 10_000,
            exploration_initial_eps: 1.0,
            exploration_final_eps: 0.05,
            exploration_fraction: 0.1,
        }
    }
}

/// Receives every setting of a [`Config`] in the order of its declaration.
pub trait Visitor {
    /// `key`: as in files and `--set`; `doc`: one line for `config.yaml` and the documentation.
    fn field(&mut self, key: &'static str, doc: &'static str, field: &mut dyn Field);
}

impl Config {
    /// The study's settings for an algorithm; presets say what differs.
    fn new(algorithm: Algorithm) -> Self {
        let dqn = matches!(algorithm, Algorithm::Dqn(_));
        Self {
            name: algorithm.name().to_owned(),
            timesteps: if dqn { 1_000_000 } else { 500_000 },
            max_steps: coverage_env::MAX_STEPS,
            num_envs: 1,
            gamma: 0.99,
            hidden: vec![64, 64],
            activation: if dqn { Activation::Relu } else { Activation::Tanh },
            optimizer: OptimizerConfig {
                learning_rate: 1e-4,
                adam_eps: if dqn { 1e-8 } else { 1e-5 },
                max_grad_norm: if dqn { 10.0 } else { 0.5 },
                l2: L2::None,
                l2_coef: 0.0,
                l2_covers: L2Covers::All,
            },
            algorithm,
            kernel: Kernel::Auto,
        }
    }

    /// Declares every setting but `name`, `algorithm` and `extends`, which decide what is declared.
    pub fn visit(&mut self, v: &mut dyn Visitor) {
        const M: u64 = 1_000_000;
        v.field(
            "timesteps",
            "timesteps per stage and seed (PPO rounds up to whole rollouts)",
            &mut integer(&mut self.timesteps, 1..=1_000_000 * M),
        );
        v.field("max_steps", "step limit of an episode", &mut integer(&mut self.max_steps, 1..=M));
        v.field("num_envs", "environments per seed", &mut integer(&mut self.num_envs, 1..=4096));
        v.field("gamma", "discount", &mut fraction(&mut self.gamma));
        v.field("hidden", "widths of the hidden layers", &mut list(&mut self.hidden, 0..=8, 1..=4096));
        v.field("activation", "activation of the hidden layers", &mut choice(&mut self.activation));
        let optimizer = &mut self.optimizer;
        v.field("learning_rate", "step size of Adam", &mut positive(&mut optimizer.learning_rate));
        v.field("adam_eps", "epsilon of Adam's denominator", &mut at_least(&mut optimizer.adam_eps, 1e-12));
        v.field("max_grad_norm", "largest norm of a seed's gradient", &mut positive(&mut optimizer.max_grad_norm));
        v.field("l2", "how the L2 penalty acts", &mut choice(&mut optimizer.l2));
        v.field("l2_coef", "its coefficient", &mut non_negative(&mut optimizer.l2_coef));
        v.field("l2_covers", "the parameters it acts on", &mut choice(&mut optimizer.l2_covers));
        match &mut self.algorithm {
            Algorithm::Ppo(ppo) => ppo.visit(v),
            Algorithm::Dqn(dqn) => dqn.visit(v),
        }
        v.field("kernel", "which implementation computes updates", &mut choice(&mut self.kernel));
    }

    /// All settings as one JSON object, in the order of their declaration; [`resolve`] takes it back.
    pub fn to_json(&self) -> Map<String, Value> {
        struct Collect(Map<String, Value>);
        impl Visitor for Collect {
            fn field(&mut self, key: &'static str, _doc: &'static str, field: &mut dyn Field) {
                self.0.insert(key.to_owned(), field.get());
            }
        }
        let mut collect = Collect(Map::new());
        collect.0.insert("name".to_owned(), self.name.clone().into());
        collect.0.insert("algorithm".to_owned(), self.algorithm.name().into());
        self.clone().visit(&mut collect);
        collect.0
    }

    /// All settings as a YAML file with a comment on each line; `--config` takes it back.
    pub fn to_yaml(&self) -> String {
        struct Lines(String);
        impl Visitor for Lines {
            fn field(&mut self, key: &'static str, doc: &'static str, field: &mut dyn Field) {
                self.0.push_str(&format!("{:<39} # {doc}\n", format!("{key}: {}", field.get())));
            }
        }
        let name = Value::from(self.name.clone());
        let mut lines = Lines(format!("name: {name}\nalgorithm: {}\n", self.algorithm.name()));
        self.clone().visit(&mut lines);
        lines.0
    }
}

impl Algorithm {
    /// `ppo` or `dqn`.
    pub fn name(&self) -> &'static str {
        match self {
            Self::Ppo(_) => "ppo",
            Self::Dqn(_) => "dqn",
        }
    }
}

impl PpoConfig {
    fn visit(&mut self, v: &mut dyn Visitor) {
        v.field("n_steps", "timesteps per environment in a rollout", &mut integer(&mut self.n_steps, 1..=1 << 20));
        v.field("batch_size", "samples in a minibatch", &mut integer(&mut self.batch_size, 1..=1 << 20));
        v.field("n_epochs", "passes over a rollout in an update", &mut integer(&mut self.n_epochs, 1..=1000));
        v.field("gae_lambda", "lambda of generalised advantage estimation", &mut fraction(&mut self.gae_lambda));
        v.field("clip_range", "clip range of the probability ratio", &mut positive(&mut self.clip_range));
        v.field("ent_coef", "coefficient of the entropy bonus", &mut non_negative(&mut self.ent_coef));
        v.field("vf_coef", "coefficient of the value loss", &mut non_negative(&mut self.vf_coef));
        v.field(
            "normalize_advantage",
            "normalise advantages minibatch by minibatch",
            &mut flag(&mut self.normalize_advantage),
        );
    }
}

impl DqnConfig {
    fn visit(&mut self, v: &mut dyn Visitor) {
        const MANY: u64 = 1_000_000_000;
        v.field("buffer_size", "transitions in the replay buffer", &mut integer(&mut self.buffer_size, 1..=10_000_000));
        v.field(
            "learning_starts",
            "timesteps of a stage with uniform actions and no update",
            &mut integer(&mut self.learning_starts, 0..=MANY),
        );
        v.field(
            "train_freq",
            "steps of the environments between updates",
            &mut integer(&mut self.train_freq, 1..=MANY),
        );
        v.field("gradient_steps", "gradient steps of an update", &mut integer(&mut self.gradient_steps, 1..=10_000));
        v.field("batch_size", "transitions in a minibatch", &mut integer(&mut self.batch_size, 1..=1 << 20));
        v.field(
            "target_update_interval",
            "timesteps between copies into the target network",
            &mut integer(&mut self.target_update_interval, 1..=MANY),
        );
        v.field(
            "exploration_initial_eps",
            "epsilon at the start of the first stage",
            &mut fraction(&mut self.exploration_initial_eps),
        );
        v.field(
            "exploration_final_eps",
            "epsilon after its decay and in later stages",
            &mut fraction(&mut self.exploration_final_eps),
        );
        v.field(
            "exploration_fraction",
            "share of the first stage over which epsilon decays",
            &mut fraction(&mut self.exploration_fraction),
        );
    }
}

impl Choice for L2 {
    const ALL: &'static [(&'static str, Self)] =
        &[("none", Self::None), ("adamw", Self::AdamW), ("adam", Self::Adam), ("loss", Self::Loss)];
}

impl Choice for L2Covers {
    const ALL: &'static [(&'static str, Self)] = &[("all", Self::All), ("weights", Self::Weights)];
}

impl Choice for Kernel {
    const ALL: &'static [(&'static str, Self)] =
        &[("auto", Self::Auto), ("fused", Self::Fused), ("autograd", Self::Autograd)];
}

impl Choice for Activation {
    const ALL: &'static [(&'static str, Self)] = &[("tanh", Self::Tanh), ("relu", Self::Relu)];
}
