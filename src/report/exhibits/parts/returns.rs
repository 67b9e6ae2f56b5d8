//! Mean returns as rows of tables: arms', planners' and those that the paper printed.

use super::notes::deviation_note;
use super::style::PLANNERS;
use crate::report::analysis::{Analysis, Arm, LevelInfo, LevelOutcome, MatrixCell, Planner};
use crate::report::published::{Published, PublishedArm, PublishedMean};
use crate::report::table::Cell;

/// A mean return, as a table shows it.
#[derive(Clone, Copy)]
pub struct Mean {
    mean: f64,
    /// Over seeds, of several.
    std: Option<f64>,
    /// Over start cells, of one seed.
    std_over_starts: Option<f64>,
    seeds: usize,
}

impl From<&LevelOutcome> for Mean {
    fn from(outcome: &LevelOutcome) -> Self {
        let one = outcome.seeds.values().next().filter(|_| outcome.seeds.len() == 1);
        let std_over_starts = one.map(|seed| seed.std);
        Self { mean: outcome.mean, std: outcome.std, std_over_starts, seeds: outcome.seeds.len() }
    }
}

impl From<&MatrixCell> for Mean {
    fn from(cell: &MatrixCell) -> Self {
        Self { mean: cell.mean, std: cell.std, std_over_starts: cell.std_over_starts, seeds: cell.seeds.len() }
    }
}

/// What the numbers after ± are, in all of a table: one that is over seeds in some cells cannot be over start cells in
/// others.
#[derive(Clone, Copy, PartialEq)]
pub enum Spread {
    /// Over seeds.
    Seeds,
    /// Over the start cells of one seed each, where no cell has more.
    Starts,
}

impl Spread {
    pub fn of<'a>(mut cells: impl Iterator<Item = &'a Option<Mean>>) -> Self {
        if cells.any(|cell| cell.is_some_and(|mean| mean.seeds > 1)) { Self::Seeds } else { Self::Starts }
    }

    pub fn note(self) -> String {
        match self {
            Self::Seeds => {
                "Mean ± population standard deviation over seeds, each the mean over every start cell; of one \
                            seed there is none."
                    .to_owned()
            }
            Self::Starts => deviation_note(1),
        }
    }
}

/// The most seeds that one of these has.
pub fn most_seeds<'a>(means: impl Iterator<Item = &'a Option<Mean>>) -> usize {
    means.flatten().map(|mean| mean.seeds).max().unwrap_or(0)
}

/// A mean in a row that says it is of `row` seeds.
pub fn mean_cell(mean: &Option<Mean>, spread: Spread, row: usize) -> Cell {
    let Some(mean) = mean else { return Cell::Missing };
    let std = if spread == Spread::Seeds { mean.std } else { mean.std_over_starts };
    Cell::MeanStd(mean.mean, std).of_seeds(mean.seeds, row)
}

pub fn arm_row(arm: &Arm, means: &[Option<Mean>], spread: Spread) -> Vec<Cell> {
    let seeds = most_seeds(means.iter());
    let cells = means.iter().map(|mean| mean_cell(mean, spread, seeds));
    [arm.name.as_str().into(), Cell::count(seeds)].into_iter().chain(cells).collect()
}

/// The means of A* and of the optimum on these levels.
pub fn planner_rows(analysis: &Analysis, levels: &[usize]) -> Vec<Vec<Cell>> {
    let row = |(name, planner): (&str, fn(&LevelInfo) -> &Option<Planner>)| {
        let cell = |&level: &usize| {
            planner(&analysis.levels[level]).as_ref().map_or(Cell::Missing, |p| Cell::Number(p.mean, 2))
        };
        [name.into(), "".into()].into_iter().chain(levels.iter().map(cell)).collect()
    };
    PLANNERS.map(row).to_vec()
}

/// What the paper printed for the model that an arm repeats. `is_shared` tells of a column, and of how many stages the
/// arm has in common with the paper's sequence, whether the two have been trained alike; none where no column is.
pub fn published_row(
    analysis: &Analysis,
    arm: &Arm,
    of: impl Fn(&Published) -> &[PublishedArm; 3],
    is_shared: impl Fn(usize, usize) -> bool,
) -> Option<Vec<Cell>> {
    let values = of(analysis.published.as_ref()?).iter().find(|published| published.preset == arm.preset)?;
    let stages = analysis.stages_of_paper(arm);
    let is_shown = |column: usize| is_shared(column, stages);
    let any = (0..analysis.levels.len()).filter_map(|level| analysis.paper_column(level)).any(is_shown);
    let label = format!("{} (published)", arm.preset);
    any.then(|| published(&label, analysis, &values.levels, is_shown))
}

/// A row of the paper's, with its columns in the order of the levels here.
pub fn published(
    label: &str,
    analysis: &Analysis,
    values: &[PublishedMean; 5],
    is_shown: impl Fn(usize) -> bool,
) -> Vec<Cell> {
    let cell = |level: usize| match analysis.paper_column(level).filter(|&column| is_shown(column)) {
        Some(column) => Cell::MeanStd(values[column].mean, Some(values[column].std)),
        None => Cell::Missing,
    };
    [label.into(), Cell::count(1)].into_iter().chain((0..analysis.levels.len()).map(cell)).collect()
}

/// What the published rows are, and which of the arms that they stand below were trained for another time.
pub fn published_note(paper: &Published, arms: &[&Arm]) -> String {
    let dqn = if arms.iter().any(|arm| arm.preset == "dqn") { " (DQN 1,000,000)" } else { "" };
    let mut note = format!(
        "Published: what the paper printed, of one seed, trained for 500,000 timesteps per level{dqn}. Its ± is over \
         episodes from drawn start cells."
    );
    let other_time = |arm: &&Arm| {
        let published = paper.timesteps(&arm.preset)?;
        let here = arm.stages.iter().map(|stage| stage.timesteps).find(|&timesteps| timesteps != published)?;
        Some(format!("{} ({here} timesteps on a level, not {published})", arm.name))
    };
    let others: Vec<String> = arms.iter().filter_map(other_time).collect();
    if !others.is_empty() {
        note += &format!(" Trained for another time here: {}.", others.join(", "));
    }
    note
}
