//! Arms against each other: how probably a run of the one does better than a run of the other.

use charts::{About, Axis, IntervalChart, IntervalPanel, IntervalSeries, Layout, Orientation, Reference, Style, Width};
use rl_stats::few::FEW;
use rl_stats::pairs::estimate_probability_of_improvement;
use rl_stats::{Bootstrap, Estimate};
use serde::Serialize;

use super::exhibit::{Definition, Exhibit, NamedFigure, NamedTable};
use super::parts::caption;
use super::parts::notes::level_names;
use super::parts::style::{PROTOCOLS, point, short_name};
use crate::report::analysis::{Analysis, Arm, LevelOutcome};
use crate::report::table::{Cell, Table};

/// The name of the table and the figure.
const NAME: &str = "probability-of-improvement";

/// Each two arms of one protocol, unpaired.
#[derive(Debug, Serialize)]
#[serde(transparent)]
pub struct Improvements {
    /// Of each two.
    pub pairs: Vec<Improvement>,
}

/// Two arms of one protocol, compared on the returns right after training on each level.
#[derive(Clone, Debug, Serialize)]
pub struct Improvement {
    /// Index of the arm that may be better.
    pub x: usize,
    /// Index of the other.
    pub y: usize,
    /// Indices of the levels that both have results on.
    pub levels: Vec<usize>,
    /// The probability that a run of x earns more than a run of y on the same level, ties half, averaged over levels;
    /// runs are not paired (Agarwal et al. 2021).
    pub probability: Estimate,
}

/// Every two arms of one protocol and sequence, forks after one stage; that of y over x is 1 minus that of x over y.
fn between(arms: &[Arm], bootstrap: &Bootstrap) -> Vec<Improvement> {
    let mut all = Vec::new();
    for (x, arm) in arms.iter().enumerate() {
        // Other levels or none have gone before in another sequence, or up to another checkpoint.
        let past = |arm: &Arm| (arm.protocol, arm.sequence.clone(), arm.treatment.as_ref().map(|t| t.after));
        for (y, other) in arms.iter().enumerate().skip(x + 1).filter(|(_, other)| past(other) == past(arm)) {
            let both = arm.levels.iter().zip(&other.levels).enumerate();
            let shared: Vec<(usize, &LevelOutcome, &LevelOutcome)> =
                both.filter_map(|(level, (a, b))| Some((level, a.as_ref()?, b.as_ref()?))).collect();
            if shared.is_empty() {
                continue;
            }
            let returns = |outcome: &LevelOutcome| outcome.seeds.values().map(|seed| seed.mean).collect::<Vec<f64>>();
            let of_x: Vec<Vec<f64>> = shared.iter().map(|(_, outcome, _)| returns(outcome)).collect();
            let of_y: Vec<Vec<f64>> = shared.iter().map(|(_, _, outcome)| returns(outcome)).collect();
            let probability = estimate_probability_of_improvement(bootstrap, &of_x, &of_y);
            all.push(Improvement { x, y, levels: shared.iter().map(|(level, ..)| *level).collect(), probability });
        }
    }
    all
}

impl Improvements {
    /// Of all arms.
    pub fn new(analysis: &Analysis) -> Self {
        Self { pairs: between(&analysis.arms, &analysis.conventions.bootstrap) }
    }
}

impl Exhibit for Improvements {
    fn key(&self) -> &'static str {
        "improvements"
    }

    fn heading(&self) -> &'static str {
        "Arms against each other"
    }

    fn absence(&self) -> &'static str {
        "No two arms have finished the same level in the same way."
    }

    fn definitions(&self) -> Vec<Definition> {
        vec![Definition {
            name: "probability of improvement",
            meaning:
                "share of pairs, a run of X and one of Y on the same level, in which X earns more; ties count half; \
                 averaged over levels"
                    .to_owned(),
            place: "over-seeds-and-levels-agarwal-et-al-2021",
        }]
    }

    fn numbers(&self) -> serde_json::Result<Option<String>> {
        serde_json::to_string(self).map(Some)
    }

    fn tables(&self, analysis: &Analysis) -> Vec<NamedTable> {
        vec![NamedTable::new(NAME, self.table(analysis))]
    }

    fn figures(&self, analysis: &Analysis) -> Vec<NamedFigure> {
        self.figure(analysis).into_iter().collect()
    }
}

impl Improvements {
    /// The least number of runs in a comparison.
    fn fewest(&self) -> usize {
        self.pairs.iter().map(|pair| pair.probability.runs).min().unwrap_or(0)
    }

    fn table(&self, analysis: &Analysis) -> Table {
        let name = |arm: usize| Cell::from(analysis.arms[arm].name.as_str());
        let row = |improvement: &Improvement| {
            let levels = level_names(analysis, &improvement.levels);
            vec![name(improvement.x), name(improvement.y), levels.into(), Cell::estimate(&improvement.probability, 3)]
        };
        let confidence = 100.0 * analysis.conventions.bootstrap.confidence;
        let interval = if self.fewest() < FEW {
            format!(
                "[low, high]: {confidence:.0}% interval, exact (Clopper-Pearson), of as many pairs as the smaller arm \
                 has seeds; from {FEW} seeds on percentile bootstrap."
            )
        } else {
            format!("[low, high]: {confidence:.0}% interval, percentile bootstrap over seeds.")
        };
        let mut notes = vec!["Unpaired, ties half, averaged over levels.".to_owned(), interval];
        if self.fewest() == 1 {
            notes.push("One seed has no interval.".to_owned());
        }
        let title = "Probability that a run of X earns more right after training than a run of Y";
        Table::new(title, ["X", "Y", "levels", "P(X > Y)"], self.pairs.iter().map(row).collect(), notes)
    }

    /// The probability of improvement of each two arms, a figure per protocol.
    fn figure(&self, analysis: &Analysis) -> Option<NamedFigure> {
        let mut panels = Vec::new();
        let mut shown = Vec::new();
        for (protocol, title) in PROTOCOLS {
            let pairs: Vec<&Improvement> =
                self.pairs.iter().filter(|pair| analysis.arms[pair.x].protocol == protocol).collect();
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
            name: NAME.to_owned(),
            caption: caption::join([
                "Probability that a run of the first arm earns more than a run of the second right after training \
                 on the same level. It is averaged over levels; runs are not paired."
                    .to_owned(),
                caption::seeds(analysis, &shown),
                caption::improvements(analysis, &shown, self.fewest()),
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
            tables: vec![NAME.to_owned()],
        })
    }
}
