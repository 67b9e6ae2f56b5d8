//! A rollout: what the policy met in `n_steps`, and the advantages estimated from it.

use bit_mlp::BitBatch;
use coverage_env::random::below;
use coverage_env::{Action, Level, Scene, Sensor, State, VecEnv};
use rand::Rng;

use crate::agent::choice::log_softmax;
use crate::agent::observe::{observations, observe};

/// The rollout of one seed: T steps of N environments, stored time-major, `[T, N]`.
#[derive(Clone, Debug, Default)]
pub struct Rollout {
    num_envs: usize,
    /// What sees the environments.
    sensor: &'static dyn Sensor,
    /// Observations that were acted upon, `[T, N]`.
    pub inputs: BitBatch,
    /// Observations beyond them: the N that follow the last step, then the final ones of truncated episodes.
    pub beyond: BitBatch,
    /// `[T, N]`.
    pub actions: Vec<u8>,
    /// `[T, N]`; [`Rollout::estimate`] adds γ·V(final observation) where an episode was truncated.
    pub rewards: Vec<f32>,
    /// Whether the episode ended with this step, `[T, N]`.
    pub dones: Vec<bool>,
    /// Where an episode was truncated and not terminated: indices into `[T, N]`, in the order of `beyond`.
    pub truncated: Vec<usize>,
    /// V(s) of the policy that collected, `[T, N]`.
    pub values: Vec<f32>,
    /// ln π(a|s) of the policy that collected, `[T, N]`.
    pub log_probs: Vec<f32>,
    /// Generalised advantage estimates, `[T, N]`.
    pub advantages: Vec<f32>,
    /// Advantages + values, `[T, N]`: what the value tower learns.
    pub returns: Vec<f32>,
    /// Final observations met so far, appended to `beyond` at the end.
    finals: BitBatch,
}

impl Rollout {
    /// An empty rollout of `num_envs` environments on `level`, as `sensor` sees them.
    pub fn new(num_envs: usize, sensor: &'static dyn Sensor, level: &Level) -> Self {
        let [inputs, beyond, finals] = std::array::from_fn(|_| observations(sensor, level));
        Self { num_envs, sensor, inputs, beyond, finals, ..Self::default() }
    }

    /// So many of its states drawn at random, with repetition.
    pub fn draw(&self, count: usize, stream: &mut impl Rng) -> BitBatch {
        let mut drawn = BitBatch::default();
        drawn.set_constant(self.inputs.constant());
        for _ in 0..count {
            drawn.push_sample(self.inputs.sample(below(stream, self.inputs.len() as u32) as usize));
        }
        drawn
    }

    /// Samples collected, T·N once it is full.
    pub fn len(&self) -> usize {
        self.rewards.len()
    }

    /// Whether nothing is collected.
    pub fn is_empty(&self) -> bool {
        self.rewards.is_empty()
    }

    /// Empties it for the next collection.
    pub fn clear(&mut self) {
        [&mut self.inputs, &mut self.beyond, &mut self.finals].into_iter().for_each(BitBatch::clear);
        self.actions.clear();
        self.rewards.clear();
        self.dones.clear();
        self.truncated.clear();
    }

    /// Adds the N observations of one step and the actions taken on them.
    pub fn push_observations(&mut self, observations: &BitBatch, actions: &[Action]) {
        (0..observations.len()).for_each(|i| self.inputs.push_sample(observations.sample(i)));
        self.actions.extend(actions.iter().map(|&action| action as u8));
    }

    /// Adds what the N environments answered.
    pub fn push_steps<R: Rng>(&mut self, envs: &VecEnv<R>) {
        for (step, state) in envs.steps().iter().zip(envs.final_states()) {
            if step.truncated && !step.terminated {
                self.truncated.push(self.rewards.len());
                self.push_final(envs.level(), state);
            }
            self.rewards.push(step.reward);
            self.dones.push(step.terminated || step.truncated);
        }
    }

    fn push_final(&mut self, level: &Level, state: &State) {
        self.finals.push_with(|rows| self.sensor.push_active(Scene::new(level, state), rows));
    }

    /// Closes the collection: notes the observations that follow the last step.
    pub fn finish<R: Rng>(&mut self, envs: &VecEnv<R>) {
        observe(self.sensor, envs, &mut self.beyond);
        (0..self.finals.len()).for_each(|i| self.beyond.push_sample(self.finals.sample(i)));
    }

    /// Fills in values, log-probabilities, advantages and returns.
    ///
    /// `logits`, `[T, N, 4]`, and `values`, `[T, N]`, belong to `inputs`; `beyond` are the values of the observations beyond. The reward of a step
    /// that truncated its episode first gains γ·V(final observation), which is as much as not ending it there
    /// (Pardo et al. 2018, section 3); then generalised advantage estimation (Schulman et al. 2016, equation 16)
    ///
    /// δₜ = rₜ + γ·V(sₜ₊₁)·(1 − dₜ) − V(sₜ), Aₜ = δₜ + γλ·(1 − dₜ)·Aₜ₊₁.
    pub fn estimate(&mut self, logits: &[f32], values: Vec<f32>, beyond: &[f32], gamma: f64, lambda: f64) {
        let (last_values, final_values) = beyond.split_at(self.num_envs);
        for (&at, value) in self.truncated.iter().zip(final_values) {
            self.rewards[at] += gamma as f32 * value;
        }
        self.values = values;
        self.log_probs.clear();
        let taken = logits.chunks_exact(Action::COUNT).zip(&self.actions);
        self.log_probs.extend(taken.map(|(logits, &action)| log_softmax(logits)[usize::from(action)]));

        let (n, samples) = (self.num_envs, self.rewards.len());
        let decay = (gamma * lambda) as f32;
        self.advantages.clear();
        self.advantages.resize(samples, 0.0);
        for i in (0..samples).rev() {
            let (next_value, next_advantage) = match i + n {
                next if next < samples => (self.values[next], self.advantages[next]),
                next => (last_values[next - samples], 0.0),
            };
            let alive = f32::from(!self.dones[i]);
            let delta = self.rewards[i] + gamma as f32 * next_value * alive - self.values[i];
            self.advantages[i] = delta + decay * alive * next_advantage;
        }
        self.returns.clear();
        self.returns.extend(self.advantages.iter().zip(&self.values).map(|(a, v)| a + v));
    }

    /// 1 − Var(returns − values) / Var(returns); NaN where the returns do not vary.
    pub fn explained_variance(&self) -> f64 {
        let variance = |of: &dyn Fn(usize) -> f64| {
            let count = self.returns.len() as f64;
            let mean = (0..self.returns.len()).map(of).sum::<f64>() / count;
            (0..self.returns.len()).map(|i| (of(i) - mean).powi(2)).sum::<f64>() / count
        };
        let total = variance(&|i| self.returns[i].into());
        if total == 0.0 { f64::NAN } else { 1.0 - variance(&|i| f64::from(self.returns[i] - self.values[i])) / total }
    }
}
