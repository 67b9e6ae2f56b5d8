//! Proximal policy optimisation (Schulman et al. 2017), as Stable-Baselines3 2.9 has it.
//!
//! [`Ppo::advance`] is one iteration: collect a rollout, estimate advantages, update over minibatches. The networks'
//! arithmetic is behind [`PpoUpdater`], once with libtorch and once fused; everything else is here and in [`Rollout`].

mod autograd;
mod fused;
mod rollout;

use bit_mlp::{BitBatch, GradientNorms};
use coverage_env::random::{shuffle, unit_f32};
use coverage_env::{Action, VecEnv};

pub use autograd::AutogradPpo;
pub use fused::FusedPpo;
pub use rollout::{Outputs, Rollout};

use super::episodes::EpisodeWindow;
use super::random::Stream;
use super::snapshot::{Position, Snapshot};
use super::state::AgentState;
use super::{Backend, Learner, Metrics, Stage, dose_metrics, network, observations, observe, sample};
use crate::config::{Config, OptimizerConfig, PpoConfig};

/// The networks' part of PPO for S seeds: forward passes and updates.
pub trait PpoUpdater: Send {
    /// Policy logits for the N current observations of each seed, `[S, N, 4]`.
    fn act(&mut self, inputs: &[BitBatch], logits: &mut [f32]);
    /// Policy logits and values of every sample of each seed.
    fn forward(&mut self, inputs: &[&BitBatch]) -> Vec<Outputs>;
    /// Makes finished rollouts ready for their minibatches.
    fn load(&mut self, rollouts: &[&Rollout]);
    /// One clipped Adam step per seed on the samples `indices[s]` of its rollout, equally many for each.
    fn minibatch(&mut self, rollouts: &[&Rollout], indices: &[&[u32]]) -> Vec<PpoLoss>;
    /// Norms of the last minibatch's gradient, the loss's and the L2 penalty's.
    fn norms(&self, seed: usize) -> GradientNorms;
    /// Writes the weights and optimiser state of a seed into `agent`.
    fn save(&self, seed: usize, agent: &mut AgentState);
}

/// The terms of one minibatch's loss, as Stable-Baselines3 logs them.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PpoLoss {
    /// Clipped surrogate, negated (Schulman et al. 2017, equation 7).
    pub policy: f32,
    /// Mean squared error of the values.
    pub value: f32,
    /// Negated mean entropy.
    pub entropy: f32,
    /// What is descended: policy + ent_coef · entropy + vf_coef · value, an L2 penalty in the loss aside.
    pub total: f32,
    /// Schulman's estimate, the mean of (r − 1) − ln r, of the KL divergence from the old policy.
    pub approx_kl: f32,
    /// Share of samples whose ratio r left the clip range.
    pub clip_fraction: f32,
    /// Norm of the gradient before clipping.
    pub grad_norm: f32,
}

/// PPO for S independent seeds that advance together.
pub struct Ppo {
    config: PpoConfig,
    optimizer: OptimizerConfig,
    gamma: f64,
    updater: Box<dyn PpoUpdater>,
    seeds: Vec<Seed>,
}

/// What each seed has of its own beside its networks.
struct Seed {
    agent: AgentState,
    envs: VecEnv<Stream>,
    actions: Stream,
    minibatches: Stream,
    rollout: Rollout,
    /// Order of the rollout's samples in this epoch.
    order: Vec<u32>,
    episodes: EpisodeWindow,
    timesteps: u64,
    losses: Losses,
}

/// The losses of an update's minibatches, summed up for the log.
#[derive(Default)]
struct Losses {
    sum: PpoLoss,
    count: u32,
    last_total: f32,
    /// Over the last epoch alone, as Stable-Baselines3 has it.
    kl_sum: f32,
    kl_count: u32,
}

impl Ppo {
    /// Seeds where these snapshots were taken; they have been checked against the stage.
    pub(super) fn new(
        config: &Config,
        ppo: &PpoConfig,
        stage: &Stage,
        snapshots: Vec<Snapshot>,
        backend: Backend,
    ) -> Self {
        let network = network(config, &stage.level);
        let agents: Vec<AgentState> = snapshots.iter().map(|snapshot| snapshot.agent.clone()).collect();
        let updater: Box<dyn PpoUpdater> = match backend {
            Backend::Fused => Box::new(FusedPpo::new(&network, ppo, &config.optimizer, &agents)),
            Backend::Autograd(device) => Box::new(AutogradPpo::new(network, device, ppo, &config.optimizer, &agents)),
        };
        let seed = |snapshot: Snapshot| Seed {
            envs: snapshot.envs(config, stage).expect("a snapshot is checked before it is used"),
            actions: Stream::at(&snapshot.position.actions),
            minibatches: Stream::at(&snapshot.position.minibatches),
            rollout: Rollout::new(config.num_envs, &stage.level),
            order: Vec::new(),
            episodes: snapshot.position.episodes,
            timesteps: snapshot.position.timesteps,
            losses: Losses::default(),
            agent: snapshot.agent,
        };
        Self {
            config: ppo.clone(),
            optimizer: config.optimizer.clone(),
            gamma: config.gamma,
            updater,
            seeds: snapshots.into_iter().map(seed).collect(),
        }
    }

    /// Runs the policy for `n_steps` in every environment.
    fn collect(&mut self) {
        let num_envs = self.seeds[0].envs.len();
        let mut current: Vec<BitBatch> = self.seeds.iter().map(|seed| observations(seed.envs.level())).collect();
        let mut logits = vec![0.0; self.seeds.len() * num_envs * Action::ALL.len()];
        let mut actions = Vec::with_capacity(num_envs);
        self.seeds.iter_mut().for_each(|seed| seed.rollout.clear());
        for _ in 0..self.config.n_steps {
            for (seed, current) in self.seeds.iter().zip(&mut current) {
                observe(&seed.envs, current);
            }
            self.updater.act(&current, &mut logits);
            for (s, (seed, logits)) in self.seeds.iter_mut().zip(logits.chunks_exact(num_envs * 4)).enumerate() {
                actions.clear();
                actions.extend(logits.chunks_exact(4).map(|z| sample(z, unit_f32(&mut seed.actions))));
                seed.rollout.push_observations(&current[s], &actions);
                seed.envs.step(&actions);
                seed.rollout.push_steps(&seed.envs);
                seed.episodes.extend(seed.envs.steps());
            }
        }
        for seed in &mut self.seeds {
            seed.rollout.finish(&seed.envs);
            seed.timesteps += seed.rollout.len() as u64;
        }
    }

    /// Values, log-probabilities, advantages and returns of the collected rollouts.
    fn estimate(&mut self) {
        let outputs = self.updater.forward(&self.seeds.iter().map(|seed| &seed.rollout.inputs).collect::<Vec<_>>());
        let beyond = self.updater.forward(&self.seeds.iter().map(|seed| &seed.rollout.beyond).collect::<Vec<_>>());
        for (seed, (outputs, beyond)) in self.seeds.iter_mut().zip(outputs.iter().zip(&beyond)) {
            seed.rollout.estimate(outputs, &beyond.values, self.gamma, self.config.gae_lambda);
        }
    }

    /// `n_epochs` passes of minibatches over the rollouts, each in a fresh order.
    fn update(&mut self) {
        self.updater.load(&self.seeds.iter().map(|seed| &seed.rollout).collect::<Vec<_>>());
        for seed in &mut self.seeds {
            seed.losses = Losses::default();
            // Beginning from the same order each time, an update depends on no order before it.
            seed.order.clear();
            seed.order.extend(0..seed.rollout.len() as u32);
        }
        for _ in 0..self.config.n_epochs {
            for seed in &mut self.seeds {
                shuffle(&mut seed.minibatches, &mut seed.order);
                seed.losses.begin_epoch();
            }
            let samples = self.seeds[0].order.len();
            for start in (0..samples).step_by(self.config.batch_size) {
                let end = samples.min(start + self.config.batch_size);
                let rollouts: Vec<&Rollout> = self.seeds.iter().map(|seed| &seed.rollout).collect();
                let indices: Vec<&[u32]> = self.seeds.iter().map(|seed| &seed.order[start..end]).collect();
                let losses = self.updater.minibatch(&rollouts, &indices);
                self.seeds.iter_mut().zip(losses).for_each(|(seed, loss)| seed.losses.push(loss));
            }
        }
        for (s, seed) in self.seeds.iter_mut().enumerate() {
            seed.agent.counters.updates += self.config.n_epochs as u64;
            seed.agent.counters.timesteps += seed.rollout.len() as u64;
            self.updater.save(s, &mut seed.agent);
        }
    }
}

impl Losses {
    fn begin_epoch(&mut self) {
        (self.kl_sum, self.kl_count) = (0.0, 0);
    }

    fn push(&mut self, loss: PpoLoss) {
        self.sum.policy += loss.policy;
        self.sum.value += loss.value;
        self.sum.entropy += loss.entropy;
        self.sum.clip_fraction += loss.clip_fraction;
        self.sum.grad_norm += loss.grad_norm;
        self.count += 1;
        self.last_total = loss.total;
        self.kl_sum += loss.approx_kl;
        self.kl_count += 1;
    }
}

impl Seed {
    /// The row of the update just made; docs/metrics.md defines each column.
    fn metrics(&self, config: &PpoConfig, optimizer: &OptimizerConfig, norms: GradientNorms) -> Metrics {
        let mean = |sum: f32| f64::from(sum) / f64::from(self.losses.count);
        let losses = &self.losses;
        let mut row = vec![
            ("rollout/ep_rew_mean", self.episodes.mean_return()),
            ("rollout/ep_len_mean", self.episodes.mean_length()),
            ("rollout/episodes", self.episodes.count as f64),
            ("train/approx_kl", f64::from(losses.kl_sum) / f64::from(losses.kl_count)),
            ("train/clip_fraction", mean(losses.sum.clip_fraction)),
            ("train/clip_range", config.clip_range),
            ("train/entropy_loss", mean(losses.sum.entropy)),
            ("train/explained_variance", self.rollout.explained_variance()),
            ("train/learning_rate", optimizer.learning_rate),
            ("train/loss", f64::from(losses.last_total)),
            ("train/policy_gradient_loss", mean(losses.sum.policy)),
            ("train/value_loss", mean(losses.sum.value)),
            ("train/n_updates", self.agent.counters.updates as f64),
            ("train/grad_norm", mean(losses.sum.grad_norm)),
        ];
        row.extend(dose_metrics(&self.agent, optimizer, norms));
        row
    }
}

impl Learner for Ppo {
    fn advance(&mut self) -> Vec<Metrics> {
        self.collect();
        self.estimate();
        self.update();
        let row = |(s, seed): (usize, &Seed)| seed.metrics(&self.config, &self.optimizer, self.updater.norms(s));
        self.seeds.iter().enumerate().map(row).collect()
    }

    fn timesteps(&self) -> u64 {
        self.seeds[0].timesteps
    }

    fn next_timesteps(&self) -> u64 {
        self.timesteps() + (self.config.n_steps * self.seeds[0].envs.len()) as u64
    }

    fn parameters(&self, seed: usize) -> &[f32] {
        &self.seeds[seed].agent.parameters
    }

    fn states(&self) -> Vec<AgentState> {
        self.seeds.iter().map(|seed| seed.agent.clone()).collect()
    }

    fn snapshot(&self, seed: usize) -> Snapshot {
        let seed = &self.seeds[seed];
        let position = Position::of(seed.timesteps, &seed.envs, &seed.actions, &seed.minibatches, &seed.episodes);
        Snapshot { agent: seed.agent.clone(), position, replay: None }
    }
}
