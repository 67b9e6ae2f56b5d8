//! Heads and notes of tables, in the same words everywhere.

use std::collections::BTreeSet;

use rl_stats::Estimate;

use crate::report::analysis::Analysis;

/// A table's head from a few fixed columns and one per level.
pub fn columns(fixed: &[&str], analysis: &Analysis, levels: impl IntoIterator<Item = usize>) -> Vec<String> {
    let levels = levels.into_iter().map(|level| format!("level {}", analysis.levels[level].name));
    fixed.iter().map(|&name| name.to_owned()).chain(levels).collect()
}

/// Names of levels, in a row.
pub fn level_names(analysis: &Analysis, levels: &[usize]) -> String {
    levels.iter().map(|&level| analysis.levels[level].name.as_str()).collect::<Vec<_>>().join(", ")
}

/// What an interval is, once for all tables that have some; names the arms that have estimates without one.
pub fn interval_note<'a>(analysis: &Analysis, estimates: impl Iterator<Item = (usize, &'a Estimate)>) -> String {
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

/// What the number after ± is, in a table of so many seeds.
pub fn deviation_note(seeds: usize) -> String {
    match seeds {
        1 => "Mean ± population standard deviation over every start cell of one seed: one seed tells nothing of the \
              spread between seeds."
            .to_owned(),
        seeds => {
            format!("Mean ± population standard deviation over {seeds} seeds, each the mean over every start cell.")
        }
    }
}

/// A remark on the paper, in brackets; nothing where none of its levels is compared.
pub fn of_paper(analysis: &Analysis, remark: &str) -> String {
    if analysis.published.is_some() { format!(" ({remark})") } else { String::new() }
}
