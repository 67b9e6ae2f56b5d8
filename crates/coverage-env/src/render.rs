//! A state as text.

use crate::level::{Cell, Level};
use crate::state::State;

/// What the characters of [`render`] mean.
pub const LEGEND: &str = "@ agent   T target to visit   * visited target   o visited cell   . free   # wall";

/// The map with the agent, its trail and the targets left, a line per row, and a line that counts.
///
/// ```
/// use coverage_env::{Level, State, render::render};
///
/// let level = Level::from_map("room", ".T\n#.")?;
/// let state = State::at_start(&level, 0)?;
/// assert_eq!(render(&level, &state), "@T\n#.\nstep 0, 0 of 1 targets visited\n");
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn render(level: &Level, state: &State) -> String {
    let symbol = |cell: usize| match (level.cell(cell), state.visited.contains(cell)) {
        _ if cell == usize::from(state.agent) => '@',
        (Cell::Target, true) => '*',
        (Cell::Free, true) => 'o',
        (untouched, _) => untouched.to_char(),
    };
    let mut text = String::new();
    for row in 0..level.height() {
        let first = row * level.width();
        text.extend((first..first + level.width()).map(symbol));
        text.push('\n');
    }
    let targets = level.targets().len();
    let visited = targets - state.remaining as usize;
    text + &format!("step {}, {visited} of {targets} targets visited\n", state.steps)
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::{Action, CoverageEnv};

    #[test]
    fn the_trail_and_the_targets_left_can_be_told_apart() {
        let level = Level::from_map("room", ".T.\n#.T").expect("a valid map");
        let mut env = CoverageEnv::new(Arc::new(level), 9);
        env.reset_at(0).expect("a start");
        for action in [Action::Right, Action::Right, Action::Left] {
            env.step(action);
        }
        let text = render(env.level(), env.state());
        assert_eq!(text, "o@o\n#.T\nstep 3, 1 of 2 targets visited\n");
        env.step(Action::Right);
        env.step(Action::Down);
        let text = render(env.level(), env.state());
        assert_eq!(text, "o*o\n#.@\nstep 5, 2 of 2 targets visited\n");
    }
}
