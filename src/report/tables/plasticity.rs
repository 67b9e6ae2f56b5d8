//! Plasticity measures at the end of each stage: what the training on each level leaves behind.

use rl_stats::Estimate;

use super::super::analysis::{Analysis, Arm, PlasticityEnd};
use super::super::{Cell, Table};
use super::{columns, interval_note};

/// Every measure's name begins so.
const PREFIX: &str = "plasticity/";
/// What every one of these tables says.
const MEASURES: &str = "Of the last row of plasticity.csv of each stage; docs/metrics.md defines the measures.";

/// A table per arm that has logged plasticity: a row per measure, a column per level that it was trained on.
pub(super) fn at_ends(analysis: &Analysis) -> Vec<(&Arm, Table)> {
    let mut tables = Vec::new();
    for (index, arm) in analysis.arms.iter().enumerate() {
        let title = format!("{}: plasticity measures at the end of each stage", arm.name);
        tables.push((arm, table(analysis, index, title, &arm.plasticity_ends)));
    }
    tables
}

/// A table per curriculum with runs afresh: the differences.
pub(super) fn differences(analysis: &Analysis) -> Vec<(&Arm, Table)> {
    let mut tables = Vec::new();
    for against in &analysis.against_afresh {
        let arm = &analysis.arms[against.curriculum];
        let title = format!("{}: plasticity measures at the end of each stage, curriculum - afresh", arm.name);
        let mut table = table(analysis, against.curriculum, title, &against.plasticity);
        table.notes.push("Differences are paired by seed.".to_owned());
        tables.push((arm, table));
    }
    tables
}

fn table(analysis: &Analysis, arm: usize, title: String, ends: &[PlasticityEnd]) -> Table {
    let stages = &analysis.arms[arm].stages;
    let mut measures: Vec<&str> = ends.iter().map(|end| end.measure.as_str()).collect();
    measures.dedup();
    let most = ends.iter().map(|end| end.value.seeds.len()).max().unwrap_or(0);
    let row = |measure: &str| {
        let cell = |level: usize| {
            let end = ends.iter().find(|end| end.measure == measure && end.level == level)?;
            let estimate = &end.value.mean;
            Some(Cell::estimate(estimate, decimals(estimate)).of_seeds(estimate.runs, most))
        };
        let cells = stages.iter().map(|stage| cell(stage.level).unwrap_or(Cell::Missing));
        [measure.strip_prefix(PREFIX).unwrap_or(measure).into()].into_iter().chain(cells).collect()
    };
    Table {
        title,
        columns: columns(&["measure"], stages.iter().map(|stage| analysis.levels[stage.level].name.clone())),
        rows: measures.into_iter().map(row).collect(),
        notes: vec![
            format!("{MEASURES} Means over {}.", if most == 1 { "1 seed".to_owned() } else { format!("{most} seeds") }),
            interval_note(analysis, ends.iter().map(|end| (arm, &end.value.mean))),
        ],
    }
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
