//! Between arms: how probably a run of the one does better than a run of the other.

use rl_stats::pairs::estimate_probability_of_improvement;
use rl_stats::{Bootstrap, Estimate};
use serde::Serialize;

use super::{Arm, LevelOutcome};

/// Two arms of one protocol, compared on the returns right after training on each level.
#[derive(Clone, Debug, Serialize)]
pub struct Improvement {
    /// Index of the arm that may be better.
    pub x: usize,
    /// Index of the other.
    pub y: usize,
    /// Indices of the levels that both have results on.
    pub levels: Vec<usize>,
    /// The probability that a run of x earns more than a run of y on the same level, ties half, averaged over levels;
    /// runs are not paired (Agarwal et al. 2021).
    pub probability: Estimate,
}

/// Every two arms of one protocol; that of y over x is 1 minus that of x over y.
pub(super) fn between(arms: &[Arm], bootstrap: &Bootstrap) -> Vec<Improvement> {
    let mut all = Vec::new();
    for (x, arm) in arms.iter().enumerate() {
        for (y, other) in arms.iter().enumerate().skip(x + 1).filter(|(_, other)| other.protocol == arm.protocol) {
            let both = arm.levels.iter().zip(&other.levels).enumerate();
            let shared: Vec<(usize, &LevelOutcome, &LevelOutcome)> =
                both.filter_map(|(level, (a, b))| Some((level, a.as_ref()?, b.as_ref()?))).collect();
            if shared.is_empty() {
                continue;
            }
            let returns = |outcome: &LevelOutcome| outcome.seeds.values().map(|seed| seed.mean).collect::<Vec<f64>>();
            let of_x: Vec<Vec<f64>> = shared.iter().map(|(_, outcome, _)| returns(outcome)).collect();
            let of_y: Vec<Vec<f64>> = shared.iter().map(|(_, _, outcome)| returns(outcome)).collect();
            let probability = estimate_probability_of_improvement(bootstrap, &of_x, &of_y);
            all.push(Improvement { x, y, levels: shared.iter().map(|(level, ..)| *level).collect(), probability });
        }
    }
    all
}
