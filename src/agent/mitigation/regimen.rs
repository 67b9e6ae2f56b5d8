//! The mitigations of a learner at work.

use super::hooks::Mitigation;
use super::list::Mitigations;
use super::patient::{Patient, STEPS, steps};
use crate::agent::engine::{Engine, Units};
use crate::agent::learner::Metrics;
use crate::agent::network::Network;
use crate::agent::optimizer::OptimizerConfig;
use crate::agent::state::AgentState;

/// What a learner of S seeds calls after every step and for every row of its log.
pub struct Regimen {
    mitigations: Mitigations,
    optimizer: OptimizerConfig,
    network: Network,
    /// The names of the algorithm's copies of its parameters.
    copies: &'static [&'static str],
    stage: u16,
    /// Gradient steps of each agent so far, counted where mitigations act between them.
    steps: Vec<u64>,
    /// Whether any mitigation ever acts between steps.
    counts_steps: bool,
}

impl Regimen {
    /// Mitigations at work on agents of this network in a stage.
    pub fn new<'a>(
        mitigations: &Mitigations,
        optimizer: &OptimizerConfig,
        network: Network,
        copies: &'static [&'static str],
        stage: u16,
        agents: impl Iterator<Item = &'a AgentState>,
    ) -> Self {
        Self {
            network,
            copies,
            stage,
            steps: agents.map(steps).collect(),
            counts_steps: mitigations.iter().any(Mitigation::acts_between_steps),
            mitigations: mitigations.clone(),
            optimizer: optimizer.clone(),
        }
    }

    /// Lets mitigations act after a gradient step of every seed.
    pub fn after_step(&mut self, engine: &mut dyn Engine) {
        if !self.counts_steps {
            return;
        }
        let Self { mitigations, network, copies, stage, steps, .. } = self;
        for (s, step) in steps.iter_mut().enumerate() {
            *step += 1;
            for mitigation in mitigations.iter().filter(|mitigation| mitigation.acts_after(*step)) {
                let units = if mitigation.reads_units() { engine.units(s) } else { Units::default() };
                engine.edit(s, &mut |agent| {
                    let mut patient = Patient { network, agent, copies, stage: *stage, step: *step };
                    mitigation.after_step(&mut patient, &units);
                });
            }
        }
    }

    /// What mitigations add to a seed's row of the log.
    pub fn metrics(&self, engine: &dyn Engine, seed: usize) -> Metrics {
        let norms = || engine.norms(seed);
        self.mitigations.iter().flat_map(|mitigation| mitigation.metrics(&self.optimizer, &norms)).collect()
    }

    /// Writes what it counts into the agent.
    pub fn save(&self, seed: usize, agent: &mut AgentState) {
        if self.counts_steps {
            agent.kept.numbers.insert(STEPS.to_owned(), self.steps[seed]);
        }
    }
}
