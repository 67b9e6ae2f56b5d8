//! The tables of an [`Analysis`].

mod continual;
mod overview;
mod plasticity;
mod plasticity_loss;
mod returns;

use std::collections::BTreeSet;

use rl_stats::Estimate;

use super::analysis::{Analysis, Arm, Protocol};
use super::names::{file_name, make_unique};
use super::topic::Topic;
use super::{Cell, Table};

/// A table and what its file is called.
#[derive(Clone, Debug)]
pub struct NamedTable {
    /// The file's name without extension.
    pub name: String,
    /// Where it belongs.
    pub topic: Topic,
    /// The table.
    pub table: Table,
}

/// Every table that has rows.
pub fn all(analysis: &Analysis) -> Vec<NamedTable> {
    let mut tables = vec![
        named("planners", Topic::Levels, returns::planners(analysis)),
        named("right-after-training", Topic::Returns, returns::right_after(analysis)),
        named("returns", Topic::Returns, returns::by_level(analysis)),
        named("aggregates", Topic::Returns, overview::aggregates(analysis)),
        named("optimality-gap", Topic::Returns, overview::optimality_gap(analysis)),
        named("probability-of-improvement", Topic::Returns, overview::improvement(analysis)),
    ];
    let curricula = || analysis.arms.iter().filter(|arm| arm.protocol == Protocol::Curriculum);
    for level in returns::stage_levels(analysis) {
        let name = format!("after-level-{}", file_name(&analysis.levels[level].name));
        tables.push(named(&name, Topic::Matrix, returns::after_stage(analysis, level)));
    }
    for (arm, matrix) in curricula().filter_map(|arm| Some((arm, arm.matrix.as_ref()?))) {
        tables.push(named(&matrix_name(arm), Topic::Matrix, returns::matrix(analysis, arm, matrix)));
    }
    tables.push(named("continual-learning", Topic::Continual, continual::measures(analysis)));
    tables.push(named("forgetting", Topic::Continual, continual::forgetting(analysis)));
    tables.push(named("against-afresh", Topic::AgainstAfresh, plasticity_loss::curves(analysis)));
    tables.push(named("time-to-threshold", Topic::AgainstAfresh, plasticity_loss::times(analysis)));
    for (arm, table) in plasticity::at_ends(analysis) {
        tables.push(named(&plasticity_name(arm), Topic::Plasticity, table));
    }
    for (arm, table) in plasticity::differences(analysis) {
        tables.push(named(&plasticity_differences_name(arm), Topic::Plasticity, table));
    }
    tables.push(named("settings", Topic::Settings, overview::settings(analysis)));
    tables.push(named("missing", Topic::Missing, overview::missing(analysis)));
    tables.retain(|named| !named.table.rows.is_empty());
    for named in &mut tables {
        named.table.notes.extend(other_seeds_note(&named.table));
    }
    make_unique(tables.iter_mut().map(|named| &mut named.name));
    tables
}

/// What the table of an arm's matrix is called.
pub(super) fn matrix_name(arm: &Arm) -> String {
    format!("matrix-{}", file_name(&arm.name))
}

/// What the table of an arm's plasticity measures at the end of each stage is called.
pub(super) fn plasticity_name(arm: &Arm) -> String {
    format!("plasticity-{}", file_name(&arm.name))
}

/// What the table of their differences curriculum − afresh is called.
pub(super) fn plasticity_differences_name(arm: &Arm) -> String {
    format!("plasticity-differences-{}", file_name(&arm.name))
}

/// The tables that a terminal gets: what each arm earns, what it forgets, whether it learns worse than afresh, and in
/// what the arms differ.
pub fn main(analysis: &Analysis) -> Vec<Table> {
    const MAIN: [&str; 6] =
        ["right-after-training", "aggregates", "continual-learning", "against-afresh", "settings", "missing"];
    let is_main = |named: &NamedTable| MAIN.contains(&named.name.as_str());
    all(analysis).into_iter().filter(is_main).map(|named| named.table).collect()
}

fn named(name: &str, topic: Topic, table: Table) -> NamedTable {
    NamedTable { name: name.to_owned(), topic, table }
}

/// A table's head from a few fixed columns and one per level.
fn columns(fixed: &[&str], levels: impl Iterator<Item = String>) -> Vec<String> {
    fixed.iter().map(|&name| name.to_owned()).chain(levels.map(|level| format!("level {level}"))).collect()
}

fn count(number: usize) -> Cell {
    Cell::Number(number as f64, 0)
}

/// Names of levels, in a row.
fn level_names(analysis: &Analysis, levels: &[usize]) -> String {
    levels.iter().map(|&level| analysis.levels[level].name.as_str()).collect::<Vec<_>>().join(", ")
}

/// What "(n = …)" is, where a table has such cells.
fn other_seeds_note(table: &Table) -> Option<String> {
    let is_other = |cell: &Cell| matches!(cell, Cell::OfSeeds(..));
    let note = "(n = …): of so many seeds only, as others have no result there; one seed has no spread.";
    table.rows.iter().flatten().any(is_other).then(|| note.to_owned())
}

/// What an interval is, once for all tables that have some; names the arms that have estimates without one.
fn interval_note<'a>(analysis: &Analysis, estimates: impl Iterator<Item = (usize, &'a Estimate)>) -> String {
    let bootstrap = analysis.conventions.bootstrap;
    let mut note = format!(
        "[low, high]: {:.0}% interval over seeds, percentile bootstrap with {} resamples.",
        100.0 * bootstrap.confidence,
        bootstrap.resamples
    );
    let alone: BTreeSet<usize> = estimates.filter(|(_, estimate)| estimate.runs == 1).map(|(arm, _)| arm).collect();
    let alone: Vec<&str> = alone.into_iter().map(|arm| analysis.arms[arm].name.as_str()).collect();
    if !alone.is_empty() {
        note += &format!(" One seed has no interval: {}.", alone.join(", "));
    }
    note
}
