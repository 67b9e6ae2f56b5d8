//! Measures of continual learning, per seed and over seeds, of normalised returns.

use std::collections::BTreeMap;

use rl_stats::continual::{ReturnMatrix, mean_entry};
use rl_stats::pairs::estimate_mean;
use rl_stats::{Bootstrap, Estimate};
use serde::Serialize;

use super::{ArmStage, Matrix, MatrixRow};

/// The measures of a curriculum; only seeds that have finished all stages count.
#[derive(Clone, Debug, Serialize)]
pub struct Continual {
    /// Mean return on all levels at the end (Lopez-Paz & Ranzato 2017).
    pub average_performance: Option<OverSeeds>,
    /// Mean change on each level from the end of its own stage to the end of all (Lopez-Paz & Ranzato 2017).
    pub backward_transfer: Option<OverSeeds>,
    /// Mean gain over the untrained model on each level right before training on it (Lopez-Paz & Ranzato 2017).
    pub forward_transfer: Option<OverSeeds>,
    /// Mean loss from the end of a level's own stage to the end of all (Wołczyk et al. 2021).
    pub forgetting: Option<OverSeeds>,
    /// The same for each stage.
    pub forgetting_by_stage: Vec<Option<OverSeeds>>,
    /// Mean loss on an earlier level through one stage (Powers et al. 2022).
    pub isolated_forgetting: Option<OverSeeds>,
    /// Mean gain on a later level through one stage (Powers et al. 2022).
    pub zero_shot_transfer: Option<OverSeeds>,
}

/// One number per seed.
#[derive(Clone, Debug, Serialize)]
pub struct OverSeeds {
    /// Their mean, with its interval over seeds.
    pub mean: Estimate,
    /// Each seed's.
    pub seeds: BTreeMap<u64, f64>,
}

impl OverSeeds {
    /// `None` of no seeds.
    pub(super) fn new(seeds: BTreeMap<u64, f64>, bootstrap: &Bootstrap) -> Option<Self> {
        (!seeds.is_empty()).then(|| Self { mean: estimate_mean(bootstrap, seeds.values().copied().collect()), seeds })
    }
}

impl Continual {
    /// `None` where no seed has finished, or an optimum is unknown.
    pub(super) fn new(matrix: &Matrix, stages: &[ArmStage], bootstrap: &Bootstrap) -> Option<Self> {
        let matrices = seed_matrices(matrix);
        if matrices.is_empty() {
            return None;
        }
        let over_seeds = |of: &dyn Fn(&ReturnMatrix) -> Option<f64>| {
            OverSeeds::new(matrices.iter().filter_map(|(&seed, r)| Some((seed, of(r)?))).collect(), bootstrap)
        };
        // Normalised returns are shares of the optimum already.
        let ones = vec![1.0; stages.len()];
        Some(Self {
            average_performance: over_seeds(&ReturnMatrix::average_performance),
            backward_transfer: over_seeds(&ReturnMatrix::backward_transfer),
            forward_transfer: over_seeds(&ReturnMatrix::forward_transfer),
            forgetting: over_seeds(&ReturnMatrix::mean_forgetting),
            forgetting_by_stage: (0..stages.len()).map(|stage| over_seeds(&|r| Some(r.forgetting()[stage]))).collect(),
            isolated_forgetting: over_seeds(&|r| mean_entry(&r.isolated_forgetting(&ones))),
            zero_shot_transfer: over_seeds(&|r| mean_entry(&r.zero_shot_transfer(&ones))),
        })
    }
}

/// The whole normalised matrices, by seed.
fn seed_matrices(matrix: &Matrix) -> BTreeMap<u64, ReturnMatrix> {
    let Some((before, after)) = matrix.rows.split_first() else { return BTreeMap::new() };
    let last = after.last().and_then(|row| row.cells.first()?.as_ref());
    let of_seed = |&seed: &u64| {
        let row = |row: &MatrixRow| -> Option<Vec<f64>> {
            row.cells.iter().map(|cell| cell.as_ref()?.normalised_seeds.get(&seed).copied()).collect()
        };
        Some((seed, ReturnMatrix::new(row(before)?, after.iter().map(row).collect::<Option<_>>()?)))
    };
    last.into_iter().flat_map(|cell| cell.seeds.keys()).filter_map(of_seed).collect()
}
