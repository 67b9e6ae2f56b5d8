//! From text to cells, and whether every start can reach every target.

use super::{Cell, LevelDefect, MAX_CELLS, MAX_NAME_BYTES};
use crate::action::Action;

/// Names become parts of paths, so they must not escape from a folder.
pub(super) fn check_name(name: &str) -> Result<(), LevelDefect> {
    let unfit = |character: char| character.is_control() || matches!(character, '/' | '\\');
    if name.trim().is_empty() || name.len() > MAX_NAME_BYTES || name.contains(unfit) {
        return Err(LevelDefect::Name { name: name.chars().take(MAX_NAME_BYTES).collect() });
    }
    Ok(())
}

/// The width of `map` and its cells, row-major.
pub(super) fn parse_cells(map: &str) -> Result<(usize, Box<[Cell]>), LevelDefect> {
    let map = map.trim_matches(['\n', '\r']);
    let width = map.lines().next().map_or(0, |row| row.chars().count());
    if width == 0 {
        return Err(LevelDefect::EmptyMap);
    }
    let mut cells = Vec::with_capacity(map.len().min(MAX_CELLS));
    for (row, line) in map.lines().enumerate() {
        for (column, character) in line.chars().enumerate() {
            let unknown = LevelDefect::UnknownCharacter { row, column, character };
            cells.push(Cell::from_char(character).ok_or(unknown)?);
            if cells.len() > MAX_CELLS {
                return Err(LevelDefect::TooManyCells);
            }
        }
        let length = cells.len() - row * width;
        if length != width {
            return Err(LevelDefect::RaggedRow { row, length, width });
        }
    }
    Ok((width, cells.into()))
}

/// Checks that there are targets and starts, and that the open cells form one region.
pub(super) fn check_connected(
    cells: &[Cell],
    width: usize,
    neighbors: &[[u16; Action::COUNT]],
) -> Result<(), LevelDefect> {
    let is = |wanted: Cell| move |&cell: &usize| cells[cell] == wanted;
    let targets = || (0..cells.len()).filter(is(Cell::Target));
    let starts = || (0..cells.len()).filter(is(Cell::Free));
    let first_target = targets().next().ok_or(LevelDefect::NoTarget)?;
    let first_start = starts().next().ok_or(LevelDefect::NoStart)?;

    let region = regions(cells, neighbors);
    if (0..cells.len()).all(|cell| is(Cell::Wall)(&cell) || region[cell] == region[first_start]) {
        return Ok(());
    }
    let has_start = |target: &usize| starts().any(|start| region[start] == region[*target]);
    if let Some(target) = targets().find(|target| !has_start(target)) {
        let (row, column) = (target / width, target % width);
        return Err(LevelDefect::UnreachableTarget { row, column });
    }
    // Blame the starts outside the region of most targets: that is the map its author meant.
    let targets_in = |wanted: usize| targets().filter(|&target| region[target] == wanted).count();
    let main = (targets().map(|target| region[target]))
        .max_by_key(|&region| (targets_in(region), std::cmp::Reverse(region)))
        .unwrap_or(region[first_target]);
    let start = starts().find(|&start| region[start] != main).unwrap_or(first_start);
    let target = targets().find(|&target| region[target] == main).unwrap_or(first_target);
    Err(LevelDefect::TrappedStart {
        row: start / width,
        column: start % width,
        target_row: target / width,
        target_column: target % width,
    })
}

/// Numbers the connected regions of open cells; each cell's region, and `usize::MAX` on walls.
fn regions(cells: &[Cell], neighbors: &[[u16; Action::COUNT]]) -> Vec<usize> {
    const NONE: usize = usize::MAX;
    let mut region = vec![NONE; cells.len()];
    let mut frontier = Vec::new();
    for seed in 0..cells.len() {
        if cells[seed] == Cell::Wall || region[seed] != NONE {
            continue;
        }
        // A region is called by its first cell.
        region[seed] = seed;
        frontier.push(seed);
        while let Some(cell) = frontier.pop() {
            for next in neighbors[cell].map(usize::from) {
                if region[next] == NONE {
                    region[next] = seed;
                    frontier.push(next);
                }
            }
        }
    }
    region
}
