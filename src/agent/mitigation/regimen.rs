//! The mitigations of a learner at work.

use super::{Mitigation, Patient};
use crate::agent::config::Config;
use crate::agent::engine::Engine;
use crate::agent::network::Network;
use crate::agent::state::AgentState;
use crate::agent::{Metrics, Stage};

/// The number under which an agent keeps its gradient steps, where mitigations count them.
const STEPS: &str = "mitigation/steps";

/// Gradient steps of an agent's life so far.
pub(super) fn steps(agent: &AgentState) -> u64 {
    agent.kept.numbers.get(STEPS).copied().unwrap_or(0)
}

/// What a learner of S seeds calls after every step and for every row of its log.
pub struct Regimen {
    config: Config,
    network: Network,
    stage: u16,
    /// Gradient steps of each agent's life so far.
    steps: Vec<u64>,
    /// Whether any mitigation ever acts between steps.
    counts_steps: bool,
}

impl Regimen {
    /// The mitigations of `config`, for agents in this stage.
    pub fn new<'a>(config: &Config, stage: &Stage, agents: impl Iterator<Item = &'a AgentState>) -> Self {
        Self {
            network: config.network(&stage.level),
            stage: stage.index,
            steps: agents.map(steps).collect(),
            counts_steps: config.mitigations.iter().any(Mitigation::acts_between_steps),
            config: config.clone(),
        }
    }

    /// Lets mitigations act after a gradient step of every seed.
    pub fn after_step(&mut self, engine: &mut dyn Engine) {
        if !self.counts_steps {
            return;
        }
        let Self { config, network, stage, steps, .. } = self;
        for (s, step) in steps.iter_mut().enumerate() {
            *step += 1;
            for mitigation in config.mitigations.iter().filter(|mitigation| mitigation.acts_after(*step)) {
                let units = engine.units(s);
                engine.edit(s, &mut |agent| {
                    mitigation.after_step(&mut Patient { network, agent, stage: *stage, step: *step }, &units);
                });
            }
        }
    }

    /// What mitigations add to a seed's row of the log.
    pub fn metrics(&self, engine: &dyn Engine, seed: usize) -> Metrics {
        let norms = || engine.norms(seed);
        self.config.mitigations.iter().flat_map(|mitigation| mitigation.metrics(&self.config, &norms)).collect()
    }

    /// Writes what it counts into the agent.
    pub fn save(&self, seed: usize, agent: &mut AgentState) {
        if self.counts_steps {
            agent.kept.numbers.insert(STEPS.to_owned(), self.steps[seed]);
        }
    }
}
