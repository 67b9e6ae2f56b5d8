//! Transitions that outlive their stage: what a replay buffer leaves to the next level, and what it has of earlier ones.
//!
//! A transition of another level cannot be kept as a scene, which means something on its own level alone. So it is kept as
//! the sensor saw it: one bit for each input, those that all scenes of its level share included.

use std::ops::Range;

use bit_mlp::BitBatch;
use coverage_env::{Action, Level, Sensor};

use crate::agent::buffers::{Buffer, Buffers, Data};

const INPUTS: &str = "replay/inputs";
const ACTIONS: &str = "replay/actions";
const REWARDS: &str = "replay/rewards";
const TERMINATED: &str = "replay/terminated";

/// The observations before and after each of K transitions, one bit for each input, `[K, 2, words]`.
///
/// Bit b of word w is the input 64 · w + b. Bits beyond the last input are 0.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Observed {
    /// Words of one observation.
    words: usize,
    bits: Vec<u64>,
}

impl Observed {
    /// None yet, of so many inputs each.
    pub fn new(inputs: usize) -> Self {
        Self { words: inputs.div_ceil(64), bits: Vec::new() }
    }

    /// Transitions, K.
    pub fn len(&self) -> usize {
        self.bits.len() / (2 * self.words).max(1)
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.bits.is_empty()
    }

    /// Adds an observation with these inputs: the one before a transition, and then the one after it.
    pub fn push(&mut self, inputs: &[u16]) {
        let start = self.bits.len();
        self.bits.resize(start + self.words, 0);
        for &input in inputs {
            self.bits[start + usize::from(input) / 64] |= 1 << (input % 64);
        }
    }

    /// The inputs that are 1 in an observation, ascending; `place` is 2k before transition k, and 2k + 1 after it.
    pub fn inputs(&self, place: usize) -> impl Iterator<Item = u16> + '_ {
        let words = self.bits[place * self.words..][..self.words].iter().enumerate();
        words.flat_map(|(w, &word)| {
            let rest = std::iter::successors(Some(word), |word| Some(word & word.wrapping_sub(1)));
            rest.take_while(|&word| word != 0).map(move |word| (64 * w) as u16 + word.trailing_zeros() as u16)
        })
    }

    /// Forgets all but the last `len` transitions.
    fn keep_last(&mut self, len: usize) {
        self.bits.drain(..self.bits.len() - 2 * len * self.words);
        self.bits.shrink_to_fit();
    }

    /// Adds it to buffers under this name.
    pub fn write(self, name: &str, buffers: &mut Buffers) {
        buffers.add(name, &[self.len(), 2, self.words], Data::U64(self.bits));
    }

    /// Reads it from buffers, where there is one of this name.
    ///
    /// # Errors
    /// An array of another type or shape.
    pub fn read(name: &str, buffers: &Buffers) -> Result<Option<Self>, String> {
        match buffers.get(name) {
            None => Ok(None),
            Some(Buffer { shape, data: Data::U64(bits) }) => match shape[..] {
                [len, 2, words] if len.checked_mul(2).and_then(|n| n.checked_mul(words)) == Some(bits.len()) => {
                    Ok(Some(Self { words, bits: bits.clone() }))
                }
                _ => Err(format!("its {name} has another shape: {shape:?}")),
            },
            Some(_) => Err(format!("its {name} is of another type")),
        }
    }

    /// Whether every observation is one of so many inputs.
    pub(super) fn is_of(&self, inputs: usize) -> bool {
        let beyond = match inputs % 64 {
            0 => 0,
            used => u64::MAX << used,
        };
        let last_words = self.bits.iter().skip(self.words.wrapping_sub(1)).step_by(self.words.max(1));
        self.words == inputs.div_ceil(64) && self.words > 0 && last_words.fold(0, |all, word| all | word) & beyond == 0
    }
}

/// What a stage leaves of its replay buffer: K transitions, the oldest first.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Past {
    /// The observations acted upon, and those that followed.
    pub observed: Observed,
    /// `[K]`.
    pub actions: Vec<u8>,
    /// `[K]`.
    pub rewards: Vec<f32>,
    /// `[K]`.
    pub terminated: Vec<bool>,
}

impl Past {
    /// Forgets all but the newest `most` transitions.
    pub fn keep_newest(&mut self, most: usize) {
        let gone = self.actions.len().saturating_sub(most);
        self.observed.keep_last(self.actions.len() - gone);
        self.actions.drain(..gone);
        self.rewards.drain(..gone);
        self.terminated.drain(..gone);
    }

    /// Adds it to what an agent leaves to the next stage.
    pub fn write(self, buffers: &mut Buffers) {
        let len = self.actions.len();
        self.observed.write(INPUTS, buffers);
        buffers.add(ACTIONS, &[len], Data::U8(self.actions));
        buffers.add(REWARDS, &[len], Data::F32(self.rewards));
        buffers.add(TERMINATED, &[len], Data::U8(self.terminated.into_iter().map(u8::from).collect()));
    }

    /// Reads it from what an agent brings, if there is anything.
    ///
    /// # Errors
    /// Arrays that are missing, of another type, or of different lengths.
    pub fn read(buffers: &Buffers) -> Result<Option<Self>, String> {
        let Some(observed) = Observed::read(INPUTS, buffers)? else { return Ok(None) };
        let lost = |name: &str| format!("its {name} is missing or of another type");
        let past = Self {
            observed,
            actions: buffers.u8s(ACTIONS).ok_or_else(|| lost(ACTIONS))?.to_vec(),
            rewards: buffers.f32s(REWARDS).ok_or_else(|| lost(REWARDS))?.to_vec(),
            terminated: buffers.u8s(TERMINATED).ok_or_else(|| lost(TERMINATED))?.iter().map(|&t| t != 0).collect(),
        };
        let len = past.observed.len();
        if [past.actions.len(), past.rewards.len(), past.terminated.len()] != [len; 3] {
            return Err("the arrays of its replay buffer have different lengths".to_owned());
        }
        Ok(Some(past))
    }

    /// Checks that its transitions are of observations of so many inputs.
    ///
    /// # Errors
    /// What cannot be so.
    pub fn check(&self, inputs: usize) -> Result<(), String> {
        if !self.observed.is_of(inputs) {
            return Err("its replay buffer is of another sensor, or of maps of another size".to_owned());
        }
        if self.actions.iter().any(|&action| usize::from(action) >= Action::COUNT)
            || self.rewards.iter().any(|reward| !reward.is_finite())
        {
            return Err("its replay buffer holds transitions that are not possible".to_owned());
        }
        Ok(())
    }
}

/// The slots of a replay buffer that hold transitions of earlier stages.
#[derive(Clone, Debug)]
pub(super) struct Carried {
    /// Those that are not overwritten yet.
    slots: Range<usize>,
    /// Of the last slots up to `slots.end`, those of `slots` and some before them.
    observed: Observed,
    /// The inputs that all scenes of this stage's level share.
    constant: Vec<u16>,
}

impl Carried {
    /// Slots from `start` on with these observations.
    pub(super) fn new(start: usize, observed: Observed, sensor: &dyn Sensor, level: &Level) -> Self {
        Self { slots: start..start + observed.len(), observed, constant: sensor.constant_inputs(level) }
    }

    /// Whether all have been overwritten.
    pub(super) fn is_empty(&self) -> bool {
        self.slots.is_empty()
    }

    /// The inputs that all scenes of this stage's level share.
    pub(super) fn constant(&self) -> &[u16] {
        &self.constant
    }

    /// The observations of the slots that are left.
    pub(super) fn observed(&self) -> Observed {
        let mut observed = self.observed.clone();
        observed.keep_last(self.slots.len());
        observed
    }

    /// The inputs of an observation, if its slot is one of these; `place` is 2 · slot before, and one more after.
    pub(super) fn inputs(&self, place: usize) -> Option<impl Iterator<Item = u16> + '_> {
        let first = self.slots.end - self.observed.len();
        self.slots.contains(&(place / 2)).then(|| self.observed.inputs(place - 2 * first))
    }

    /// Gives a slot to this stage. A ring overwrites its oldest first, which is the first of these.
    pub(super) fn give(&mut self, slot: usize) {
        if slot == self.slots.start && !self.is_empty() {
            self.slots.start += 1;
            if self.is_empty() {
                self.observed.keep_last(0);
            }
        }
    }

    /// Says which inputs all samples of these batches share: none, as long as some may be of other levels.
    pub(super) fn share(&self, batches: [&mut BitBatch; 2]) {
        let shared = if self.is_empty() { &self.constant[..] } else { &[] };
        batches.into_iter().for_each(|batch| batch.set_constant(shared));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_packed_is_unpacked() {
        for inputs in [6, 64, 130, 256] {
            let mut observed = Observed::new(inputs);
            let all: Vec<u16> = (0..inputs as u16).collect();
            let some = [0, 5];
            observed.push(&some);
            observed.push(&all);
            assert_eq!((observed.len(), observed.is_of(inputs)), (1, true));
            assert_eq!(observed.inputs(0).collect::<Vec<_>>(), some);
            assert_eq!(observed.inputs(1).collect::<Vec<_>>(), all);
            assert!(!observed.is_of(inputs - 1), "a bit beyond {inputs}");
        }
        assert!(!Observed::default().is_of(6) && !Observed::new(6).is_of(0));
    }

    fn past(len: u8) -> Past {
        let mut observed = Observed::new(70);
        (0..2 * u16::from(len)).for_each(|place| observed.push(&[place, 69]));
        let actions = (0..len).map(|k| k % 4).collect();
        let rewards = (0..len).map(f32::from).collect();
        Past { observed, actions, rewards, terminated: (0..len).map(|k| k % 3 == 0).collect() }
    }

    #[test]
    fn the_newest_are_kept_and_come_back() {
        let mut kept = past(5);
        kept.keep_newest(7);
        assert_eq!(kept, past(5));
        kept.keep_newest(2);
        assert_eq!(
            (kept.rewards.as_slice(), kept.terminated.as_slice()),
            ([3.0, 4.0].as_slice(), [true, false].as_slice())
        );
        assert_eq!(kept.observed.inputs(0).collect::<Vec<_>>(), [6, 69]);
        let mut buffers = Buffers::default();
        kept.clone().write(&mut buffers);
        assert_eq!(Past::read(&buffers), Ok(Some(kept)));
        assert_eq!(Past::read(&Buffers::default()), Ok(None));
    }

    #[test]
    fn what_cannot_be_is_refused() {
        let mut buffers = Buffers::default();
        past(3).write(&mut buffers);
        let refused = |name: &str, shape: &[usize], data: Data| {
            let mut buffers = buffers.clone();
            buffers.add(name, shape, data);
            Past::read(&buffers).and_then(|past| past.expect("there is one").check(70)).unwrap_err()
        };
        assert!(refused(INPUTS, &[3, 2, 2], Data::U8(vec![0; 12])).contains("another type"));
        assert!(refused(INPUTS, &[3, 2, 2], Data::U64(vec![0; 11])).contains("another shape"));
        assert!(refused(INPUTS, &[12], Data::U64(vec![0; 12])).contains("another shape"));
        assert!(refused(INPUTS, &[3, 2, 1], Data::U64(vec![0; 6])).contains("another sensor"));
        assert!(refused(INPUTS, &[3, 2, 2], Data::U64(vec![1 << 6; 12])).contains("another sensor"));
        assert!(refused(ACTIONS, &[3], Data::U8(vec![4; 3])).contains("not possible"));
        assert!(refused(REWARDS, &[3], Data::F32(vec![f32::NAN; 3])).contains("not possible"));
        assert!(refused(REWARDS, &[2], Data::F32(vec![0.0; 2])).contains("different lengths"));
        assert!(refused(TERMINATED, &[3], Data::F32(vec![0.0; 3])).contains("of another type"));
    }
}
