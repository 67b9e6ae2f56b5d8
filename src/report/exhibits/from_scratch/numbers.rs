//! Each level in the curriculum against the same level learned from scratch, paired by seed: the nearest thing to a
//! measured loss of plasticity.

use std::collections::BTreeMap;

use rl_stats::few::{holm, mean_p_value};
use rl_stats::pairs::{estimate_mean, estimate_paired_difference, estimate_paired_improvement_share};
use rl_stats::ratio::estimate_ratio_of_means;
use rl_stats::{Bootstrap, Estimate, Time};
use serde::Serialize;

use super::super::exhibit::Definition;
use crate::report::analysis::{Analysis, LevelOutcome, Pair, SeedOutcome, THRESHOLDS, ThresholdTimes};
use crate::results::mean_std;

/// The section of docs/metrics.md.
pub(super) const PLACE: &str = "the-curriculum-against-learning-from-scratch";

/// The least mean area that shares are told of: of next to nothing there is none.
pub const LEAST_AREA: f64 = 0.05;

/// A curriculum and the runs from scratch of the same settings.
#[derive(Clone, Debug, Serialize)]
pub struct Contrast {
    /// The two arms.
    #[serde(flatten)]
    pub pair: Pair,
    /// In the order of the levels; null where either has no result.
    pub levels: Vec<Option<LevelContrast>>,
    /// Areas under the normalised learning curves, over levels.
    pub area: Option<OverLevels>,
    /// Final returns, over levels.
    pub final_return: Option<OverLevels>,
    /// [`RELATIVE_LOSS`] over seeds and levels; none where next to nothing is learned from scratch.
    pub relative_loss: Option<Estimate>,
}

/// One measure over all levels on which both have it.
#[derive(Clone, Debug, Serialize)]
pub struct OverLevels {
    /// Indices of the levels.
    pub levels: Vec<usize>,
    /// Mean of curriculum − from scratch.
    pub difference: Estimate,
    /// Of Student's paired test of the difference; none where it has none.
    pub p_value: Option<f64>,
    /// By seed that has it on all of these levels: the mean over them in the curriculum, from scratch.
    pub pairs: BTreeMap<u64, (f64, f64)>,
}

/// One level in the curriculum and from scratch.
#[derive(Clone, Debug, Serialize)]
pub struct LevelContrast {
    /// Seeds that have both.
    pub seeds: Vec<u64>,
    /// Seeds that have one of them, and are left out of all pairs.
    pub unpaired: Vec<u64>,
    /// Whether it is the first of the curriculum: the same training as from scratch, so that nothing is compared.
    pub is_first: bool,
    /// Share of start cells that the runs from scratch solve at their end: whether the level can be learned at all.
    pub from_scratch_solved_share: f64,
    /// How many of the runs from scratch reach each threshold, and when: whether it can be learned, before an end that
    /// may be an unlucky one.
    pub from_scratch_thresholds: Vec<ThresholdTimes>,
    /// Area under the normalised learning curve.
    pub area: Option<Paired>,
    /// Normalised return from every start cell at the end of the stage.
    pub final_return: Option<Paired>,
    /// [`RELATIVE_LOSS`] over seeds; none where next to nothing is learned from scratch.
    pub relative_loss: Option<Estimate>,
    /// Times to the thresholds.
    pub thresholds: Vec<PairedTimes>,
}

/// One number per seed, in the curriculum and from scratch.
#[derive(Clone, Debug, Serialize)]
pub struct Paired {
    /// Mean in the curriculum.
    pub curriculum: Estimate,
    /// Mean from scratch.
    pub from_scratch: Estimate,
    /// Mean of curriculum − from scratch: negative where the curriculum is worse.
    pub difference: Estimate,
    /// Share of seeds that do better in the curriculum, ties half; none on its first level.
    pub paired_improvement_share: Option<Estimate>,
    /// Of Student's paired test of the difference, adjusted by Holm for all levels of the contrast; none on its first
    /// level, and where the test has none.
    pub p_holm: Option<f64>,
    /// By seed: in the curriculum, from scratch.
    pub pairs: BTreeMap<u64, (f64, f64)>,
}

/// Times to a threshold, in the curriculum and from scratch.
#[derive(Clone, Debug, Serialize)]
pub struct PairedTimes {
    /// The normalised return to be reached.
    pub threshold: f64,
    /// In the curriculum.
    pub curriculum: TimeSummary,
    /// From scratch.
    pub from_scratch: TimeSummary,
    /// Share of seeds that are sooner in the curriculum; a tie, as when both never get there, counts half. None on its
    /// first level.
    pub sooner_share: Option<Estimate>,
    /// By seed: in the curriculum, from scratch.
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

impl Contrast {
    /// Of one pair.
    pub fn new(analysis: &Analysis, pair: Pair) -> Self {
        let bootstrap = &analysis.conventions.bootstrap;
        let mut levels = LevelContrast::all(analysis, pair);
        adjust(levels.iter_mut().flatten().filter_map(|level| level.area.as_mut()));
        adjust(levels.iter_mut().flatten().filter_map(|level| level.final_return.as_mut()));
        let area = OverLevels::new(&levels, |level| level.area.as_ref(), bootstrap);
        let areas = || area.iter().flat_map(|area| area.pairs.values());
        Self {
            pair,
            relative_loss: relative_loss(areas(), bootstrap),
            area,
            final_return: OverLevels::new(&levels, |level| level.final_return.as_ref(), bootstrap),
            levels,
        }
    }
}

/// Adjusts the p-values of one measure on several levels, so that they can be read together.
fn adjust<'a>(levels: impl Iterator<Item = &'a mut Paired>) {
    let mut p_values: Vec<&mut f64> = levels.filter_map(|level| level.p_holm.as_mut()).collect();
    let adjusted = holm(&p_values.iter().map(|p| **p).collect::<Vec<f64>>());
    p_values.iter_mut().zip(adjusted).for_each(|(p, adjusted)| **p = adjusted);
}

/// The p-value of Student's paired test.
fn paired_p_value(pairs: &[(f64, f64)]) -> Option<f64> {
    mean_p_value(&pairs.iter().map(|(a, b)| a - b).collect::<Vec<f64>>())
}

/// A measure that compares two areas.
pub struct AreaMeasure {
    /// Its name.
    pub name: &'static str,
    /// Its formula.
    pub formula: &'static str,
    /// The same in words.
    pub meaning: &'static str,
}

impl AreaMeasure {
    /// As the page defines it.
    pub fn definition(&self) -> Definition {
        let meaning = format!("{}: {}, of means over seeds and levels", self.meaning, self.formula);
        Definition { name: self.name, meaning, place: PLACE }
    }
}

/// Forward transfer by areas, after Wołczyk et al. (2021), who average ratios.
pub const TRANSFER_BY_AREAS: AreaMeasure = AreaMeasure {
    name: "transfer by areas",
    formula: "(A − A_scratch) / (1 − A_scratch)",
    meaning: "what share of the area that is left to gain from scratch is gained by a past",
};

/// The share of the area from scratch that is lost.
pub const RELATIVE_LOSS: AreaMeasure = AreaMeasure {
    name: "relative loss of area",
    formula: "(A_scratch − A) / A_scratch",
    meaning: "what share of the area from scratch is lost",
};

/// [`TRANSFER_BY_AREAS`] of a curriculum; none without runs from scratch, or where these leave next to nothing to gain.
pub fn transfer_by_areas(analysis: &Analysis, curriculum: usize) -> Option<Estimate> {
    let pair = analysis.pairs.iter().find(|pair| pair.curriculum == curriculum)?;
    let bootstrap = &analysis.conventions.bootstrap;
    let levels = LevelContrast::all(analysis, *pair);
    let area = OverLevels::new(&levels, |level| level.area.as_ref(), bootstrap)?;
    share(area.pairs.values().map(|&(area, scratch)| (area - scratch, 1.0 - scratch)), bootstrap)
}

/// (A_scratch − A) / A_scratch of pairs A, A_scratch.
fn relative_loss<'a>(areas: impl Iterator<Item = &'a (f64, f64)>, bootstrap: &Bootstrap) -> Option<Estimate> {
    share(areas.map(|&(area, from_scratch)| (from_scratch - area, from_scratch)), bootstrap)
}

/// Every relative loss of a contrast, level by level and over all of them.
pub(super) fn relative_losses(contrast: &Contrast) -> impl Iterator<Item = &Estimate> {
    let levels = contrast.levels.iter().flatten().filter_map(|level| level.relative_loss.as_ref());
    levels.chain(contrast.relative_loss.as_ref())
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
            let (curriculum, from_scratch): (Vec<f64>, Vec<f64>) = all.into_iter().unzip();
            Some((seed, (mean_std(&curriculum).0, mean_std(&from_scratch).0)))
        };
        let pairs: BTreeMap<u64, (f64, f64)> = by_level.first()?.keys().filter_map(of_seed).collect();
        let all: Vec<(f64, f64)> = pairs.values().copied().collect();
        (!all.is_empty()).then(|| Self {
            levels,
            difference: estimate_paired_difference(bootstrap, &all),
            p_value: paired_p_value(&all),
            pairs,
        })
    }
}

impl LevelContrast {
    /// Of every level; null where either has no result.
    fn all(analysis: &Analysis, pair: Pair) -> Vec<Option<Self>> {
        let [arm, other] = [pair.curriculum, pair.from_scratch].map(|index| &analysis.arms[index]);
        let first = arm.stages.iter().find(|stage| stage.stage == 0).map(|stage| stage.level);
        let level = |(level, (a, b)): (usize, (&Option<LevelOutcome>, &Option<LevelOutcome>))| {
            let is_first = first == Some(level);
            Some(Self::new(a.as_ref()?, b.as_ref()?, is_first, &analysis.conventions.bootstrap))
        };
        arm.levels.iter().zip(&other.levels).enumerate().map(level).collect()
    }

    fn new(curriculum: &LevelOutcome, from_scratch: &LevelOutcome, is_first: bool, bootstrap: &Bootstrap) -> Self {
        let (a, b) = (&curriculum.seeds, &from_scratch.seeds);
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
            from_scratch_solved_share: from_scratch.solved_share,
            from_scratch_thresholds: from_scratch.thresholds.clone(),
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
        let (curriculum, from_scratch): (Vec<f64>, Vec<f64>) = all.iter().copied().unzip();
        (!all.is_empty()).then(|| Self {
            curriculum: estimate_mean(bootstrap, curriculum),
            from_scratch: estimate_mean(bootstrap, from_scratch),
            difference: estimate_paired_difference(bootstrap, &all),
            paired_improvement_share: (!is_first)
                .then(|| estimate_paired_improvement_share(bootstrap.confidence, &all)),
            p_holm: if is_first { None } else { paired_p_value(&all) },
            pairs,
        })
    }
}

impl PairedTimes {
    fn new(threshold: f64, pairs: BTreeMap<u64, (Time, Time)>, is_first: bool, bootstrap: &Bootstrap) -> Option<Self> {
        let (curriculum, from_scratch): (Vec<Time>, Vec<Time>) = pairs.values().copied().unzip();
        // Sooner is better: the pair is turned round.
        let turned: Vec<(f64, f64)> = pairs.values().map(|(a, b)| (b.to_f64(), a.to_f64())).collect();
        Some(Self {
            threshold,
            curriculum: TimeSummary::new(&curriculum)?,
            from_scratch: TimeSummary::new(&from_scratch)?,
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
