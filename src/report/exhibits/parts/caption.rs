//! What captions say of seeds, intervals and gaps, in the same words everywhere.

use std::collections::BTreeSet;

use rl_stats::Bootstrap;
use rl_stats::few::FEW;

use super::notes::method;
use crate::report::analysis::{Analysis, Band, Missing};

/// How many gaps a caption lists before it refers to the table of all.
const MOST_LISTED: usize = 4;

/// Of how many seeds the arms are: "5 seeds each.", "1 seed." or arm by arm.
pub fn seeds(analysis: &Analysis, arms: &[usize]) -> String {
    let count = |arm: usize| analysis.arms[arm].seeds.len();
    let plural = |count: usize| if count == 1 { "1 seed".to_owned() } else { format!("{count} seeds") };
    match arms {
        [] => String::new(),
        [one] => format!("{}.", plural(count(*one))),
        [first, rest @ ..] if rest.iter().all(|&arm| count(arm) == count(*first)) => {
            format!("{} per arm.", plural(count(*first)))
        }
        arms => {
            let each = arms.iter().map(|&arm| format!("{} {}", analysis.arms[arm].name, count(arm)));
            format!("Seeds: {}.", each.collect::<Vec<_>>().join(", "))
        }
    }
}

/// What the bands of curves are.
pub fn bands(analysis: &Analysis, arms: &[usize]) -> String {
    let bootstrap = &analysis.conventions.curve_bootstrap;
    means(analysis, arms, bootstrap, ["Bands", ", at each point by itself", "band"])
}

/// What the bars at points are.
pub fn intervals(analysis: &Analysis, arms: &[usize]) -> String {
    means(analysis, arms, &analysis.conventions.bootstrap, ["Bars", "", "interval"])
}

/// What `drawn` is: intervals of means over seeds, `at` some place; a mean of one seed has no `noun`.
fn means(analysis: &Analysis, arms: &[usize], bootstrap: &Bootstrap, [drawn, at, noun]: [&str; 3]) -> String {
    let sentence = format!(
        "{drawn}: {:.0}% intervals of the mean over seeds{at}{}.",
        100.0 * bootstrap.confidence,
        in_brackets(method(bootstrap, seed_counts(analysis, arms)))
    );
    without_interval(analysis, arms, &sentence, noun)
}

/// The numbers of seeds that means of these arms may be of: less than all where something is missing.
fn seed_counts(analysis: &Analysis, arms: &[usize]) -> impl Iterator<Item = usize> {
    let has_gaps = |arm: usize| analysis.missing.iter().any(|missing| missing.arm == arm);
    let of_arm = |&arm: &usize| {
        let all = analysis.arms[arm].seeds.len();
        if has_gaps(arm) { (1..=all).collect::<Vec<usize>>() } else { vec![all] }
    };
    arms.iter().flat_map(of_arm).collect::<Vec<usize>>().into_iter()
}

fn in_brackets(method: Option<String>) -> String {
    method.map_or(String::new(), |method| format!(" ({})", method.replace(" (", "; ").replace(')', "")))
}

/// `sentence`, unless one seed each has no spread to show; names the arms that have none beside others.
fn without_interval(analysis: &Analysis, arms: &[usize], sentence: &str, what: &str) -> String {
    let (alone, several): (Vec<usize>, Vec<usize>) = arms.iter().partition(|&&arm| analysis.arms[arm].seeds.len() == 1);
    if several.is_empty() {
        return format!("One seed has no {what}.");
    }
    let names: Vec<&str> = alone.iter().map(|&arm| analysis.arms[arm].name.as_str()).collect();
    if !names.is_empty() {
        return format!("{sentence} One seed has none: {}.", names.join(", "));
    }
    // Where seeds lack results, one may be left.
    let gaps = analysis.missing.iter().any(|missing| arms.contains(&missing.arm));
    if gaps { format!("{sentence} Where one seed alone has a result there is none.") } else { sentence.to_owned() }
}

/// Of how many seeds the points of curves are, where those of one arm are not all of the same number; `arms` are the
/// points of each.
pub fn points<'a, B: Iterator<Item = &'a Band>>(arms: impl Iterator<Item = B>) -> String {
    let counts = arms.map(|bands| bands.map(|band| band.seeds).collect::<BTreeSet<usize>>());
    let varied: BTreeSet<usize> = counts.filter(|counts| counts.len() > 1).flatten().collect();
    let ends = varied.first().zip(varied.last());
    ends.map_or(String::new(), |(least, most)| format!("Points are of {least} to {most} seeds."))
}

/// What the bars at probabilities of improvement are, of comparisons of as few runs as this.
pub fn improvements(analysis: &Analysis, arms: &[usize], fewest: usize) -> String {
    let confidence = 100.0 * analysis.conventions.bootstrap.confidence;
    let sentence = if fewest < FEW {
        format!(
            "Bars: {confidence:.0}% intervals, exact (Clopper–Pearson), of as many pairs as the smaller arm has seeds."
        )
    } else {
        format!("Bars: {confidence:.0}% intervals, percentile bootstrap over seeds.")
    };
    without_interval(analysis, arms, &sentence, "interval")
}

/// What the bars at shares of pairs are.
pub fn share_intervals(analysis: &Analysis, arms: &[usize]) -> String {
    let confidence = analysis.conventions.bootstrap.confidence;
    let sentence = format!("Bars: {:.0}% intervals over pairs, exact (Clopper–Pearson).", 100.0 * confidence);
    without_interval(analysis, arms, &sentence, "interval")
}

/// What has no result among these arms; empty where nothing is missing.
pub fn missing(analysis: &Analysis, arms: &[usize]) -> String {
    let gaps: Vec<&Missing> = analysis.missing.iter().filter(|missing| arms.contains(&missing.arm)).collect();
    if gaps.is_empty() {
        return String::new();
    }
    let gap = |missing: &&Missing| {
        let levels = if missing.levels.len() == 1 { "level" } else { "levels" };
        let arm = &analysis.arms[missing.arm].name;
        format!("{arm} seed {}, {levels} {} ({})", missing.seed, missing.levels.join(", "), missing.why)
    };
    let mut listed: Vec<String> = gaps.iter().take(MOST_LISTED).map(gap).collect();
    if gaps.len() > MOST_LISTED {
        listed.push(format!("and {} more, which the table of missing results lists", gaps.len() - MOST_LISTED));
    }
    format!("Missing: {}.", listed.join("; "))
}

/// Sentences as one text; empty ones are left out.
pub fn join(sentences: impl IntoIterator<Item = impl Into<String>>) -> String {
    let sentences = sentences.into_iter().map(Into::into).filter(|sentence: &String| !sentence.is_empty());
    sentences.collect::<Vec<String>>().join(" ")
}
