//! The loop: act, store, learn.

use bit_mlp::BitBatch;
use coverage_env::{Action, Sensor, VecEnv};

use super::exploration::Exploration;
use super::loss::{DqnLoss, TARGET};
use super::replay::{Replay, ReplayState, Transitions};
use super::settings::DqnConfig;
use crate::agent::algorithm::Setup;
use crate::agent::buffers::Buffers;
use crate::agent::choice::{Behaviour, uniform};
use crate::agent::engine::{Engine, Loss};
use crate::agent::episodes::EpisodeWindow;
use crate::agent::learner::{Learner, Metrics, weight_norm};
use crate::agent::mitigation::Regimen;
use crate::agent::observe::{observations, observe};
use crate::agent::snapshot::{Position, Snapshot};
use crate::agent::state::AgentState;
use crate::random::Stream;

/// Timesteps between two rows of the log.
const LOG_INTERVAL: u64 = 2048;
/// DQN for S independent seeds that advance together.
pub struct Dqn {
    config: DqnConfig,
    sensor: &'static dyn Sensor,
    learning_rate: f64,
    /// γ.
    gamma: f64,
    exploration: Exploration,
    engine: Box<dyn Engine>,
    regimen: Regimen,
    seeds: Vec<Seed>,
    /// Each seed's current observations, kept between steps to spare their memory.
    current: Vec<BitBatch>,
    /// Each seed's action values `[S, N, 4]`.
    values: Vec<f32>,
    /// Of this stage.
    timesteps: u64,
    /// Timesteps after which the stage ends.
    end: u64,
    num_envs: usize,
}

/// What each seed has of its own beside its networks.
struct Seed {
    agent: AgentState,
    envs: VecEnv<Stream>,
    actions: Stream,
    minibatches: Stream,
    replay: Replay,
    /// The actions of this step, `[N]`.
    chosen: Vec<Action>,
    transitions: Transitions,
    episodes: EpisodeWindow,
    losses: Losses,
}

/// Sums over the minibatches since the last row of the log.
#[derive(Default)]
struct Losses {
    loss: f64,
    grad_norm: f64,
    count: u32,
}

impl Dqn {
    /// Seeds where their snapshots were taken.
    pub(super) fn new(dqn: &DqnConfig, setup: Setup<'_>) -> Self {
        let Setup { shared, stage, snapshots, engine, regimen } = setup;
        let timesteps = snapshots[0].position.timesteps;
        let seed = |snapshot: Snapshot| Seed {
            envs: snapshot.envs(shared.max_steps, stage).expect("a snapshot is checked before it is used"),
            actions: Stream::at(&snapshot.position.actions),
            minibatches: Stream::at(&snapshot.position.minibatches),
            replay: Replay::restore(dqn.buffer_size, &stage.level, shared.sensor, &replay_of(&snapshot.buffers)),
            chosen: Vec::with_capacity(shared.num_envs),
            transitions: Transitions::new(shared.sensor, &stage.level),
            episodes: snapshot.position.episodes,
            losses: Losses::default(),
            agent: snapshot.agent,
        };
        Self {
            config: dqn.clone(),
            sensor: shared.sensor,
            learning_rate: shared.optimizer.learning_rate,
            gamma: shared.gamma,
            exploration: Exploration::new(dqn, stage),
            engine,
            regimen,
            current: vec![observations(shared.sensor, &stage.level); snapshots.len()],
            values: vec![0.0; snapshots.len() * shared.num_envs * Action::COUNT],
            seeds: snapshots.into_iter().map(seed).collect(),
            timesteps,
            end: stage.timesteps,
            num_envs: shared.num_envs,
        }
    }
}

impl Dqn {
    /// One step of every environment, and an update when one is due.
    fn step(&mut self) {
        self.act();
        for seed in &mut self.seeds {
            seed.episodes.extend(seed.envs.steps());
            seed.agent.counters.target_calls += 1;
        }
        self.timesteps += self.num_envs as u64;

        let calls = self.seeds[0].agent.counters.target_calls;
        let interval = (self.config.target_update_interval / self.num_envs as u64).max(1);
        if calls.is_multiple_of(interval) {
            self.engine.copy(TARGET);
        }
        let steps = self.timesteps / self.num_envs as u64;
        if steps.is_multiple_of(self.config.train_freq) && self.timesteps > self.config.learning_starts {
            (0..self.config.gradient_steps).for_each(|_| self.update());
        }
    }

    /// Chooses ε-greedy actions, takes them, and stores the transitions.
    fn act(&mut self) {
        let random = self.timesteps < self.config.learning_starts;
        let behaviour = Behaviour::EpsilonGreedy(self.exploration.epsilon(self.timesteps));
        if !random {
            for (seed, current) in self.seeds.iter().zip(&mut self.current) {
                observe(self.sensor, &seed.envs, current);
            }
            self.engine.act(&self.current, &mut self.values);
        }
        for (seed, values) in self.seeds.iter_mut().zip(self.values.chunks_exact(self.num_envs * Action::COUNT)) {
            seed.chosen.clear();
            for values in values.chunks_exact(Action::COUNT) {
                let actions = &mut seed.actions;
                seed.chosen.push(if random { uniform(actions) } else { behaviour.choose(values, actions) });
            }
            seed.replay.begin(seed.envs.states(), &seed.chosen);
            seed.envs.step(&seed.chosen);
            seed.replay.end(&seed.envs);
        }
    }

    fn update(&mut self) {
        for seed in &mut self.seeds {
            seed.replay.sample(self.config.batch_size, &mut seed.minibatches, &mut seed.transitions);
        }
        let gamma = self.gamma as f32;
        let mut losses: Vec<DqnLoss<'_>> =
            self.seeds.iter().map(|seed| DqnLoss::new(gamma, &seed.transitions)).collect();
        let draw =
            |seed: usize, count: usize, stream: &mut Stream| self.seeds[seed].replay.draw(self.sensor, count, stream);
        let mut each: Vec<&mut dyn Loss<'_>> = losses.iter_mut().map(|loss| loss as _).collect();
        let norms = self.regimen.descend(&mut *self.engine, &mut each, &draw);
        let losses: Vec<f32> = losses.into_iter().map(|loss| loss.value).collect();
        for ((seed, loss), norm) in self.seeds.iter_mut().zip(losses).zip(norms) {
            seed.agent.counters.updates += 1;
            seed.losses.loss += f64::from(loss);
            seed.losses.grad_norm += f64::from(norm);
            seed.losses.count += 1;
        }
    }

    /// The row of a seed; docs/metrics.md defines each column.
    fn metrics(&self, s: usize) -> Metrics {
        let seed = &self.seeds[s];
        let mean = |sum: f64| sum / f64::from(seed.losses.count);
        let mut row = vec![
            ("rollout/ep_rew_mean", seed.episodes.mean_return()),
            ("rollout/ep_len_mean", seed.episodes.mean_length()),
            ("rollout/episodes", seed.episodes.count as f64),
            ("rollout/exploration_rate", self.exploration.epsilon(self.timesteps)),
            ("train/learning_rate", self.learning_rate),
            ("train/loss", mean(seed.losses.loss)),
            ("train/n_updates", seed.agent.counters.updates as f64),
            ("train/grad_norm", mean(seed.losses.grad_norm)),
            ("train/weight_norm", weight_norm(&seed.agent)),
        ];
        row.extend(self.regimen.metrics(&*self.engine, s));
        row
    }
}

impl Learner for Dqn {
    fn advance(&mut self) -> Vec<Metrics> {
        let (before, end) = (self.timesteps, self.next_timesteps());
        self.seeds.iter_mut().for_each(|seed| seed.losses = Losses::default());
        while self.timesteps < end {
            self.step();
        }
        for (s, seed) in self.seeds.iter_mut().enumerate() {
            seed.agent.counters.timesteps += self.timesteps - before;
            self.engine.save(s, &mut seed.agent);
            self.regimen.save(s, &mut seed.agent);
        }
        (0..self.seeds.len()).map(|s| self.metrics(s)).collect()
    }

    fn timesteps(&self) -> u64 {
        self.timesteps
    }

    /// The next multiple of the log's interval, or the end of the stage, but whole blocks of `train_freq` steps.
    fn next_timesteps(&self) -> u64 {
        let due = (self.timesteps / LOG_INTERVAL + 1) * LOG_INTERVAL;
        let block = self.config.train_freq * self.num_envs as u64;
        due.min(self.end).max(self.timesteps + 1).next_multiple_of(block)
    }

    fn agents(&self) -> Vec<&AgentState> {
        self.seeds.iter().map(|seed| &seed.agent).collect()
    }

    fn leaving(&self, seed: usize) -> AgentState {
        let seed = &self.seeds[seed];
        let mut agent = seed.agent.clone();
        if self.config.saves_replay() {
            seed.replay.past(self.sensor).write(&mut agent.kept.buffers);
        }
        agent
    }

    fn snapshot(&self, seed: usize) -> Snapshot {
        let seed = &self.seeds[seed];
        let position = Position::of(self.timesteps, &seed.envs, &seed.actions, &seed.minibatches, &seed.episodes);
        let mut buffers = Buffers::default();
        seed.replay.state().write(&mut buffers);
        Snapshot { agent: seed.agent.clone(), position, buffers }
    }
}

/// The replay buffer of a checked snapshot.
fn replay_of(buffers: &Buffers) -> ReplayState {
    ReplayState::read(buffers).expect("a snapshot is checked before it is used")
}
