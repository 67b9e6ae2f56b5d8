//! R[i, j]: the return on level j before the first stage and after each stage i.

use std::collections::BTreeMap;

use rl_stats::pairs::estimate_mean;
use rl_stats::{Bootstrap, Interval};
use serde::Serialize;

use super::groups::{ArmStage, Group};
use super::levels::LevelInfo;
use super::run::Evaluated;
use crate::results::mean_std;

/// The matrix of returns of a curriculum.
#[derive(Clone, Debug, Serialize)]
pub struct Matrix {
    /// Indices of the levels that it was evaluated on, each once, in the order of their first stages.
    pub levels: Vec<usize>,
    /// Before the first stage, then after each.
    pub rows: Vec<MatrixRow>,
}

/// The returns on all levels at one time.
#[derive(Clone, Debug, Serialize)]
pub struct MatrixRow {
    /// The stage just trained, and its level's index; none before the first.
    pub after: Option<ArmStage>,
    /// In the order of [`Matrix::levels`]; null where no seed has a result.
    pub cells: Vec<Option<MatrixCell>>,
}

/// The return on one level at one time.
#[derive(Clone, Debug, Serialize)]
pub struct MatrixCell {
    /// Mean over seeds of the mean over every start cell.
    pub mean: f64,
    /// Population standard deviation over seeds; none of one.
    pub std: Option<f64>,
    /// That of one seed over its start cells; none of several.
    pub std_over_starts: Option<f64>,
    /// Of the mean; none with one seed.
    pub interval: Option<Interval>,
    /// Mean share of start cells solved.
    pub solved_share: f64,
    /// The mean, normalised; none where the optimum is unknown.
    pub normalised: Option<f64>,
    /// Each seed's mean.
    pub seeds: BTreeMap<u64, f64>,
    /// Each seed's normalised mean; empty where the optimum is unknown.
    pub normalised_seeds: BTreeMap<u64, f64>,
    /// The same of the sampled policy; empty also where runs of earlier versions did not sample.
    pub sampled_normalised_seeds: BTreeMap<u64, f64>,
}

impl Matrix {
    pub(super) fn new(group: &Group, levels: &[LevelInfo], stages: &[ArmStage], bootstrap: &Bootstrap) -> Self {
        let mut columns: Vec<usize> = Vec::new();
        for stage in stages {
            if !columns.contains(&stage.level) {
                columns.push(stage.level);
            }
        }
        let row = |after: Option<ArmStage>| MatrixRow {
            after,
            cells: columns
                .iter()
                .map(|&column| MatrixCell::new(group, after, &levels[column].name, bootstrap))
                .collect(),
        };
        let times = [None].into_iter().chain(stages.iter().copied().map(Some));
        Self { rows: times.map(row).collect(), levels: columns }
    }
}

impl MatrixCell {
    fn new(group: &Group, after: Option<ArmStage>, level: &str, bootstrap: &Bootstrap) -> Option<Self> {
        let key = (after.map(|stage| stage.stage), level.to_owned());
        let evaluated: BTreeMap<u64, &Evaluated> =
            group.runs.iter().filter_map(|run| Some((run.manifest.seed, run.evaluations.get(&key)?))).collect();
        let all = |of: fn(&Evaluated) -> f64| evaluated.values().map(|e| of(e)).collect::<Vec<f64>>();
        let seeds: BTreeMap<u64, f64> = evaluated.iter().map(|(&seed, e)| (seed, e.mean)).collect();
        let (std_over_starts, several) = match evaluated.values().collect::<Vec<_>>()[..] {
            [] => return None,
            [one] => (Some(one.std), false),
            _ => (None, true),
        };
        let (mean, std) = mean_std(&all(|e| e.mean));
        let normalised_seeds: BTreeMap<u64, f64> =
            evaluated.iter().filter_map(|(&seed, e)| Some((seed, e.normalised?))).collect();
        let normalised = normalised_seeds.values().copied().collect::<Vec<f64>>();
        Some(Self {
            mean,
            std: several.then_some(std),
            std_over_starts,
            interval: estimate_mean(bootstrap, all(|e| e.mean)).interval,
            solved_share: mean_std(&all(|e| e.solved_share)).0,
            normalised: (!normalised.is_empty()).then(|| mean_std(&normalised).0),
            seeds,
            normalised_seeds,
            sampled_normalised_seeds: group
                .runs
                .iter()
                .filter_map(|run| Some((run.manifest.seed, run.sampled.get(&key)?.normalised?)))
                .collect(),
        })
    }
}
