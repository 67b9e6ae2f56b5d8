//! What an algorithm is to the rest of the program.

use std::any::Any;
use std::fmt::Debug;

use coverage_env::Level;

use super::choice::Behaviour;
use super::engine::Engine;
use super::learner::Learner;
use super::mitigation::Regimen;
use super::network::{Head, Outputs};
use super::shared::Shared;
use super::snapshot::Snapshot;
use super::stage::Stage;
use super::state::AgentState;
use crate::config::Settings;

/// A learning algorithm, as its settings: from them come its networks, its learner, and what it needs.
pub trait Algorithm: Settings + Any + Debug + Send + Sync {
    /// Its name in configs and checkpoints.
    fn name(&self) -> &'static str;
    /// Changes the settings that it shares with others to the paper's for it.
    fn defaults(&self, shared: &mut Shared);
    /// What the outputs of the acting tower mean.
    fn outputs(&self) -> Outputs;
    /// How its agents choose actions after so many timesteps of a stage; without these, once exploration has decayed. What
    /// DQN does before it learns is left out.
    fn behaviour(&self, when: Option<(&Stage, u64)>) -> Behaviour;
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
    fn check(&self, shared: &Shared) -> Result<(), Misfit>;
    /// The largest thing that one seed keeps beside its network on maps of this level's size: what, and its bytes.
    fn memory(&self, shared: &Shared, level: &Level) -> (String, u64);
    /// Optimiser steps of a stage with so many timesteps.
    fn optimizer_steps(&self, shared: &Shared, timesteps: u64) -> u64;
    /// Refuses settings with which an agent cannot go on from a stage that was trained with those of `parent`.
    ///
    /// # Errors
    /// The setting, what is wrong with it, and what mends it.
    fn goes_on_from(&self, _parent: &dyn Algorithm) -> Result<(), String> {
        Ok(())
    }
    /// Checks that an agent, as read from a file, brings what a stage begins with.
    ///
    /// # Errors
    /// What is missing, or cannot be so on maps of this level's size.
    fn check_agent(&self, _agent: &AgentState, _shared: &Shared, _level: &Level) -> Result<(), String> {
        Ok(())
    }
    /// Adds what it keeps in the midst of a stage to the snapshot of the stage's beginning, and takes it out of
    /// [what the agent brings](crate::agent::state::Kept::buffers).
    fn begin(&self, _snapshot: &mut Snapshot, _level: &Level) {}
    /// Checks what [`begin`](Self::begin) added, as read from a file.
    ///
    /// # Errors
    /// What cannot be so on this level.
    fn check_snapshot(&self, snapshot: &Snapshot, shared: &Shared, level: &Level) -> Result<(), String>;
    /// A learner at work on a stage.
    fn learner(&self, setup: Setup<'_>) -> Box<dyn Learner>;
    /// A copy.
    fn boxed(&self) -> Box<dyn Algorithm>;
}

/// What a learner is made of, beside its algorithm's settings.
pub struct Setup<'a> {
    /// What all algorithms share.
    pub shared: &'a Shared,
    /// The stage.
    pub stage: &'a Stage,
    /// Where its seeds stand; they have been checked against the stage, and stand together.
    pub snapshots: Vec<Snapshot>,
    /// The agents' networks and Adam.
    pub engine: Box<dyn Engine>,
    /// The mitigations.
    pub regimen: Regimen,
}

/// Settings that do not fit together.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Misfit {
    /// The settings that can be changed to mend it.
    pub keys: &'static [&'static str],
    /// What is wrong, and what is possible.
    pub problem: String,
}

impl Clone for Box<dyn Algorithm> {
    fn clone(&self) -> Self {
        self.boxed()
    }
}
