//! What a mitigation is to the rest of the program.

use std::any::Any;
use std::fmt::Debug;
use std::sync::Arc;

use bit_mlp::BitBatch;

use super::patient::Patient;
use crate::agent::engine::{Engine, GradientNorms, Loss, Penalty, Pull, Units};
use crate::agent::learner::Metrics;
use crate::agent::network::{Network, Outputs};
use crate::agent::optimizer::OptimizerConfig;
use crate::agent::shared::Shared;
use crate::agent::state::AgentState;
use crate::config::Settings;
use crate::random::Stream;

/// A setting that a mitigation brings.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Brought {
    /// Its key.
    pub key: &'static str,
    /// Its value, as in a file.
    pub value: &'static str,
    /// Whether another value is another dose of the method; else it is not the method at all, and refused.
    pub is_dose: bool,
}

impl Brought {
    /// A setting without which it is not this method.
    pub const fn fixed(key: &'static str, value: &'static str) -> Self {
        Self { key, value, is_dose: false }
    }

    /// A setting whose value is the dose.
    pub const fn dose(key: &'static str, value: &'static str) -> Self {
        Self { key, value, is_dose: true }
    }
}

/// Gradient steps of S seeds, with what a mitigation remembers from one to the next.
pub trait Descent: Send {
    /// One step per seed down its loss and what is added to it; returns the norms of the gradients before clipping, `[S]`.
    fn descend(&mut self, losses: &mut [&mut dyn Loss<'_>], surroundings: Surroundings<'_>) -> Vec<f32>;
    /// Ends a row of the log of a seed: what outlasts it goes into the agent.
    fn save(&mut self, seed: usize, agent: &mut AgentState);
}

/// What a [`Descent`] works with.
pub struct Surroundings<'a> {
    /// What computes.
    pub engine: &'a mut dyn Engine,
    /// Gradient steps that each agent has made under mitigations, `[S]`.
    pub steps: &'a [u64],
    /// Draws so many states of a seed, by its place.
    pub draw: &'a dyn Fn(usize, usize, &mut Stream) -> BitBatch,
}

/// A method against loss of plasticity, as its settings. Every hook has a default that does nothing and costs nothing.
pub trait Mitigation: Settings + Any + Debug + Send + Sync {
    /// Its name in the setting `mitigations`.
    fn name(&self) -> &'static str;
    /// What it does, and whose it is, in one line.
    fn summary(&self) -> &'static str;
    /// A number of its own, which its random streams have; never changed, and never used again for another; at most 1,000.
    fn number(&self) -> u16;
    /// Settings that it brings when it is listed, as `--set` takes them, in place of a preset's.
    fn brings(&self) -> &'static [Brought] {
        &[]
    }
    /// Whether it is there without being listed, as its own settings say.
    fn is_always_listed(&self) -> bool {
        false
    }
    /// Refuses settings that it cannot work with.
    ///
    /// # Errors
    /// The key to change, and what is wrong and what is possible.
    fn check(&self, _shared: &Shared) -> Result<(), (&'static str, String)> {
        Ok(())
    }
    /// What draws the parameters beside the loss.
    fn pull(&self) -> Option<Pull> {
        None
    }
    /// What else is added to the loss's gradient.
    fn penalty(&self, _network: &Network) -> Option<Arc<dyn Penalty>> {
        None
    }
    /// What makes the gradient steps of S agents in a stage, where the loss gets what depends on samples beside the minibatch.
    fn descent(&self, _stage: u16, _outputs: Outputs, _agents: &[&AgentState]) -> Option<Box<dyn Descent>> {
        None
    }
    /// Acts at the beginning of a stage, the first included.
    fn begin_stage(&self, _patient: &mut Patient<'_>) {}
    /// Acts at a switch of levels: at the beginning of every stage but the first.
    fn at_switch(&self, _patient: &mut Patient<'_>) {}
    /// Whether it ever acts between gradient steps; only then are steps counted.
    fn acts_between_steps(&self) -> bool {
        false
    }
    /// Whether it acts after this gradient step, counted from 1 over the agent's life.
    fn acts_after(&self, _step: u64) -> bool {
        self.acts_between_steps()
    }
    /// Whether it reads what the hidden units did; only then are their activations copied for it.
    fn reads_units(&self) -> bool {
        false
    }
    /// Acts after a gradient step; `units` is what the hidden units did in it, or empty if it does not read that.
    fn after_step(&self, _patient: &mut Patient<'_>, _units: &Units) {}
    /// What it adds to a row of the log, given the norms of the last gradient.
    fn metrics(&self, _optimizer: &OptimizerConfig, _norms: &dyn Fn() -> GradientNorms) -> Metrics {
        Metrics::new()
    }
    /// A copy.
    fn boxed(&self) -> Box<dyn Mitigation>;
}
