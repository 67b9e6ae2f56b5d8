//! What arms earn on each level right after training on it.

use charts::{About, Axis, IntervalChart, IntervalPanel, IntervalSeries, Layout, Reference, Segment, Width};

use super::exhibit::{Definition, Exhibit, NamedFigure, NamedTable};
use super::parts::caption;
use super::parts::notes::{columns, interval_note, median_note, of_paper, percentile_note};
use super::parts::returns::{Mean, Spread, arm_row, planner_rows, published, published_note, published_row};
use super::parts::style::{PLANNERS, PROTOCOLS, arms_of, level_label, point, short_name, style};
use crate::report::analysis::{Analysis, Arm, LevelInfo, Planner, Protocol};
use crate::report::table::{Cell, Table};

/// The table of mean returns.
const RIGHT_AFTER: &str = "right-after-training";
/// The table of all statistics, and the figure.
const RETURNS: &str = "returns";

/// Returns right after training.
pub struct Returns;

impl Exhibit for Returns {
    fn key(&self) -> &'static str {
        RETURNS
    }

    fn heading(&self) -> &'static str {
        "Returns right after training"
    }

    fn lead(&self) -> &'static str {
        "Runs are seeds: every interval is over seeds, none over episodes."
    }

    fn absence(&self) -> &'static str {
        "No stage is finished."
    }

    fn definitions(&self) -> Vec<Definition> {
        let one = |name, meaning: &str, place| Definition { name, meaning: meaning.to_owned(), place };
        vec![
            one(
                "normalised return",
                "(R + max_steps) / (R_opt + max_steps): 0 is the worst return there is, 1 the proved mean optimum over \
                 all start cells",
                "normalised-return",
            ),
            one(
                "interval",
                "95%, of the mean over seeds: Student's t of 2 or 3 seeds, studentised bootstrap of 4 to 29, percentile \
                 bootstrap of more; of ratios of means Fieller's of 2 to 29, percentile bootstrap of more; of curves at \
                 each point by itself; of shares of pairs (Clopper–Pearson) and of medians over seeds exact; one seed \
                 has none",
                "intervals",
            ),
        ]
    }

    fn tables(&self, analysis: &Analysis) -> Vec<NamedTable> {
        vec![NamedTable::main(RIGHT_AFTER, right_after(analysis)), NamedTable::new(RETURNS, by_level(analysis))]
    }

    fn figures(&self, analysis: &Analysis) -> Vec<NamedFigure> {
        figure(analysis).into_iter().collect()
    }
}

/// The paper's Table 5: what each arm earns on each level right after training on it.
pub fn right_after(analysis: &Analysis) -> Table {
    let of_arm = |arm: &Arm| arm.levels.iter().map(|level| level.as_ref().map(Mean::from)).collect::<Vec<_>>();
    let arms = || analysis.arms.iter().filter(|arm| arm.protocol != Protocol::Fork);
    let means: Vec<Vec<Option<Mean>>> = arms().map(of_arm).collect();
    let spread = Spread::of(means.iter().flatten());
    let (mut rows, mut published_arms) = (Vec::new(), Vec::new());
    for (arm, means) in arms().zip(&means) {
        rows.push(arm_row(arm, means, spread));
        // What is earned after a stage depends on all stages before it.
        let shared = |column: usize, stages: usize| column < stages;
        if let Some(row) = published_row(analysis, arm, |paper| &paper.right_after, shared) {
            rows.push(row);
            published_arms.push(arm);
        }
    }
    rows.extend(planner_rows(analysis, (0..analysis.levels.len()).collect::<Vec<_>>().as_slice()));
    let mut notes = vec![spread.note()];
    if let Some(paper) = &analysis.published {
        rows.push(published("A* (published)", analysis, &paper.right_after_astar, |_| true));
        notes.push(published_note(paper, &published_arms));
    }
    let title = format!("Return on each level right after training on it{}", of_paper(analysis, "the paper's Table 5"));
    Table::new(title, columns(&["arm", "seeds"], analysis, 0..analysis.levels.len()), rows, notes)
}

/// The same in full: mean, median and interquartile mean over seeds, level by level, with their intervals.
pub fn by_level(analysis: &Analysis) -> Table {
    let mut rows = Vec::new();
    let mut shown = Vec::new();
    for (index, arm) in analysis.arms.iter().enumerate() {
        for (level, outcome) in analysis.levels.iter().zip(&arm.levels) {
            let Some(outcome) = outcome else { continue };
            let returns = [&outcome.return_mean, &outcome.return_median, &outcome.return_iqm];
            let fixed: [Cell; 3] =
                [arm.name.as_str().into(), level.name.as_str().into(), Cell::count(outcome.return_mean.runs)];
            let cells = returns.into_iter().map(|estimate| Cell::estimate(estimate, 2));
            rows.push(fixed.into_iter().chain(cells).chain([Cell::estimate(&outcome.normalised, 3)]).collect());
            shown.push((index, &outcome.return_mean));
        }
    }
    let columns = ["arm", "level", "seeds", "mean", "median", "IQM", "mean, normalised"];
    let notes = vec![
        interval_note(analysis, shown.iter().copied()),
        median_note(shown.iter().map(|(_, estimate)| estimate.runs)),
        percentile_note("IQMs", shown.iter().map(|(_, estimate)| estimate.runs)),
    ];
    Table::new("Return on each level right after training on it, over seeds", columns, rows, notes)
}

/// The average return of each arm on each level right after training on it; the paper's Figure 6 as its text says.
fn figure(analysis: &Analysis) -> Option<NamedFigure> {
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
        name: RETURNS.to_owned(),
        caption: caption::join([
            format!(
                "Average return on each level right after training on it{}. Greedy, from every start cell.",
                of_paper(analysis, "the paper's Figure 6 as its text says")
            ),
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
        tables: vec![RIGHT_AFTER.to_owned(), RETURNS.to_owned()],
    })
}

/// A* and the optimum, level by level.
fn planners(analysis: &Analysis) -> Vec<Reference> {
    let reference = |(name, planner): (&str, fn(&LevelInfo) -> &Option<Planner>)| {
        let segment = |(place, level): (usize, &LevelInfo)| {
            let value = planner(level).as_ref()?.mean;
            Some(Segment { from: place as f64, to: (place + 1) as f64, value })
        };
        let segments = analysis.levels.iter().enumerate().filter_map(segment).collect();
        Reference { name: name.to_owned(), segments }
    };
    let both = PLANNERS.map(reference);
    both.into_iter().filter(|reference| !reference.segments.is_empty()).collect()
}
