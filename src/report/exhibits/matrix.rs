//! Returns on every level after every stage: what is left of earlier levels, and what is there of later ones.

use charts::{About, Axis, HeatMap, HeatPanel, Layout, Width};

use super::exhibit::{Exhibit, NamedFigure, NamedTable};
use super::parts::caption;
use super::parts::notes::{columns, deviation_note};
use super::parts::returns::{
    Mean, Spread, arm_row, mean_cell, most_seeds, planner_rows, published_note, published_row,
};
use crate::report::analysis::{Analysis, Arm, Matrix, MatrixCell, MatrixRow};
use crate::report::names::file_name;
use crate::report::table::{Cell, Table};

/// R[i, j] of every curriculum.
pub struct Matrices;

impl Exhibit for Matrices {
    fn key(&self) -> &'static str {
        "matrices"
    }

    fn heading(&self) -> &'static str {
        "Returns on every level after every stage"
    }

    fn lead(&self) -> &'static str {
        "What is left of earlier levels, and what is there of later ones."
    }

    fn absence(&self) -> &'static str {
        "There are no runs through a curriculum."
    }

    fn tables(&self, analysis: &Analysis) -> Vec<NamedTable> {
        let after = |level: usize| {
            let name = format!("after-level-{}", file_name(&analysis.levels[level].name));
            NamedTable::new(name, after_stage(analysis, level))
        };
        let own = |arm: &Arm| Some(NamedTable::of_one_arm(table_name(arm), of_arm(analysis, arm)?));
        stage_levels(analysis).into_iter().map(after).chain(analysis.arms.iter().filter_map(own)).collect()
    }

    fn figures(&self, analysis: &Analysis) -> Vec<NamedFigure> {
        figure(analysis).into_iter().collect()
    }
}

/// What the table of an arm's matrix is called.
fn table_name(arm: &Arm) -> String {
    format!("matrix-{}", file_name(&arm.name))
}

/// Indices of the levels that some curriculum has a stage on.
pub fn stage_levels(analysis: &Analysis) -> Vec<usize> {
    let matrices = || analysis.arms.iter().filter_map(|arm| arm.matrix.as_ref());
    (0..analysis.levels.len()).filter(|&level| matrices().any(|matrix| row_after(matrix, level).is_some())).collect()
}

/// The paper's Tables 2 to 4: the return on every level after the stage on one of them, for every arm.
pub fn after_stage(analysis: &Analysis, level: usize) -> Table {
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
    let column = analysis.paper_column(level);
    let column =
        column.filter(|&column| analysis.published.as_ref().is_some_and(|paper| paper.evaluated_after(column)));
    let (mut rows, mut published_arms) = (Vec::new(), Vec::new());
    for (arm, means) in &means {
        rows.push(arm_row(arm, means, spread));
        let trained = |_: usize, stages: usize| column.is_some_and(|column| column < stages);
        if let Some(row) = published_row(analysis, arm, |paper| &paper.after_level_3, trained) {
            rows.push(row);
            published_arms.push(*arm);
        }
    }
    let (mut title, mut notes) = ("", vec![spread.note()]);
    if let Some(paper) = analysis.published.as_ref().filter(|_| !published_arms.is_empty()) {
        title = " (the paper's Tables 2 to 4)";
        notes.push(published_note(paper, &published_arms));
    }
    let title = format!("Return on every level after the stage on level {}{title}", own.name);
    Table::new(title, columns(&["arm", "seeds"], analysis, 0..analysis.levels.len()), rows, notes)
}

/// The same for one arm alone, a row per level, with what was done with the level until then. None without a matrix, or
/// where the stage is not in it.
pub fn after_stage_of_arm(analysis: &Analysis, arm: &Arm, stage: u16) -> Option<Table> {
    let matrix = arm.matrix.as_ref()?;
    let row = matrix.rows.iter().find(|row| row.after.is_some_and(|after| after.stage == stage))?;
    let last = row.after?;
    let trained = |level: usize| match arm.stages.iter().rfind(|s| s.level == level && s.stage <= stage) {
        Some(last) if last.stage == stage => "last",
        Some(_) => "earlier",
        None => "not yet",
    };
    let means: Vec<Option<Mean>> = row.cells.iter().map(|cell| cell.as_ref().map(Mean::from)).collect();
    let (spread, seeds) = (Spread::of(means.iter()), most_seeds(means.iter()));
    let line = |((cell, mean), &level): ((&Option<MatrixCell>, &Option<Mean>), &usize)| {
        let info = &analysis.levels[level];
        let solved = cell.as_ref().map_or(Cell::Missing, |cell| Cell::Number(100.0 * cell.solved_share, 1));
        let planned = [&info.astar, &info.optimal]
            .map(|planner| planner.as_ref().map_or(Cell::Missing, |planner| Cell::Number(planner.mean, 2)));
        let fixed = [info.name.as_str().into(), trained(level).into(), mean_cell(mean, spread, seeds), solved];
        fixed.into_iter().chain(planned).collect::<Vec<Cell>>()
    };
    let name = &analysis.levels[last.level].name;
    let column = analysis.paper_column(last.level).filter(|&column| column < analysis.stages_of_paper(arm));
    let of_paper = match (&analysis.published, column) {
        (Some(paper), Some(column)) if paper.evaluated_after(column) => " (the paper's Tables 2 to 4)",
        _ => "",
    };
    Some(Table::new(
        format!("Return on every level after the stage on level {name}{of_paper}"),
        ["level", "trained", "return", "solved %", "A*", "optimal"],
        row.cells.iter().zip(&means).zip(&matrix.levels).map(line).collect(),
        vec![deviation_note(seeds)],
    ))
}

/// R[i, j] of one arm; none without a matrix.
pub fn of_arm(analysis: &Analysis, arm: &Arm) -> Option<Table> {
    let matrix = arm.matrix.as_ref()?;
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
    Some(Table::new(
        format!("{}: mean return on each level (columns) after each stage (rows: level last trained on)", arm.name),
        columns(&["last trained on"], analysis, matrix.levels.iter().copied()),
        rows,
        vec![deviation_note(seeds)],
    ))
}

fn row_after(matrix: &Matrix, level: usize) -> Option<&MatrixRow> {
    matrix.rows.iter().find(|row| row.after.is_some_and(|stage| stage.level == level))
}

fn cell_on<'a>(matrix: &Matrix, row: &'a MatrixRow, level: usize) -> Option<&'a MatrixCell> {
    let column = matrix.levels.iter().position(|&column| column == level)?;
    row.cells[column].as_ref()
}

/// R[i, j] of every curriculum, as it is.
fn figure(analysis: &Analysis) -> Option<NamedFigure> {
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
        caption: caption::join([
            "R[i, j]: mean return on each level (columns) after each stage (rows: the level last trained on), greedy, \
             from every start cell. On the diagonal is what was just trained on."
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
        tables: arms.iter().map(|&arm| table_name(&analysis.arms[arm])).collect(),
    })
}
