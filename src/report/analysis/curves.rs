//! Series over training: learning curves and plasticity measures, per seed and over seeds, on a grid of bounded size.

use std::collections::{BTreeMap, BTreeSet};

use serde::Serialize;

use super::bands::Bands;
use super::groups::{ArmStage, Group};
use super::logs::{Bin, Bins};
use super::run::Run;

/// The learning curve of one stage: the moving mean return of the last 100 episodes (`rollout/ep_rew_mean`).
#[derive(Clone, Debug, Serialize)]
pub struct Curve {
    /// The stage's number.
    pub stage: u16,
    /// Index into the levels.
    pub level: usize,
    /// The grid: one point per stretch of the stage in which there are rows.
    pub points: Vec<SeriesPoint>,
    /// The mean over the seeds that have a value, by point.
    pub mean: Vec<Option<Band>>,
    /// Each seed's values, by point; null where it has none.
    pub seeds: BTreeMap<u64, Vec<Option<f64>>>,
}

/// A plasticity measure during one stage.
#[derive(Clone, Debug, Serialize)]
pub struct PlasticitySeries {
    /// The measure's column in `plasticity.csv`.
    pub measure: String,
    /// The stage's number.
    pub stage: u16,
    /// Index into the levels.
    pub level: usize,
    /// The grid.
    pub points: Vec<SeriesPoint>,
    /// The mean over the seeds that have a value, by point.
    pub mean: Vec<Option<Band>>,
    /// Each seed's values, by point; null where it has none.
    pub seeds: BTreeMap<u64, Vec<Option<f64>>>,
}

/// One place on the time axis: the mean over the rows of its stretch.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct SeriesPoint {
    /// Timesteps of the stage.
    pub timesteps: f64,
    /// Timesteps of all stages so far.
    pub cumulative_timesteps: f64,
}

/// A mean over seeds.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Band {
    /// Its value.
    pub value: f64,
    /// The lower bound of its interval; none with one seed.
    pub low: Option<f64>,
    /// The upper bound.
    pub high: Option<f64>,
    /// How many seeds it is of: fewer where some were interrupted.
    pub seeds: usize,
}

/// What all seeds of one stage have in common: the grid, and each seed's values on it.
struct Series {
    points: Vec<SeriesPoint>,
    seeds: BTreeMap<u64, Vec<Option<f64>>>,
}

impl Series {
    fn new(seeds: &BTreeMap<u64, &Bins>) -> Self {
        let bins_at = |place: usize| seeds.values().filter_map(move |bins| bins.at(place));
        let occupied: BTreeSet<usize> = seeds.values().flat_map(|bins| bins.places()).collect();
        let point = |&place: &usize| {
            let sum = |of: fn(&Bin) -> f64| bins_at(place).map(of).sum::<f64>();
            let rows = sum(|bin| bin.rows);
            SeriesPoint {
                timesteps: sum(|bin| bin.timesteps) / rows,
                cumulative_timesteps: sum(|bin| bin.cumulative) / rows,
            }
        };
        let values = |bins: &Bins| occupied.iter().map(|&place| bins.at(place).and_then(Bin::mean)).collect::<Vec<_>>();
        Self {
            points: occupied.iter().map(point).collect(),
            seeds: seeds.iter().map(|(&seed, bins)| (seed, values(bins))).collect(),
        }
    }

    /// The mean over seeds at every point.
    fn means(&self, bands: &mut Bands) -> Vec<Option<Band>> {
        let mut at = |place: usize| {
            let values: Vec<f64> = self.seeds.values().filter_map(|values| values[place]).collect();
            let (value, interval) = bands.mean(&values)?;
            let [low, high] = [interval.map(|i| i.low), interval.map(|i| i.high)];
            Some(Band { value, low, high, seeds: values.len() })
        };
        (0..self.points.len()).map(&mut at).collect()
    }
}

/// The learning curves of an arm, one per stage.
pub(super) fn learning(group: &Group, stages: &[ArmStage], names: &[&str], bands: &mut Bands) -> Vec<Curve> {
    let curve = |stage: &ArmStage| {
        let runs = group.runs_on(stage, names[stage.level]);
        let bins = runs.iter().map(|(&seed, run)| (seed, &run.logs.stages[usize::from(stage.stage)].bins)).collect();
        let series = Series::new(&bins);
        Curve {
            stage: stage.stage,
            level: stage.level,
            mean: series.means(bands),
            points: series.points,
            seeds: series.seeds,
        }
    };
    stages.iter().map(curve).collect()
}

/// The plasticity measures of an arm, one series per measure and stage; those without a row are left out.
pub(super) fn plasticity<'a>(
    group: &Group<'a>,
    stages: &[ArmStage],
    names: &[&str],
    bands: &mut Bands,
) -> Vec<PlasticitySeries> {
    let measures: BTreeSet<&String> = group.runs.iter().flat_map(|run| run.logs.plasticity.keys()).collect();
    let mut all = Vec::new();
    for measure in measures {
        for stage in stages {
            let of_run = |run: &'a Run| run.logs.plasticity.get(measure)?.bins.get(usize::from(stage.stage));
            let runs = group.runs_on(stage, names[stage.level]);
            let bins = runs.into_iter().filter_map(|(seed, run)| Some((seed, of_run(run)?)));
            let series = Series::new(&bins.collect());
            if series.points.is_empty() {
                continue;
            }
            all.push(PlasticitySeries {
                measure: measure.clone(),
                stage: stage.stage,
                level: stage.level,
                mean: series.means(bands),
                points: series.points,
                seeds: series.seeds,
            });
        }
    }
    all
}
