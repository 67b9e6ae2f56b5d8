//! Maps: parsed, validated once, immutable from then on.

mod error;
mod file;
mod validate;

pub use error::{LevelDefect, LevelError};
pub use file::{BUILTIN_IDS, MAX_FILE_BYTES};

use crate::action::Action;
use crate::cell_set::CellSet;

/// The most cells that a map may have, height times width; 128 × 128, for example.
///
/// The bound lets cells and the inputs of an observation (four per cell) be numbered by `u16`.
pub const MAX_CELLS: usize = 1 << 14;

/// The longest name of a level, in bytes; a name becomes part of paths and table rows.
pub const MAX_NAME_BYTES: usize = 100;

/// What stands on one cell of a map.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Cell {
    /// `.`: open ground, where an episode may start.
    Free,
    /// `#`: cannot be entered.
    Wall,
    /// `T`: open ground that must be visited; no episode starts here.
    Target,
}

impl Cell {
    /// The cell that a map's character means.
    pub const fn from_char(character: char) -> Option<Cell> {
        match character {
            '.' => Some(Cell::Free),
            '#' => Some(Cell::Wall),
            'T' => Some(Cell::Target),
            _ => None,
        }
    }

    /// The character of this cell in a map.
    pub const fn to_char(self) -> char {
        match self {
            Cell::Free => '.',
            Cell::Wall => '#',
            Cell::Target => 'T',
        }
    }
}

/// A validated map.
///
/// # Guarantees
/// - At least one target and one start cell; at most [`MAX_CELLS`] cells.
/// - Cells that are not walls form one connected region, so that every start reaches every target.
///   A free cell that is walled in is refused, not ignored: it would be a start, and an evaluation
///   from every start could never be solved from there.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Level {
    name: String,
    height: usize,
    width: usize,
    cells: Box<[Cell]>,
    targets: Box<[usize]>,
    starts: Box<[usize]>,
    /// Where each action leads from each cell, `[H * W][4]`; from walls, nowhere.
    neighbors: Box<[[u16; Action::COUNT]]>,
    /// The cells that are not walls: channel 0 of an observation.
    open: CellSet,
    /// The targets once more: channel 2 of an observation.
    target_set: CellSet,
}

impl Level {
    /// Parses a map of rows of `.`, `#` and `T`, separated by line breaks.
    ///
    /// Empty lines before and after the map are ignored. Rows in errors count from the first row
    /// of the map.
    ///
    /// # Errors
    /// [`LevelError`] with `name` as its origin, for a map or name that breaks the
    /// [guarantees](Level#guarantees).
    pub fn from_map(name: impl Into<String>, map: &str) -> Result<Level, LevelError> {
        let name = name.into();
        Level::parse(&name, map).map_err(|defect| LevelError::new(name, defect))
    }

    /// As [`from_map`](Level::from_map), leaving it to the caller to say where the map came from.
    fn parse(name: &str, map: &str) -> Result<Level, LevelDefect> {
        let (width, cells) = validate::parse_cells(map)?;
        Level::from_cells(name, width, cells)
    }

    /// Validates `cells`, full rows of `width` each, at most [`MAX_CELLS`] in all.
    pub(crate) fn from_cells(name: &str, width: usize, cells: Box<[Cell]>) -> Result<Level, LevelDefect> {
        validate::check_name(name)?;
        let height = cells.len() / width;
        let neighbors = neighbor_table(&cells, height, width);
        validate::check_connected(&cells, width, &neighbors)?;

        let all = |wanted: Cell| (0..cells.len()).filter(|&cell| cells[cell] == wanted).collect();
        let targets: Box<[usize]> = all(Cell::Target);
        let starts: Box<[usize]> = all(Cell::Free);
        let set = |members: &[usize]| {
            let mut set = CellSet::new(cells.len());
            members.iter().for_each(|&cell| {
                set.insert(cell);
            });
            set
        };
        let target_set = set(&targets);
        let open = set(&[&*targets, &*starts].concat());
        let name = name.to_owned();
        Ok(Level { name, height, width, cells, targets, starts, neighbors, open, target_set })
    }

    /// What the level is called: the built-in id, the file's `name`, or its stem.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// H, the number of rows.
    pub fn height(&self) -> usize {
        self.height
    }

    /// W, the number of columns.
    pub fn width(&self) -> usize {
        self.width
    }

    /// The number of cells, H × W. (A level is never empty.)
    #[expect(clippy::len_without_is_empty, reason = "a level always has cells")]
    pub fn len(&self) -> usize {
        self.cells.len()
    }

    /// What stands on `cell`.
    ///
    /// # Panics
    /// If `cell` lies outside the map.
    pub fn cell(&self, cell: usize) -> Cell {
        self.cells[cell]
    }

    /// The cells, row-major, `[H * W]`.
    pub fn cells(&self) -> &[Cell] {
        &self.cells
    }

    /// The target cells, ascending.
    pub fn targets(&self) -> &[usize] {
        &self.targets
    }

    /// The cells where an episode may start, ascending: free and not targets.
    pub fn starts(&self) -> &[usize] {
        &self.starts
    }

    /// Whether an episode may start on `cell`; false outside the map.
    pub fn is_start(&self, cell: usize) -> bool {
        self.cells.get(cell) == Some(&Cell::Free)
    }

    /// Whether `cell` is a target.
    ///
    /// # Panics
    /// If `cell` lies outside the map.
    #[inline]
    pub fn is_target(&self, cell: usize) -> bool {
        self.cells[cell] == Cell::Target
    }

    /// The `(row, column)` of `cell`.
    pub fn position(&self, cell: usize) -> (usize, usize) {
        (cell / self.width, cell % self.width)
    }

    /// The cell at `(row, column)`, or `None` outside the map.
    pub fn index(&self, row: usize, column: usize) -> Option<usize> {
        (row < self.height && column < self.width).then(|| row * self.width + column)
    }

    /// Where `action` leads from `cell`: the next cell, or `cell` itself before a wall or the edge.
    ///
    /// # Panics
    /// If `cell` lies outside the map.
    #[inline]
    pub fn neighbor(&self, cell: usize, action: Action) -> usize {
        usize::from(self.neighbors[cell][action.index()])
    }

    /// The map as text, a line per row; [`from_map`](Level::from_map) reads it back.
    pub fn to_map(&self) -> String {
        let row = |cells: &[Cell]| cells.iter().map(|cell| cell.to_char()).chain(['\n']).collect();
        self.cells.chunks(self.width).map(row).collect::<Vec<String>>().concat()
    }

    /// The cells that are not walls.
    pub fn open_cells(&self) -> &CellSet {
        &self.open
    }

    /// The targets as a set.
    pub(crate) fn target_cells(&self) -> &CellSet {
        &self.target_set
    }
}

/// Where each action leads from each cell: itself if the way is barred, and always itself from a
/// wall. Cells fit `u16` since there are at most [`MAX_CELLS`].
pub(crate) fn neighbor_table(cells: &[Cell], height: usize, width: usize) -> Box<[[u16; Action::COUNT]]> {
    let destination = |cell: usize, action: Action| {
        let (row_step, column_step) = action.offset();
        let row = (cell / width).checked_add_signed(row_step).filter(|&row| row < height);
        let column = (cell % width).checked_add_signed(column_step).filter(|&column| column < width);
        let ahead = row.zip(column).map(|(row, column)| row * width + column);
        let open = |cell: &usize| cells[*cell] != Cell::Wall;
        ahead.filter(open).filter(|_| open(&cell)).unwrap_or(cell) as u16
    };
    (0..cells.len()).map(|cell| Action::ALL.map(|action| destination(cell, action))).collect()
}
