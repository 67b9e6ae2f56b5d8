//! Deep Q-learning (Mnih et al. 2015), as Stable-Baselines3 2.9 has it.
//!
//! Its loop is `Dqn::step`: every environment makes a step, and every `train_freq` of them an update follows. The
//! networks' arithmetic is behind [`DqnUpdater`], once with libtorch and once fused.

mod autograd;
mod fused;
mod replay;

use bit_mlp::{BitBatch, GradientNorms};
use coverage_env::random::{below, unit_f64};
use coverage_env::{Action, VecEnv};

pub use autograd::AutogradDqn;
pub use fused::FusedDqn;
pub use replay::{Replay, ReplayState, Transitions};

use super::episodes::EpisodeWindow;
use super::random::Stream;
use super::snapshot::{Position, Snapshot};
use super::state::AgentState;
use super::{Backend, Learner, Metrics, Stage, dose_metrics, greedy, network, observations, observe};
use crate::config::{Config, DqnConfig, OptimizerConfig};

/// Timesteps between two rows of the log.
const LOG_INTERVAL: u64 = 2048;

/// The networks' part of DQN for S seeds.
pub trait DqnUpdater: Send {
    /// Action values for the N current observations of each seed, `[S, N, 4]`.
    fn act(&mut self, inputs: &[BitBatch], values: &mut [f32]);
    /// One clipped Adam step per seed on its transitions.
    fn minibatch(&mut self, transitions: &[&Transitions]) -> Vec<DqnLoss>;
    /// Copies each network into its target network.
    fn copy_target(&mut self);
    /// Norms of the last minibatch's gradient, the loss's and the L2 penalty's.
    fn norms(&self, seed: usize) -> GradientNorms;
    /// Writes the weights, target network and optimiser state of a seed into `agent`.
    fn save(&self, seed: usize, agent: &mut AgentState);
}

/// What one minibatch brought.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct DqnLoss {
    /// Mean smooth L1 loss of the temporal-difference errors.
    pub loss: f32,
    /// Norm of the gradient before clipping.
    pub grad_norm: f32,
}

/// ε over the timesteps of a stage.
///
/// Linear from `exploration_initial_eps` to `exploration_final_eps` over the first `exploration_fraction` of the first
/// stage; a later stage has the final value throughout ("without exploration").
#[derive(Clone, Copy, Debug)]
pub struct Exploration {
    initial: f64,
    last: f64,
    /// Timesteps of the decay; 0 where there is none.
    decay: f64,
}

impl Exploration {
    /// The schedule of a stage.
    pub fn new(config: &DqnConfig, stage: &Stage) -> Self {
        let decay = if stage.index == 0 { config.exploration_fraction * stage.horizon as f64 } else { 0.0 };
        Self { initial: config.exploration_initial_eps, last: config.exploration_final_eps, decay }
    }

    /// ε after this many timesteps.
    pub fn epsilon(&self, timesteps: u64) -> f64 {
        let timesteps = timesteps as f64;
        if timesteps > self.decay || self.decay == 0.0 {
            return self.last;
        }
        self.initial + (self.last - self.initial) * timesteps / self.decay
    }
}

/// DQN for S independent seeds that advance together.
pub struct Dqn {
    config: DqnConfig,
    optimizer: OptimizerConfig,
    exploration: Exploration,
    updater: Box<dyn DqnUpdater>,
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
    /// Seeds where these snapshots were taken; they have been checked against the stage and stand together.
    pub(super) fn new(
        config: &Config,
        dqn: &DqnConfig,
        stage: &Stage,
        snapshots: Vec<Snapshot>,
        backend: Backend,
    ) -> Self {
        let network = network(config, &stage.level);
        let agents: Vec<AgentState> = snapshots.iter().map(|snapshot| snapshot.agent.clone()).collect();
        let updater: Box<dyn DqnUpdater> = match backend {
            Backend::Fused => Box::new(FusedDqn::new(&network, config.gamma, &config.optimizer, &agents)),
            Backend::Autograd(device) => {
                Box::new(AutogradDqn::new(network, device, config.gamma, &config.optimizer, &agents))
            }
        };
        let timesteps = snapshots[0].position.timesteps;
        let seed = |snapshot: Snapshot| Seed {
            envs: snapshot.envs(config, stage).expect("a snapshot is checked before it is used"),
            actions: Stream::at(&snapshot.position.actions),
            minibatches: Stream::at(&snapshot.position.minibatches),
            replay: Replay::restore(dqn.buffer_size, &stage.level, &snapshot.replay.unwrap_or_default()),
            chosen: Vec::with_capacity(config.num_envs),
            transitions: Transitions::new(&stage.level),
            episodes: snapshot.position.episodes,
            losses: Losses::default(),
            agent: snapshot.agent,
        };
        Self {
            config: dqn.clone(),
            optimizer: config.optimizer.clone(),
            exploration: Exploration::new(dqn, stage),
            updater,
            current: vec![observations(&stage.level); agents.len()],
            values: vec![0.0; agents.len() * config.num_envs * Action::COUNT],
            seeds: snapshots.into_iter().map(seed).collect(),
            timesteps,
            end: stage.timesteps,
            num_envs: config.num_envs,
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
            self.updater.copy_target();
        }
        let steps = self.timesteps / self.num_envs as u64;
        if steps.is_multiple_of(self.config.train_freq) && self.timesteps > self.config.learning_starts {
            (0..self.config.gradient_steps).for_each(|_| self.update());
        }
    }

    /// Chooses ε-greedy actions, takes them, and stores the transitions.
    fn act(&mut self) {
        let random = self.timesteps < self.config.learning_starts;
        let epsilon = self.exploration.epsilon(self.timesteps);
        if !random {
            for (seed, current) in self.seeds.iter().zip(&mut self.current) {
                observe(&seed.envs, current);
            }
            self.updater.act(&self.current, &mut self.values);
        }
        for (seed, values) in self.seeds.iter_mut().zip(self.values.chunks_exact(self.num_envs * Action::COUNT)) {
            seed.chosen.clear();
            for values in values.chunks_exact(Action::COUNT) {
                let explore = random || unit_f64(&mut seed.actions) < epsilon;
                let uniform = |actions: &mut Stream| Action::ALL[below(actions, Action::COUNT as u32) as usize];
                seed.chosen.push(if explore { uniform(&mut seed.actions) } else { greedy(values) });
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
        let transitions: Vec<&Transitions> = self.seeds.iter().map(|seed| &seed.transitions).collect();
        let losses = self.updater.minibatch(&transitions);
        for (seed, loss) in self.seeds.iter_mut().zip(losses) {
            seed.agent.counters.updates += 1;
            seed.losses.loss += f64::from(loss.loss);
            seed.losses.grad_norm += f64::from(loss.grad_norm);
            seed.losses.count += 1;
        }
    }

    /// The row of a seed; docs/metrics.md defines each column.
    fn metrics(&self, seed: &Seed, norms: GradientNorms) -> Metrics {
        let mean = |sum: f64| sum / f64::from(seed.losses.count);
        let mut row = vec![
            ("rollout/ep_rew_mean", seed.episodes.mean_return()),
            ("rollout/ep_len_mean", seed.episodes.mean_length()),
            ("rollout/episodes", seed.episodes.count as f64),
            ("rollout/exploration_rate", self.exploration.epsilon(self.timesteps)),
            ("train/learning_rate", self.optimizer.learning_rate),
            ("train/loss", mean(seed.losses.loss)),
            ("train/n_updates", seed.agent.counters.updates as f64),
            ("train/grad_norm", mean(seed.losses.grad_norm)),
        ];
        row.extend(dose_metrics(&seed.agent, &self.optimizer, norms));
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
            self.updater.save(s, &mut seed.agent);
        }
        self.seeds.iter().enumerate().map(|(s, seed)| self.metrics(seed, self.updater.norms(s))).collect()
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

    fn parameters(&self, seed: usize) -> &[f32] {
        &self.seeds[seed].agent.parameters
    }

    fn states(&self) -> Vec<AgentState> {
        self.seeds.iter().map(|seed| seed.agent.clone()).collect()
    }

    fn snapshot(&self, seed: usize) -> Snapshot {
        let seed = &self.seeds[seed];
        let position = Position::of(self.timesteps, &seed.envs, &seed.actions, &seed.minibatches, &seed.episodes);
        Snapshot { agent: seed.agent.clone(), position, replay: Some(seed.replay.state()) }
    }
}
