//! The replay buffer: a ring of transitions with packed observations.

use std::sync::Arc;

use bit_mlp::BitBatch;
use coverage_env::random::below;
use coverage_env::{Action, Level, Scene, Sensor, State, VecEnv};
use rand::Rng;

use super::carried::{Carried, Observed, Past};
use crate::agent::buffers::{Buffers, Data};
use crate::agent::observe::observations;

/// What a snapshot calls the observations of earlier stages; there is no such array where there are none.
const CARRIED: &str = "replay/carried";

/// A ring of transitions of one seed, the oldest overwritten first.
///
/// Of its own level it keeps scenes, not what a sensor makes of them: the agent's cell and one bit per visited cell.
/// Everything else is the level's. At 8×8 a transition takes 26 bytes, so that 100,000 of them take 2.6 MB. It may begin with
/// transitions of earlier stages, which it keeps as observations: 64 bytes more.
#[derive(Clone, Debug)]
pub struct Replay {
    level: Arc<Level>,
    capacity: usize,
    /// Words of one scene's visited cells.
    words: usize,
    /// Transitions stored.
    len: usize,
    /// Where the next one goes.
    next: usize,
    /// The agent's cell before and after, `[capacity, 2]`.
    cells: Vec<u16>,
    /// Visited cells before and after, `[capacity, 2, words]`.
    visited: Vec<u64>,
    /// `[capacity]`.
    actions: Vec<u8>,
    /// `[capacity]`.
    rewards: Vec<f32>,
    /// Whether the episode terminated; a truncated one goes on as far as learning knows, `[capacity]`.
    terminated: Vec<bool>,
    /// The slots that hold transitions of earlier stages, if it began with any.
    carried: Option<Carried>,
}

/// What a [`Replay`] of K transitions holds, as files keep it; its first K slots, in their order.
///
/// Slots with transitions of earlier stages have zeros in `cells` and `visited`. They are the oldest: those from `next` on if
/// the ring is full, and the first ones if not.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ReplayState {
    /// The slot that is filled next.
    pub next: usize,
    /// The agent's cell before and after, `[K, 2]`.
    pub cells: Vec<u16>,
    /// Visited cells before and after, `[K, 2, words]`.
    pub visited: Vec<u64>,
    /// `[K]`.
    pub actions: Vec<u8>,
    /// `[K]`.
    pub rewards: Vec<f32>,
    /// `[K]`.
    pub terminated: Vec<bool>,
    /// Observations of the slots with transitions of earlier stages, in their order.
    pub carried: Observed,
}

/// A minibatch of B transitions.
#[derive(Clone, Debug, Default)]
pub struct Transitions {
    /// What sees the scenes that the buffer keeps.
    pub sensor: &'static dyn Sensor,
    /// Observations acted upon, `[B]`.
    pub inputs: BitBatch,
    /// Observations that followed: the final one where the episode ended, `[B]`.
    pub next: BitBatch,
    /// `[B]`.
    pub actions: Vec<u8>,
    /// `[B]`.
    pub rewards: Vec<f32>,
    /// `[B]`.
    pub terminated: Vec<bool>,
}

impl Replay {
    /// An empty buffer for `capacity` transitions.
    pub fn new(capacity: usize, level: &Arc<Level>) -> Self {
        let words = level.len().div_ceil(64);
        Self {
            level: level.clone(),
            capacity,
            words,
            len: 0,
            next: 0,
            cells: vec![0; capacity * 2],
            visited: vec![0; capacity * 2 * words],
            actions: vec![0; capacity],
            rewards: vec![0.0; capacity],
            terminated: vec![false; capacity],
            carried: None,
        }
    }

    /// A buffer that holds what another one held; it has been [checked](ReplayState::check).
    pub fn restore(capacity: usize, level: &Arc<Level>, sensor: &dyn Sensor, state: &ReplayState) -> Self {
        let mut replay = Self::new(capacity, level);
        replay.len = state.actions.len();
        replay.next = state.next;
        replay.cells[..state.cells.len()].copy_from_slice(&state.cells);
        replay.visited[..state.visited.len()].copy_from_slice(&state.visited);
        replay.actions[..state.actions.len()].copy_from_slice(&state.actions);
        replay.rewards[..state.rewards.len()].copy_from_slice(&state.rewards);
        replay.terminated[..state.terminated.len()].copy_from_slice(&state.terminated);
        let carried = |observed: &Observed| Carried::new(replay.oldest(), observed.clone(), sensor, level);
        replay.carried = Some(&state.carried).filter(|observed| !observed.is_empty()).map(carried);
        replay
    }

    /// What it holds.
    pub fn state(&self) -> ReplayState {
        let len = self.len;
        ReplayState {
            next: self.next,
            cells: self.cells[..2 * len].to_vec(),
            visited: self.visited[..2 * len * self.words].to_vec(),
            actions: self.actions[..len].to_vec(),
            rewards: self.rewards[..len].to_vec(),
            terminated: self.terminated[..len].to_vec(),
            carried: self
                .carried
                .as_ref()
                .filter(|carried| !carried.is_empty())
                .map(Carried::observed)
                .unwrap_or_default(),
        }
    }

    /// What it leaves to the next stage: everything that it holds, as `sensor` sees it.
    pub fn past(&self, sensor: &dyn Sensor) -> Past {
        let constant = sensor.constant_inputs(&self.level);
        let mut past = Past { observed: Observed::new(sensor.inputs(&self.level)), ..Past::default() };
        let mut inputs = Vec::new();
        for slot in (0..self.len).map(|i| (self.oldest() + i) % self.len) {
            for place in [2 * slot, 2 * slot + 1] {
                inputs.clear();
                self.push_all(place, &constant, sensor, &mut inputs);
                past.observed.push(&inputs);
            }
            past.actions.push(self.actions[slot]);
            past.rewards.push(self.rewards[slot]);
            past.terminated.push(self.terminated[slot]);
        }
        past
    }

    /// Transitions stored.
    pub fn len(&self) -> usize {
        self.len
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.len == 0
    }

    /// The slot of the oldest transition.
    fn oldest(&self) -> usize {
        if self.len == self.capacity { self.next } else { 0 }
    }

    /// Bytes that the buffer takes, without transitions of earlier stages.
    pub fn bytes(&self) -> usize {
        self.cells.len() * 2 + self.visited.len() * 8 + self.actions.len() * (1 + 4 + 1)
    }

    /// Stores the first half of N transitions: where the environments stand and what is done there.
    pub fn begin(&mut self, states: &[State], actions: &[Action]) {
        for (i, (state, action)) in states.iter().zip(actions).enumerate() {
            let slot = (self.next + i) % self.capacity;
            self.put(2 * slot, state);
            self.actions[slot] = *action as u8;
        }
    }

    /// Stores the second half, once the environments have made their step.
    pub fn end<R: Rng>(&mut self, envs: &VecEnv<R>) {
        let states = envs.states().iter().zip(envs.final_states());
        for (step, (state, last)) in envs.steps().iter().zip(states) {
            let slot = self.next;
            self.put(2 * slot + 1, if step.episode.is_some() { last } else { state });
            self.rewards[slot] = step.reward;
            self.terminated[slot] = step.terminated;
            if let Some(carried) = &mut self.carried {
                carried.give(slot);
            }
            self.next = (slot + 1) % self.capacity;
            self.len = self.capacity.min(self.len + 1);
        }
    }

    fn put(&mut self, place: usize, state: &State) {
        self.cells[place] = state.agent;
        self.visited[place * self.words..][..self.words].copy_from_slice(state.visited.words());
    }

    /// Draws `count` transitions uniformly with replacement into `out`.
    pub fn sample(&self, count: usize, stream: &mut impl Rng, out: &mut Transitions) {
        out.clear();
        if let Some(carried) = &self.carried {
            carried.share([&mut out.inputs, &mut out.next]);
        }
        for _ in 0..count {
            self.copy(below(stream, self.len as u32) as usize, out);
        }
    }

    /// So many states of transitions drawn at random, with repetition.
    pub fn draw(&self, sensor: &'static dyn Sensor, count: usize, stream: &mut impl Rng) -> BitBatch {
        let mut drawn = Transitions::new(sensor, &self.level);
        self.sample(count, stream, &mut drawn);
        drawn.inputs
    }

    /// Appends the transition in `slot` to `out`.
    fn copy(&self, slot: usize, out: &mut Transitions) {
        let sensor = out.sensor;
        let mixed = self.carried.as_ref().filter(|carried| !carried.is_empty());
        let active = |place: usize, batch: &mut BitBatch| {
            batch.push_with(|rows| match mixed {
                None => sensor.push_active(self.scene(place), rows),
                Some(carried) => self.push_all(place, carried.constant(), sensor, rows),
            });
        };
        active(2 * slot, &mut out.inputs);
        active(2 * slot + 1, &mut out.next);
        out.actions.push(self.actions[slot]);
        out.rewards.push(self.rewards[slot]);
        out.terminated.push(self.terminated[slot]);
    }

    /// The scene at a place of this stage.
    fn scene(&self, place: usize) -> Scene<'_> {
        let visited = &self.visited[place * self.words..][..self.words];
        Scene { level: &self.level, agent: self.cells[place], visited }
    }

    /// Appends all inputs that are 1 at a place of any stage, ascending; `constant` are those that this level's scenes share.
    fn push_all(&self, place: usize, constant: &[u16], sensor: &dyn Sensor, rows: &mut Vec<u16>) {
        match self.carried.as_ref().and_then(|carried| carried.inputs(place)) {
            Some(inputs) => rows.extend(inputs),
            None => {
                let start = rows.len();
                rows.extend_from_slice(constant);
                sensor.push_active(self.scene(place), rows);
                rows[start..].sort_unstable();
            }
        }
    }
}

impl ReplayState {
    /// A buffer of this capacity on a level at the beginning of a stage, with what earlier ones have left.
    pub fn beginning(mut past: Past, capacity: usize, level: &Level) -> Self {
        past.keep_newest(capacity);
        let len = past.actions.len();
        Self {
            next: len % capacity,
            cells: vec![0; 2 * len],
            visited: vec![0; 2 * len * level.len().div_ceil(64)],
            actions: past.actions,
            rewards: past.rewards,
            terminated: past.terminated,
            carried: past.observed,
        }
    }

    /// Adds it to the buffers of a snapshot.
    pub fn write(self, buffers: &mut Buffers) {
        let len = self.actions.len();
        let words = self.visited.len() / (2 * len).max(1);
        buffers.add("replay/next", &[1], Data::U64(vec![self.next as u64]));
        buffers.add("replay/cells", &[len, 2], Data::U16(self.cells));
        buffers.add("replay/visited", &[len, 2, words], Data::U64(self.visited));
        buffers.add("replay/actions", &[len], Data::U8(self.actions));
        buffers.add("replay/rewards", &[len], Data::F32(self.rewards));
        let terminated = self.terminated.into_iter().map(u8::from).collect();
        buffers.add("replay/terminated", &[len], Data::U8(terminated));
        if !self.carried.is_empty() {
            self.carried.write(CARRIED, buffers);
        }
    }

    /// Reads it from the buffers of a snapshot.
    ///
    /// # Errors
    /// A buffer that is missing or of another type.
    pub fn read(buffers: &Buffers) -> Result<Self, String> {
        let lost = |name: &str| format!("its {name} is missing: it belongs to another algorithm");
        let next = buffers.u64s("replay/next").and_then(|next| usize::try_from(*next.first()?).ok());
        let bytes = |name: &str| buffers.u8s(name).ok_or_else(|| lost(name));
        Ok(Self {
            next: next.ok_or_else(|| lost("replay/next"))?,
            cells: buffers.u16s("replay/cells").ok_or_else(|| lost("replay/cells"))?.to_vec(),
            visited: buffers.u64s("replay/visited").ok_or_else(|| lost("replay/visited"))?.to_vec(),
            actions: bytes("replay/actions")?.to_vec(),
            rewards: buffers.f32s("replay/rewards").ok_or_else(|| lost("replay/rewards"))?.to_vec(),
            terminated: bytes("replay/terminated")?.iter().map(|&terminated| terminated != 0).collect(),
            carried: Observed::read(CARRIED, buffers)?.unwrap_or_default(),
        })
    }

    /// Checks that a buffer of this capacity on this level can hold it.
    ///
    /// # Errors
    /// What cannot be so.
    pub fn check(&self, capacity: usize, level: &Level, sensor: &dyn Sensor) -> Result<(), &'static str> {
        let len = self.actions.len();
        let open = level.open_cells().words();
        let lengths = [self.cells.len(), self.visited.len(), self.rewards.len(), self.terminated.len()];
        if len > capacity || lengths != [2 * len, 2 * len * open.len(), len, len] {
            return Err("its replay buffer has another size");
        }
        let in_order = if len < capacity { self.next == len } else { self.next < capacity };
        if !in_order {
            return Err("its replay buffer is filled in another order");
        }
        let oldest = if len == capacity { self.next } else { 0 };
        let has_carried = !self.carried.is_empty();
        if has_carried && (!self.carried.is_of(sensor.inputs(level)) || self.carried.len() > len - oldest) {
            return Err("its replay buffer holds something else of earlier stages than it can");
        }
        let within = |(&cell, visited): (&u16, &[u64])| {
            usize::from(cell) < level.len() && visited.iter().zip(open).all(|(word, open)| word & !open == 0)
        };
        if !self.cells.iter().zip(self.visited.chunks_exact(open.len())).all(within)
            || self.actions.iter().any(|&action| usize::from(action) >= Action::COUNT)
            || self.rewards.iter().any(|reward| !reward.is_finite())
        {
            return Err("its replay buffer holds transitions that the level does not have");
        }
        Ok(())
    }
}

impl Transitions {
    /// An empty minibatch for transitions on `level`, as `sensor` sees them.
    pub fn new(sensor: &'static dyn Sensor, level: &Level) -> Self {
        let [inputs, next] = std::array::from_fn(|_| observations(sensor, level));
        Self { sensor, inputs, next, ..Self::default() }
    }

    fn clear(&mut self) {
        self.inputs.clear();
        self.next.clear();
        self.actions.clear();
        self.rewards.clear();
        self.terminated.clear();
    }

    /// The targets r + γ·(1 − terminated)·max Q(next), `[B]`, given the target network's `next_values`, `[B, 4]`.
    pub fn targets<'a>(&'a self, next_values: &'a [f32], gamma: f32) -> impl Iterator<Item = f32> + 'a {
        let transitions = self.rewards.iter().zip(&self.terminated);
        transitions.zip(next_values.chunks_exact(Action::COUNT)).map(move |((reward, &terminated), values)| {
            let best = values.iter().copied().fold(f32::NEG_INFINITY, f32::max);
            if terminated { *reward } else { reward + gamma * best }
        })
    }
}
