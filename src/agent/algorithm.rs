//! What an algorithm is to the rest of the program, and the list of them.

use std::any::Any;
use std::fmt::Debug;

use coverage_env::Level;

use super::config::Config;
use super::engine::Engine;
use super::network::{Head, Outputs};
use super::snapshot::Snapshot;
use super::{Learner, Stage, dqn, ppo};
use crate::config::Settings;

/// Every algorithm, with its default settings. A new one is a folder beside these and a line here.
const ALGORITHMS: &[fn() -> Box<dyn Algorithm>] =
    &[|| Box::new(ppo::PpoConfig::default()), || Box::new(dqn::DqnConfig::default())];

/// A learning algorithm, as its settings: from them come its networks, its learner, and what it needs.
pub trait Algorithm: Settings + Any + Debug + Send + Sync {
    /// Its name in configs and checkpoints.
    fn name(&self) -> &'static str;
    /// Changes the settings that it shares with others to the paper's for it.
    fn defaults(&self, config: &mut Config);
    /// What the outputs of the acting tower mean.
    fn outputs(&self) -> Outputs;
    /// The towers of its network; the first one acts.
    fn heads(&self) -> &'static [Head];
    /// Copies of the parameters that its agents carry, by name.
    fn copies(&self) -> &'static [&'static str] {
        &[]
    }
    /// Refuses settings that are possible one by one, but not together.
    ///
    /// # Errors
    /// The keys, and what is wrong with them.
    fn check(&self, config: &Config) -> Result<(), Misfit>;
    /// The largest thing that one seed keeps beside its network on maps of so many cells: what, and its bytes.
    fn memory(&self, config: &Config, cells: usize) -> (String, u64);
    /// Optimiser steps of a stage with so many timesteps.
    fn optimizer_steps(&self, config: &Config, timesteps: u64) -> u64;
    /// Adds what it keeps in the midst of a stage to the snapshot of the stage's beginning.
    fn begin(&self, _snapshot: &mut Snapshot) {}
    /// Checks what [`begin`](Self::begin) added, as read from a file.
    ///
    /// # Errors
    /// What cannot be so on this level.
    fn check_snapshot(&self, snapshot: &Snapshot, level: &Level) -> Result<(), String>;
    /// A learner of seeds where these snapshots were taken; they have been checked against the stage.
    fn learner(
        &self,
        config: &Config,
        stage: &Stage,
        snapshots: Vec<Snapshot>,
        engine: Box<dyn Engine>,
    ) -> Box<dyn Learner>;
    /// A copy.
    fn boxed(&self) -> Box<dyn Algorithm>;
}

/// Settings that do not fit together.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Misfit {
    /// The settings that can be changed to mend it.
    pub keys: &'static [&'static str],
    /// What is wrong, and what is possible.
    pub problem: String,
}

/// The algorithm of this name, with its default settings.
pub fn by_name(name: &str) -> Option<Box<dyn Algorithm>> {
    ALGORITHMS.iter().map(|make| make()).find(|algorithm| algorithm.name() == name)
}

/// The names of all algorithms.
pub fn names() -> Vec<&'static str> {
    ALGORITHMS.iter().map(|make| make().name()).collect()
}

impl Clone for Box<dyn Algorithm> {
    fn clone(&self) -> Self {
        self.boxed()
    }
}
