//! Plasticity measures over training: all arms together, each curriculum against afresh, and layer by layer.

use std::collections::BTreeSet;

use charts::{About, Axis, Curve, CurveChart, CurvePanel, Layout, Style, Width};

use super::super::analysis::{AgainstAfresh, Analysis, Arm, Protocol};
use super::super::names::file_name;
use super::super::tables::{plasticity_differences_name, plasticity_name};
use super::super::topic::Topic;
use super::curves::by_sequence;
use super::timeline::{Timeline, levels_of};
use super::track::{Seeds, Track};
use super::{AFRESH, NamedFigure, arms_of, caption, short_name, style};

const PREFIX: &str = "plasticity/";
/// What a hidden layer has and an output layer has not.
const HIDDEN: &str = "effective_rank";
const WEIGHTS: &str = "weight_magnitude";

/// The measures of a layer, and of all parameters, with the titles of their panels, in order.
const TITLES: [(&str, &str); 12] = [
    ("dormant_0.1", "dormant units, τ = 0.1 (share)"),
    ("dormant_0.025", "dormant units, τ = 0.025 (share)"),
    ("dead_units", "dead units (share; ReLU)"),
    ("saturated_units", "saturated units (share; tanh)"),
    ("saturated_activations", "saturated activations (share; tanh)"),
    ("effective_rank", "effective rank"),
    ("stable_rank", "stable rank"),
    ("rank_99", "singular values for 99%"),
    (WEIGHTS, "mean weight magnitude"),
    ("grad_norm", "gradient norm before clipping"),
    ("update_norm", "update norm"),
    ("policy_churn", "policy churn (share of states)"),
];

/// The layer, if it is of one, and the name of a measure by its column.
fn parse(column: &str) -> (Option<&str>, &str) {
    let column = column.strip_prefix(PREFIX).unwrap_or(column);
    column.rsplit_once('/').map_or((None, column), |(layer, name)| (Some(layer), name))
}

/// Tower and number of a layer, such as `policy.1`.
fn layer_order(layer: &str) -> (&str, usize) {
    let (tower, number) = layer.rsplit_once('.').unwrap_or((layer, ""));
    (tower, number.parse().unwrap_or(0))
}

/// The layers of an arm that have this measure.
fn layers<'a>(arm: &'a Arm, measure: &str) -> Vec<&'a str> {
    let layer = |column: &'a str| match parse(column) {
        (Some(layer), name) if name == measure => Some(layer),
        _ => None,
    };
    let all: BTreeSet<&str> = arm.plasticity.iter().filter_map(|series| layer(&series.measure)).collect();
    let mut all: Vec<&str> = all.into_iter().collect();
    all.sort_by_key(|layer| layer_order(layer));
    all
}

/// The last hidden layer of the network that decides on actions.
fn acting_layer(arm: &Arm) -> Option<&str> {
    let decides = |layer: &&str| ["policy", "q"].contains(&layer_order(layer).0);
    layers(arm, HIDDEN).into_iter().rfind(decides)
}

/// One arm in a figure.
#[derive(Clone)]
struct Line<'a> {
    arm: &'a Arm,
    name: String,
    style: Style,
    /// The layer whose measures are drawn.
    layer: Option<&'a str>,
}

/// Curves of one measure: `column` gives the column of each line.
fn panel(
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
        let of_column =
            |level: usize| line.arm.plasticity.iter().find(|series| series.level == level && series.measure == column);
        for level in timeline.levels() {
            if let Some((series, x)) = of_column(level).zip(timeline.place(line.arm, level)) {
                Track::from(series).append(&mut curve, seeds, x, |value| value);
            }
        }
        (!curve.centre.is_empty()).then_some(curve)
    };
    let curves: Vec<Curve> = lines.iter().filter_map(curve).collect();
    let stages = timeline.stages(analysis);
    (!curves.is_empty()).then_some(CurvePanel { title, curves, stages, ..CurvePanel::default() })
}

/// A panel per measure of these lines: of all parameters if `whole`, and of each line's layer.
fn panels(analysis: &Analysis, timeline: &Timeline, lines: &[Line], whole: bool) -> Vec<CurvePanel> {
    let mut measures: BTreeSet<&str> = BTreeSet::new();
    for line in lines {
        let shown = line.arm.plasticity.iter().map(|series| parse(&series.measure));
        let shown = shown.filter(|(layer, _)| if layer.is_some() { *layer == line.layer } else { whole });
        measures.extend(shown.map(|(_, name)| name));
    }
    // What has no title here goes by its own name, after all that have one.
    let order = |name: &str| TITLES.iter().position(|(known, _)| *known == name).unwrap_or(TITLES.len());
    let mut measures: Vec<&str> = measures.into_iter().collect();
    measures.sort_by_key(|name| (order(name), *name));
    let of_measure = |name: &str| {
        let title = TITLES.get(order(name)).map_or(name, |(_, title)| title).to_owned();
        panel(analysis, timeline, lines, title, |line| {
            let of_layer = line.layer.map(|layer| format!("{PREFIX}{layer}/{name}"));
            let logged = |column: &String| line.arm.plasticity.iter().any(|series| series.measure == *column);
            of_layer.filter(logged).or_else(|| whole.then(|| format!("{PREFIX}{name}")))
        })
    };
    measures.into_iter().filter_map(of_measure).collect()
}

fn chart(timeline: &Timeline, about: About, panels: Vec<CurvePanel>) -> charts::Drawing {
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
fn of_seeds(analysis: &Analysis, timeline: &Timeline, arms: &[usize]) -> String {
    let of_arm = |&arm: &usize| analysis.arms[arm].plasticity.iter().flat_map(|series| series.mean.iter().flatten());
    caption::join([
        format!("Lines: means over seeds. {}", caption::seeds(analysis, arms)),
        caption::bands(analysis, arms),
        caption::points(arms.iter().map(of_arm)),
        timeline.note().to_owned(),
        caption::missing(analysis, arms),
    ])
}

pub(super) fn figures(analysis: &Analysis) -> Vec<NamedFigure> {
    let mut figures = Vec::new();
    for arms in by_sequence(&arms_of(analysis, Protocol::Curriculum)) {
        figures.extend(together(analysis, "plasticity", "Plasticity measures during the curriculum", &arms));
        figures.extend(by_layer(analysis, &arms));
    }
    let has_curriculum = |afresh: usize| analysis.against_afresh.iter().any(|against| against.afresh == afresh);
    let alone: Vec<(usize, &Arm)> =
        arms_of(analysis, Protocol::Afresh).into_iter().filter(|&(index, _)| !has_curriculum(index)).collect();
    let title = "Plasticity measures of fresh agents, level beside level";
    figures.extend(together(analysis, "plasticity-afresh", title, &alone));
    figures.extend(analysis.against_afresh.iter().filter_map(|against| against_afresh(analysis, against)));
    figures
}

/// The arms that have logged plasticity as lines in their own styles, and a sentence on those that have not.
fn logged<'a>(analysis: &Analysis, arms: &[(usize, &'a Arm)]) -> (Vec<usize>, Vec<Line<'a>>, String) {
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
fn layer_note(lines: &[Line]) -> String {
    let mut layers: Vec<String> = lines.iter().filter_map(|line| line.layer.map(str::to_owned)).collect();
    layers.sort();
    layers.dedup();
    format!(
        "Units, ranks and weights are those of the last hidden layer of the network that chooses actions ({}); gradient \
         and update are of all parameters.",
        layers.join(", ")
    )
}

/// All these arms in one figure, of the last hidden layers.
fn together(analysis: &Analysis, name: &str, title: &str, arms: &[(usize, &Arm)]) -> Option<NamedFigure> {
    let (indices, lines, not_logged) = logged(analysis, arms);
    let trained = |level: &usize| lines.iter().any(|line| levels_of(line.arm).contains(level));
    let levels = match lines.first()?.arm {
        arm if arm.protocol == Protocol::Curriculum => levels_of(arm),
        _ => (0..analysis.levels.len()).filter(trained).collect(),
    };
    let timeline = Timeline::new(&lines.iter().map(|line| line.arm).collect::<Vec<_>>(), &levels);
    Some(NamedFigure {
        name: name.to_owned(),
        topic: Topic::Plasticity,
        caption: caption::join([
            format!("{title}. {}", layer_note(&lines)),
            of_seeds(analysis, &timeline, &indices),
            not_logged,
        ]),
        drawing: chart(&timeline, About::new(title, "A panel per measure."), panels(analysis, &timeline, &lines, true)),
        tables: indices.iter().map(|&arm| plasticity_name(&analysis.arms[arm])).collect(),
    })
}

/// One arm in its curriculum and afresh; the runs afresh stand where the curriculum trains on their level.
fn against_afresh(analysis: &Analysis, against: &AgainstAfresh) -> Option<NamedFigure> {
    let both = [against.curriculum, against.afresh];
    let [arm, other] = both.map(|index| &analysis.arms[index]);
    if arm.plasticity.is_empty() || other.plasticity.is_empty() {
        return None;
    }
    let timeline = Timeline::new(&[arm, other], &levels_of(arm));
    let name = format!("{} in the curriculum", arm.name);
    let lines = [
        Line { arm, name, style: style(analysis, against.curriculum), layer: acting_layer(arm) },
        Line { arm: other, name: "afresh".to_owned(), style: AFRESH, layer: acting_layer(other) },
    ];
    let title = format!("{}: plasticity in the curriculum and afresh", arm.name);
    Some(NamedFigure {
        name: format!("plasticity-against-afresh-{}", file_name(&arm.name)),
        topic: Topic::Plasticity,
        caption: caption::join([
            format!("{title}, each fresh agent where the curriculum trains on its level. {}", layer_note(&lines)),
            of_seeds(analysis, &timeline, &both),
        ]),
        drawing: chart(&timeline, About::new(title, "A panel per measure."), panels(analysis, &timeline, &lines, true)),
        tables: vec![plasticity_differences_name(arm)],
    })
}

/// Every hidden layer but those of the main figure, and the weights of all layers.
fn by_layer(analysis: &Analysis, arms: &[(usize, &Arm)]) -> Vec<NamedFigure> {
    let (indices, lines, _) = logged(analysis, arms);
    let Some(first) = lines.first() else { return Vec::new() };
    let timeline = Timeline::new(&lines.iter().map(|line| line.arm).collect::<Vec<_>>(), &levels_of(first.arm));
    let all_layers = |measure: &str| {
        let layers: BTreeSet<&str> = lines.iter().flat_map(|line| layers(line.arm, measure)).collect();
        let mut layers: Vec<&str> = layers.into_iter().collect();
        layers.sort_by_key(|layer| layer_order(layer));
        layers
    };
    let of_layer = |layer: &str| {
        let in_it = |line: &&Line| layers(line.arm, HIDDEN).contains(&layer);
        let with: Vec<Line> = lines.iter().filter(in_it).cloned().collect();
        // The main figure has it already.
        if with.iter().all(|line| line.layer == Some(layer)) {
            return None;
        }
        let shown: Vec<usize> =
            indices.iter().zip(&lines).filter(|(_, line)| in_it(line)).map(|(index, _)| *index).collect();
        let with: Vec<Line> = with.into_iter().map(|line| Line { layer: Some(layer), ..line }).collect();
        let title = format!("Hidden layer {layer} during the curriculum");
        Some(NamedFigure {
            name: format!("plasticity-{}", file_name(layer)),
            topic: Topic::PlasticityByLayer,
            caption: caption::join([format!("{title}."), of_seeds(analysis, &timeline, &shown)]),
            drawing: chart(
                &timeline,
                About::new(title, "A panel per measure."),
                panels(analysis, &timeline, &with, false),
            ),
            tables: Vec::new(),
        })
    };
    let mut figures: Vec<NamedFigure> = all_layers(HIDDEN).into_iter().filter_map(of_layer).collect();
    let weights_of = |layer: &str| {
        let column = |_: &Line| Some(format!("{PREFIX}{layer}/{WEIGHTS}"));
        panel(analysis, &timeline, &lines, format!("layer {layer}"), column)
    };
    let weights: Vec<CurvePanel> = all_layers(WEIGHTS).into_iter().filter_map(weights_of).collect();
    if !weights.is_empty() {
        let title = "Mean magnitude of the weights of every layer, the output layers' too";
        figures.push(NamedFigure {
            name: "plasticity-weights".to_owned(),
            topic: Topic::PlasticityByLayer,
            caption: caption::join([format!("{title}."), of_seeds(analysis, &timeline, &indices)]),
            drawing: chart(&timeline, About::new(title, "A panel per layer."), weights),
            tables: Vec::new(),
        });
    }
    figures
}
