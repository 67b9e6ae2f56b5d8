//! Returns as they are: the study's Tables 1 to 5, for every arm and stage.

use super::super::analysis::{Analysis, Arm, LevelInfo, LevelOutcome, Matrix, MatrixCell, MatrixRow, Planner};
use super::super::published::{Published, PublishedArm, PublishedMean};
use super::super::study::deviation_note;
use super::super::{Cell, Table};
use super::{columns, count, interval_note};

/// A mean return, as a table shows it.
#[derive(Clone, Copy)]
struct Mean {
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
enum Spread {
    /// Over seeds.
    Seeds,
    /// Over the start cells of one seed each, where no cell has more.
    Starts,
}

impl Spread {
    fn of<'a>(mut cells: impl Iterator<Item = &'a Option<Mean>>) -> Self {
        if cells.any(|cell| cell.is_some_and(|mean| mean.seeds > 1)) { Self::Seeds } else { Self::Starts }
    }

    fn note(self) -> String {
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

/// The study's Table 1, and the optimum that it did not have.
pub(super) fn planners(analysis: &Analysis) -> Table {
    let mut rows = Vec::new();
    for level in &analysis.levels {
        let planner = |name: &str, planner: &Option<Planner>| {
            let planner = planner.as_ref()?;
            let mut row: Vec<Cell> = vec![level.name.as_str().into(), name.into(), count(planner.starts.len())];
            let numbers = [(planner.mean, 2), (planner.std, 2), (planner.min as f64, 0), (planner.max as f64, 0)];
            row.extend(numbers.map(|(value, decimals)| Cell::Number(value, decimals)));
            row.push(Cell::Number(planner.length, 2));
            Some(row)
        };
        rows.extend(planner("A*", &level.astar));
        if let Some((study, column)) = published_column(analysis, level) {
            let [mean, min, max] = [study.astar_mean, study.astar_min, study.astar_max].map(|values| values[column]);
            let numbers = [Cell::Number(mean, 2), Cell::Missing, Cell::Number(min, 0), Cell::Number(max, 0)];
            let row = [level.name.as_str().into(), "A* (published)".into(), count(20)].into_iter().chain(numbers);
            rows.push(row.chain([Cell::Missing]).collect());
        }
        rows.extend(planner("optimal", &level.optimal));
        rows.extend(planner("random", &level.random));
    }
    let names = ["level", "planner", "episodes", "mean", "std", "min", "max", "mean length"];
    Table {
        title: "What planners earn (the study's Table 1)".to_owned(),
        columns: names.map(str::to_owned).to_vec(),
        rows,
        notes: vec!["One episode from every start cell; the published ones from 20 drawn start cells.".to_owned()],
    }
}

/// The study's Table 5: what each arm earns on each level right after training on it.
pub(super) fn right_after(analysis: &Analysis) -> Table {
    let of_arm = |arm: &Arm| arm.levels.iter().map(|level| level.as_ref().map(Mean::from)).collect::<Vec<_>>();
    let means: Vec<Vec<Option<Mean>>> = analysis.arms.iter().map(of_arm).collect();
    let spread = Spread::of(means.iter().flatten());
    let (mut rows, mut published_arms) = (Vec::new(), Vec::new());
    for (arm, means) in analysis.arms.iter().zip(&means) {
        rows.push(arm_row(arm, means, spread));
        // What is earned after a stage depends on all stages before it.
        let shared = |column: usize, stages: usize| column < stages;
        if let Some(row) = published_row(analysis, arm, |study| &study.right_after, shared) {
            rows.push(row);
            published_arms.push(arm);
        }
    }
    rows.extend(planner_rows(analysis, (0..analysis.levels.len()).collect::<Vec<_>>().as_slice()));
    let mut notes = vec![spread.note()];
    if let Some(study) = &analysis.published {
        rows.push(published("A* (published)", analysis, study, &study.right_after_astar, |_| true));
        notes.push(published_note(study, &published_arms));
    }
    Table {
        title: "Return on each level right after training on it (the study's Table 5)".to_owned(),
        columns: columns(&["arm", "seeds"], analysis.levels.iter().map(|level| level.name.clone())),
        rows,
        notes,
    }
}

/// The same in full: mean, median and interquartile mean over seeds, level by level, with their intervals.
pub(super) fn by_level(analysis: &Analysis) -> Table {
    let mut rows = Vec::new();
    let mut shown = Vec::new();
    for (index, arm) in analysis.arms.iter().enumerate() {
        for (level, outcome) in analysis.levels.iter().zip(&arm.levels) {
            let Some(outcome) = outcome else { continue };
            let returns = [&outcome.return_mean, &outcome.return_median, &outcome.return_iqm];
            let fixed: [Cell; 3] =
                [arm.name.as_str().into(), level.name.as_str().into(), count(outcome.return_mean.runs)];
            let cells = returns.into_iter().map(|estimate| Cell::estimate(estimate, 2));
            rows.push(fixed.into_iter().chain(cells).chain([Cell::estimate(&outcome.normalised, 3)]).collect());
            shown.push((index, &outcome.return_mean));
        }
    }
    let names = ["arm", "level", "seeds", "mean", "median", "IQM", "mean, normalised"];
    Table {
        title: "Return on each level right after training on it, over seeds".to_owned(),
        columns: names.map(str::to_owned).to_vec(),
        rows,
        notes: vec![interval_note(analysis, shown.into_iter())],
    }
}

/// Indices of the levels that some curriculum has a stage on.
pub(super) fn stage_levels(analysis: &Analysis) -> Vec<usize> {
    let matrices = || analysis.arms.iter().filter_map(|arm| arm.matrix.as_ref());
    (0..analysis.levels.len()).filter(|&level| matrices().any(|matrix| row_after(matrix, level).is_some())).collect()
}

/// The study's Tables 2 to 4: the return on every level after the stage on one of them, for every arm.
pub(super) fn after_stage(analysis: &Analysis, level: usize) -> Table {
    let of_arm = |arm: &Arm| {
        let matrix = arm.matrix.as_ref()?;
        let row = row_after(matrix, level)?;
        let cell = |level: usize| cell_on(matrix, row, level).map(Mean::from);
        Some((0..analysis.levels.len()).map(cell).collect::<Vec<_>>())
    };
    let means: Vec<(&Arm, Vec<Option<Mean>>)> =
        analysis.arms.iter().filter_map(|arm| Some((arm, of_arm(arm)?))).collect();
    let spread = Spread::of(means.iter().flat_map(|(_, means)| means));
    let own = &analysis.levels[level];
    let column = analysis.published.as_ref().filter(|study| study.evaluated_after(own)).and_then(|s| s.column(own));
    let (mut rows, mut published_arms) = (Vec::new(), Vec::new());
    for (arm, means) in &means {
        rows.push(arm_row(arm, means, spread));
        let trained = |_: usize, stages: usize| column.is_some_and(|column| column < stages);
        if let Some(row) = published_row(analysis, arm, |study| &study.after_level_3, trained) {
            rows.push(row);
            published_arms.push(*arm);
        }
    }
    let (mut title, mut notes) = ("", vec![spread.note()]);
    if let Some(study) = analysis.published.as_ref().filter(|_| !published_arms.is_empty()) {
        title = " (the study's Tables 2-4)";
        notes.push(published_note(study, &published_arms));
    }
    Table {
        title: format!("Return on every level after the stage on level {}{title}", own.name),
        columns: columns(&["arm", "seeds"], analysis.levels.iter().map(|level| level.name.clone())),
        rows,
        notes,
    }
}

/// R[i, j] of one arm.
pub(super) fn matrix(analysis: &Analysis, arm: &Arm, matrix: &Matrix) -> Table {
    let name = |level: usize| analysis.levels[level].name.clone();
    let of_row = |row: &MatrixRow| row.cells.iter().map(|cell| cell.as_ref().map(Mean::from)).collect::<Vec<_>>();
    let means: Vec<Vec<Option<Mean>>> = matrix.rows.iter().map(of_row).collect();
    let spread = Spread::of(means.iter().flatten());
    let seeds = most_seeds(means.iter().flatten());
    let row = |(row, means): (&MatrixRow, &Vec<Option<Mean>>)| {
        let label = row.after.map_or("before".to_owned(), |stage| format!("level {}", name(stage.level)));
        let cells = means.iter().map(|mean| mean_cell(mean, spread, seeds));
        [label.into()].into_iter().chain(cells).collect::<Vec<Cell>>()
    };
    let mut rows: Vec<Vec<Cell>> = matrix.rows.iter().zip(&means).map(row).collect();
    for mut planner in planner_rows(analysis, &matrix.levels) {
        planner.remove(1);
        rows.push(planner);
    }
    Table {
        title: format!(
            "{}: mean return on each level (columns) after each stage (rows: level last trained on)",
            arm.name
        ),
        columns: columns(&["last trained on"], matrix.levels.iter().map(|&level| name(level))),
        rows,
        notes: vec![deviation_note(seeds)],
    }
}

fn row_after(matrix: &Matrix, level: usize) -> Option<&MatrixRow> {
    matrix.rows.iter().find(|row| row.after.is_some_and(|stage| stage.level == level))
}

fn cell_on<'a>(matrix: &Matrix, row: &'a MatrixRow, level: usize) -> Option<&'a MatrixCell> {
    let column = matrix.levels.iter().position(|&column| column == level)?;
    row.cells[column].as_ref()
}

/// The most seeds that one of these has.
fn most_seeds<'a>(means: impl Iterator<Item = &'a Option<Mean>>) -> usize {
    means.flatten().map(|mean| mean.seeds).max().unwrap_or(0)
}

/// A mean in a row that says it is of `row` seeds.
fn mean_cell(mean: &Option<Mean>, spread: Spread, row: usize) -> Cell {
    let Some(mean) = mean else { return Cell::Missing };
    let std = if spread == Spread::Seeds { mean.std } else { mean.std_over_starts };
    Cell::MeanStd(mean.mean, std).of_seeds(mean.seeds, row)
}

fn arm_row(arm: &Arm, means: &[Option<Mean>], spread: Spread) -> Vec<Cell> {
    let seeds = most_seeds(means.iter());
    let cells = means.iter().map(|mean| mean_cell(mean, spread, seeds));
    [arm.name.as_str().into(), count(seeds)].into_iter().chain(cells).collect()
}

fn planner_rows(analysis: &Analysis, levels: &[usize]) -> Vec<Vec<Cell>> {
    let row = |name: &str, of: fn(&LevelInfo) -> &Option<Planner>| {
        let cell =
            |&level: &usize| of(&analysis.levels[level]).as_ref().map_or(Cell::Missing, |p| Cell::Number(p.mean, 2));
        [name.into(), "".into()].into_iter().chain(levels.iter().map(cell)).collect()
    };
    vec![row("A*", |level| &level.astar), row("optimal", |level| &level.optimal)]
}

/// The study and the column it has for a level.
fn published_column<'a>(analysis: &'a Analysis, level: &LevelInfo) -> Option<(&'a Published, usize)> {
    let study = analysis.published.as_ref()?;
    Some((study, study.column(level)?))
}

/// What the study printed for the model that an arm repeats. `is_shared` tells of a column, and of how many stages the
/// arm has in common with the study's curriculum, whether the two have been trained alike; none where no column is.
fn published_row(
    analysis: &Analysis,
    arm: &Arm,
    of: impl Fn(&Published) -> &[PublishedArm; 3],
    is_shared: impl Fn(usize, usize) -> bool,
) -> Option<Vec<Cell>> {
    let study = analysis.published.as_ref()?;
    let values = of(study).iter().find(|published| published.preset == arm.preset)?;
    let stages = study.shared_stages(arm, &analysis.levels);
    let shown = |column: usize| is_shared(column, stages);
    let any = analysis.levels.iter().filter_map(|level| study.column(level)).any(shown);
    let label = format!("{} (published)", arm.preset);
    any.then(|| published(&label, analysis, study, &values.levels, shown))
}

/// A row of the study's, with its columns in the order of the levels here.
fn published(
    label: &str,
    analysis: &Analysis,
    study: &Published,
    values: &[PublishedMean; 5],
    is_shown: impl Fn(usize) -> bool,
) -> Vec<Cell> {
    let cell = |level: &LevelInfo| match study.column(level).filter(|&column| is_shown(column)) {
        Some(column) => Cell::MeanStd(values[column].mean, Some(values[column].std)),
        None => Cell::Missing,
    };
    [label.into(), count(1)].into_iter().chain(analysis.levels.iter().map(cell)).collect()
}

/// What the published rows are, and which of the arms that they stand below were trained for another time.
fn published_note(study: &Published, arms: &[&Arm]) -> String {
    let mut note =
        "Published: one seed, 500,000 timesteps per level (DQN 1,000,000), ± over episodes from drawn start \
                    cells."
            .to_owned();
    let other_time = |arm: &&Arm| {
        let published = study.right_after.iter().find(|published| published.preset == arm.preset)?.timesteps;
        let here = arm.stages.iter().map(|stage| stage.timesteps).find(|&timesteps| timesteps != published)?;
        Some(format!("{} ({here} timesteps on a level, not {published})", arm.name))
    };
    let others: Vec<String> = arms.iter().filter_map(other_time).collect();
    if !others.is_empty() {
        note += &format!(" Trained for another time here: {}.", others.join(", "));
    }
    note
}
