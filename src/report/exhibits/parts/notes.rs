//! Heads and notes of tables, in the same words everywhere.

use std::collections::BTreeSet;

use rl_stats::few::{FEW, LEAST_STUDENTISED};
use rl_stats::{Bootstrap, Estimate, LEAST_OF_MEDIAN};

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
    let estimates: Vec<(usize, &Estimate)> = estimates.collect();
    let bootstrap = &analysis.conventions.bootstrap;
    let mut note = match method(bootstrap, estimates.iter().map(|(_, estimate)| estimate.runs)) {
        Some(method) => {
            format!("[low, high]: {:.0}% interval of the mean over seeds, {method}.", 100.0 * bootstrap.confidence)
        }
        None => String::new(),
    };
    let alone = estimates.iter().filter(|(_, estimate)| estimate.runs == 1).map(|(arm, _)| *arm);
    let alone: BTreeSet<usize> = alone.collect();
    let alone: Vec<&str> = alone.into_iter().map(|arm| analysis.arms[arm].name.as_str()).collect();
    if !alone.is_empty() {
        let space = if note.is_empty() { "" } else { " " };
        note += &format!("{space}One seed has no interval: {}.", alone.join(", "));
    }
    note
}

/// How intervals of means over so many seeds are made; none where all are of one seed.
pub fn method(bootstrap: &Bootstrap, seeds: impl Iterator<Item = usize>) -> Option<String> {
    let (mut student, mut studentised, mut percentile) = (false, false, false);
    for seeds in seeds.filter(|seeds| *seeds > 1) {
        student |= seeds < LEAST_STUDENTISED;
        studentised |= (LEAST_STUDENTISED..FEW).contains(&seeds);
        percentile |= seeds >= FEW;
    }
    let resamples = bootstrap.resamples;
    let each = [
        (student, "Student's t".to_owned(), "of 2 or 3 seeds".to_owned()),
        (studentised, "studentised bootstrap".to_owned(), format!("of {LEAST_STUDENTISED} to {}", FEW - 1)),
        (percentile, "percentile bootstrap".to_owned(), format!("of {FEW} or more")),
    ];
    let used: Vec<(String, String)> = each.into_iter().filter(|(is, ..)| *is).map(|(_, name, of)| (name, of)).collect();
    let names = match &used[..] {
        [] => return None,
        [(name, _)] => name.clone(),
        several => several.iter().map(|(name, of)| format!("{name} {of}")).collect::<Vec<_>>().join(", "),
    };
    Some(if studentised || percentile { format!("{names} ({resamples} resamples)") } else { names })
}

/// That the intervals of what is no mean are percentile intervals, which promise too much with few seeds.
pub fn percentile_note(what: &str, seeds: impl Iterator<Item = usize>) -> String {
    let seeds: Vec<usize> = seeds.filter(|seeds| *seeds > 1).collect();
    let few = if seeds.iter().any(|seeds| *seeds < FEW) { ", too narrow with few seeds" } else { "" };
    if seeds.is_empty() { String::new() } else { format!("{what}: percentile bootstrap{few}.") }
}

/// How the intervals of ratios of means are made; nothing where all are of one seed.
pub fn ratio_method<'a>(what: &str, ratios: impl Iterator<Item = &'a Estimate>) -> String {
    let (mut fieller, mut percentile) = (false, false);
    for runs in ratios.map(|ratio| ratio.runs).filter(|runs| *runs > 1) {
        fieller |= runs < FEW;
        percentile |= runs >= FEW;
    }
    let how = match (fieller, percentile) {
        (false, false) => return String::new(),
        (true, false) => "Fieller's interval".to_owned(),
        (false, true) => "percentile bootstrap".to_owned(),
        (true, true) => format!("Fieller's interval below {FEW} seeds, percentile bootstrap from there on"),
    };
    format!("{what}: {how}.")
}

/// The same, and when a ratio stands without an interval.
pub fn ratio_note<'a>(what: &str, ratios: impl Iterator<Item = &'a Estimate>) -> String {
    let method = ratio_method(what, ratios);
    if method.is_empty() { method } else { format!("{method} {NO_END}") }
}

/// When a ratio of several seeds has no interval.
const NO_END: &str = "There is no interval where it would have no end: the denominator may be 0.";

/// What the intervals of medians over seeds are; nothing where all are of one seed.
pub fn median_note(seeds: impl Iterator<Item = usize>) -> String {
    let seeds: Vec<usize> = seeds.filter(|seeds| *seeds > 1).collect();
    let few = seeds.iter().any(|seeds| *seeds < LEAST_OF_MEDIAN);
    let none = if few { format!(" Fewer than {LEAST_OF_MEDIAN} seeds have none.") } else { String::new() };
    if seeds.is_empty() { String::new() } else { format!("Medians: exact interval, between two of the seeds.{none}") }
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

/// A remark on the paper, in brackets; nothing where no arm was trained as the paper's models were.
pub fn of_paper(analysis: &Analysis, remark: &str) -> String {
    let any = analysis.arms.iter().any(|arm| analysis.stages_of_paper(arm) > 0);
    if any { format!(" ({remark})") } else { String::new() }
}
