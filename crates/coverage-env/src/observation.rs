//! What the agent sees: a state as a binary array.

use crate::cell_set::Cells;
use crate::level::Level;
use crate::state::State;

/// A state as a binary array of shape `[4, H, W]`, row-major.
///
/// | channel | 1 where |
/// |---|---|
/// | 0 | the cell is not a wall (targets included) |
/// | 1 | the agent is |
/// | 2 | the cell is a target (visited ones stay) |
/// | 3 | the agent has been (the start included) |
///
/// An *input* is an index into the flattened array, `(channel * H + row) * W + column`. It fits `u16`
/// since a level has at most [`MAX_CELLS`](crate::level::MAX_CELLS) cells.
#[derive(Clone, Copy, Debug)]
pub struct Observation<'a> {
    level: &'a Level,
    agent: u16,
    /// As [`CellSet::words`](crate::CellSet::words) gives it.
    visited: &'a [u64],
}

impl<'a> Observation<'a> {
    /// How many channels there are.
    pub const CHANNELS: usize = 4;

    /// What the agent sees in `state`, which must be a state of `level`.
    pub fn new(level: &'a Level, state: &'a State) -> Observation<'a> {
        Observation::packed(level, state.agent, state.visited.words())
    }

    /// What the agent sees from cell `agent` when it has been on the cells of `visited`, words as
    /// [`CellSet::words`](crate::CellSet::words) gives them: the form in which observations are stored.
    pub fn packed(level: &'a Level, agent: u16, visited: &'a [u64]) -> Observation<'a> {
        Observation { level, agent, visited }
    }

    /// The number of inputs of an observation of `level`, 4 · H · W.
    pub fn len(level: &Level) -> usize {
        Observation::CHANNELS * level.len()
    }

    /// Writes the array to `out`, `[4 * H * W]`; every element is overwritten.
    ///
    /// # Panics
    /// If `out` is not [`len`](Observation::len) long.
    pub fn write(&self, out: &mut [f32]) {
        assert_eq!(out.len(), Observation::len(self.level), "length of the observation's buffer");
        let cells = self.level.len();
        let (open, rest) = out.split_at_mut(cells);
        let (agent, rest) = rest.split_at_mut(cells);
        let (targets, visited) = rest.split_at_mut(cells);
        write_bits(self.level.open_cells().words(), open);
        agent.fill(0.0);
        agent[usize::from(self.agent)] = 1.0;
        write_bits(self.level.target_cells().words(), targets);
        write_bits(self.visited, visited);
    }

    /// The inputs that are 1 in every state of `level`, ascending: channels 0 and 2.
    ///
    /// Together with [`push_active`](Observation::push_active), these are all inputs that are 1.
    pub fn constant_inputs(level: &Level) -> Vec<u16> {
        let input = |channel: usize| move |cell: usize| (channel * level.len() + cell) as u16;
        let open = level.open_cells().iter().map(input(0));
        let targets = level.target_cells().iter().map(input(2));
        open.chain(targets).collect()
    }

    /// Appends the inputs of channels 1 and 3 that are 1, ascending: the agent's and the visited
    /// cells'. At least 2 and at most H · W + 1 of them.
    pub fn push_active(&self, out: &mut Vec<u16>) {
        let cells = self.level.len();
        out.push((cells + usize::from(self.agent)) as u16);
        // Room is made once, so that the loop has no capacity to check.
        let first = out.len();
        let count: usize = self.visited.iter().map(|word| word.count_ones() as usize).sum();
        out.resize(first + count, 0);
        for (input, cell) in out[first..].iter_mut().zip(Cells::of(self.visited)) {
            *input = (3 * cells + cell) as u16;
        }
    }
}

/// Four bits as four numbers, to write bits a quarter of a vector register at a time: several times
/// faster than bit by bit.
const NIBBLES: [[f32; 4]; 16] = {
    let mut nibbles = [[0.0; 4]; 16];
    let mut index = 0;
    while index < 64 {
        nibbles[index / 4][index % 4] = ((index / 4) >> (index % 4) & 1) as f32;
        index += 1;
    }
    nibbles
};

/// Writes bit `i` of `words` to `out[i]`.
#[inline]
fn write_bits(words: &[u64], out: &mut [f32]) {
    let (full, rest) = out.as_chunks_mut::<64>();
    for (&word, out) in words.iter().zip(full) {
        let (quads, _) = out.as_chunks_mut::<4>();
        for (index, quad) in quads.iter_mut().enumerate() {
            *quad = NIBBLES[(word >> (4 * index) & 15) as usize];
        }
    }
    let last = words.last().copied().unwrap_or(0);
    for (index, value) in rest.iter_mut().enumerate() {
        *value = f32::from((last >> index & 1) as u8);
    }
}
