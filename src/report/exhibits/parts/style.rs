//! How arms look and what they are called, in every figure alike.

use charts::Style;

use crate::report::analysis::{Analysis, Arm, LevelInfo, Planner, Protocol};

/// Runs from scratch where they stand beside their own curriculum, which has the arm's style.
pub const FROM_SCRATCH: Style = Style(6);

/// Curves of other programs: dashed in three ways, in a colour that no arm has.
pub fn foreign(place: usize) -> Style {
    const DASHED: [usize; 3] = [1, 3, 4];
    Style(FROM_SCRATCH.0 + 7 * DASHED[place % DASHED.len()])
}

/// How an arm looks. A curriculum and its runs from scratch look the same: where both are in one panel, the runs from
/// scratch are drawn as [`FROM_SCRATCH`].
pub fn style(analysis: &Analysis, arm: usize) -> Style {
    let leader = |arm: usize| analysis.pairs.iter().find(|p| p.from_scratch == arm).map_or(arm, |p| p.curriculum);
    let leaders = (0..analysis.arms.len()).filter(|&other| leader(other) == other);
    let place = leaders.take_while(|&other| other != leader(arm)).count();
    // Every seventh is kept for `FROM_SCRATCH`.
    Style(place / FROM_SCRATCH.0 * (FROM_SCRATCH.0 + 1) + place % FROM_SCRATCH.0)
}

/// Arms of a protocol, with their indices.
pub fn arms_of(analysis: &Analysis, protocol: Protocol) -> Vec<(usize, &Arm)> {
    analysis.arms.iter().enumerate().filter(|(_, arm)| arm.protocol == protocol).collect()
}

/// What an arm is called where the figure says already how it was trained.
pub fn short_name(arm: &Arm) -> String {
    arm.name.replacen(" (from scratch)", "", 1)
}

/// What a level is called.
pub fn level_label(analysis: &Analysis, level: usize) -> String {
    format!("level {}", analysis.levels[level].name)
}

/// A planner by its name in figures.
type NamedPlanner = (&'static str, fn(&LevelInfo) -> &Option<Planner>);

/// The planners that figures show as lines.
pub const PLANNERS: [NamedPlanner; 2] = [("A*", |level| &level.astar), ("optimal", |level| &level.optimal)];

/// The protocols in which arms are compared level by level, and the titles of their panels. Forks stand in an exhibit of
/// their own: most have not trained on every level.
pub const PROTOCOLS: [(Protocol, &str); 2] =
    [(Protocol::Curriculum, "in the curriculum"), (Protocol::FromScratch, "from scratch")];

/// A statistic as a point with its interval and, beside it, each seed.
pub fn point<'a>(estimate: &rl_stats::Estimate, seeds: impl IntoIterator<Item = &'a f64>) -> charts::Estimate {
    charts::Estimate {
        value: estimate.value,
        interval: estimate.interval.map(|interval| (interval.low, interval.high)),
        seeds: seeds.into_iter().copied().collect(),
    }
}
