//! What an arm earns on a level right after training on it, and how it got there.

use std::collections::BTreeMap;

use rl_stats::aggregate::{self, interquartile_mean};
use rl_stats::pairs::estimate_mean;
use rl_stats::{Bootstrap, Estimate, Time, estimate_median};
use serde::Serialize;

use super::conventions::THRESHOLDS;
use super::groups::Group;
use super::run::Run;
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
    /// When the learning curve first reached each of [`Conventions::thresholds`](super::Conventions), in timesteps of
    /// the stage; empty without a curve.
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
    /// What is missing to the optimum.
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

impl SeedOutcome {
    fn new(run: &Run, stage: u16, level: &str) -> Option<Self> {
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
    /// What the seeds that have finished their stage on this level earn right after it; `None` where none has.
    pub(super) fn of(group: &Group, level: &str, bootstrap: &Bootstrap) -> Option<Self> {
        let outcome = |run: &&Run| Some((run.manifest.seed, SeedOutcome::new(run, run.finished_stage(level)?, level)?));
        Self::new(group.runs.iter().filter_map(outcome).collect(), bootstrap)
    }

    /// Sums up seeds; `None` of none.
    fn new(seeds: BTreeMap<u64, SeedOutcome>, bootstrap: &Bootstrap) -> Option<Self> {
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
            return_mean: estimate_mean(bootstrap, returns[0].clone()),
            return_median: estimate_median(bootstrap.confidence, returns[0].clone()),
            return_iqm: bootstrap.estimate(&returns, interquartile_mean),
            normalised: estimate(|seed| seed.normalised),
            optimality_gap: estimate(|seed| seed.normalised.map(optimality_gap)),
            steps: estimate(|seed| seed.steps),
            steps_solved: estimate(|seed| seed.steps_solved),
            area: estimate(|seed| seed.area),
            thresholds: ThresholdTimes::all(&seeds),
            seeds,
        })
    }
}

impl ThresholdTimes {
    /// Of seeds' times; none of no seeds.
    pub fn new(threshold: f64, times: &[Time]) -> Option<Self> {
        let censored = times.iter().filter(|&&time| time == Time::Never).count();
        Some(Self { threshold, median: Time::median(times)?, censored, seeds: times.len() })
    }

    fn all(seeds: &BTreeMap<u64, SeedOutcome>) -> Vec<Self> {
        let of = |(place, &threshold): (usize, &f64)| {
            let times: Vec<Time> = seeds.values().filter_map(|seed| seed.times.get(place).copied()).collect();
            Self::new(threshold, &times)
        };
        THRESHOLDS.iter().enumerate().filter_map(of).collect()
    }
}

/// What is missing to the optimum: 1 − min(R̂, 1), of a normalised return R̂ (Agarwal et al. 2021).
pub fn optimality_gap(normalised: f64) -> f64 {
    aggregate::optimality_gap(&[vec![normalised]], 1.0)
}
