//! Curves of other programs beside those of arms that are trained alike.

use std::collections::{BTreeMap, BTreeSet};

use rl_stats::curve::Curve as Summary;
use rl_stats::pairs::estimate_mean;
use rl_stats::{Estimate, Time};
use serde::Serialize;

use super::super::parts::notes::interval_note;
use crate::report::analysis::{Analysis, Arm, Protocol, THRESHOLDS, ThresholdTimes};
use crate::report::foreign::ForeignCurve;
use crate::report::published::PAPER;
use crate::report::table::{Cell, Table};

/// The curves of one source beside one arm on one level.
#[derive(Debug, Serialize)]
pub struct Beside {
    /// Index of the arm that is trained alike.
    pub arm: usize,
    /// Index of the level.
    pub level: usize,
    /// Whose curves they are.
    pub source: String,
    /// How many seeds.
    pub seeds: usize,
    /// The last timestep of the longest.
    pub timesteps: f64,
    /// Mean area under the normalised curve; none where the optimum is unknown.
    pub area: Option<Estimate>,
    /// When the thresholds were reached; empty where the optimum is unknown.
    pub thresholds: Vec<ThresholdTimes>,
}

/// Whether a curve's level is this one. A name of the paper's levels means their maps, whatever they are called here.
fn is_level(analysis: &Analysis, level: usize, name: &str) -> bool {
    match PAPER.levels.iter().position(|own| *own == name) {
        Some(column) => analysis.paper_column(level) == Some(column),
        None => analysis.levels[level].name == name,
    }
}

/// The curves that belong beside one of these arms on a level: of its preset, trained in the same way. Within a
/// sequence the levels before must be the same, in the same order. A file that names no stages means the paper's
/// sequence, which was also trained for the paper's timesteps.
pub fn beside<'a>(analysis: &'a Analysis, arms: &[&Arm], level: usize) -> Vec<&'a ForeignCurve> {
    let belongs = |curve: &&ForeignCurve| arms.iter().any(|arm| is_beside(analysis, arm, level, curve));
    analysis.foreign_curves.iter().filter(belongs).collect()
}

fn is_beside(analysis: &Analysis, arm: &Arm, level: usize, curve: &ForeignCurve) -> bool {
    let Some(place) = arm.stages.iter().position(|stage| stage.level == level) else { return false };
    let in_sequence = arm.protocol == Protocol::Curriculum;
    curve.arm == arm.preset
        && curve.in_sequence == in_sequence
        && is_level(analysis, level, &curve.level)
        && (!in_sequence || has_same_past(analysis, arm, place, curve))
}

/// Whether an arm's stages up to `place` are those of the sequence that a curve is of.
fn has_same_past(analysis: &Analysis, arm: &Arm, place: usize, curve: &ForeignCurve) -> bool {
    match curve.stage {
        None => {
            let timesteps = PAPER.timesteps(&arm.preset);
            place < analysis.stages_of_paper(arm)
                && arm.stages[..=place].iter().all(|stage| timesteps.is_none_or(|paper| paper == stage.timesteps))
        }
        Some(stage) => {
            let has = |place: usize| {
                analysis.foreign_curves.iter().any(|other| {
                    let same = other.source == curve.source && other.arm == curve.arm && other.in_sequence;
                    same && other.stage == Some(place) && is_level(analysis, arm.stages[place].level, &other.level)
                })
            };
            stage == place && (0..place).all(has)
        }
    }
}

/// Everything that is beside something.
pub fn all(analysis: &Analysis) -> Vec<Beside> {
    let mut all = Vec::new();
    for (index, arm) in analysis.arms.iter().enumerate() {
        for level in 0..analysis.levels.len() {
            let curves = beside(analysis, &[arm], level);
            let sources: BTreeSet<&str> = curves.iter().map(|curve| curve.source.as_str()).collect();
            for source in sources {
                let own: Vec<&ForeignCurve> = curves.iter().filter(|curve| curve.source == source).copied().collect();
                all.push(Beside::new(analysis, index, level, &own));
            }
        }
    }
    all
}

impl Beside {
    fn new(analysis: &Analysis, arm: usize, level: usize, curves: &[&ForeignCurve]) -> Self {
        let info = &analysis.levels[level];
        let summary = |curve: &&ForeignCurve| {
            let mut summary = Summary::new(&THRESHOLDS);
            curve.points.iter().try_for_each(|&(timesteps, value)| {
                summary.push(timesteps, info.normalised(value)?);
                Some(())
            })?;
            Some(summary)
        };
        let summaries: Vec<Summary> = curves.iter().filter_map(summary).collect();
        let areas: Vec<f64> = summaries.iter().filter_map(Summary::area).collect();
        let times = |(place, &threshold): (usize, &f64)| {
            let times: Vec<Time> = summaries.iter().map(|summary| summary.times()[place]).collect();
            ThresholdTimes::new(threshold, &times)
        };
        let last = curves.iter().filter_map(|curve| curve.points.last());
        Self {
            arm,
            level,
            source: curves.first().map_or_else(String::new, |curve| curve.source.clone()),
            seeds: curves.len(),
            timesteps: last.map(|point| point.0).fold(0.0, f64::max),
            area: (!areas.is_empty()).then(|| estimate_mean(&analysis.conventions.bootstrap, areas)),
            thresholds: THRESHOLDS.iter().enumerate().filter_map(times).collect(),
        }
    }
}

/// A row per arm and level that other curves stand beside, then one per source.
pub fn table(analysis: &Analysis, all: &[Beside]) -> Table {
    let mut own: BTreeMap<(usize, usize), Vec<&Beside>> = BTreeMap::new();
    for beside in all {
        own.entry((beside.arm, beside.level)).or_default().push(beside);
    }
    let times = |times: &[ThresholdTimes]| {
        let cells = |place: usize| match times.get(place) {
            Some(times) => [Cell::Text(times.median.to_string()), Cell::count(times.censored)],
            None => [Cell::Missing, Cell::Missing],
        };
        (0..THRESHOLDS.len()).flat_map(cells).collect::<Vec<Cell>>()
    };
    let (mut rows, mut areas) = (Vec::new(), Vec::new());
    for ((arm, level), others) in own {
        let (name, level_name) = (analysis.arms[arm].name.as_str(), analysis.levels[level].name.as_str());
        let mut row = |whose: &str, seeds: usize, timesteps: f64, area: &Option<Estimate>, when: &[ThresholdTimes]| {
            let fixed = [name.into(), level_name.into(), whose.into(), Cell::count(seeds), Cell::Number(timesteps, 0)];
            rows.push(fixed.into_iter().chain(times(when)).chain([Cell::estimate(area, 3)]).collect::<Vec<Cell>>());
        };
        if let Some(outcome) = &analysis.arms[arm].levels[level] {
            let stage = analysis.arms[arm].stages.iter().find(|stage| stage.level == level);
            let timesteps = stage.map_or(f64::NAN, |stage| stage.timesteps as f64);
            areas.extend(outcome.area.map(|area| (arm, area)));
            row("ours", outcome.seeds.len(), timesteps, &outcome.area, &outcome.thresholds);
        }
        for other in others {
            row(&other.source, other.seeds, other.timesteps, &other.area, &other.thresholds);
        }
    }
    let reached =
        THRESHOLDS.iter().flat_map(|threshold| [format!("time to {threshold}"), format!("never {threshold}")]);
    let fixed = ["arm", "level", "whose", "seeds", "timesteps"].map(str::to_owned);
    let notes = vec![
        "Of learning curves, normalised. Times are medians over seeds; beside them stands how many seeds never get \
         there. An area is the mean over a curve: do not compare areas of trainings of differing lengths."
            .to_owned(),
        interval_note(analysis, areas.iter().map(|(arm, area)| (*arm, area))),
    ];
    let columns = fixed.into_iter().chain(reached).chain(["area".to_owned()]);
    Table::new("Learning curves beside those of other programs", columns, rows, notes)
}
