//! Measures of continual learning, per seed and over seeds, of normalised returns.

mod measures;

use std::collections::BTreeMap;

use charts::{About, Axis, IntervalChart, IntervalPanel, IntervalSeries, Layout, Reference, Width};
use rl_stats::Estimate;
use rl_stats::continual::ReturnMatrix;
use serde::{Serialize, Serializer};

use measures::FORGETTING;
pub use measures::{MEASURES, Measure};

use super::exhibit::{Definition, Exhibit, NamedFigure, NamedTable};
use super::from_scratch::{TRANSFER_BY_AREAS, transfer_by_areas};
use super::parts::caption;
use super::parts::notes::{columns, interval_note, ratio_note};
use super::parts::style::{level_label, point, style};
use crate::report::analysis::{Analysis, Matrix, MatrixCell, MatrixRow, OverSeeds};
use crate::report::parallel;
use crate::report::table::{Cell, Table};
use crate::results::Policy;

/// The section of docs/metrics.md, and the name of the main table and figure.
const PLACE: &str = "continual-learning";
/// The key in `report.json`.
pub const KEY: &str = "continual";

/// The measures of every arm.
#[derive(Debug, Serialize)]
#[serde(transparent)]
pub struct Continual {
    /// In the order of the arms; null where no seed has finished all stages, or an optimum is unknown.
    pub arms: Vec<Option<Measured>>,
}

/// The measures of a curriculum; only seeds that have finished all stages count.
#[derive(Debug, Serialize)]
pub struct Measured {
    /// In the order of [`MEASURES`].
    #[serde(flatten, serialize_with = "by_key")]
    pub values: Vec<Option<OverSeeds>>,
    /// Forgetting on the level of each stage.
    pub forgetting_by_stage: Vec<Option<OverSeeds>>,
    /// See [`TRANSFER_BY_AREAS`].
    pub transfer_by_areas: Option<Estimate>,
}

fn by_key<S: Serializer>(values: &[Option<OverSeeds>], serializer: S) -> Result<S::Ok, S::Error> {
    serializer.collect_map(MEASURES.iter().map(Measure::key).zip(values))
}

impl Continual {
    /// Of every arm.
    pub fn new(analysis: &Analysis) -> Self {
        let of_arm = |index: &usize| Measured::new(analysis, *index, analysis.arms[*index].matrix.as_ref()?);
        Self { arms: parallel::map(&(0..analysis.arms.len()).collect::<Vec<usize>>(), of_arm) }
    }

    /// The measures that have a place in tables and figures, and their places in [`MEASURES`].
    fn shown(&self) -> impl Iterator<Item = (usize, &'static Measure)> {
        let is_there = |place: usize| self.measured().any(|(_, measured)| measured.values[place].is_some());
        let shown = move |(place, measure): &(usize, &Measure)| measure.policy == Policy::Greedy || is_there(*place);
        const { &MEASURES }.iter().enumerate().filter(shown)
    }

    /// The arms that have measures, by their indices.
    fn measured(&self) -> impl Iterator<Item = (usize, &Measured)> {
        self.arms.iter().enumerate().filter_map(|(index, measured)| Some((index, measured.as_ref()?)))
    }
}

impl Measured {
    fn new(analysis: &Analysis, arm: usize, matrix: &Matrix) -> Option<Self> {
        let matrices = seed_matrices(matrix, |cell| &cell.normalised_seeds);
        let sampled = seed_matrices(matrix, |cell| &cell.sampled_normalised_seeds);
        let stages = matrix.rows.len().saturating_sub(1);
        let over_seeds = |policy: Policy, of: &dyn Fn(&ReturnMatrix) -> Option<f64>| {
            let matrices = if policy == Policy::Greedy { &matrices } else { &sampled };
            let seeds = matrices.iter().filter_map(|(&seed, returns)| Some((seed, of(returns)?))).collect();
            OverSeeds::new(seeds, &analysis.conventions.bootstrap)
        };
        (!matrices.is_empty()).then(|| Self {
            values: MEASURES.iter().map(|measure| over_seeds(measure.policy, &measure.of)).collect(),
            forgetting_by_stage: (0..stages)
                .map(|stage| over_seeds(Policy::Greedy, &|r| Some(r.forgetting()[stage])))
                .collect(),
            transfer_by_areas: transfer_by_areas(analysis, arm),
        })
    }

    /// The value of a measure by its name.
    pub fn get(&self, name: &str) -> Option<&OverSeeds> {
        let place = MEASURES.iter().position(|measure| measure.name == name)?;
        self.values[place].as_ref()
    }

    /// The first measure, which every seed has that has any.
    fn first(&self) -> Option<&OverSeeds> {
        self.values.first()?.as_ref()
    }

    fn seeds(&self) -> usize {
        self.first().map_or(0, |first| first.seeds.len())
    }
}

/// The whole matrices of these normalised returns, by seed: a column per stage, so that a level that comes again has several.
fn seed_matrices(matrix: &Matrix, returns: fn(&MatrixCell) -> &BTreeMap<u64, f64>) -> BTreeMap<u64, ReturnMatrix> {
    let Some((before, after)) = matrix.rows.split_first() else { return BTreeMap::new() };
    let of_stage = |row: &MatrixRow| matrix.levels.iter().position(|level| Some(*level) == row.after.map(|s| s.level));
    let Some(columns) = after.iter().map(of_stage).collect::<Option<Vec<usize>>>() else { return BTreeMap::new() };
    let last = after.last().and_then(|row| row.cells.first()?.as_ref());
    let of_seed = |&seed: &u64| {
        let row = |row: &MatrixRow| -> Option<Vec<f64>> {
            let cell = |&column: &usize| returns(row.cells[column].as_ref()?).get(&seed).copied();
            columns.iter().map(cell).collect()
        };
        let returns = ReturnMatrix::new(row(before)?, after.iter().map(row).collect::<Option<_>>()?);
        Some((seed, returns.of_tasks(&columns)))
    };
    last.into_iter().flat_map(|cell| cell.seeds.keys()).filter_map(of_seed).collect()
}

impl Exhibit for Continual {
    fn key(&self) -> &'static str {
        KEY
    }

    fn heading(&self) -> &'static str {
        "Continual learning"
    }

    fn lead(&self) -> &'static str {
        "Of normalised returns: 0 is the worst return there is, 1 the proved mean optimum. R[i, j] is the return on \
         the level of stage j after stage i. b[j] is the untrained model's; T is the number of stages."
    }

    fn absence(&self) -> &'static str {
        "No run has finished its curriculum, or a level has no proved optimum."
    }

    fn definitions(&self) -> Vec<Definition> {
        let definition = |measure: &Measure| Definition {
            name: measure.name,
            meaning: format!("{}: {}", measure.meaning, measure.formula),
            place: PLACE,
        };
        let areas = Definition { place: PLACE, ..TRANSFER_BY_AREAS.definition() };
        MEASURES.iter().map(definition).chain([areas]).collect()
    }

    fn numbers(&self) -> serde_json::Result<Option<String>> {
        serde_json::to_string(self).map(Some)
    }

    fn tables(&self, analysis: &Analysis) -> Vec<NamedTable> {
        vec![
            NamedTable::main(PLACE, self.measures_table(analysis)),
            NamedTable::new(FORGETTING, self.forgetting_table(analysis)),
        ]
    }

    fn figures(&self, analysis: &Analysis) -> Vec<NamedFigure> {
        if self.measured().next().is_none() {
            return Vec::new();
        }
        vec![self.measures_figure(analysis), self.forgetting_figure(analysis)]
    }
}

impl Continual {
    fn intervals(&self, analysis: &Analysis) -> String {
        let first = |(arm, measured): (usize, &'_ Measured)| Some((arm, measured.first()?.mean));
        let estimates: Vec<(usize, Estimate)> = self.measured().filter_map(first).collect();
        interval_note(analysis, estimates.iter().map(|(arm, estimate)| (*arm, estimate)))
    }

    /// A row per curriculum, a column per measure.
    fn measures_table(&self, analysis: &Analysis) -> Table {
        let row = |(arm, measured): (usize, &Measured)| {
            let seeds = measured.seeds();
            let cell = |(place, _): (usize, _)| {
                let value = measured.values[place].as_ref();
                let own = value.map_or(0, |value| value.seeds.len());
                Cell::estimate(value.map(|value| &value.mean), 3).of_seeds(own, seeds)
            };
            let areas = measured.transfer_by_areas.as_ref();
            let areas = Cell::estimate(areas, 3).of_seeds(areas.map_or(0, |areas| areas.runs), seeds);
            let fixed = [analysis.arms[arm].name.as_str().into(), Cell::count(seeds)];
            fixed.into_iter().chain(self.shown().map(cell)).chain([areas]).collect()
        };
        let measures = self.shown().map(|(_, measure)| measure.name).chain([TRANSFER_BY_AREAS.name]);
        let notes = vec![
            "Of seeds that have finished all stages. Transfer by areas is of those that have areas on all levels that \
             were also trained from scratch. docs/metrics.md defines the measures."
                .to_owned(),
            self.intervals(analysis),
            ratio_note(
                "Transfer by areas",
                self.measured().filter_map(|(_, measured)| measured.transfer_by_areas.as_ref()),
            ),
        ];
        let columns = ["arm", "seeds"].into_iter().chain(measures);
        Table::new("Continual learning, of normalised returns", columns, self.measured().map(row).collect(), notes)
    }

    /// What is lost on each level from the end of its own stage to the end of all.
    fn forgetting_table(&self, analysis: &Analysis) -> Table {
        let levels = 0..analysis.levels.len();
        let row = |(arm, measured): (usize, &Measured)| {
            let cell = |level| Cell::estimate(on_level(analysis, arm, measured, level).map(|lost| &lost.mean), 3);
            let fixed = [analysis.arms[arm].name.as_str().into(), Cell::count(measured.seeds())];
            fixed.into_iter().chain(levels.clone().map(cell)).collect()
        };
        Table::new(
            "Forgetting: normalised return right after a level's own stage minus at the end of all",
            columns(&["arm", "seeds"], analysis, levels.clone()),
            self.measured().map(row).collect(),
            vec![self.intervals(analysis)],
        )
    }

    /// What both captions end with.
    fn caption(&self, analysis: &Analysis, first: &str) -> String {
        let arms: Vec<usize> = self.measured().map(|(index, _)| index).collect();
        caption::join([
            first.to_owned(),
            "Marks: means over the seeds that have finished all stages; dots: single seeds.".to_owned(),
            caption::intervals(analysis, &arms),
            caption::missing(analysis, &arms),
        ])
    }

    /// Every measure, each arm's.
    fn measures_figure(&self, analysis: &Analysis) -> NamedFigure {
        let panel = |(place, measure): (usize, &Measure)| {
            let series = |(index, measured): (usize, &Measured)| IntervalSeries {
                name: analysis.arms[index].name.clone(),
                style: style(analysis, index),
                estimates: vec![measured.values[place].as_ref().map(over_seeds)],
            };
            IntervalPanel {
                title: measure.name.to_owned(),
                categories: vec![String::new()],
                series: self.measured().map(series).collect(),
                references: measure.is_change.then(|| Reference::across("no effect", 0.0)).into_iter().collect(),
            }
        };
        NamedFigure {
            name: PLACE.to_owned(),
            caption: self.caption(
                analysis,
                "Measures of continual learning, of normalised returns. Forgetting is a loss: above 0 something is \
                 forgotten. Transfer is a gain: below 0 the past harms.",
            ),
            drawing: IntervalChart {
                about: About::new("Continual learning", "Average performance, transfer and forgetting of each arm."),
                layout: Layout { width: Width::Page, columns: 3, panel_height: 95.0 },
                values: Axis::new("normalised return"),
                panels: self.shown().map(panel).collect(),
                ..IntervalChart::default()
            }
            .draw(),
            tables: vec![PLACE.to_owned()],
        }
    }

    /// What is lost of each level.
    fn forgetting_figure(&self, analysis: &Analysis) -> NamedFigure {
        let levels = 0..analysis.levels.len();
        let series = |(index, measured): (usize, &Measured)| IntervalSeries {
            name: analysis.arms[index].name.clone(),
            style: style(analysis, index),
            estimates: levels.clone().map(|l| on_level(analysis, index, measured, l).map(over_seeds)).collect(),
        };
        NamedFigure {
            name: FORGETTING.to_owned(),
            caption: self.caption(
                analysis,
                "Normalised return on each level right after its own stage minus at the end of all: above 0 it is \
                 forgotten. The last level is 0 by definition.",
            ),
            drawing: IntervalChart {
                about: About::new("Forgetting", "What each arm loses of each level."),
                layout: Layout { width: Width::Page, columns: 1, panel_height: 110.0 },
                values: Axis::new(FORGETTING),
                panels: vec![IntervalPanel {
                    categories: levels.clone().map(|level| level_label(analysis, level)).collect(),
                    series: self.measured().map(series).collect(),
                    references: vec![Reference::across("nothing forgotten", 0.0)],
                    ..IntervalPanel::default()
                }],
                ..IntervalChart::default()
            }
            .draw(),
            tables: vec![FORGETTING.to_owned()],
        }
    }
}

/// What an arm forgets of a level; none of a level that it has no stage on.
fn on_level<'a>(analysis: &Analysis, arm: usize, measured: &'a Measured, level: usize) -> Option<&'a OverSeeds> {
    let stage = analysis.arms[arm].stages.iter().position(|stage| stage.level == level)?;
    measured.forgetting_by_stage.get(stage)?.as_ref()
}

fn over_seeds(measure: &OverSeeds) -> charts::Estimate {
    point(&measure.mean, measure.seeds.values())
}
