//! The iteration: collect, estimate, update.

use std::ops::Range;

use bit_mlp::BitBatch;
use coverage_env::random::shuffle;
use coverage_env::{Action, Sensor, VecEnv};

use super::loss::{POLICY, PpoLoss, PpoTerms, VALUE};
use super::rollout::Rollout;
use super::settings::PpoConfig;
use crate::agent::algorithm::Setup;
use crate::agent::buffers::Buffers;
use crate::agent::choice::Behaviour;
use crate::agent::engine::{Engine, Loss};
use crate::agent::episodes::EpisodeWindow;
use crate::agent::learner::{Learner, Metrics, weight_norm};
use crate::agent::mitigation::Regimen;
use crate::agent::observe::{observations, observe};
use crate::agent::snapshot::{Position, Snapshot};
use crate::agent::state::AgentState;
use crate::random::Stream;

/// PPO for S independent seeds that advance together.
pub struct Ppo {
    config: PpoConfig,
    sensor: &'static dyn Sensor,
    learning_rate: f64,
    gamma: f64,
    engine: Box<dyn Engine>,
    regimen: Regimen,
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
    sum: PpoTerms,
    grad_norm: f32,
    count: u32,
    last_total: f32,
    /// Over the last epoch alone, as Stable-Baselines3 has it.
    kl_sum: f32,
    kl_count: u32,
}

impl Ppo {
    /// Seeds where their snapshots were taken.
    pub(super) fn new(ppo: &PpoConfig, setup: Setup<'_>) -> Self {
        let Setup { shared, stage, snapshots, engine, regimen } = setup;
        let seed = |snapshot: Snapshot| Seed {
            envs: snapshot.envs(shared.max_steps, stage).expect("a snapshot is checked before it is used"),
            actions: Stream::at(&snapshot.position.actions),
            minibatches: Stream::at(&snapshot.position.minibatches),
            rollout: Rollout::new(shared.num_envs, shared.sensor, &stage.level),
            order: Vec::new(),
            episodes: snapshot.position.episodes,
            timesteps: snapshot.position.timesteps,
            losses: Losses::default(),
            agent: snapshot.agent,
        };
        Self {
            config: ppo.clone(),
            sensor: shared.sensor,
            learning_rate: shared.optimizer.learning_rate,
            gamma: shared.gamma,
            engine,
            regimen,
            seeds: snapshots.into_iter().map(seed).collect(),
        }
    }

    /// Runs the policy for `n_steps` in every environment.
    fn collect(&mut self) {
        let num_envs = self.seeds[0].envs.len();
        let sensor = self.sensor;
        let mut current: Vec<BitBatch> =
            self.seeds.iter().map(|seed| observations(sensor, seed.envs.level())).collect();
        let mut logits = vec![0.0; self.seeds.len() * num_envs * Action::ALL.len()];
        let mut actions = Vec::with_capacity(num_envs);
        self.seeds.iter_mut().for_each(|seed| seed.rollout.clear());
        for _ in 0..self.config.n_steps {
            for (seed, current) in self.seeds.iter().zip(&mut current) {
                observe(sensor, &seed.envs, current);
            }
            self.engine.act(&current, &mut logits);
            for (s, (seed, logits)) in self.seeds.iter_mut().zip(logits.chunks_exact(num_envs * 4)).enumerate() {
                actions.clear();
                actions.extend(logits.chunks_exact(4).map(|z| Behaviour::Sampled.choose(z, &mut seed.actions)));
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
        let collected: Vec<&BitBatch> = self.seeds.iter().map(|seed| &seed.rollout.inputs).collect();
        let beyond: Vec<&BitBatch> = self.seeds.iter().map(|seed| &seed.rollout.beyond).collect();
        let logits = self.engine.forward(POLICY, &collected);
        let values = self.engine.forward(VALUE, &collected);
        let beyond = self.engine.forward(VALUE, &beyond);
        for (((seed, logits), values), beyond) in self.seeds.iter_mut().zip(logits).zip(values).zip(beyond) {
            seed.rollout.estimate(&logits, values, &beyond, self.gamma, self.config.gae_lambda);
        }
    }

    /// `n_epochs` passes of minibatches over the rollouts, each in a fresh order.
    fn update(&mut self) {
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
                self.minibatch(start..samples.min(start + self.config.batch_size));
            }
        }
        for (s, seed) in self.seeds.iter_mut().enumerate() {
            seed.agent.counters.updates += self.config.n_epochs as u64;
            seed.agent.counters.timesteps += seed.rollout.len() as u64;
            self.engine.save(s, &mut seed.agent);
            self.regimen.save(s, &mut seed.agent);
        }
    }

    /// One step per seed on these places of its order.
    fn minibatch(&mut self, places: Range<usize>) {
        let (config, seeds) = (&self.config, &self.seeds);
        let seeds = seeds.iter();
        let mut losses: Vec<PpoLoss<'_>> =
            seeds.map(|seed| PpoLoss::new(config, &seed.rollout, &seed.order[places.clone()])).collect();
        let draw = |seed: usize, count: usize, stream: &mut Stream| self.seeds[seed].rollout.draw(count, stream);
        let mut each: Vec<&mut dyn Loss<'_>> = losses.iter_mut().map(|loss| loss as _).collect();
        let norms = self.regimen.descend(&mut *self.engine, &mut each, &draw);
        let terms: Vec<PpoTerms> = losses.into_iter().map(|loss| loss.terms).collect();
        for ((seed, terms), norm) in self.seeds.iter_mut().zip(terms).zip(norms) {
            seed.losses.push(terms, norm);
        }
    }
}

impl Losses {
    fn begin_epoch(&mut self) {
        (self.kl_sum, self.kl_count) = (0.0, 0);
    }

    fn push(&mut self, terms: PpoTerms, grad_norm: f32) {
        self.sum.policy += terms.policy;
        self.sum.value += terms.value;
        self.sum.entropy += terms.entropy;
        self.sum.clip_fraction += terms.clip_fraction;
        self.grad_norm += grad_norm;
        self.count += 1;
        self.last_total = terms.total;
        self.kl_sum += terms.approx_kl;
        self.kl_count += 1;
    }
}

impl Seed {
    /// The row of the update just made; docs/metrics.md defines each column.
    fn metrics(&self, config: &PpoConfig, learning_rate: f64) -> Metrics {
        let mean = |sum: f32| f64::from(sum) / f64::from(self.losses.count);
        let losses = &self.losses;
        vec![
            ("rollout/ep_rew_mean", self.episodes.mean_return()),
            ("rollout/ep_len_mean", self.episodes.mean_length()),
            ("rollout/episodes", self.episodes.count as f64),
            ("train/approx_kl", f64::from(losses.kl_sum) / f64::from(losses.kl_count)),
            ("train/clip_fraction", mean(losses.sum.clip_fraction)),
            ("train/clip_range", config.clip_range),
            ("train/entropy_loss", mean(losses.sum.entropy)),
            ("train/explained_variance", self.rollout.explained_variance()),
            ("train/learning_rate", learning_rate),
            ("train/loss", f64::from(losses.last_total)),
            ("train/policy_gradient_loss", mean(losses.sum.policy)),
            ("train/value_loss", mean(losses.sum.value)),
            ("train/n_updates", self.agent.counters.updates as f64),
            ("train/grad_norm", mean(losses.grad_norm)),
            ("train/weight_norm", weight_norm(&self.agent)),
        ]
    }
}

impl Learner for Ppo {
    fn advance(&mut self) -> Vec<Metrics> {
        self.collect();
        self.estimate();
        self.update();
        let row = |(s, seed): (usize, &Seed)| {
            let mut row = seed.metrics(&self.config, self.learning_rate);
            row.extend(self.regimen.metrics(&*self.engine, s));
            row
        };
        self.seeds.iter().enumerate().map(row).collect()
    }

    fn timesteps(&self) -> u64 {
        self.seeds[0].timesteps
    }

    fn next_timesteps(&self) -> u64 {
        self.timesteps() + (self.config.n_steps * self.seeds[0].envs.len()) as u64
    }

    fn agents(&self) -> Vec<&AgentState> {
        self.seeds.iter().map(|seed| &seed.agent).collect()
    }

    fn snapshot(&self, seed: usize) -> Snapshot {
        let seed = &self.seeds[seed];
        let position = Position::of(seed.timesteps, &seed.envs, &seed.actions, &seed.minibatches, &seed.episodes);
        Snapshot { agent: seed.agent.clone(), position, buffers: Buffers::default() }
    }
}
