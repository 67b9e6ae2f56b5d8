//! Each level in the curriculum against the same level learned afresh, paired by seed: the nearest thing to a measured
//! loss of plasticity.

use std::collections::BTreeMap;

use rl_stats::pairs::{
    estimate_mean, estimate_paired_difference, estimate_paired_improvement_share, estimate_ratio_of_means,
};
use rl_stats::{Bootstrap, Estimate, Time};
use serde::Serialize;

use super::arms::same_but_stages;
use super::{Arm, LevelOutcome, PlasticityEnd, Protocol, SeedOutcome, THRESHOLDS, ThresholdTimes, ends};
use crate::results::mean_std;

/// The least mean area that shares are told of: of next to nothing there is none.
const LEAST_AREA: f64 = 0.05;

/// A curriculum and the runs afresh of the same settings.
#[derive(Clone, Debug, Serialize)]
pub struct AgainstAfresh {
    /// Index of the curriculum's arm.
    pub curriculum: usize,
    /// Index of the arm afresh.
    pub afresh: usize,
    /// In the order of the levels; null where either has no result.
    pub levels: Vec<Option<LevelContrast>>,
    /// Areas under the normalised learning curves, over levels.
    pub area: Option<OverLevels>,
    /// Final returns, over levels.
    pub final_return: Option<OverLevels>,
    /// (A_afresh − A) / A_afresh, both averaged over seeds and levels before they are divided; none where next to nothing
    /// is learned afresh.
    pub relative_loss: Option<Estimate>,
    /// (A − A_afresh) / (1 − A_afresh), likewise: forward transfer by areas after Wołczyk et al. (2021), who average
    /// ratios; none where learning afresh leaves next to nothing to gain.
    pub area_transfer: Option<Estimate>,
    /// Plasticity measures at the end of each level: curriculum − afresh.
    pub plasticity: Vec<PlasticityEnd>,
}

/// One measure over all levels on which both have it.
#[derive(Clone, Debug, Serialize)]
pub struct OverLevels {
    /// Indices of the levels.
    pub levels: Vec<usize>,
    /// Mean of curriculum − afresh.
    pub difference: Estimate,
    /// By seed that has it on all of these levels: the mean over them in the curriculum, afresh.
    pub pairs: BTreeMap<u64, (f64, f64)>,
}

/// One level in the curriculum and afresh.
#[derive(Clone, Debug, Serialize)]
pub struct LevelContrast {
    /// Seeds that have both.
    pub seeds: Vec<u64>,
    /// Seeds that have one of them, and are left out of all pairs.
    pub unpaired: Vec<u64>,
    /// Whether it is the first of the curriculum: the same training as afresh, so that nothing is compared.
    pub is_first: bool,
    /// Share of start cells that the runs afresh solve at their end: whether the level can be learned at all.
    pub afresh_solved_share: f64,
    /// How many of the runs afresh reach each threshold, and when: whether it can be learned, before an end that may be
    /// an unlucky one.
    pub afresh_thresholds: Vec<ThresholdTimes>,
    /// Area under the normalised learning curve.
    pub area: Option<Paired>,
    /// Normalised return from every start cell at the end of the stage.
    pub final_return: Option<Paired>,
    /// (A_afresh − A) / A_afresh, both averaged over seeds before they are divided; none where next to nothing is learned
    /// afresh.
    pub relative_loss: Option<Estimate>,
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
    /// Share of seeds that do better in the curriculum, ties half; none on its first level.
    pub paired_improvement_share: Option<Estimate>,
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
    /// Share of seeds that are sooner in the curriculum; a tie, as when both never get there, counts half. None on its
    /// first level.
    pub sooner_share: Option<Estimate>,
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
        let first = arm.stages.iter().find(|stage| stage.stage == 0).map(|stage| stage.level);
        let level = |(level, (a, b)): (usize, (&Option<LevelOutcome>, &Option<LevelOutcome>))| {
            Some(LevelContrast::new(a.as_ref()?, b.as_ref()?, first == Some(level), bootstrap))
        };
        let levels: Vec<Option<LevelContrast>> = arm.levels.iter().zip(&other.levels).enumerate().map(level).collect();
        let area = OverLevels::new(&levels, |level| level.area.as_ref(), bootstrap);
        let areas = || area.iter().flat_map(|area| area.pairs.values());
        Self {
            curriculum,
            afresh,
            relative_loss: relative_loss(areas(), bootstrap),
            area_transfer: share(areas().map(|&(area, afresh)| (area - afresh, 1.0 - afresh)), bootstrap),
            area,
            final_return: OverLevels::new(&levels, |level| level.final_return.as_ref(), bootstrap),
            plasticity: ends::differences(arm, other, bootstrap),
            levels,
        }
    }
}

/// (A_afresh − A) / A_afresh of pairs A, A_afresh.
fn relative_loss<'a>(areas: impl Iterator<Item = &'a (f64, f64)>, bootstrap: &Bootstrap) -> Option<Estimate> {
    share(areas.map(|&(area, afresh)| (afresh - area, afresh)), bootstrap)
}

/// The ratio of the mean numerator to the mean denominator, if that is an area to speak of.
fn share(pairs: impl Iterator<Item = (f64, f64)>, bootstrap: &Bootstrap) -> Option<Estimate> {
    let pairs: Vec<(f64, f64)> = pairs.collect();
    let denominators: Vec<f64> = pairs.iter().map(|pair| pair.1).collect();
    (mean_std(&denominators).0 >= LEAST_AREA).then(|| estimate_ratio_of_means(bootstrap, &pairs))
}

impl OverLevels {
    fn new(
        levels: &[Option<LevelContrast>],
        measure: fn(&LevelContrast) -> Option<&Paired>,
        bootstrap: &Bootstrap,
    ) -> Option<Self> {
        let of_level = |(level, contrast): (usize, &'_ Option<LevelContrast>)| {
            contrast.as_ref().and_then(measure).map(|paired| (level, paired.pairs.clone()))
        };
        let (levels, by_level): (Vec<usize>, Vec<_>) = levels.iter().enumerate().filter_map(of_level).unzip();
        let of_seed = |&seed: &u64| {
            let all = by_level.iter().map(|pairs| pairs.get(&seed).copied()).collect::<Option<Vec<(f64, f64)>>>()?;
            let (curriculum, afresh): (Vec<f64>, Vec<f64>) = all.into_iter().unzip();
            Some((seed, (mean_std(&curriculum).0, mean_std(&afresh).0)))
        };
        let pairs: BTreeMap<u64, (f64, f64)> = by_level.first()?.keys().filter_map(of_seed).collect();
        let all: Vec<(f64, f64)> = pairs.values().copied().collect();
        (!all.is_empty()).then(|| Self { levels, difference: estimate_paired_difference(bootstrap, &all), pairs })
    }
}

impl LevelContrast {
    fn new(curriculum: &LevelOutcome, afresh: &LevelOutcome, is_first: bool, bootstrap: &Bootstrap) -> Self {
        let (a, b) = (&curriculum.seeds, &afresh.seeds);
        let seeds: Vec<u64> = a.keys().filter(|seed| b.contains_key(seed)).copied().collect();
        let unpaired = |x: &BTreeMap<u64, SeedOutcome>| x.keys().filter(|s| !seeds.contains(s)).copied().collect();
        let unpaired: Vec<Vec<u64>> = vec![unpaired(a), unpaired(b)];
        let paired = |of: fn(&SeedOutcome) -> Option<f64>| {
            let pair = |seed: &u64| Some((*seed, (of(&a[seed])?, of(&b[seed])?)));
            Paired::new(seeds.iter().filter_map(pair).collect(), is_first, bootstrap)
        };
        let area = paired(|seed| seed.area);
        let times = |(place, &threshold): (usize, &f64)| {
            let pair = |seed: &u64| Some((*seed, (*a[seed].times.get(place)?, *b[seed].times.get(place)?)));
            PairedTimes::new(threshold, seeds.iter().filter_map(pair).collect(), is_first, bootstrap)
        };
        Self {
            is_first,
            afresh_solved_share: afresh.solved_share,
            afresh_thresholds: afresh.thresholds.clone(),
            relative_loss: area.as_ref().and_then(|area| relative_loss(area.pairs.values(), bootstrap)),
            area,
            final_return: paired(|seed| seed.normalised),
            thresholds: THRESHOLDS.iter().enumerate().filter_map(times).collect(),
            unpaired: unpaired.concat(),
            seeds,
        }
    }
}

impl Paired {
    fn new(pairs: BTreeMap<u64, (f64, f64)>, is_first: bool, bootstrap: &Bootstrap) -> Option<Self> {
        let all: Vec<(f64, f64)> = pairs.values().copied().collect();
        let (curriculum, afresh): (Vec<f64>, Vec<f64>) = all.iter().copied().unzip();
        (!all.is_empty()).then(|| Self {
            curriculum: estimate_mean(bootstrap, curriculum),
            afresh: estimate_mean(bootstrap, afresh),
            difference: estimate_paired_difference(bootstrap, &all),
            paired_improvement_share: (!is_first)
                .then(|| estimate_paired_improvement_share(bootstrap.confidence, &all)),
            pairs,
        })
    }
}

impl PairedTimes {
    fn new(threshold: f64, pairs: BTreeMap<u64, (Time, Time)>, is_first: bool, bootstrap: &Bootstrap) -> Option<Self> {
        let (curriculum, afresh): (Vec<Time>, Vec<Time>) = pairs.values().copied().unzip();
        // Sooner is better: the pair is turned round.
        let turned: Vec<(f64, f64)> = pairs.values().map(|(a, b)| (b.to_f64(), a.to_f64())).collect();
        Some(Self {
            threshold,
            curriculum: TimeSummary::new(&curriculum)?,
            afresh: TimeSummary::new(&afresh)?,
            sooner_share: (!is_first).then(|| estimate_paired_improvement_share(bootstrap.confidence, &turned)),
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
