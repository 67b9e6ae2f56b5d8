//! Grid worlds side by side.

use crate::color::{Paint, Rgb};
use crate::drawing::{Drawing, Rect, Stroke};
use crate::frame::{self, Frame, PanelHeight, Plan};
use crate::layout::{About, Layout};
use crate::legend::{Entry, Key};

/// Maps of grid worlds.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct GridMaps {
    /// Name and description.
    pub about: About,
    /// Width and number of columns; the panels' height follows from the maps.
    pub layout: Layout,
    /// The maps.
    pub maps: Vec<GridMap>,
}

/// One grid world.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct GridMap {
    /// Stands above the map; empty for none.
    pub title: String,
    /// `[rows][columns]`, from the upper left; a short row is filled up with free cells.
    pub tiles: Vec<Vec<Tile>>,
}

/// What a cell of a grid world is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Tile {
    /// Passable: white.
    #[default]
    Free,
    /// Impassable: black.
    Wall,
    /// To be covered: green.
    Target,
}

impl Tile {
    fn paint(self) -> Paint {
        const WHITE: Rgb = [0xff, 0xff, 0xff];
        const BLACK: Rgb = [0x1a, 0x1a, 0x1a];
        const GREEN: Rgb = [0x00, 0x9e, 0x73];
        Paint::Fixed(match self {
            Self::Free => WHITE,
            Self::Wall => BLACK,
            Self::Target => GREEN,
        })
    }
}

/// Lines between cells, on maps of any colour scheme.
const LINES: Paint = Paint::Fixed([0xb4, 0xb9, 0xbf]);

impl GridMap {
    /// Rows and columns.
    fn size(&self) -> (usize, usize) {
        (self.tiles.len(), self.tiles.iter().map(Vec::len).max().unwrap_or(0))
    }
}

impl GridMaps {
    /// Lays the figure out.
    pub fn draw(&self) -> Drawing {
        let nothing = [GridMap::default()];
        let maps = if self.maps.is_empty() { &nothing } else { self.maps.as_slice() };
        let share = maps
            .iter()
            .map(GridMap::size)
            .map(|(rows, columns)| if columns == 0 { 0.5 } else { rows as f64 / columns as f64 })
            .fold(0.0, f64::max);
        let frame = Frame {
            about: &self.about,
            layout: &self.layout,
            height: PanelHeight::Share(share, f64::INFINITY),
            titles: maps.iter().map(|map| map.title.clone()).collect(),
            legend: vec![
                Entry::new(Key::Tile(Tile::Free.paint()), "free"),
                Entry::new(Key::Tile(Tile::Wall.paint()), "wall"),
                Entry::new(Key::Tile(Tile::Target.paint()), "target"),
            ],
            left: frame::gutters(&self.layout, maps.len(), 1.0, |_, _| 1.0),
            right: 1.0,
            above: 0.0,
            row_gap: 0.0,
            below: 0.0,
            x_title: String::new(),
            y_title: String::new(),
            footer: 0.0,
        };
        let Plan { mut drawing, panels, .. } = frame.arrange();
        for (map, panel) in maps.iter().zip(panels) {
            draw_map(&mut drawing, map, panel);
        }
        drawing
    }
}

/// Draws `map` with square cells, in the middle of the upper edge of `panel`.
fn draw_map(drawing: &mut Drawing, map: &GridMap, panel: Rect) {
    let (rows, columns) = map.size();
    if columns == 0 {
        return frame::no_data(drawing, panel);
    }
    let side = (panel.width / columns as f64).min(panel.height / rows as f64);
    let (width, height) = (side * columns as f64, side * rows as f64);
    let outline = Rect { left: panel.left + (panel.width - width) / 2.0, top: panel.top, width, height };
    let corner = |row: usize, column: usize| (outline.left + column as f64 * side, outline.top + row as f64 * side);

    drawing.fill_rect(outline, Tile::Free.paint());
    for (row, tiles) in map.tiles.iter().enumerate() {
        for (column, tile) in tiles.iter().enumerate().filter(|(_, tile)| **tile != Tile::Free) {
            let (left, top) = corner(row, column);
            drawing.fill_rect(Rect { left, top, width: side, height: side }, tile.paint());
        }
    }
    let across = (1..rows).map(|row| vec![corner(row, 0), corner(row, columns)]);
    let down = (1..columns).map(|column| vec![corner(0, column), corner(rows, column)]);
    drawing.path(across.chain(down).collect(), Stroke::new(LINES, 0.4));
    frame::outline(drawing, outline);
}
