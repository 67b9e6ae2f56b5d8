//! The figures of an [`Analysis`].

mod caption;
mod continual;
mod curves;
mod maps;
mod outcomes;
mod plasticity;
mod timeline;
mod track;

use charts::{Drawing, Style};

pub use maps::draw_levels;

use super::analysis::{Analysis, Arm, Protocol};
use super::{names, topic::Topic};

/// A figure, what its files are called, and what is said of it.
#[derive(Clone, Debug)]
pub struct NamedFigure {
    /// The file's name without extension.
    pub name: String,
    /// Where it belongs.
    pub topic: Topic,
    /// What it shows: of how many seeds, what its bands are, what is missing.
    pub caption: String,
    /// The figure.
    pub drawing: Drawing,
    /// The tables that hold its numbers, by name.
    pub tables: Vec<String>,
}

/// Every figure for which there is something to show.
pub fn all(analysis: &Analysis) -> Vec<NamedFigure> {
    let mut figures: Vec<NamedFigure> = maps::figure(analysis).into_iter().collect();
    figures.extend(curves::figures(analysis));
    figures.extend(outcomes::figures(analysis));
    figures.extend(continual::figures(analysis));
    figures.extend(plasticity::figures(analysis));
    names::make_unique(figures.iter_mut().map(|figure| &mut figure.name));
    figures
}

/// Runs afresh where they stand beside their own curriculum, which has the arm's style.
const AFRESH: Style = Style(6);

/// How an arm looks in every figure. A curriculum and its runs afresh look the same: where both are in one panel, the
/// runs afresh are drawn as [`AFRESH`].
fn style(analysis: &Analysis, arm: usize) -> Style {
    let leader = |arm: usize| analysis.against_afresh.iter().find(|a| a.afresh == arm).map_or(arm, |a| a.curriculum);
    let leaders = (0..analysis.arms.len()).filter(|&other| leader(other) == other);
    let place = leaders.take_while(|&other| other != leader(arm)).count();
    // Every seventh is kept for `AFRESH`.
    Style(place / AFRESH.0 * (AFRESH.0 + 1) + place % AFRESH.0)
}

/// Arms of a protocol, with their indices.
fn arms_of(analysis: &Analysis, protocol: Protocol) -> Vec<(usize, &Arm)> {
    analysis.arms.iter().enumerate().filter(|(_, arm)| arm.protocol == protocol).collect()
}

/// What an arm is called where the figure says already how it was trained.
fn short_name(arm: &Arm) -> String {
    arm.name.replacen(" (afresh)", "", 1)
}

fn level_label(analysis: &Analysis, level: usize) -> String {
    format!("level {}", analysis.levels[level].name)
}

/// A statistic as a point with its interval and, beside it, each seed.
fn point<'a>(estimate: &rl_stats::Estimate, seeds: impl IntoIterator<Item = &'a f64>) -> charts::Estimate {
    charts::Estimate {
        value: estimate.value,
        interval: estimate.interval.map(|interval| (interval.low, interval.high)),
        seeds: seeds.into_iter().copied().collect(),
    }
}
