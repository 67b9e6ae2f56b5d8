//! How much an L2 penalty amounts to: what is known before training, and what is measured.

use serde::{Deserialize, Serialize};

use crate::agent::Metrics;
use crate::agent::Stage;
use crate::agent::config::Config;
use crate::agent::mitigation::{L2, L2Penalty};
use crate::config::Choice;
use crate::experiment::Curriculum;

/// A penalty below this share of the weights, or of the loss's gradient, is too weak to act.
pub const WEAK: f64 = 0.01;

/// The dose of one run, as its manifest records it: what is known before training, and what each stage measured.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Dose {
    /// How the penalty acts, as the setting `l2` says it.
    pub l2: String,
    /// λ.
    pub l2_coef: f64,
    /// Over all stages that are trained.
    pub optimizer_steps: u64,
    /// ∏(1 − αλ) over all optimiser steps, in exact arithmetic; of decoupled decay alone.
    pub planned_shrink: Option<f64>,
    /// The same with the factor rounded to `f32`, as PyTorch and we multiply by it.
    pub shrink: Option<f64>,
    /// ‖θ‖ at the end of each finished stage; none where it was no number, and for the stages of a fork's parent.
    pub weight_norm: Vec<Option<f64>>,
    /// Mean ratio of the penalty's gradient to the loss's in each finished stage, of a penalty that has a gradient; none
    /// for a stage without an update.
    pub l2_ratio: Vec<Option<f64>>,
}

/// What the running stage has measured so far.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct StageDose {
    /// Of the ratios of the penalty's gradient to the loss's, as its bits, which is how snapshots of format 1 have it.
    #[serde(with = "as_bits")]
    sum: f64,
    count: u32,
}

/// A float as the integer of its bits.
mod as_bits {
    use serde::{Deserialize, Deserializer, Serializer};

    pub fn serialize<S: Serializer>(value: &f64, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_u64(value.to_bits())
    }

    pub fn deserialize<'de, D: Deserializer<'de>>(deserializer: D) -> Result<f64, D::Error> {
        u64::deserialize(deserializer).map(f64::from_bits)
    }
}

impl StageDose {
    /// Takes in a row of the log.
    pub fn measure(&mut self, metrics: &Metrics) {
        if let Some((_, ratio)) = metrics.iter().find(|(name, value)| *name == "train/l2_ratio" && value.is_finite()) {
            self.sum += ratio;
            self.count += 1;
        }
    }
}

impl Dose {
    /// What is known before training.
    pub fn planned(config: &Config, curriculum: &Curriculum) -> Self {
        let of_stage = |stage: &Stage| config.algorithm.optimizer_steps(&config.shared, stage.timesteps);
        let steps: u64 = curriculum.trained().iter().map(of_stage).sum();
        // A fork measured nothing in the stages of its parent.
        let of_parent = vec![None; curriculum.begins.into()];
        let penalty = config.mitigations.find::<L2Penalty>().cloned().unwrap_or_default();
        let decay = config.shared.optimizer.learning_rate * penalty.coefficient;
        let decoupled = |shrink: f64| (penalty.kind == L2::AdamW).then_some(shrink);
        Self {
            l2: penalty.kind.name().to_owned(),
            l2_coef: penalty.coefficient,
            optimizer_steps: steps,
            planned_shrink: decoupled((steps as f64 * (-decay).ln_1p()).exp()),
            shrink: decoupled(f64::from((1.0 - decay) as f32).powf(steps as f64)),
            weight_norm: of_parent.clone(),
            l2_ratio: if matches!(penalty.kind, L2::Adam | L2::Loss) { of_parent } else { Vec::new() },
        }
    }

    /// One line for the beginning of a training, where there is a penalty.
    pub fn line(&self) -> Option<String> {
        let Self { l2_coef, optimizer_steps, .. } = self;
        let percent = |shrink: f64| 100.0 * (1.0 - shrink);
        if let (Some(planned), Some(shrink)) = (self.planned_shrink, self.shrink) {
            return Some(format!(
                "L2 dose: decoupled decay (AdamW) of {l2_coef:e} is to shrink the weights by {:.2}% in all over \
                 {optimizer_steps} optimiser steps; with the factor rounded to 32 bits it shrinks them by {:.2}%{}",
                percent(planned),
                percent(shrink),
                if 1.0 - shrink < WEAK { ": too weak to act" } else { "" }
            ));
        }
        let enters = match self.kind()? {
            L2::Adam => "coupled inside Adam",
            L2::Loss => "in the loss",
            L2::None | L2::AdamW => return None,
        };
        Some(format!(
            "L2 dose: coefficient {l2_coef:e} {enters}; train/l2_ratio shows the ratio of its gradient to the loss's"
        ))
    }

    /// Goes back to where so many stages are done.
    pub fn go_back(&mut self, stages: u16) {
        self.weight_norm.truncate(stages.into());
        self.l2_ratio.truncate(stages.into());
    }

    /// Closes a stage with what it measured and the norm of the weights as they are now.
    pub fn end_stage(&mut self, stage: StageDose, parameters: &[f32]) {
        let finite = |value: f64| Some(value).filter(|value| value.is_finite());
        self.weight_norm.push(finite(parameters.iter().map(|&p| f64::from(p).powi(2)).sum::<f64>().sqrt()));
        if matches!(self.kind(), Some(L2::Adam | L2::Loss)) {
            self.l2_ratio.push(finite(stage.sum / f64::from(stage.count)));
        }
    }

    fn kind(&self) -> Option<L2> {
        L2::ALL.iter().find(|(name, _)| *name == self.l2).map(|(_, kind)| *kind)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use coverage_env::Level;

    #[test]
    fn the_published_penalty_does_nothing() {
        let config = crate::agent::config::resolve(Some("ppo-l2"), None, &[], None).unwrap();
        let levels = coverage_env::BUILTIN_IDS.iter().filter_map(|id| Level::builtin(id));
        let stages = levels.map(|level| (level.into(), 500_000)).collect();
        let dose = Dose::planned(&config, &Curriculum::sequence("five", stages).unwrap());
        // Five levels of 245 rollouts of 2,048 timesteps, each ten epochs of 32 minibatches.
        assert_eq!(dose.optimizer_steps, 5 * 245 * 320);
        let planned = dose.planned_shrink.unwrap();
        assert!((1.0 - planned - 0.00391).abs() < 1e-5, "{planned}");
        // 1 − 10⁻⁸ is 1 in 32 bits.
        assert_eq!(dose.shrink, Some(1.0));
        assert!(dose.line().unwrap().contains("0.39%") && dose.line().unwrap().contains("0.00%"));
    }

    #[test]
    fn dqn_makes_a_step_every_fourth_timestep_after_its_start() {
        let config = crate::agent::config::resolve(Some("dqn"), None, &[], None).unwrap();
        assert_eq!(config.algorithm.optimizer_steps(&config.shared, 1_000_000), 250_000 - 25);
    }
}
