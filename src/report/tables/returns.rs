//! Returns as they are: the study's Tables 1 to 5, for every arm and stage.

use super::super::analysis::{Analysis, Arm, LevelInfo, Matrix, MatrixCell, MatrixRow, Planner};
use super::super::published::{Published, PublishedArm, PublishedMean};
use super::super::study::deviation_note;
use super::super::{Cell, Table};
use super::{columns, count};

/// The level after whose stage the study evaluated its models on all levels.
const STUDY_LEVEL: &str = "3";

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
    let mut rows = Vec::new();
    for arm in &analysis.arms {
        let cells = arm.levels.iter().map(|level| level.as_ref().map(|level| (level.mean, level.std)));
        rows.push(arm_row(arm, cells));
        if arm.matrix.is_some() {
            rows.extend(published_row(analysis, arm, |study| &study.right_after));
        }
    }
    rows.extend(planner_rows(analysis, (0..analysis.levels.len()).collect::<Vec<_>>().as_slice()));
    if let Some(study) = &analysis.published {
        rows.push(published(analysis, "A* (published)", study, &study.right_after_astar));
    }
    let most = analysis.arms.iter().flat_map(|arm| &arm.levels).flatten().map(|level| level.seeds.len()).max();
    Table {
        title: "Return on each level right after training on it (the study's Table 5)".to_owned(),
        columns: columns(&["arm", "seeds"], analysis.levels.iter().map(|level| level.name.clone())),
        rows,
        notes: notes(analysis, most),
    }
}

/// Indices of the levels that some curriculum has a stage on.
pub(super) fn stage_levels(analysis: &Analysis) -> Vec<usize> {
    let matrices = || analysis.arms.iter().filter_map(|arm| arm.matrix.as_ref());
    (0..analysis.levels.len()).filter(|&level| matrices().any(|matrix| row_after(matrix, level).is_some())).collect()
}

/// The study's Tables 2 to 4: the return on every level after the stage on one of them, for every arm.
pub(super) fn after_stage(analysis: &Analysis, level: usize) -> Table {
    let name = &analysis.levels[level].name;
    let is_study = name == STUDY_LEVEL && analysis.published.is_some();
    let mut rows = Vec::new();
    for arm in &analysis.arms {
        let Some((matrix, row)) = arm.matrix.as_ref().and_then(|m| Some((m, row_after(m, level)?))) else { continue };
        let cell = |level: usize| cell_on(matrix, row, level).map(|cell| (cell.mean, cell.std));
        rows.push(arm_row(arm, (0..analysis.levels.len()).map(cell)));
        if is_study {
            rows.extend(published_row(analysis, arm, |study| &study.after_level_3));
        }
    }
    let study = if is_study { " (the study's Tables 2-4)" } else { "" };
    let most = analysis.arms.iter().map(|arm| arm.seeds.len()).max();
    Table {
        title: format!("Return on every level after the stage on level {name}{study}"),
        columns: columns(&["arm", "seeds"], analysis.levels.iter().map(|level| level.name.clone())),
        rows,
        notes: notes(analysis, most),
    }
}

/// R[i, j] of one arm.
pub(super) fn matrix(analysis: &Analysis, arm: &Arm, matrix: &Matrix) -> Table {
    let name = |level: usize| analysis.levels[level].name.clone();
    let row = |row: &MatrixRow| {
        let label = row.after.map_or("before".to_owned(), |stage| format!("level {}", name(stage.level)));
        let cell = |cell: &Option<MatrixCell>| mean_std(cell.as_ref().map(|cell| (cell.mean, cell.std)));
        [label.into()].into_iter().chain(row.cells.iter().map(cell)).collect::<Vec<Cell>>()
    };
    let mut rows: Vec<Vec<Cell>> = matrix.rows.iter().map(row).collect();
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
        notes: vec![deviation_note(arm.seeds.len())],
    }
}

fn row_after(matrix: &Matrix, level: usize) -> Option<&MatrixRow> {
    matrix.rows.iter().find(|row| row.after.is_some_and(|stage| stage.level == level))
}

fn cell_on<'a>(matrix: &Matrix, row: &'a MatrixRow, level: usize) -> Option<&'a MatrixCell> {
    let column = matrix.levels.iter().position(|&column| column == level)?;
    row.cells[column].as_ref()
}

fn mean_std(result: Option<(f64, f64)>) -> Cell {
    result.map_or(Cell::Missing, |(mean, std)| Cell::MeanStd(mean, std))
}

fn arm_row(arm: &Arm, cells: impl Iterator<Item = Option<(f64, f64)>>) -> Vec<Cell> {
    [arm.name.as_str().into(), count(arm.seeds.len())].into_iter().chain(cells.map(mean_std)).collect()
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

/// What the study printed for the model that an arm repeats.
fn published_row(analysis: &Analysis, arm: &Arm, of: impl Fn(&Published) -> &[PublishedArm; 3]) -> Option<Vec<Cell>> {
    let study = analysis.published.as_ref()?;
    let published_arm = of(study).iter().find(|published| published.preset == arm.preset)?;
    Some(published(analysis, &format!("{} (published)", arm.preset), study, &published_arm.levels))
}

fn published(analysis: &Analysis, label: &str, study: &Published, values: &[PublishedMean; 5]) -> Vec<Cell> {
    let cell =
        |level: &LevelInfo| mean_std(study.column(level).map(|column| (values[column].mean, values[column].std)));
    [label.into(), count(1)].into_iter().chain(analysis.levels.iter().map(cell)).collect()
}

fn notes(analysis: &Analysis, most_seeds: Option<usize>) -> Vec<String> {
    let mut notes = vec![if most_seeds == Some(1) {
        deviation_note(1)
    } else {
        "Mean ± population standard deviation over seeds, each the mean over every start cell; where an arm has one \
         seed, over its start cells."
            .to_owned()
    }];
    if analysis.published.is_some() {
        notes.push(
            "Published: one seed, 500,000 timesteps per level (DQN 1,000,000), ± over episodes from drawn start cells."
                .to_owned(),
        );
    }
    notes
}
