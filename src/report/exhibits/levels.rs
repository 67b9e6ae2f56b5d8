//! The maps, and what planners earn on them.

use charts::{About, Drawing, GridMap, GridMaps, Layout, Tile, Width};
use coverage_env::{Cell as Square, Level};

use super::exhibit::{Exhibit, NamedFigure, NamedTable};
use crate::report::analysis::{Analysis, LevelInfo, Planner};
use crate::report::table::{Cell, Table};

/// Maps that stand side by side, and of how many more do.
const COLUMNS: [usize; 2] = [5, 10];
const MANY: usize = 15;
/// The table's name.
const TABLE: &str = "planners";

/// The levels of a comparison.
pub struct Levels;

impl Exhibit for Levels {
    fn key(&self) -> &'static str {
        "levels"
    }

    fn heading(&self) -> &'static str {
        "Levels and planners"
    }

    fn absence(&self) -> &'static str {
        "No level can be read."
    }

    fn tables(&self, analysis: &Analysis) -> Vec<NamedTable> {
        vec![NamedTable::new(TABLE, planners(analysis))]
    }

    fn fits_many_arms(&self) -> bool {
        true
    }

    fn figures(&self, analysis: &Analysis) -> Vec<NamedFigure> {
        maps(analysis).into_iter().collect()
    }
}

/// The paper's Table 1, and the optimum that it did not have.
fn planners(analysis: &Analysis) -> Table {
    let mut rows = Vec::new();
    for (index, level) in analysis.levels.iter().enumerate() {
        let planner = |name: &str, planner: &Option<Planner>| {
            let planner = planner.as_ref()?;
            let mut row: Vec<Cell> = vec![level.name.as_str().into(), name.into(), Cell::count(planner.starts.len())];
            let numbers = [(planner.mean, 2), (planner.std, 2), (planner.min as f64, 0), (planner.max as f64, 0)];
            row.extend(numbers.map(|(value, decimals)| Cell::Number(value, decimals)));
            row.push(Cell::Number(planner.length, 2));
            Some(row)
        };
        rows.extend(planner("A*", &level.astar));
        if let Some((paper, column)) = analysis.published.as_ref().zip(analysis.paper_column(index)) {
            let [mean, min, max] = [paper.astar_mean, paper.astar_min, paper.astar_max].map(|values| values[column]);
            let numbers = [Cell::Number(mean, 2), Cell::Missing, Cell::Number(min, 0), Cell::Number(max, 0)];
            let row = [level.name.as_str().into(), "A* (published)".into(), Cell::count(20)];
            rows.push(row.into_iter().chain(numbers).chain([Cell::Missing]).collect());
        }
        rows.extend(planner("optimal", &level.optimal));
        rows.extend(planner("random", &level.random));
    }
    let mut notes = vec!["One episode from every start cell.".to_owned()];
    if analysis.published.is_some() {
        notes.push("Those published are from 20 drawn start cells.".to_owned());
    }
    let columns = ["level", "planner", "episodes", "mean", "std", "min", "max", "mean length"];
    let all = (0..analysis.levels.len()).all(|level| analysis.paper_column(level).is_some());
    let of_paper = if all { " (the paper's Table 1)" } else { "" };
    Table::new(format!("What planners earn{of_paper}"), columns, rows, notes)
}

/// Maps side by side with their names: targets green, walls black, free cells white.
pub fn draw_levels(levels: &[Level]) -> Drawing {
    let columns = levels.len().clamp(1, COLUMNS[usize::from(levels.len() > MANY)]);
    GridMaps {
        about: About::new("Levels", "Maps of the levels: targets green, walls black, free cells white."),
        layout: Layout { width: if columns > 2 { Width::Page } else { Width::Column }, columns, ..Layout::default() },
        maps: levels.iter().map(map).collect(),
    }
    .draw()
}

fn map(level: &Level) -> GridMap {
    let tile = |row: usize, column: usize| match level.cell(row * level.width() + column) {
        Square::Free => Tile::Free,
        Square::Wall => Tile::Wall,
        Square::Target => Tile::Target,
    };
    let row = |row: usize| (0..level.width()).map(|column| tile(row, column)).collect();
    GridMap { title: format!("level {}", level.name()), tiles: (0..level.height()).map(row).collect() }
}

/// The levels of a comparison; none where no map can be read.
fn maps(analysis: &Analysis) -> Option<NamedFigure> {
    let level = |info: &LevelInfo| Level::from_map(info.name.clone(), &info.map).ok();
    let levels: Vec<Level> = analysis.levels.iter().filter_map(level).collect();
    let unreadable = analysis.levels.len() - levels.len();
    let mut caption = "The levels, in the order of training: targets green, walls black, free cells white.".to_owned();
    if unreadable > 0 {
        caption += &format!(" {unreadable} more cannot be read as a map.");
    }
    (!levels.is_empty()).then(|| NamedFigure {
        name: "levels".to_owned(),
        caption,
        drawing: draw_levels(&levels),
        tables: vec![TABLE.to_owned()],
    })
}
