//! What the agent sees: a state as a binary array.

use crate::env::State;
use crate::level::Level;

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
    state: &'a State,
}

impl<'a> Observation<'a> {
    /// How many channels there are.
    pub const CHANNELS: usize = 4;

    /// What the agent sees in `state`, which must be a state of `level`.
    pub fn new(level: &'a Level, state: &'a State) -> Observation<'a> {
        Observation { level, state }
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
        assert_eq!(
            out.len(),
            Observation::len(self.level),
            "length of the observation's buffer"
        );
        let cells = self.level.len();
        let (open, rest) = out.split_at_mut(cells);
        let (agent, rest) = rest.split_at_mut(cells);
        let (targets, visited) = rest.split_at_mut(cells);
        write_bits(self.level.open_cells().words(), open);
        agent.fill(0.0);
        agent[usize::from(self.state.agent)] = 1.0;
        write_bits(self.level.target_cells().words(), targets);
        write_bits(self.state.visited.words(), visited);
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
        out.push((cells + usize::from(self.state.agent)) as u16);
        out.extend(
            self.state
                .visited
                .iter()
                .map(|cell| (3 * cells + cell) as u16),
        );
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
fn write_bits(words: &[u64], out: &mut [f32]) {
    for (&word, out) in words.iter().zip(out.chunks_mut(64)) {
        let mut bits = word;
        let mut quads = out.chunks_exact_mut(4);
        for quad in &mut quads {
            quad.copy_from_slice(&NIBBLES[(bits & 15) as usize]);
            bits >>= 4;
        }
        let rest = quads.into_remainder();
        rest.copy_from_slice(&NIBBLES[(bits & 15) as usize][..rest.len()]);
    }
}
