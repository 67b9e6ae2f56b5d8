//! What arms earn right after training, against each other, and on every level after every stage.

use charts::{
    About, Axis, HeatMap, HeatPanel, IntervalChart, IntervalPanel, IntervalSeries, Layout, Orientation, Reference,
    Segment, Style, Width,
};

use super::super::analysis::{Analysis, Arm, Improvement, LevelInfo, Matrix, MatrixRow, Planner, Protocol};
use super::super::topic::Topic;
use super::{NamedFigure, arms_of, caption, level_label, point, short_name, style};

/// The protocols in which arms are compared, and the titles of their panels.
const PROTOCOLS: [(Protocol, &str); 2] = [(Protocol::Curriculum, "in the curriculum"), (Protocol::Afresh, "afresh")];

pub(super) fn figures(analysis: &Analysis) -> Vec<NamedFigure> {
    [returns(analysis), improvement(analysis), matrices(analysis)].into_iter().flatten().collect()
}

/// The average return of each arm on each level right after training on it: the study's Figure 6 as its text says.
fn returns(analysis: &Analysis) -> Option<NamedFigure> {
    let has_results = |(_, arm): &(usize, &Arm)| arm.levels.iter().any(Option::is_some);
    let mut shown = Vec::new();
    let mut panels = Vec::new();
    for (protocol, title) in PROTOCOLS {
        let arms: Vec<(usize, &Arm)> = arms_of(analysis, protocol).into_iter().filter(has_results).collect();
        if arms.is_empty() {
            continue;
        }
        let series = |&(index, arm): &(usize, &Arm)| IntervalSeries {
            name: short_name(arm),
            style: style(analysis, index),
            estimates: arm
                .levels
                .iter()
                .map(|level| level.as_ref())
                .map(|level| level.map(|level| point(&level.return_mean, level.seeds.values().map(|seed| &seed.mean))))
                .collect(),
        };
        panels.push(IntervalPanel {
            title: title.to_owned(),
            categories: (0..analysis.levels.len()).map(|level| level_label(analysis, level)).collect(),
            series: arms.iter().map(series).collect(),
            references: planners(analysis),
        });
        shown.extend(arms.iter().map(|&(index, _)| index));
    }
    (!panels.is_empty()).then(|| NamedFigure {
        name: "returns".to_owned(),
        topic: Topic::Returns,
        caption: caption::join([
            "Average return on each level right after training on it (the study's Figure 6 as its text says), greedy, from \
             every start cell."
                .to_owned(),
            format!("Marks: means over seeds; dots: single seeds. {}", caption::seeds(analysis, &shown)),
            caption::intervals(analysis, &shown),
            "A dash at the bottom: no result.".to_owned(),
            caption::missing(analysis, &shown),
        ]),
        drawing: IntervalChart {
            about: About::new("Returns right after training", "Average return of each arm on each level."),
            layout: Layout { width: Width::Page, columns: 1, panel_height: 130.0 },
            values: Axis::new("average return"),
            panels,
            ..IntervalChart::default()
        }
        .draw(),
        tables: vec!["right-after-training".to_owned(), "optimality-gap".to_owned()],
    })
}

/// A* and the optimum, level by level.
fn planners(analysis: &Analysis) -> Vec<Reference> {
    let reference = |name: &str, planner: fn(&LevelInfo) -> &Option<Planner>| {
        let segment = |(place, level): (usize, &LevelInfo)| {
            let value = planner(level).as_ref()?.mean;
            Some(Segment { from: place as f64, to: (place + 1) as f64, value })
        };
        let segments = analysis.levels.iter().enumerate().filter_map(segment).collect();
        Reference { name: name.to_owned(), segments }
    };
    let both = [reference("A*", |level| &level.astar), reference("optimum", |level| &level.optimal)];
    both.into_iter().filter(|reference| !reference.segments.is_empty()).collect()
}

/// The probability of improvement of each two arms, a figure per protocol.
fn improvement(analysis: &Analysis) -> Option<NamedFigure> {
    let mut panels = Vec::new();
    let mut shown = Vec::new();
    for (protocol, title) in PROTOCOLS {
        let pairs: Vec<&Improvement> =
            analysis.improvements.iter().filter(|pair| analysis.arms[pair.x].protocol == protocol).collect();
        if pairs.is_empty() {
            continue;
        }
        let name = |pair: &&Improvement| {
            format!("{} > {}", short_name(&analysis.arms[pair.x]), short_name(&analysis.arms[pair.y]))
        };
        panels.push(IntervalPanel {
            title: title.to_owned(),
            categories: pairs.iter().map(name).collect(),
            series: vec![IntervalSeries {
                name: String::new(),
                style: Style(0),
                estimates: pairs.iter().map(|pair| Some(point(&pair.probability, []))).collect(),
            }],
            references: vec![Reference::across("no difference", 0.5)],
        });
        shown.extend(pairs.iter().flat_map(|pair| [pair.x, pair.y]));
    }
    shown.sort_unstable();
    shown.dedup();
    (!panels.is_empty()).then(|| NamedFigure {
        name: "probability-of-improvement".to_owned(),
        topic: Topic::Returns,
        caption: caption::join([
            "Probability that a run of the first arm earns more right after training than a run of the second on the same \
             level, averaged over levels; runs are not paired."
                .to_owned(),
            caption::seeds(analysis, &shown),
            caption::intervals(analysis, &shown),
            caption::missing(analysis, &shown),
        ]),
        drawing: IntervalChart {
            about: About::new("Probability of improvement", "Each two arms, right after training on each level."),
            layout: Layout { width: Width::Page, columns: panels.len(), panel_height: 60.0 },
            orientation: Orientation::Horizontal,
            values: Axis { range: Some((-0.03, 1.03)), ..Axis::new("probability of improvement") },
            panels,
            ..IntervalChart::default()
        }
        .draw(),
        tables: vec!["probability-of-improvement".to_owned()],
    })
}

/// R[i, j] of every curriculum, as it is.
fn matrices(analysis: &Analysis) -> Option<NamedFigure> {
    const COLUMNS: usize = 3;
    let with_matrix = |(index, arm): (usize, &'_ Arm)| arm.matrix.is_some().then_some(index);
    let arms: Vec<usize> = analysis.arms.iter().enumerate().filter_map(with_matrix).collect();
    let name = |level: usize| analysis.levels[level].name.clone();
    let panel = |&arm: &usize| {
        let arm = &analysis.arms[arm];
        let row = |row: &MatrixRow| row.cells.iter().map(|cell| cell.as_ref().map(|cell| cell.mean)).collect();
        let of_matrix = |matrix: &Matrix| HeatPanel {
            title: arm.name.clone(),
            rows: matrix.rows.iter().map(|r| r.after.map_or("before".to_owned(), |stage| name(stage.level))).collect(),
            columns: matrix.levels.iter().map(|&level| name(level)).collect(),
            cells: matrix.rows.iter().map(row).collect(),
        };
        arm.matrix.as_ref().map(of_matrix)
    };
    let panels: Vec<HeatPanel> = arms.iter().filter_map(panel).collect();
    (!panels.is_empty()).then(|| NamedFigure {
        name: "matrices".to_owned(),
        topic: Topic::Matrix,
        caption: caption::join([
            "R[i, j]: mean return on each level (columns) after each stage (rows: the level last trained on), greedy, from \
             every start cell. On the diagonal is what was just trained on."
                .to_owned(),
            format!("Means over seeds. {} Hatched: no result.", caption::seeds(analysis, &arms)),
            caption::missing(analysis, &arms),
        ]),
        drawing: HeatMap {
            about: About::new("Returns on every level after every stage", "A matrix per arm; the diagonal stands out."),
            layout: Layout {
                width: if panels.len() > 1 { Width::Page } else { Width::Column },
                columns: panels.len().min(COLUMNS),
                ..Layout::default()
            },
            row_label: "after training on level".to_owned(),
            column_label: "evaluated on level".to_owned(),
            values: Axis::new("return"),
            decimals: 1,
            panels,
        }
        .draw(),
        tables: arms.iter().map(|&arm| super::super::tables::matrix_name(&analysis.arms[arm])).collect(),
    })
}
