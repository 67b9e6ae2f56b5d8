//! The whole map.

use super::{Scene, Sensor};
use crate::cell_set::Cells;
use crate::level::Level;

/// How many channels there are.
const CHANNELS: usize = 4;

/// The whole map, `[4, H, W]`: what the paper's agents see.
///
/// | channel | 1 where |
/// |---|---|
/// | 0 | the cell is not a wall (targets included) |
/// | 1 | the agent is |
/// | 2 | the cell is a target (visited ones stay) |
/// | 3 | the agent has been (the start included) |
///
/// Inputs fit `u16` since a level has at most [`MAX_CELLS`](crate::level::MAX_CELLS) cells.
#[derive(Clone, Copy, Debug)]
pub struct Full;

impl Sensor for Full {
    fn name(&self) -> &'static str {
        "full"
    }

    fn shape(&self, height: usize, width: usize) -> [usize; 3] {
        [CHANNELS, height, width]
    }

    /// Channels 0 and 2.
    fn constant_inputs(&self, level: &Level) -> Vec<u16> {
        let input = |channel: usize| move |cell: usize| (channel * level.len() + cell) as u16;
        let open = level.open_cells().iter().map(input(0));
        let targets = level.target_cells().iter().map(input(2));
        open.chain(targets).collect()
    }

    /// Channels 1 and 3: the agent's and the visited cells'. At least 2 and at most H · W + 1 inputs.
    fn push_active(&self, scene: Scene<'_>, out: &mut Vec<u16>) {
        let cells = scene.level.len();
        out.push((cells + usize::from(scene.agent)) as u16);
        // Room is made once, so that the loop has no capacity to check.
        let first = out.len();
        let count: usize = scene.visited.iter().map(|word| word.count_ones() as usize).sum();
        out.resize(first + count, 0);
        for (input, cell) in out[first..].iter_mut().zip(Cells::of(scene.visited)) {
            *input = (3 * cells + cell) as u16;
        }
    }

    /// By words of 64 cells, which is several times faster than input by input.
    fn write(&self, scene: Scene<'_>, out: &mut [f32]) {
        assert_eq!(out.len(), self.inputs(scene.level), "length of the observation's buffer");
        let cells = scene.level.len();
        let (open, rest) = out.split_at_mut(cells);
        let (agent, rest) = rest.split_at_mut(cells);
        let (targets, visited) = rest.split_at_mut(cells);
        write_bits(scene.level.open_cells().words(), open);
        agent.fill(0.0);
        agent[usize::from(scene.agent)] = 1.0;
        write_bits(scene.level.target_cells().words(), targets);
        write_bits(scene.visited, visited);
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
