//! The learners: networks, optimiser, PPO and DQN over an axis of seeds. Nothing here touches a file or a terminal.

pub mod dqn;
pub mod network;
pub mod ppo;
pub mod random;
pub mod snapshot;
pub mod state;

mod choice;
mod episodes;
mod fused;
pub(crate) mod stacked;

use std::sync::Arc;

use bit_mlp::{BitBatch, GradientNorms};
use coverage_env::{Level, Observation, VecEnv};
use rand::Rng;
use tch::Device;

use crate::config::{Algorithm, Config, Kernel, L2, OptimizerConfig};
use network::Network;
use snapshot::{Snapshot, SnapshotError};
use state::AgentState;

pub use choice::{greedy, sample};
pub use episodes::EpisodeWindow;

/// An algorithm at work on one stage with S seeds side by side.
pub trait Learner: Send {
    /// Collects and updates once: a rollout for PPO; for DQN up to the next multiple of 2,048 timesteps, or of the
    /// environments' `train_freq` steps if that is more.
    ///
    /// Returns each seed's metrics, in the order of the seeds.
    fn advance(&mut self) -> Vec<Metrics>;
    /// Timesteps of this stage so far, the same for each seed.
    fn timesteps(&self) -> u64;
    /// What [`timesteps`](Self::timesteps) will be after the next [`advance`](Self::advance).
    fn next_timesteps(&self) -> u64;
    /// θ of one seed as it is now, `[P]`; seeds are counted in their order here.
    fn parameters(&self, seed: usize) -> &[f32];
    /// The agents as they are now.
    fn states(&self) -> Vec<AgentState>;
    /// All that the rest of the stage depends on, of the seed with this place in their order.
    fn snapshot(&self, seed: usize) -> Snapshot;
}

/// Names and values of one log row, named as Stable-Baselines3's logger names them.
pub type Metrics = Vec<(&'static str, f64)>;

/// One stage as a learner sees it.
#[derive(Clone, Debug)]
pub struct Stage {
    /// Its place in the curriculum, from 0.
    pub index: u16,
    /// The map that all environments have.
    pub level: Arc<Level>,
    /// Timesteps to train for.
    pub timesteps: u64,
    /// Timesteps that schedules span: `timesteps`, unless the run was extended.
    pub horizon: u64,
}

/// How networks are computed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Backend {
    /// Hand-derived gradients on the CPU.
    Fused,
    /// libtorch and autograd on this device.
    Autograd(Device),
}

impl Backend {
    /// What `kernel` means on `device`.
    ///
    /// # Errors
    /// In words, where the fused kernel is forced on a device that it does not know.
    pub fn choose(kernel: Kernel, device: Device) -> Result<Self, String> {
        match (kernel, device) {
            (Kernel::Auto | Kernel::Fused, Device::Cpu) => Ok(Self::Fused),
            (Kernel::Fused, _) => Err("kernel=fused runs on the CPU only: drop --device or kernel=fused".to_owned()),
            (Kernel::Auto | Kernel::Autograd, device) => Ok(Self::Autograd(device)),
        }
    }

    /// The name that manifests record.
    pub fn name(self) -> &'static str {
        match self {
            Self::Fused => "fused",
            Self::Autograd(_) => "autograd",
        }
    }
}

/// An empty batch for observations of `level`, with what all of them share.
fn observations(level: &Level) -> BitBatch {
    let mut batch = BitBatch::default();
    batch.set_constant(&Observation::constant_inputs(level));
    batch
}

/// Writes the current observations of all environments into `batch`, `[N]` samples.
fn observe<R: Rng>(envs: &VecEnv<R>, batch: &mut BitBatch) {
    batch.clear();
    for state in envs.states() {
        batch.push_with(|rows| Observation::new(envs.level(), state).push_active(rows));
    }
}

/// What tells how strongly an L2 penalty acts: the norm of all parameters and, where the penalty has a gradient, the
/// ratio of its norm to that of the loss's gradient where the two are added, in the update's last minibatch.
fn dose_metrics(agent: &AgentState, optimizer: &OptimizerConfig, norms: GradientNorms) -> Metrics {
    let squares: f64 = agent.parameters.iter().map(|&p| f64::from(p).powi(2)).sum();
    let mut row = vec![("train/weight_norm", squares.sqrt())];
    let loss = f64::from(norms.loss);
    let beside = match optimizer.l2 {
        L2::Loss => Some(loss),
        L2::Adam => Some(loss.min(optimizer.max_grad_norm)),
        L2::None | L2::AdamW => None,
    };
    row.extend(beside.map(|loss| ("train/l2_ratio", f64::from(norms.penalty) / loss)));
    row
}

/// The network that `config` trains on maps of this level's size.
pub fn network(config: &Config, level: &Level) -> Network {
    let inputs = Observation::len(level);
    match config.algorithm {
        Algorithm::Ppo(_) => Network::actor_critic(inputs, &config.hidden, config.activation),
        Algorithm::Dqn(_) => Network::q_network(inputs, &config.hidden, config.activation),
    }
}

/// A fresh agent as `config` wants it on maps of this level's size.
pub fn fresh(config: &Config, level: &Level, seed: u64) -> AgentState {
    AgentState::new(&network(config, level), seed, matches!(config.algorithm, Algorithm::Dqn(_)))
}

/// A learner at the beginning of `stage`, with agents as they come out of the stage before.
pub fn learner(config: &Config, stage: &Stage, agents: Vec<AgentState>, backend: Backend) -> Box<dyn Learner> {
    let beginning = |agent| Snapshot::beginning(config, stage, agent);
    build(config, stage, agents.into_iter().map(beginning).collect(), backend)
}

/// A learner in the midst of `stage`, where its seeds were when these snapshots were taken; it goes on as if it had
/// never stopped.
///
/// # Errors
/// Snapshots that cannot be of this stage, or of seeds that stand at different timesteps.
pub fn resume(
    config: &Config,
    stage: &Stage,
    snapshots: Vec<Snapshot>,
    backend: Backend,
) -> Result<Box<dyn Learner>, SnapshotError> {
    snapshots.iter().try_for_each(|snapshot| snapshot.check(config, stage))?;
    SnapshotError::unless_together(&snapshots)?;
    Ok(build(config, stage, snapshots, backend))
}

/// A learner from snapshots that are known to fit.
fn build(config: &Config, stage: &Stage, snapshots: Vec<Snapshot>, backend: Backend) -> Box<dyn Learner> {
    match &config.algorithm {
        Algorithm::Ppo(ppo) => Box::new(ppo::Ppo::new(config, ppo, stage, snapshots, backend)),
        Algorithm::Dqn(dqn) => Box::new(dqn::Dqn::new(config, dqn, stage, snapshots, backend)),
    }
}
