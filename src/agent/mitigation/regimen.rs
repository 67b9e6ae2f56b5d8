//! The mitigations of a learner at work.

use bit_mlp::BitBatch;

use super::hooks::{Descent, Mitigation, Surroundings};
use super::list::Mitigations;
use super::patient::{Patient, STEPS, steps};
use crate::agent::engine::{Engine, Loss, Units};
use crate::agent::learner::Metrics;
use crate::agent::network::{Network, Outputs};
use crate::agent::optimizer::OptimizerConfig;
use crate::agent::state::AgentState;
use crate::random::Stream;

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
    /// What makes the gradient steps, where it is not the engine alone.
    descent: Option<Box<dyn Descent>>,
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
        outputs: Outputs,
        stage: u16,
        agents: impl Iterator<Item = &'a AgentState>,
    ) -> Self {
        let agents: Vec<&AgentState> = agents.collect();
        Self {
            descent: mitigations.iter().find_map(|mitigation| mitigation.descent(stage, outputs, &agents)),
            network,
            copies,
            stage,
            steps: agents.into_iter().map(steps).collect(),
            counts_steps: mitigations.iter().any(Mitigation::acts_between_steps),
            mitigations: mitigations.clone(),
            optimizer: optimizer.clone(),
        }
    }

    /// One step per seed down its loss and what mitigations add to it; then mitigations act. `draw` draws so many states of a
    /// seed, by its place.
    pub fn descend(
        &mut self,
        engine: &mut dyn Engine,
        losses: &mut [&mut dyn Loss<'_>],
        draw: &dyn Fn(usize, usize, &mut Stream) -> BitBatch,
    ) -> Vec<f32> {
        let norms = match &mut self.descent {
            Some(descent) => descent.descend(losses, Surroundings { engine, steps: &self.steps, draw }),
            None => engine.descend(losses),
        };
        self.after_step(engine);
        norms
    }

    /// Lets mitigations act after a gradient step of every seed. One whose gradient was not finite counts, too: the row of the
    /// log ends the run.
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

    /// Writes what it counts into the agent, at the end of a row of the log.
    pub fn save(&mut self, seed: usize, agent: &mut AgentState) {
        if let Some(descent) = &mut self.descent {
            descent.save(seed, agent);
        }
        if self.counts_steps {
            agent.kept.numbers.insert(STEPS.to_owned(), self.steps[seed]);
        }
    }
}
