//! The study's Figure 1: the levels.

use charts::{About, Drawing, GridMap, GridMaps, Layout, Tile, Width};
use coverage_env::{Cell, Level};

use super::super::analysis::Analysis;
use super::super::topic::Topic;
use super::NamedFigure;

/// Maps that stand side by side, at most.
const COLUMNS: usize = 5;

/// Maps side by side with their names: targets green, walls black, free cells white.
pub fn draw_levels(levels: &[Level]) -> Drawing {
    let columns = levels.len().clamp(1, COLUMNS);
    GridMaps {
        about: About::new("Levels", "Maps of the levels: targets green, walls black, free cells white."),
        layout: Layout { width: if columns > 2 { Width::Page } else { Width::Column }, columns, ..Layout::default() },
        maps: levels.iter().map(map).collect(),
    }
    .draw()
}

fn map(level: &Level) -> GridMap {
    let tile = |row: usize, column: usize| match level.cell(row * level.width() + column) {
        Cell::Free => Tile::Free,
        Cell::Wall => Tile::Wall,
        Cell::Target => Tile::Target,
    };
    let row = |row: usize| (0..level.width()).map(|column| tile(row, column)).collect();
    GridMap { title: format!("level {}", level.name()), tiles: (0..level.height()).map(row).collect() }
}

/// The levels of a comparison; none where no map can be read.
pub(super) fn figure(analysis: &Analysis) -> Option<NamedFigure> {
    let level = |info: &super::super::analysis::LevelInfo| Level::from_map(info.name.clone(), &info.map).ok();
    let levels: Vec<Level> = analysis.levels.iter().filter_map(level).collect();
    let unreadable = analysis.levels.len() - levels.len();
    let mut caption = "The levels, in the order of training: targets green, walls black, free cells white.".to_owned();
    if unreadable > 0 {
        caption += &format!(" {unreadable} more cannot be read as a map.");
    }
    (!levels.is_empty()).then(|| NamedFigure {
        name: "levels".to_owned(),
        topic: Topic::Levels,
        caption,
        drawing: draw_levels(&levels),
        tables: vec!["planners".to_owned()],
    })
}
