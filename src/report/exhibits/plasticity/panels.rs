//! Panels of plasticity measures over training.

use std::collections::BTreeSet;

use charts::{About, Axis, Curve, CurveChart, CurvePanel, Layout, Style, Width};

use super::super::parts::caption;
use super::super::parts::style::{short_name, style};
use super::super::parts::timeline::Timeline;
use super::super::parts::track::{Seeds, Track};
use crate::measure::{Column, Measure, States, catalogue};
use crate::report::analysis::{Analysis, Arm, PlasticitySeries};

/// What a hidden layer has and an output layer has not.
pub(super) const HIDDEN: &str = "effective_rank";
pub(super) const WEIGHTS: &str = "weight_magnitude";

/// Tower and number of a layer, such as `policy.1`.
pub(super) fn layer_order(layer: &str) -> (&str, usize) {
    let (tower, number) = layer.rsplit_once('.').unwrap_or((layer, ""));
    (tower, number.parse().unwrap_or(0))
}

/// The layers of an arm that have this measure.
pub(super) fn layers<'a>(arm: &'a Arm, measure: &str) -> Vec<&'a str> {
    let layer = |column: &'a str| Some(Column::parse(column)).filter(|column| column.name == measure)?.layer;
    let all: BTreeSet<&str> = arm.plasticity.iter().filter_map(|series| layer(&series.measure)).collect();
    let mut all: Vec<&str> = all.into_iter().collect();
    all.sort_by_key(|layer| layer_order(layer));
    all
}

/// The last hidden layer of the network that decides on actions.
pub(super) fn acting_layer(arm: &Arm) -> Option<&str> {
    last_layer(arm, &["policy", "q"])
}

/// The last hidden layer of the network that only values states.
pub(super) fn value_layer(arm: &Arm) -> Option<&str> {
    last_layer(arm, &["value"])
}

fn last_layer<'a>(arm: &'a Arm, towers: &[&str]) -> Option<&'a str> {
    layers(arm, HIDDEN).into_iter().rfind(|layer| towers.contains(&layer_order(layer).0))
}

/// One arm in a figure.
#[derive(Clone)]
pub(super) struct Line<'a> {
    pub(super) arm: &'a Arm,
    pub(super) name: String,
    pub(super) style: Style,
    /// The layer whose measures are drawn.
    pub(super) layer: Option<&'a str>,
}

/// Curves of one measure: `column` gives the column of each line.
pub(super) fn panel(
    analysis: &Analysis,
    timeline: &Timeline,
    lines: &[Line],
    title: String,
    column: impl Fn(&Line) -> Option<String>,
) -> Option<CurvePanel> {
    let seeds = if lines.len() > 1 { Seeds::Hidden } else { Seeds::Shown };
    let curve = |line: &Line| {
        let mut curve = Curve::new(line.name.as_str(), line.style);
        let column = column(line)?;
        let of_column = line.arm.plasticity.iter().filter(|series| series.measure == column);
        let place = |series: &'_ PlasticitySeries| timeline.place(line.arm, series.stage, series.level);
        let mut placed: Vec<_> = of_column.filter_map(|series| Some((series, place(series)?))).collect();
        placed.sort_by(|(_, x), (_, other)| x(0.0).total_cmp(&other(0.0)));
        for (series, x) in placed {
            Track::from(series).append(&mut curve, seeds, x, |value| value);
        }
        (!curve.centre.is_empty()).then_some(curve)
    };
    let curves: Vec<Curve> = lines.iter().filter_map(curve).collect();
    let stages = timeline.stages(analysis);
    (!curves.is_empty()).then_some(CurvePanel { title, curves, stages, ..CurvePanel::default() })
}

/// A panel per measure of these lines: of all parameters if `whole`, and of each line's layer.
pub(super) fn panels(analysis: &Analysis, timeline: &Timeline, lines: &[Line], whole: bool) -> Vec<CurvePanel> {
    let mut measures: BTreeSet<(Place, &str, States)> = BTreeSet::new();
    for line in lines {
        let columns = line.arm.plasticity.iter().map(|series| Column::parse(&series.measure));
        let is_shown = |column: &Column| column.layer.map_or(whole, |layer| line.layer == Some(layer));
        measures.extend(columns.filter(is_shown).map(|column| (Place::of(column), column.name, column.states)));
    }
    let of_measure = |(place, name, states): (Place, &str, States)| {
        let title = place.title().unwrap_or_else(|| name.to_owned());
        let title = if states == States::Visited { format!("{title}, visited states") } else { title };
        panel(analysis, timeline, lines, title, |line| {
            let column = |layer| Column { layer, name, states }.to_string();
            let of_layer = line.layer.map(|layer| column(Some(layer)));
            let logged = |column: &String| line.arm.plasticity.iter().any(|series| series.measure == *column);
            of_layer.filter(logged).or_else(|| whole.then(|| column(None)))
        })
    };
    measures.into_iter().filter_map(of_measure).collect()
}

/// A measure's place in the catalogue; what the catalogue does not know comes after all that it does.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct Place(usize);

impl Place {
    fn of(column: Column) -> Self {
        let known = |measure: &Measure| catalogue().position(|other| other.name == measure.name);
        Self(column.measure().and_then(known).unwrap_or(usize::MAX))
    }

    /// What the catalogue calls it.
    fn title(self) -> Option<String> {
        catalogue().nth(self.0).map(Measure::label)
    }
}

pub(super) fn chart(timeline: &Timeline, about: About, panels: Vec<CurvePanel>) -> charts::Drawing {
    CurveChart {
        about,
        layout: Layout { width: Width::Page, columns: 3, panel_height: 72.0 },
        x: timeline.axis(),
        y: Axis::default(),
        free_y: true,
        panels,
    }
    .draw()
}

/// What captions end with.
pub(super) fn of_seeds(analysis: &Analysis, timeline: &Timeline, arms: &[usize]) -> String {
    let of_arm = |&arm: &usize| analysis.arms[arm].plasticity.iter().flat_map(|series| series.mean.iter().flatten());
    caption::join([
        format!("Lines: means over seeds. {}", caption::seeds(analysis, arms)),
        caption::bands(analysis, arms),
        caption::points(arms.iter().map(of_arm)),
        timeline.note().to_owned(),
        caption::missing(analysis, arms),
    ])
}

/// The arms that have logged plasticity as lines in their own styles, and a sentence on those that have not.
pub(super) fn logged<'a>(analysis: &Analysis, arms: &[(usize, &'a Arm)]) -> (Vec<usize>, Vec<Line<'a>>, String) {
    let (with, without): (Vec<_>, Vec<_>) = arms.iter().copied().partition(|(_, arm)| !arm.plasticity.is_empty());
    let line = |&(index, arm): &(usize, &'a Arm)| Line {
        arm,
        name: short_name(arm),
        style: style(analysis, index),
        layer: acting_layer(arm),
    };
    let names: Vec<&str> = without.iter().map(|(_, arm)| arm.name.as_str()).collect();
    let not_logged =
        if names.is_empty() { String::new() } else { format!("Not logged, and so not shown: {}.", names.join(", ")) };
    (with.iter().map(|&(index, _)| index).collect(), with.iter().map(line).collect(), not_logged)
}

/// Which layer the measures are of.
pub(super) fn layer_note(lines: &[Line]) -> String {
    let mut layers: Vec<String> = lines.iter().filter_map(|line| line.layer.map(str::to_owned)).collect();
    layers.sort();
    layers.dedup();
    format!(
        "Units, ranks and weights are those of the last hidden layer of the network that chooses actions ({}). \
         Gradient and update are of all parameters.",
        layers.join(", ")
    )
}
