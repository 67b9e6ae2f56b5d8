//! How much an L2 penalty amounts to: what is known before training, and what is measured.

use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use crate::agent::Metrics;
use crate::agent::Stage;
use crate::agent::config::Config;
use crate::agent::mitigation::{L2, L2Penalty};
use crate::config::Choice;
use crate::curriculum::Curriculum;

/// A treatment below this share of the weights, or of the loss's gradient, is too weak to act.
pub const WEAK: f64 = 0.01;

/// The dose of one run, measured stage by stage.
#[derive(Clone, Debug)]
pub struct Dose {
    l2: L2,
    coef: f64,
    /// ∏(1 − αλ) over all optimiser steps, of decoupled decay, in exact arithmetic.
    planned_shrink: f64,
    /// The same with the factor rounded to `f32`, as PyTorch and we multiply by it.
    shrink: f64,
    optimizer_steps: u64,
    weight_norms: Vec<f64>,
    /// Mean ratio of the penalty's gradient to the loss's, per stage.
    ratios: Vec<f64>,
    stage: StageDose,
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

impl Dose {
    /// What is known before training, and what `recorded`, a manifest's, says of the stages done by earlier starts.
    pub fn new(config: &Config, curriculum: &Curriculum, recorded: &Value) -> Self {
        let of_stage = |stage: &Stage| config.algorithm.optimizer_steps(config, stage.timesteps);
        let steps = curriculum.stages.iter().map(of_stage).sum();
        let penalty = L2Penalty::of(config);
        let decay = config.optimizer.learning_rate * penalty.coefficient;
        let earlier = |key: &str| {
            let list = recorded.get(key).and_then(Value::as_array).map_or(&[][..], Vec::as_slice);
            list.iter().map(|v| v.as_f64().unwrap_or(f64::NAN)).collect()
        };
        Self {
            l2: penalty.kind,
            coef: penalty.coefficient,
            planned_shrink: (steps as f64 * (-decay).ln_1p()).exp(),
            shrink: f64::from((1.0 - decay) as f32).powf(steps as f64),
            optimizer_steps: steps,
            weight_norms: earlier("weight_norm"),
            ratios: earlier("l2_ratio"),
            stage: StageDose::default(),
        }
    }

    /// One line for the beginning of a training, where there is a penalty.
    pub fn line(&self) -> Option<String> {
        let Self { coef, optimizer_steps, .. } = self;
        let percent = |shrink: f64| 100.0 * (1.0 - shrink);
        match self.l2 {
            L2::None => None,
            L2::AdamW => Some(format!(
                "L2 dose: decoupled decay (AdamW) of {coef:e} is to shrink the weights by {:.2}% in all over \
                 {optimizer_steps} optimiser steps; with the factor rounded to 32 bits it shrinks them by {:.2}%{}",
                percent(self.planned_shrink),
                percent(self.shrink),
                if 1.0 - self.shrink < WEAK { ": too weak to act" } else { "" }
            )),
            L2::Adam | L2::Loss => Some(format!(
                "L2 dose: coefficient {coef:e} {}; train/l2_ratio shows the ratio of its gradient to the loss's",
                if self.l2 == L2::Adam { "coupled inside Adam" } else { "in the loss" }
            )),
        }
    }

    /// Goes back to where `stages` are done and the running one has measured this.
    pub fn go_on(&mut self, stages: u16, stage: StageDose) {
        self.weight_norms.truncate(stages.into());
        self.ratios.truncate(stages.into());
        self.stage = stage;
    }

    /// What the running stage has measured so far.
    pub fn stage(&self) -> StageDose {
        self.stage
    }

    /// Takes in a row of the log.
    pub fn measure(&mut self, metrics: &Metrics) {
        if let Some((_, ratio)) = metrics.iter().find(|(name, value)| *name == "train/l2_ratio" && value.is_finite()) {
            self.stage.sum += ratio;
            self.stage.count += 1;
        }
    }

    /// Closes a stage with the norm of the weights as they are now.
    pub fn end_stage(&mut self, parameters: &[f32]) {
        self.weight_norms.push(parameters.iter().map(|&p| f64::from(p).powi(2)).sum::<f64>().sqrt());
        // A stage without an update has no ratio: NaN, which JSON shows as null.
        let StageDose { sum, count } = std::mem::take(&mut self.stage);
        self.ratios.push(sum / f64::from(count));
    }

    /// What the manifest records.
    pub fn to_json(&self) -> Value {
        let decoupled = |shrink: f64| if self.l2 == L2::AdamW { json!(shrink) } else { Value::Null };
        json!({
            "l2": self.l2.name(),
            "l2_coef": self.coef,
            "optimizer_steps": self.optimizer_steps,
            "planned_shrink": decoupled(self.planned_shrink),
            "shrink": decoupled(self.shrink),
            "weight_norm": self.weight_norms,
            "l2_ratio": if matches!(self.l2, L2::Adam | L2::Loss) { &self.ratios[..] } else { &[] },
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use coverage_env::Level;

    #[test]
    fn the_published_penalty_does_nothing() {
        let config = crate::agent::config::resolve(Some("ppo-l2"), None, &[], None).unwrap();
        let levels = coverage_env::BUILTIN_IDS.iter().filter_map(|id| Level::builtin(id)).collect();
        let dose = Dose::new(&config, &Curriculum::sequence(levels, 500_000).unwrap(), &Value::Null);
        // Five levels of 245 rollouts of 2,048 timesteps, each ten epochs of 32 minibatches.
        assert_eq!(dose.optimizer_steps, 5 * 245 * 320);
        assert!((1.0 - dose.planned_shrink - 0.00391).abs() < 1e-5, "{}", dose.planned_shrink);
        // 1 − 10⁻⁸ is 1 in 32 bits.
        assert_eq!(dose.shrink, 1.0);
        assert!(dose.line().unwrap().contains("0.39%") && dose.line().unwrap().contains("0.00%"));
    }

    #[test]
    fn dqn_makes_a_step_every_fourth_timestep_after_its_start() {
        let config = crate::agent::config::resolve(Some("dqn"), None, &[], None).unwrap();
        assert_eq!(config.algorithm.optimizer_steps(&config, 1_000_000), 250_000 - 25);
    }
}
