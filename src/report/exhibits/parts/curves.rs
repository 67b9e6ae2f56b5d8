//! Learning curves of arms, as several exhibits draw them.

use charts::{About, Axis, Curve, CurveChart, CurvePanel, Layout, Reference, Style, Width};

use super::caption;
use super::style::{PLANNERS, level_label};
use super::timeline::{levels_of, trained_for};
use super::track::{Seeds, Track};
use crate::report::analysis::{Analysis, Arm, LevelInfo, Planner};

pub const RETURN: &str = "return";
pub const NORMALISED: &str = "normalised return";
/// What is drawn of returns during training.
pub const MOVING: &str = "Mean return of the last 100 episodes during training";

pub fn has_curves(arm: &Arm) -> bool {
    arm.curves.iter().any(|curve| !curve.points.is_empty())
}

/// Of how many seeds the points of these arms' curves are, where that is not one number.
pub fn learning_points(analysis: &Analysis, arms: &[usize]) -> String {
    let of_arm = |&arm: &usize| analysis.arms[arm].curves.iter().flat_map(|curve| curve.mean.iter().flatten());
    caption::points(arms.iter().map(of_arm))
}

/// Curricula that share the order of their levels, together.
pub fn by_sequence<'a>(curricula: &[(usize, &'a Arm)]) -> Vec<Vec<(usize, &'a Arm)>> {
    let mut groups: Vec<Vec<(usize, &Arm)>> = Vec::new();
    for &(index, arm) in curricula {
        match groups.iter_mut().find(|group| levels_of(group[0].1) == levels_of(arm)) {
            Some(group) => group.push((index, arm)),
            None => groups.push(vec![(index, arm)]),
        }
    }
    groups
}

/// A* and the optimum of one level.
pub fn planners(level: &LevelInfo) -> Vec<Reference> {
    let line = |(name, planner): (&str, fn(&LevelInfo) -> &Option<Planner>)| {
        Some(Reference::across(name, planner(level).as_ref()?.mean))
    };
    PLANNERS.into_iter().filter_map(line).collect()
}

/// The learning curve of an arm on one level, in timesteps of that level: of its first stage there.
pub fn on_level(arm: &Arm, level: usize, name: &str, style: Style) -> Curve {
    let mut curve = Curve::new(name, style);
    if let Some(stage) = arm.curves.iter().find(|curve| curve.level == level) {
        Track::from(stage).append(&mut curve, Seeds::Shown, |timesteps| timesteps, |value| value);
    }
    curve
}

/// Levels that have a panel each at most; nobody reads more of them.
const MOST_LEVELS: usize = 20;

/// A panel per level; x is as long as the longest training of these arms. None of more levels than can be read.
pub fn panel_per_level(
    analysis: &Analysis,
    about: About,
    arms: &[&Arm],
    levels: &[usize],
    curves: impl Fn(usize) -> Vec<Curve>,
) -> Option<CurveChart> {
    let panel = |&level: &usize| CurvePanel {
        title: level_label(analysis, level),
        curves: curves(level),
        references: planners(&analysis.levels[level]),
        ..CurvePanel::default()
    };
    let longest = arms.iter().flat_map(|arm| levels.iter().filter_map(|&level| trained_for(arm, level)));
    let longest = longest.fold(0.0, f64::max);
    let is_first = |(place, level): &(usize, &usize)| !levels[..*place].contains(level);
    let levels: Vec<&usize> = levels.iter().enumerate().filter(is_first).map(|(_, level)| level).collect();
    (levels.len() <= MOST_LEVELS).then(|| CurveChart {
        about,
        layout: Layout { width: Width::Page, columns: 3, panel_height: 95.0 },
        // Curves begin with the first row of a log, training at 0.
        x: Axis { range: Some((0.0, longest)), ..Axis::new("timesteps on the level") },
        y: Axis::new(RETURN),
        panels: levels.into_iter().map(panel).collect(),
        ..CurveChart::default()
    })
}
