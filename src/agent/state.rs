//! What an agent carries from one stage to the next.

use serde::{Deserialize, Serialize};

use super::network::Network;
use super::random::{Purpose, Stream};

/// One seed's agent between stages; slices have length P, in the network's order.
///
/// This is everything that continues. Environments, random streams, schedules, the episode window and the replay
/// buffer begin anew with each stage, so that a stage depends on its seed, its number and this alone.
#[derive(Clone, Debug, PartialEq)]
pub struct AgentState {
    /// The seed's number.
    pub seed: u64,
    /// θ.
    pub parameters: Vec<f32>,
    /// Adam's moments and step count.
    pub adam: AdamState,
    /// DQN's target network.
    pub target: Option<Vec<f32>>,
    /// What has been counted since the first stage.
    pub counters: Counters,
}

/// Adam's state (Kingma & Ba 2015, Algorithm 1).
#[derive(Clone, Debug, PartialEq)]
pub struct AdamState {
    /// First moment m.
    pub exp_avg: Vec<f32>,
    /// Second moment v.
    pub exp_avg_sq: Vec<f32>,
    /// Steps taken, t.
    pub step: u64,
}

/// Counts that go on over the stages.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Counters {
    /// Timesteps of all finished and running stages; checkpoints have a field of its own for it.
    #[serde(skip)]
    pub timesteps: u64,
    /// `train/n_updates`: epochs of PPO, gradient steps of DQN.
    pub updates: u64,
    /// DQN's steps of the environments, which time the copies into the target network.
    pub target_calls: u64,
}

impl AgentState {
    /// A fresh agent with the initial weights of `seed`; `target` says whether it has a target network.
    pub fn new(network: &Network, seed: u64, target: bool) -> Self {
        let parameters = network.init(&mut Stream::new(seed, 0, Purpose::Weights));
        Self {
            seed,
            adam: AdamState::new(parameters.len()),
            target: target.then(|| parameters.clone()),
            parameters,
            counters: Counters::default(),
        }
    }
}

impl AdamState {
    /// The state before the first step of `len` parameters.
    pub fn new(len: usize) -> Self {
        Self { exp_avg: vec![0.0; len], exp_avg_sq: vec![0.0; len], step: 0 }
    }
}
