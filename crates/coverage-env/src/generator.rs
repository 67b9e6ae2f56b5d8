//! Random levels, always solvable.

use chacha20::ChaCha8Rng;
use chacha20::rand_core::SeedableRng;

use crate::cell_set::CellSet;
use crate::level::{Cell, Level, MAX_CELLS, neighbor_table};
use crate::random::shuffle;

/// What a random level should be like.
///
/// ```
/// use coverage_env::generator::LevelSpec;
///
/// let spec = LevelSpec { height: 6, width: 10, wall_density: 0.25, num_targets: 4, seed: 7 };
/// let level = spec.generate()?;
/// assert_eq!((level.height(), level.width(), level.targets().len()), (6, 10, 4));
/// # Ok::<(), coverage_env::generator::SpecError>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LevelSpec {
    /// H, the number of rows.
    pub height: usize,
    /// W, the number of columns.
    pub width: usize,
    /// The share of cells that are walls, in `[0, 1)`; their number is rounded.
    pub wall_density: f64,
    /// The number of targets, at least 1.
    pub num_targets: usize,
    /// Which of these levels: the same specification is the same level, always and everywhere.
    pub seed: u64,
}

/// A specification that no level can meet.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum SpecError {
    /// No cells, or too many.
    #[error(
        "a map of {height} x {width} cells; height and width must be at least 1, their product at most {MAX_CELLS}"
    )]
    Size {
        /// The height asked for.
        height: usize,
        /// The width asked for.
        width: usize,
    },
    /// Not a share.
    #[error("a wall density of {density}; it must be at least 0 and below 1")]
    Density {
        /// The density asked for.
        density: f64,
    },
    /// Nothing to visit.
    #[error("no targets; ask for at least 1")]
    NoTargets,
    /// No cell is left to start on.
    #[error(
        "{walls} walls and {targets} targets leave no start cell on a map of {cells} cells; \
         ask for fewer of them or for a larger map"
    )]
    NoRoom {
        /// The number of cells.
        cells: usize,
        /// The number of walls asked for.
        walls: usize,
        /// The number of targets asked for.
        targets: usize,
    },
}

impl LevelSpec {
    /// The level of this specification, called `generated-HxW-wWALLS-tTARGETS-sSEED`.
    ///
    /// Walls come one by one, at cells in random order, wherever they leave the open cells
    /// connected; targets are then drawn uniformly from the open cells. So every start reaches
    /// every target, and there are exactly as many walls as asked for. (High densities leave
    /// winding corridors.)
    ///
    /// # Errors
    /// [`SpecError`] if no level can be like that.
    pub fn generate(&self) -> Result<Level, SpecError> {
        let &LevelSpec { height, width, num_targets, seed, .. } = self;
        let walls = self.check()?;
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let mut cells = vec![Cell::Free; height * width];
        let mut order: Vec<usize> = (0..cells.len()).collect();

        shuffle(&mut rng, &mut order);
        raise_walls(&mut cells, height, width, &order, walls);

        order.retain(|&cell| cells[cell] == Cell::Free);
        shuffle(&mut rng, &mut order);
        order[..num_targets].iter().for_each(|&cell| cells[cell] = Cell::Target);

        let name = format!("generated-{height}x{width}-w{walls}-t{num_targets}-s{seed}");
        Ok(Level::from_cells(&name, width, cells.into()).expect("connected, with a target and a start"))
    }

    /// The number of walls, if a level can have them.
    fn check(&self) -> Result<usize, SpecError> {
        let &LevelSpec { height, width, wall_density: density, num_targets: targets, .. } = self;
        let cells = height.checked_mul(width).filter(|cells| (1..=MAX_CELLS).contains(cells));
        let cells = cells.ok_or(SpecError::Size { height, width })?;
        if !(0.0..1.0).contains(&density) {
            return Err(SpecError::Density { density });
        }
        if targets == 0 {
            return Err(SpecError::NoTargets);
        }
        let walls = (density * cells as f64).round() as usize;
        if targets >= cells - walls {
            return Err(SpecError::NoRoom { cells, walls, targets });
        }
        Ok(walls)
    }
}

/// Turns `count` free cells into walls, by `order`, keeping the free cells connected.
fn raise_walls(cells: &mut [Cell], height: usize, width: usize, order: &[usize], count: usize) {
    let neighbors = neighbor_table(cells, height, width);
    let mut left = count;
    // A cell that joins two regions may become dispensable later. A connected map of two cells or
    // more always has a dispensable one, so every round makes progress.
    while left > 0 {
        for &cell in order {
            if left > 0 && cells[cell] == Cell::Free && is_dispensable(cells, &neighbors, cell) {
                cells[cell] = Cell::Wall;
                left -= 1;
            }
        }
    }
}

/// Whether the free cells stay connected without `cell`: whether its free neighbours do, which on
/// open ground a search finds out nearby.
fn is_dispensable(cells: &[Cell], neighbors: &[[u16; 4]], cell: usize) -> bool {
    let free = |next: &usize| *next != cell && cells[*next] == Cell::Free;
    let mut sought: Vec<usize> = neighbors[cell].map(usize::from).into_iter().filter(free).collect();
    let Some(from) = sought.pop() else {
        return false;
    };
    let mut seen = CellSet::new(cells.len());
    seen.insert(from);
    let mut frontier = std::collections::VecDeque::from([from]);
    while !sought.is_empty() {
        let Some(here) = frontier.pop_front() else {
            return false;
        };
        sought.retain(|&cell| cell != here);
        let around = neighbors[here].map(usize::from);
        frontier.extend(around.into_iter().filter(free).filter(|&next| seen.insert(next)));
    }
    true
}
