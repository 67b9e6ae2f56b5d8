//! Normalise-and-project (Lyle et al. 2024, "Normalization and Effective Learning Rates in Reinforcement Learning").

use bit_mlp::{Block, norm};

use super::hooks::{Brought, Mitigation};
use super::patient::Patient;
use crate::agent::engine::Units;
use crate::config::{Settings, Visitor, integer};

/// The list that holds ρ of each hidden layer, `[L]`.
const FIRST: &str = "normalise-project";

/// Layer normalisation in every hidden layer, and every so many gradient steps W ← ρ·W/‖W‖_F for their weights, ρ being
/// the norm with which the agent began.
///
/// The norm of W changes nothing of what follows a normalisation, but the effective learning rate. The last layer has none
/// and is left alone, and so are biases, scales and shifts. The source projects after each step, and reports that it can be
/// done far less often.
#[derive(Clone, Debug, PartialEq)]
pub struct NormaliseProject {
    /// Gradient steps from one projection to the next.
    interval: u64,
}

impl Default for NormaliseProject {
    fn default() -> Self {
        Self { interval: 1000 }
    }
}

impl Settings for NormaliseProject {
    fn visit(&mut self, v: &mut dyn Visitor) {
        let doc = "gradient steps between two projections of the weights";
        v.field("normalise_project_interval", doc, &mut integer(&mut self.interval, 1..=1_000_000_000));
    }
}

impl Mitigation for NormaliseProject {
    fn name(&self) -> &'static str {
        "normalise-project"
    }

    fn summary(&self) -> &'static str {
        "layer normalisation, and now and then weights get back their first norm (Lyle et al. 2024)"
    }

    fn number(&self) -> u16 {
        12
    }

    fn brings(&self) -> &'static [Brought] {
        const { &[Brought::fixed("layer_norm", "true")] }
    }

    /// Notes ρ once in an agent's life.
    fn begin_stage(&self, patient: &mut Patient<'_>) {
        let agent = &mut *patient.agent;
        let norms = || {
            let of = |block: &Block| norm(&agent.parameters[block.weight.clone()]);
            patient.network.hidden_blocks().map(of).collect()
        };
        agent.kept.lists.entry(FIRST.to_owned()).or_insert_with(norms);
    }

    fn acts_between_steps(&self) -> bool {
        true
    }

    fn acts_after(&self, step: u64) -> bool {
        step.is_multiple_of(self.interval)
    }

    fn after_step(&self, patient: &mut Patient<'_>, _: &Units) {
        let agent = &mut *patient.agent;
        let first = agent.kept.lists.get(FIRST).map_or(&[][..], Vec::as_slice);
        for (block, first) in patient.network.hidden_blocks().zip(first) {
            let weight = &mut agent.parameters[block.weight.clone()];
            let is = norm(weight);
            if is > 0.0 {
                weight.iter_mut().for_each(|w| *w *= first / is);
            }
        }
    }

    fn boxed(&self) -> Box<dyn Mitigation> {
        Box::new(self.clone())
    }
}
