//! Each level in the curriculum against the same level learned afresh, paired by seed: the nearest thing to a measured
//! loss of plasticity.

use std::collections::BTreeMap;

use rl_stats::continual::area_transfer;
use rl_stats::pairs::{estimate_mean, estimate_paired_difference, estimate_paired_improvement_share};
use rl_stats::{Bootstrap, Estimate, Time};
use serde::Serialize;

use super::arms::same_but_stages;
use super::{Arm, LevelOutcome, OverSeeds, Protocol, SeedOutcome, THRESHOLDS};
use crate::results::mean_std;

/// A curriculum and the runs afresh of the same settings.
#[derive(Clone, Debug, Serialize)]
pub struct AgainstAfresh {
    /// Index of the curriculum's arm.
    pub curriculum: usize,
    /// Index of the arm afresh.
    pub afresh: usize,
    /// In the order of the levels; null where either has no result.
    pub levels: Vec<Option<LevelContrast>>,
    /// Forward transfer by areas (Wołczyk et al. 2021): the mean over levels, of seeds that have them all.
    pub area_transfer: Option<OverSeeds>,
    /// Mean over levels of the difference of areas, of seeds that have them all.
    pub area_difference: Option<OverSeeds>,
    /// The same of final returns.
    pub final_difference: Option<OverSeeds>,
}

/// One level in the curriculum and afresh.
#[derive(Clone, Debug, Serialize)]
pub struct LevelContrast {
    /// Seeds that have both.
    pub seeds: Vec<u64>,
    /// Seeds that have one of them, and are left out of all pairs.
    pub unpaired: Vec<u64>,
    /// Share of start cells that the runs afresh solve at their end: whether the level can be learned at all.
    pub afresh_solved_share: f64,
    /// Area under the normalised learning curve.
    pub area: Option<Paired>,
    /// Normalised return from every start cell at the end of the stage.
    pub final_return: Option<Paired>,
    /// Forward transfer by areas (Wołczyk et al. 2021).
    pub area_transfer: Option<Estimate>,
    /// Times to the thresholds.
    pub thresholds: Vec<PairedTimes>,
}

/// One number per seed, in the curriculum and afresh.
#[derive(Clone, Debug, Serialize)]
pub struct Paired {
    /// Mean in the curriculum.
    pub curriculum: Estimate,
    /// Mean afresh.
    pub afresh: Estimate,
    /// Mean of curriculum − afresh: negative where the curriculum is worse.
    pub difference: Estimate,
    /// Share of seeds that do better in the curriculum, ties half.
    pub paired_improvement_share: Estimate,
    /// By seed: in the curriculum, afresh.
    pub pairs: BTreeMap<u64, (f64, f64)>,
}

/// Times to a threshold, in the curriculum and afresh.
#[derive(Clone, Debug, Serialize)]
pub struct PairedTimes {
    /// The normalised return to be reached.
    pub threshold: f64,
    /// In the curriculum.
    pub curriculum: TimeSummary,
    /// Afresh.
    pub afresh: TimeSummary,
    /// Share of seeds that are sooner in the curriculum; a tie, as when both never get there, counts half.
    pub sooner_share: Estimate,
    /// By seed: in the curriculum, afresh.
    pub pairs: BTreeMap<u64, (Time, Time)>,
}

/// Times over seeds.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct TimeSummary {
    /// Never counts as later than any time, so that the median may be never.
    pub median: Time,
    /// Seeds that never got there.
    pub censored: usize,
}

/// Every curriculum with its runs afresh.
pub(super) fn contrasts(arms: &[Arm], bootstrap: &Bootstrap) -> Vec<AgainstAfresh> {
    let mut all = Vec::new();
    for (curriculum, arm) in arms.iter().enumerate().filter(|(_, arm)| arm.protocol == Protocol::Curriculum) {
        let is_afresh = |other: &Arm| {
            let same = other.preset == arm.preset && same_but_stages(&other.settings, &arm.settings);
            other.protocol == Protocol::Afresh && same
        };
        if let Some(afresh) = arms.iter().position(is_afresh) {
            all.push(AgainstAfresh::new((curriculum, arm), (afresh, &arms[afresh]), bootstrap));
        }
    }
    all
}

impl AgainstAfresh {
    fn new((curriculum, arm): (usize, &Arm), (afresh, other): (usize, &Arm), bootstrap: &Bootstrap) -> Self {
        let level = |(a, b): (&Option<LevelOutcome>, &Option<LevelOutcome>)| {
            Some(LevelContrast::new(a.as_ref()?, b.as_ref()?, bootstrap))
        };
        let levels: Vec<Option<LevelContrast>> = arm.levels.iter().zip(&other.levels).map(level).collect();
        let over_levels = |measure: fn(&LevelContrast) -> Option<&Paired>, of: fn(f64, f64) -> Option<f64>| {
            OverSeeds::new(means_over_levels(&levels, measure, of), bootstrap)
        };
        let difference = |a, b| Some(a - b);
        Self {
            curriculum,
            afresh,
            area_transfer: over_levels(|level| level.area.as_ref(), area_transfer),
            area_difference: over_levels(|level| level.area.as_ref(), difference),
            final_difference: over_levels(|level| level.final_return.as_ref(), difference),
            levels,
        }
    }
}

/// The mean over levels of a comparison of one measure, of the seeds that have it on every level compared.
fn means_over_levels(
    levels: &[Option<LevelContrast>],
    measure: fn(&LevelContrast) -> Option<&Paired>,
    of: fn(f64, f64) -> Option<f64>,
) -> BTreeMap<u64, f64> {
    let by_level: Vec<&BTreeMap<u64, (f64, f64)>> =
        levels.iter().flatten().filter_map(measure).map(|paired| &paired.pairs).collect();
    let Some(first) = by_level.first() else { return BTreeMap::new() };
    let of_seed = |&seed: &u64| {
        let level = |pairs: &&BTreeMap<u64, (f64, f64)>| pairs.get(&seed).and_then(|&(a, b)| of(a, b));
        let all = by_level.iter().map(level).collect::<Option<Vec<f64>>>()?;
        Some((seed, mean_std(&all).0))
    };
    first.keys().filter_map(of_seed).collect()
}

impl LevelContrast {
    fn new(curriculum: &LevelOutcome, afresh: &LevelOutcome, bootstrap: &Bootstrap) -> Self {
        let (a, b) = (&curriculum.seeds, &afresh.seeds);
        let seeds: Vec<u64> = a.keys().filter(|seed| b.contains_key(seed)).copied().collect();
        let unpaired = |x: &BTreeMap<u64, SeedOutcome>| x.keys().filter(|s| !seeds.contains(s)).copied().collect();
        let unpaired: Vec<Vec<u64>> = vec![unpaired(a), unpaired(b)];
        let paired = |of: fn(&SeedOutcome) -> Option<f64>| {
            let pair = |seed: &u64| Some((*seed, (of(&a[seed])?, of(&b[seed])?)));
            Paired::new(seeds.iter().filter_map(pair).collect(), bootstrap)
        };
        let area = paired(|seed| seed.area);
        let transfers = |area: &Paired| area.pairs.values().map(|&(x, y)| area_transfer(x, y)).collect();
        let transfers: Option<Vec<f64>> = area.as_ref().and_then(transfers);
        let times = |(place, &threshold): (usize, &f64)| {
            let pair = |seed: &u64| Some((*seed, (*a[seed].times.get(place)?, *b[seed].times.get(place)?)));
            PairedTimes::new(threshold, seeds.iter().filter_map(pair).collect(), bootstrap)
        };
        Self {
            afresh_solved_share: afresh.solved_share,
            area,
            final_return: paired(|seed| seed.normalised),
            area_transfer: transfers.map(|transfers| estimate_mean(bootstrap, transfers)),
            thresholds: THRESHOLDS.iter().enumerate().filter_map(times).collect(),
            unpaired: unpaired.concat(),
            seeds,
        }
    }
}

impl Paired {
    fn new(pairs: BTreeMap<u64, (f64, f64)>, bootstrap: &Bootstrap) -> Option<Self> {
        let all: Vec<(f64, f64)> = pairs.values().copied().collect();
        let (curriculum, afresh): (Vec<f64>, Vec<f64>) = all.iter().copied().unzip();
        (!all.is_empty()).then(|| Self {
            curriculum: estimate_mean(bootstrap, curriculum),
            afresh: estimate_mean(bootstrap, afresh),
            difference: estimate_paired_difference(bootstrap, &all),
            paired_improvement_share: estimate_paired_improvement_share(bootstrap, &all),
            pairs,
        })
    }
}

impl PairedTimes {
    fn new(threshold: f64, pairs: BTreeMap<u64, (Time, Time)>, bootstrap: &Bootstrap) -> Option<Self> {
        let (curriculum, afresh): (Vec<Time>, Vec<Time>) = pairs.values().copied().unzip();
        // Sooner is better: the pair is turned round.
        let turned: Vec<(f64, f64)> = pairs.values().map(|(a, b)| (b.to_f64(), a.to_f64())).collect();
        Some(Self {
            threshold,
            curriculum: TimeSummary::new(&curriculum)?,
            afresh: TimeSummary::new(&afresh)?,
            sooner_share: estimate_paired_improvement_share(bootstrap, &turned),
            pairs,
        })
    }
}

impl TimeSummary {
    fn new(times: &[Time]) -> Option<Self> {
        let censored = times.iter().filter(|&&time| time == Time::Never).count();
        Some(Self { median: Time::median(times)?, censored })
    }
}
