//! What an agent carries from one stage to the next.

use std::collections::BTreeMap;
use std::ops::Range;

use serde::{Deserialize, Serialize};

use super::buffers::Buffers;
use super::network::Network;
use crate::random::{Purpose, Stream};

/// One seed's agent between stages; slices have length P, in the network's order.
///
/// This is everything that continues. Environments, random streams, schedules and the episode window begin anew with each
/// stage, and so does the replay buffer unless it is [kept](Kept::buffers). So a stage depends on its seed, its number and
/// this alone.
#[derive(Clone, Debug, PartialEq)]
pub struct AgentState {
    /// The seed's number.
    pub seed: u64,
    /// θ.
    pub parameters: Vec<f32>,
    /// Adam's moments and step count.
    pub adam: AdamState,
    /// What algorithm and mitigations keep beside them.
    pub kept: Kept,
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

/// What an algorithm or a mitigation keeps, by name. Checkpoints hold all of it, so that nobody who keeps something has
/// to write it down, and nobody can forget to.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Kept {
    /// Slices laid out as the parameters are, `[P]`: DQN's `target`, the θ₀ of a penalty.
    pub copies: BTreeMap<String, Vec<f32>>,
    /// Lists of any length, `[n]`.
    pub lists: BTreeMap<String, Vec<f32>>,
    /// Counts.
    pub numbers: BTreeMap<String, u64>,
    /// What an algorithm leaves to the next stage beside its network, such as DQN's replay buffer. A stage takes it over as it
    /// begins, so that there is nothing here in the midst of a stage.
    pub buffers: Buffers,
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
    /// An agent from scratch with the initial weights of `seed`; `copies` names those of its parameters that it carries.
    pub fn new(network: &Network, seed: u64, copies: &[&str]) -> Self {
        let parameters = network.init(&mut Stream::new(seed, 0, Purpose::Weights));
        let copies = copies.iter().map(|&name| (name.to_owned(), parameters.clone())).collect();
        Self {
            seed,
            adam: AdamState::new(parameters.len()),
            kept: Kept { copies, ..Kept::default() },
            parameters,
            counters: Counters::default(),
        }
    }

    /// Multiplies parameters, also in the copies of these names.
    pub fn scale(&mut self, range: &Range<usize>, factor: f32, copies: &[&str]) {
        for slice in self.slices(copies) {
            slice[range.clone()].iter_mut().for_each(|value| *value *= factor);
        }
    }

    /// Replaces parameters by those in `new`, `[P]`, also in the copies of these names.
    pub fn replace(&mut self, range: &Range<usize>, new: &[f32], copies: &[&str]) {
        for slice in self.slices(copies) {
            slice[range.clone()].copy_from_slice(&new[range.clone()]);
        }
    }

    /// Makes the copies of these names equal to the parameters.
    pub fn renew(&mut self, copies: &[&str]) {
        for (_, copy) in self.kept.copies.iter_mut().filter(|(name, _)| copies.contains(&name.as_str())) {
            copy.clone_from(&self.parameters);
        }
    }

    /// The parameters, and the copies of these names, `[P]` each.
    fn slices<'a>(&'a mut self, copies: &[&str]) -> impl Iterator<Item = &'a mut Vec<f32>> {
        let named = self.kept.copies.iter_mut().filter(|(name, _)| copies.contains(&name.as_str()));
        named.map(|(_, copy)| copy).chain([&mut self.parameters])
    }
}

impl Kept {
    /// Takes out the list of this name; where there is none, or one of another length, which is of other settings, it is
    /// `value` throughout.
    pub fn take_list(&mut self, name: &str, len: usize, value: f32) -> Vec<f32> {
        self.lists.remove(name).filter(|list| list.len() == len).unwrap_or_else(|| vec![value; len])
    }
}

impl AdamState {
    /// The state before the first step of `len` parameters.
    pub fn new(len: usize) -> Self {
        Self { exp_avg: vec![0.0; len], exp_avg_sq: vec![0.0; len], step: 0 }
    }

    /// Sets both moments of these parameters to 0.
    pub fn clear_moments(&mut self, range: &Range<usize>) {
        self.exp_avg[range.clone()].fill(0.0);
        self.exp_avg_sq[range.clone()].fill(0.0);
    }
}
