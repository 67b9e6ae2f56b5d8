//! Learning curves: returns during training. Of the paper's levels these are its Figures 2 to 4, and its Figure 6 as it
//! was drawn.

mod foreign;

use std::collections::BTreeSet;

use charts::{About, Axis, Curve, CurveChart, CurvePanel, Layout, Width};
use serde::Serialize;

use super::exhibit::{Exhibit, NamedFigure, NamedTable};
use super::parts::caption;
use super::parts::curves::{
    MOVING, NORMALISED, RETURN, by_sequence, has_curves, learning_points, on_level, panel_per_level,
};
use super::parts::notes::of_paper;
use super::parts::style::{self, arms_of, short_name, style};
use super::parts::timeline::{Timeline, levels_of};
use super::parts::track::{Seeds, Track};
use crate::report::analysis::{Analysis, Arm, LevelInfo, Protocol};
use crate::report::foreign::ForeignCurve;
use crate::report::names::file_name;
use foreign::Beside;

/// The table of other programs' curves.
const FOREIGN: &str = "other-curves";

/// Returns during training.
#[derive(Debug, Serialize)]
#[serde(transparent)]
pub struct Learning {
    /// Curves of other programs that stand beside arms.
    beside: Vec<Beside>,
}

impl Learning {
    /// With the curves of other programs that the analysis holds.
    pub fn new(analysis: &Analysis) -> Self {
        Self { beside: foreign::all(analysis) }
    }
}

impl Exhibit for Learning {
    fn key(&self) -> &'static str {
        "learning"
    }

    fn heading(&self) -> &'static str {
        "Learning curves"
    }

    fn lead(&self) -> &'static str {
        "Training explores. What the trained policy earns when it always takes its best action stands under Returns \
         right after training."
    }

    fn absence(&self) -> &'static str {
        "No run has a learning curve."
    }

    fn numbers(&self) -> serde_json::Result<Option<String>> {
        if self.beside.is_empty() { Ok(None) } else { serde_json::to_string(self).map(Some) }
    }

    fn tables(&self, analysis: &Analysis) -> Vec<NamedTable> {
        vec![NamedTable::main(FOREIGN, foreign::table(analysis, &self.beside))]
    }

    fn figures(&self, analysis: &Analysis) -> Vec<NamedFigure> {
        let curricula = arms_of(analysis, Protocol::Curriculum);
        let with_curves = curricula.iter().filter(|(_, arm)| has_curves(arm));
        let mut figures: Vec<NamedFigure> = with_curves.map(|&(index, arm)| of_arm(analysis, index, arm)).collect();
        figures.extend(by_sequence(&curricula).into_iter().filter_map(|arms| of_arms(analysis, &arms)));
        figures.extend(from_scratch(analysis));
        figures
    }
}

/// The learning curve of an arm over the levels that it has in common with `timeline`.
fn along(timeline: &Timeline, arm: &Arm, curve: &mut Curve, y: impl Fn(usize, f64) -> f64) {
    for stage in &arm.curves {
        if let Some(x) = timeline.place(arm, stage.stage, stage.level) {
            Track::from(stage).append(curve, Seeds::Shown, x, |value| y(stage.level, value));
        }
    }
}

/// One arm over its curriculum.
fn of_arm(analysis: &Analysis, index: usize, arm: &Arm) -> NamedFigure {
    let timeline = Timeline::new(&[arm], &levels_of(arm));
    let mut curve = Curve::new(arm.name.as_str(), style(analysis, index));
    along(&timeline, arm, &mut curve, |_, value| value);
    let (others, beside) = others(analysis, arm, &timeline);
    let title = format!("{} over its curriculum", arm.name);
    NamedFigure {
        name: format!("learning-curve-{}", file_name(&arm.name)),
        caption: caption::join([
            format!("{}: {}, one level after another.", arm.name, MOVING.to_lowercase()),
            format!("Line: mean over seeds; thin lines: single seeds. {}", caption::seeds(analysis, &[index])),
            caption::bands(analysis, &[index]),
            learning_points(analysis, &[index]),
            beside,
            "A* and the optimum are means over every start cell.".to_owned(),
            caption::missing(analysis, &[index]),
        ]),
        drawing: CurveChart {
            about: About::new(title, "Return during training, level after level, with planners as lines."),
            layout: Layout { width: Width::Page, columns: 1, panel_height: 150.0 },
            x: timeline.axis(),
            y: Axis::new(RETURN),
            panels: vec![CurvePanel {
                curves: [curve].into_iter().chain(others).collect(),
                references: timeline.planners(analysis, |_, value| Some(value)),
                stages: timeline.stages(analysis),
                ..CurvePanel::default()
            }],
            ..CurveChart::default()
        }
        .draw(),
        tables: vec![FOREIGN.to_owned()],
    }
}

/// Curves of other programs on the stages of an arm, a line per source; and whose they are, of how many curves.
fn others<'a>(analysis: &'a Analysis, arm: &Arm, timeline: &Timeline) -> (Vec<Curve>, String) {
    let sources: BTreeSet<&str> = analysis.foreign_curves.iter().map(|curve| curve.source.as_str()).collect();
    let of_source = |(place, source): (usize, &'a str)| {
        let mut curve = Curve { thin: true, ..Curve::new(source, style::foreign(place)) };
        for stage in &arm.stages {
            let x = timeline.place(arm, stage.stage, stage.level)?;
            for other in foreign::beside(analysis, &[arm], stage.level).into_iter().filter(|c| c.source == source) {
                append(&mut curve, other, &x);
            }
        }
        (!curve.centre.is_empty()).then_some((source, curve))
    };
    let (names, curves): (Vec<&str>, Vec<Curve>) = sources.into_iter().enumerate().filter_map(of_source).unzip();
    (curves, beside_note(&names))
}

/// What captions say of other programs' curves; nothing without any.
fn beside_note(names: &[&str]) -> String {
    if names.is_empty() { String::new() } else { format!("Thin dashes: single seeds of {}.", names.join(", ")) }
}

/// Draws one seed's curve as a line of its own.
fn append(curve: &mut Curve, other: &ForeignCurve, x: impl Fn(f64) -> f64) {
    curve.centre.push((x(0.0), f64::NAN));
    curve.centre.extend(other.points.iter().map(|&(timesteps, value)| (x(timesteps), value)));
}

/// All arms of one curriculum on one axis: the paper's Figure 6 as it was drawn. None for a single arm, which has a
/// figure of its own.
fn of_arms(analysis: &Analysis, arms: &[(usize, &Arm)]) -> Option<NamedFigure> {
    let arms: Vec<(usize, &Arm)> = arms.iter().copied().filter(|(_, arm)| has_curves(arm)).collect();
    let [(_, first), _, ..] = arms[..] else { return None };
    let levels = levels_of(first);
    let indices: Vec<usize> = arms.iter().map(|&(index, _)| index).collect();
    let timeline = Timeline::new(&arms.iter().map(|&(_, arm)| arm).collect::<Vec<_>>(), &levels);
    let all_optima = levels.iter().all(|&level| analysis.levels[level].optimal.is_some());
    let value = |level: &LevelInfo, value: f64| if all_optima { level.normalised(value) } else { Some(value) };
    let curve = |&(index, arm): &(usize, &Arm)| {
        let mut curve = Curve::new(arm.name.as_str(), style(analysis, index));
        let y = |level: usize, of: f64| value(&analysis.levels[level], of).unwrap_or(f64::NAN);
        along(&timeline, arm, &mut curve, y);
        curve
    };
    let scale = if all_optima {
        "0 is the worst return there is, 1 the proved mean optimum of the level."
    } else {
        "Returns are not normalised: a level has no proved optimum."
    };
    let panel = CurvePanel {
        curves: arms.iter().map(curve).collect(),
        references: timeline.planners(analysis, value),
        stages: timeline.stages(analysis),
        ..CurvePanel::default()
    };
    Some(NamedFigure {
        name: "learning-curves".to_owned(),
        caption: caption::join([
            format!("{MOVING}, all arms{}.", of_paper(analysis, "the paper's Figure 6 as it was drawn")),
            format!(
                "{scale} Lines: means over seeds; thin lines: single seeds. {}",
                caption::seeds(analysis, &indices)
            ),
            caption::bands(analysis, &indices),
            learning_points(analysis, &indices),
            timeline.note().to_owned(),
            caption::missing(analysis, &indices),
        ]),
        drawing: CurveChart {
            about: About::new("All arms over the curriculum", "Return during training, level after level."),
            layout: Layout { width: Width::Page, columns: 1, panel_height: 170.0 },
            x: timeline.axis(),
            y: Axis::new(if all_optima { NORMALISED } else { RETURN }),
            panels: vec![panel],
            ..CurveChart::default()
        }
        .draw(),
        tables: vec!["aggregates".to_owned()],
    })
}

/// Every arm from scratch, level by level.
fn from_scratch(analysis: &Analysis) -> Option<NamedFigure> {
    let arms: Vec<(usize, &Arm)> =
        arms_of(analysis, Protocol::FromScratch).into_iter().filter(|(_, arm)| has_curves(arm)).collect();
    let indices: Vec<usize> = arms.iter().map(|&(index, _)| index).collect();
    let trained = |level: &usize| arms.iter().any(|(_, arm)| levels_of(arm).contains(level));
    let levels: Vec<usize> = (0..analysis.levels.len()).filter(trained).collect();
    let alone: Vec<&Arm> = arms.iter().map(|&(_, arm)| arm).collect();
    let others = levels.iter().flat_map(|&level| foreign::beside(analysis, &alone, level));
    let lines: BTreeSet<(&str, &str)> = others.map(|curve| (curve.source.as_str(), curve.arm.as_str())).collect();
    let mut sources: Vec<&str> = lines.iter().map(|(source, _)| *source).collect();
    sources.dedup();
    let curves = |level: usize| {
        let own = |&(index, arm): &(usize, &Arm)| on_level(arm, level, &short_name(arm), style(analysis, index));
        let others = foreign::beside(analysis, &alone, level);
        let drawn = lines.iter().enumerate().filter_map(|(place, (source, preset))| {
            let mut curve = Curve { thin: true, ..Curve::new(format!("{source}: {preset}"), style::foreign(place)) };
            let of_line =
                others.iter().filter(|other| (other.source.as_str(), other.arm.as_str()) == (*source, *preset));
            of_line.for_each(|other| append(&mut curve, other, |x| x));
            (!curve.centre.is_empty()).then_some(curve)
        });
        arms.iter().map(own).chain(drawn).collect()
    };
    let about = About::new("Every level from scratch", "Return during training of new agents, a panel per level.");
    let chart = panel_per_level(analysis, about, &alone, &levels, curves)?;
    (!arms.is_empty()).then(|| NamedFigure {
        name: "learning-curves-from-scratch".to_owned(),
        caption: caption::join([
            format!("{MOVING}, a new agent on each level: what each arm can learn without a past."),
            format!("Lines: means over seeds; thin lines: single seeds. {}", caption::seeds(analysis, &indices)),
            caption::bands(analysis, &indices),
            learning_points(analysis, &indices),
            beside_note(&sources),
            caption::missing(analysis, &indices),
        ]),
        drawing: chart.draw(),
        tables: vec![FOREIGN.to_owned()],
    })
}
