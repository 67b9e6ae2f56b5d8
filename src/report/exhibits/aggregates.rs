//! Normalised returns right after training, over all levels at once.

use std::collections::BTreeMap;

use rl_stats::aggregate::{self, interquartile_mean, mean, median};
use rl_stats::pairs::estimate_mean;
use rl_stats::{Bootstrap, Estimate};
use serde::Serialize;

use super::exhibit::{Definition, Exhibit, NamedTable};
use super::parts::notes::{interval_note, level_names, percentile_note};
use crate::report::analysis::{Analysis, Arm, LevelOutcome, Protocol, SeedOutcome};
use crate::report::parallel;
use crate::report::table::{Cell, Table};

/// The section of docs/metrics.md.
const PLACE: &str = "over-seeds-and-levels-agarwal-et-al-2021";

/// Every arm over all its levels.
#[derive(Debug, Serialize)]
#[serde(transparent)]
pub struct Aggregates {
    /// In the order of the arms; null for forks, and where nothing is finished or an optimum is unknown.
    pub arms: Vec<Option<OverLevels>>,
}

/// An arm over all its levels: normalised returns right after training on each.
///
/// A seed is one draw, with its returns on all levels. Where not every level has the same seeds, they are resampled
/// level by level.
#[derive(Clone, Debug, Serialize)]
pub struct OverLevels {
    /// Indices of the levels.
    pub levels: Vec<usize>,
    /// Whether every seed has a return on every level.
    pub are_whole: bool,
    /// Mean over levels of the mean over seeds.
    pub mean: Estimate,
    /// Median over levels of the mean over seeds.
    pub median: Estimate,
    /// Interquartile mean over all runs.
    pub interquartile_mean: Estimate,
    /// The optimality gap.
    pub optimality_gap: Estimate,
}

impl OverLevels {
    /// Over the levels that have results; `None` without any, or where an optimum is unknown.
    fn new(outcomes: &[Option<LevelOutcome>], bootstrap: &Bootstrap) -> Option<Self> {
        let with_results = |(level, outcome): (usize, &Option<LevelOutcome>)| {
            let of_seed = |(&seed, outcome): (&u64, &SeedOutcome)| Some((seed, outcome.normalised?));
            let scores = outcome.as_ref()?.seeds.iter().map(of_seed).collect::<Option<BTreeMap<u64, f64>>>();
            Some((level, scores))
        };
        let (levels, scores): (Vec<usize>, Vec<Option<BTreeMap<u64, f64>>>) =
            outcomes.iter().enumerate().filter_map(with_results).unzip();
        let by_seed: Vec<BTreeMap<u64, f64>> = scores.into_iter().collect::<Option<_>>()?;
        let first = by_seed.first()?;
        let are_whole = by_seed.iter().all(|level| level.keys().eq(first.keys()));
        let scores: Vec<Vec<f64>> = by_seed.iter().map(|level| level.values().copied().collect()).collect();
        let gap = |scores: &[Vec<f64>]| aggregate::optimality_gap(scores, 1.0);
        if !are_whole {
            return Some(Self {
                levels,
                are_whole,
                mean: bootstrap.estimate(&scores, mean),
                median: bootstrap.estimate(&scores, median),
                interquartile_mean: bootstrap.estimate(&scores, interquartile_mean),
                optimality_gap: bootstrap.estimate(&scores, gap),
            });
        }
        let over_levels = |of: &dyn Fn(&[Vec<f64>]) -> f64| {
            let of_seed = |seed: usize| of(&scores.iter().map(|level| vec![level[seed]]).collect::<Vec<_>>());
            estimate_mean(bootstrap, (0..first.len()).map(of_seed).collect())
        };
        Some(Self {
            levels,
            are_whole,
            mean: over_levels(&mean),
            median: bootstrap.estimate_whole(&scores, median),
            interquartile_mean: bootstrap.estimate_whole(&scores, interquartile_mean),
            optimality_gap: over_levels(&gap),
        })
    }
}

impl Aggregates {
    /// Of every arm.
    pub fn new(analysis: &Analysis) -> Self {
        let of_arm = |arm: &Arm| {
            // Forks have few of the levels, and their means would stand beside those of all levels.
            let is_fork = arm.protocol == Protocol::Fork;
            if is_fork { None } else { OverLevels::new(&arm.levels, &analysis.conventions.bootstrap) }
        };
        Self { arms: parallel::map(&analysis.arms, of_arm) }
    }
}

impl Exhibit for Aggregates {
    fn key(&self) -> &'static str {
        "aggregates"
    }

    fn heading(&self) -> &'static str {
        "Over all levels"
    }

    fn lead(&self) -> &'static str {
        "0 is the worst return there is, 1 the proved mean optimum."
    }

    fn absence(&self) -> &'static str {
        "No stage is finished, or a level has no proved optimum."
    }

    fn definitions(&self) -> Vec<Definition> {
        let one = |name, meaning: &str| Definition { name, meaning: meaning.to_owned(), place: PLACE };
        vec![
            one("IQM", "interquartile mean: the mean of the middle half of all runs"),
            one("optimality gap", "mean of 1 − min(normalised return, 1)"),
        ]
    }

    fn numbers(&self) -> serde_json::Result<Option<String>> {
        serde_json::to_string(self).map(Some)
    }

    fn tables(&self, analysis: &Analysis) -> Vec<NamedTable> {
        vec![
            NamedTable::main("aggregates", self.table(analysis)),
            NamedTable::new("optimality-gap", distance(analysis)),
        ]
    }
}

impl Aggregates {
    /// Normalised returns right after training, over all levels.
    fn table(&self, analysis: &Analysis) -> Table {
        let with_results = || {
            let arms = analysis.arms.iter().zip(&self.arms).enumerate();
            arms.filter_map(|(index, (arm, over))| Some((index, arm, over.as_ref()?)))
        };
        // Some levels may have been finished by fewer seeds than others.
        let seeds = |arm: &Arm, a: &OverLevels| {
            let counts = a.levels.iter().filter_map(|&level| Some(arm.levels[level].as_ref()?.seeds.len()));
            let most = counts.max().unwrap_or(0);
            if a.mean.runs == most { Cell::count(most) } else { format!("{}–{most}", a.mean.runs).into() }
        };
        let row = |(_, arm, a): (usize, &Arm, &OverLevels)| {
            let estimates = [&a.mean, &a.median, &a.interquartile_mean, &a.optimality_gap];
            let fixed: [Cell; 3] = [arm.name.as_str().into(), seeds(arm, a), level_names(analysis, &a.levels).into()];
            fixed.into_iter().chain(estimates.map(|estimate| Cell::estimate(estimate, 3))).collect()
        };
        let columns = ["arm", "seeds", "levels", "mean", "median", "IQM", "optimality gap"];
        let mut notes = vec![
            "0 is the worst return there is, 1 the proved mean optimum. A seed is one draw, with all its levels."
                .to_owned(),
            interval_note(analysis, with_results().map(|(arm, _, over)| (arm, &over.mean))),
            percentile_note("Medians and IQMs", with_results().map(|(_, _, over)| over.mean.runs)),
        ];
        let ragged: Vec<&str> =
            with_results().filter(|(_, _, over)| !over.are_whole).map(|(_, arm, _)| arm.name.as_str()).collect();
        if !ragged.is_empty() {
            notes.push(format!(
                "Levels of other seeds are resampled one by one, for percentile intervals: {}.",
                ragged.join(", ")
            ));
        }
        Table::new(
            "Normalised return right after training, over levels",
            columns,
            with_results().map(row).collect(),
            notes,
        )
    }
}

/// What is missing to the optimum, in return and in steps, level by level.
fn distance(analysis: &Analysis) -> Table {
    let (mut rows, mut shown) = (Vec::new(), Vec::new());
    for (index, arm) in analysis.arms.iter().enumerate() {
        for (level, outcome) in analysis.levels.iter().zip(&arm.levels) {
            let Some(outcome) = outcome else { continue };
            let solved = |outcome: &LevelOutcome| Cell::Number(100.0 * outcome.solved_share, 1);
            let seeds = outcome.seeds.len();
            let estimate = |estimate: &Option<Estimate>, decimals: usize| {
                let runs = estimate.as_ref().map_or(0, |estimate| estimate.runs);
                Cell::estimate(estimate, decimals).of_seeds(runs, seeds)
            };
            rows.push(vec![
                arm.name.as_str().into(),
                level.name.as_str().into(),
                Cell::count(seeds),
                solved(outcome),
                estimate(&outcome.optimality_gap, 3),
                estimate(&outcome.steps, 2),
                estimate(&outcome.steps_solved, 2),
            ]);
            shown.push((index, &outcome.return_mean));
        }
    }
    let notes = vec![
        "Gap in return: the optimality gap on the level. An unsolved start counts the step limit.".to_owned(),
        interval_note(analysis, shown.into_iter()),
    ];
    let columns =
        ["arm", "level", "seeds", "solved %", "gap in return", "steps / optimal", "steps / optimal where solved"];
    Table::new("Distance to the proved optimum right after training", columns, rows, notes)
}
