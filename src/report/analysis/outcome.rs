//! What an arm earns on a level right after training on it, and how it got there.

use std::collections::BTreeMap;

use rl_stats::aggregate::{interquartile_mean, mean, median, median_run, optimality_gap};
use rl_stats::pairs::estimate_mean;
use rl_stats::{Bootstrap, Estimate, Time};
use serde::Serialize;

use super::THRESHOLDS;
use super::runs::Run;
use crate::results::mean_std;

/// One seed on one level, right after training on it.
#[derive(Clone, Debug, Serialize)]
pub struct SeedOutcome {
    /// Mean return over every start cell.
    pub mean: f64,
    /// Population standard deviation over start cells.
    pub std: f64,
    /// Share of start cells solved.
    pub solved_share: f64,
    /// Mean length over every start cell, an unsolved one counting the step limit.
    pub length: f64,
    /// The mean return, normalised; none where the optimum is unknown.
    pub normalised: Option<f64>,
    /// Mean length over the mean optimal length: 1 is optimal.
    pub steps: Option<f64>,
    /// The same over the solved start cells alone; none where none is solved.
    pub steps_solved: Option<f64>,
    /// Area under the normalised learning curve of the stage, per timestep.
    pub area: Option<f64>,
    /// When the learning curve first reached each of [`Conventions::thresholds`](super::Conventions), in timesteps of the
    /// stage; empty without a curve.
    pub times: Vec<Time>,
}

/// All seeds of an arm on one level, right after training on it.
#[derive(Clone, Debug, Serialize)]
pub struct LevelOutcome {
    /// Mean over seeds.
    pub mean: f64,
    /// Population standard deviation over seeds; none of one, whose own over start cells is in `seeds`.
    pub std: Option<f64>,
    /// Mean share of start cells solved.
    pub solved_share: f64,
    /// The mean return with its interval.
    pub return_mean: Estimate,
    /// The median over seeds.
    pub return_median: Estimate,
    /// The interquartile mean over seeds.
    pub return_iqm: Estimate,
    /// The mean normalised return.
    pub normalised: Option<Estimate>,
    /// What is missing to the optimum: the mean of 1 − the normalised return.
    pub optimality_gap: Option<Estimate>,
    /// Mean over seeds of length / optimal length.
    pub steps: Option<Estimate>,
    /// The same over solved start cells, of the seeds that solve any.
    pub steps_solved: Option<Estimate>,
    /// Mean area under the normalised learning curve.
    pub area: Option<Estimate>,
    /// When the thresholds were reached.
    pub thresholds: Vec<ThresholdTimes>,
    /// Each seed.
    pub seeds: BTreeMap<u64, SeedOutcome>,
}

/// When the seeds of an arm reached a threshold.
#[derive(Clone, Debug, Serialize)]
pub struct ThresholdTimes {
    /// The normalised return to be reached.
    pub threshold: f64,
    /// Median over seeds; never where half of them or more did not get there.
    pub median: Time,
    /// Seeds that did not get there within the stage.
    pub censored: usize,
    /// Seeds in all.
    pub seeds: usize,
}

/// An arm over all its levels: normalised returns right after training on each. Runs are resampled level by level.
#[derive(Clone, Debug, Serialize)]
pub struct Aggregates {
    /// Indices of the levels.
    pub levels: Vec<usize>,
    /// Mean over levels of the mean over seeds.
    pub mean: Estimate,
    /// Median over levels of the mean over seeds.
    pub median: Estimate,
    /// Interquartile mean over all runs.
    pub interquartile_mean: Estimate,
    /// Mean of 1 − min(score, 1).
    pub optimality_gap: Estimate,
}

impl SeedOutcome {
    pub(super) fn new(run: &Run, stage: u16, level: &str) -> Option<Self> {
        let evaluated = run.evaluations.get(&(Some(stage), level.to_owned()))?;
        let summary = run.logs.stages.get(usize::from(stage)).and_then(|log| log.summary.as_ref());
        let summary = summary.filter(|summary| summary.area().is_some());
        Some(Self {
            mean: evaluated.mean,
            std: evaluated.std,
            solved_share: evaluated.solved_share,
            length: evaluated.length,
            normalised: evaluated.normalised,
            steps: evaluated.steps,
            steps_solved: evaluated.steps_solved,
            area: summary.and_then(|summary| summary.area()),
            times: summary.map(|summary| summary.times().to_vec()).unwrap_or_default(),
        })
    }
}

impl LevelOutcome {
    /// Sums up seeds; `None` of none.
    pub(super) fn new(seeds: BTreeMap<u64, SeedOutcome>, bootstrap: &Bootstrap) -> Option<Self> {
        let all = |of: fn(&SeedOutcome) -> f64| seeds.values().map(of).collect::<Vec<f64>>();
        let estimate = |of: fn(&SeedOutcome) -> Option<f64>| {
            let values: Vec<f64> = seeds.values().filter_map(of).collect();
            (!values.is_empty()).then(|| estimate_mean(bootstrap, values))
        };
        let returns = [all(|seed| seed.mean)];
        if seeds.is_empty() {
            return None;
        }
        let (mean_return, std) = mean_std(&returns[0]);
        Some(Self {
            mean: mean_return,
            std: (seeds.len() > 1).then_some(std),
            solved_share: mean_std(&all(|seed| seed.solved_share)).0,
            return_mean: bootstrap.estimate(&returns, mean),
            return_median: bootstrap.estimate(&returns, median_run),
            return_iqm: bootstrap.estimate(&returns, interquartile_mean),
            normalised: estimate(|seed| seed.normalised),
            optimality_gap: estimate(|seed| seed.normalised.map(|share| 1.0 - share)),
            steps: estimate(|seed| seed.steps),
            steps_solved: estimate(|seed| seed.steps_solved),
            area: estimate(|seed| seed.area),
            thresholds: ThresholdTimes::all(&seeds),
            seeds,
        })
    }
}

impl ThresholdTimes {
    fn all(seeds: &BTreeMap<u64, SeedOutcome>) -> Vec<Self> {
        let of = |(place, &threshold): (usize, &f64)| {
            let times: Vec<Time> = seeds.values().filter_map(|seed| seed.times.get(place).copied()).collect();
            let censored = times.iter().filter(|&&time| time == Time::Never).count();
            Some(Self { threshold, median: Time::median(&times)?, censored, seeds: times.len() })
        };
        THRESHOLDS.iter().enumerate().filter_map(of).collect()
    }
}

impl Aggregates {
    /// Over the levels that have results; `None` without any, or where an optimum is unknown.
    pub(super) fn new(outcomes: &[Option<LevelOutcome>], bootstrap: &Bootstrap) -> Option<Self> {
        let with_results = |(level, outcome): (usize, &Option<LevelOutcome>)| {
            let scores = outcome.as_ref()?.seeds.values().map(|seed| seed.normalised).collect::<Option<Vec<f64>>>();
            Some((level, scores))
        };
        let (levels, scores): (Vec<usize>, Vec<Option<Vec<f64>>>) =
            outcomes.iter().enumerate().filter_map(with_results).unzip();
        let scores: Vec<Vec<f64>> = scores.into_iter().collect::<Option<_>>()?;
        (!levels.is_empty()).then(|| Self {
            levels,
            mean: bootstrap.estimate(&scores, mean),
            median: bootstrap.estimate(&scores, median),
            interquartile_mean: bootstrap.estimate(&scores, interquartile_mean),
            optimality_gap: bootstrap.estimate(&scores, |scores| optimality_gap(scores, 1.0)),
        })
    }
}
