//! Plasticity measures at both ends of each stage: how an agent comes to a level, and what training on it leaves behind.

use rl_stats::Estimate;
use serde::Serialize;

use super::super::parts::notes::{columns, interval_note};
use crate::measure::PREFIX;
use crate::report::analysis::{Analysis, Arm, ArmStage, OverSeeds, Pair, PlasticityEnd};
use crate::report::table::{Cell, Table};

/// What the tables of the ends say.
const LAST: &str = "Of the last row of plasticity.csv of each stage; docs/metrics.md defines the measures.";
/// What those of the beginnings say.
const FIRST: &str = "Of each stage's row of plasticity.csv at timestep 0, before its first update, on that stage's level; \
                     docs/metrics.md defines the measures.";

/// The differences curriculum − from scratch of one pair.
#[derive(Clone, Debug, Serialize)]
pub struct Differences {
    /// The two arms.
    #[serde(flatten)]
    pub pair: Pair,
    /// By measure and level, of the seeds that have both.
    pub ends: Vec<PlasticityEnd>,
}

impl Differences {
    pub(super) fn new(analysis: &Analysis, pair: Pair) -> Self {
        let [curriculum, other] = [pair.curriculum, pair.from_scratch].map(|arm| &analysis.arms[arm]);
        let of_end = |end: &PlasticityEnd| {
            let same = |other: &&PlasticityEnd| other.measure == end.measure && other.level == end.level;
            let other = &other.plasticity_ends.iter().find(same)?.value.seeds;
            let difference = |(seed, value): (&u64, &f64)| Some((*seed, value - other.get(seed)?));
            let seeds = end.value.seeds.iter().filter_map(difference).collect();
            let value = OverSeeds::new(seeds, &analysis.conventions.bootstrap)?;
            Some(PlasticityEnd { value, ..end.clone() })
        };
        Self { pair, ends: curriculum.plasticity_ends.iter().filter_map(of_end).collect() }
    }

    /// Their table.
    pub(super) fn table(&self, analysis: &Analysis) -> Table {
        let arm = &analysis.arms[self.pair.curriculum];
        let title = format!("{}: plasticity measures at the end of each stage, curriculum - from scratch", arm.name);
        let mut table = table(analysis, self.pair.curriculum, title, LAST, &self.ends);
        table.notes.push("Differences are paired by seed.".to_owned());
        table
    }
}

/// An arm's measures: a row per measure, a column per level that it was trained on.
pub(super) fn of_arm(analysis: &Analysis, index: usize, arm: &Arm) -> Table {
    let title = format!("{}: plasticity measures at the end of each stage", arm.name);
    table(analysis, index, title, LAST, &arm.plasticity_ends)
}

/// The same at the beginning of each stage.
pub(super) fn of_beginnings(analysis: &Analysis, index: usize, arm: &Arm) -> Table {
    let title = format!("{}: plasticity measures at the beginning of each stage", arm.name);
    table(analysis, index, title, FIRST, &arm.plasticity_begins)
}

fn table(analysis: &Analysis, arm: usize, title: String, note: &str, ends: &[PlasticityEnd]) -> Table {
    let stages = &analysis.arms[arm].stages;
    let mut measures: Vec<&str> = ends.iter().map(|end| end.measure.as_str()).collect();
    measures.dedup();
    let most = ends.iter().map(|end| end.value.seeds.len()).max().unwrap_or(0);
    let row = |measure: &str| {
        let cell = |stage: &ArmStage| {
            let is_of_stage = |end: &&PlasticityEnd| (end.stage, end.level) == (stage.stage, stage.level);
            let end = ends.iter().filter(is_of_stage).find(|end| end.measure == measure)?;
            let estimate = &end.value.mean;
            Some(Cell::estimate(estimate, decimals(estimate)).of_seeds(estimate.runs, most))
        };
        let cells = stages.iter().map(|stage| cell(stage).unwrap_or(Cell::Missing));
        [measure.strip_prefix(PREFIX).unwrap_or(measure).into()].into_iter().chain(cells).collect()
    };
    let seeds = if most == 1 { "1 seed".to_owned() } else { format!("{most} seeds") };
    Table::new(
        title,
        columns(&["measure"], analysis, stages.iter().map(|stage| stage.level)),
        measures.into_iter().map(row).collect(),
        vec![
            format!("{note} Means over {seeds}."),
            interval_note(analysis, ends.iter().map(|end| (arm, &end.value.mean))),
        ],
    )
}

/// Measures are shares, ranks and norms: four digits or so of each.
fn decimals(estimate: &Estimate) -> usize {
    match estimate.value.abs() {
        100.0.. => 1,
        10.0.. => 2,
        1.0.. => 3,
        _ => 4,
    }
}
