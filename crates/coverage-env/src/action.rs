//! The four moves.

/// A move of the agent to one of the four neighbouring cells.
///
/// The numbering is the paper's and that of every action index in logs, networks and files.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
#[repr(u8)]
pub enum Action {
    /// To the next row, `(row + 1, column)`.
    Down = 0,
    /// To the previous row, `(row - 1, column)`.
    Up = 1,
    /// To the next column, `(row, column + 1)`.
    Right = 2,
    /// To the previous column, `(row, column - 1)`.
    Left = 3,
}

impl Action {
    /// How many actions there are.
    pub const COUNT: usize = 4;

    /// Every action, at its own index.
    pub const ALL: [Action; Action::COUNT] = [Action::Down, Action::Up, Action::Right, Action::Left];

    /// The action numbered `index`, or `None` past 3.
    pub const fn from_index(index: u8) -> Option<Action> {
        match index {
            0 => Some(Action::Down),
            1 => Some(Action::Up),
            2 => Some(Action::Right),
            3 => Some(Action::Left),
            _ => None,
        }
    }

    /// This action's number, 0 to 3.
    pub const fn index(self) -> usize {
        self as usize
    }

    /// The change of `(row, column)` on open ground.
    pub const fn offset(self) -> (isize, isize) {
        match self {
            Action::Down => (1, 0),
            Action::Up => (-1, 0),
            Action::Right => (0, 1),
            Action::Left => (0, -1),
        }
    }
}
