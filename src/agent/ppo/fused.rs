//! PPO's loss with its gradient derived by hand, on the CPU.

use bit_mlp::{BitBatch, GradientNorms, Mlp, Prepared, Workspace};
use coverage_env::Action;

use super::rollout::log_softmax;
use super::{Outputs, PpoLoss, PpoUpdater, Rollout};
use crate::agent::fused::FusedAgent;
use crate::agent::network::Network;
use crate::agent::state::AgentState;
use crate::config::{OptimizerConfig, PpoConfig};

/// Samples of one forward pass; keeps its working memory in the cache.
const FORWARD_BATCH: usize = 256;

/// S seeds of PPO, one after another.
pub struct FusedPpo {
    policy: Mlp,
    value: Mlp,
    config: PpoConfig,
    seeds: Vec<Seed>,
}

struct Seed {
    agent: FusedAgent,
    /// The policy, made ready for single observations; stale after an update.
    acting: Option<Prepared>,
    policy: Workspace,
    value: Workspace,
    /// Gradient of the loss with respect to logits `[B, 4]` and values `[B]`.
    d_logits: Vec<f32>,
    d_values: Vec<f32>,
    /// The minibatch's advantages, normalised, `[B]`.
    advantages: Vec<f32>,
}

impl FusedPpo {
    /// Agents as they come out of the stage before.
    pub fn new(network: &Network, config: &PpoConfig, optimizer: &OptimizerConfig, agents: &[AgentState]) -> Self {
        let seed = |agent| Seed {
            agent: FusedAgent::new(network, optimizer, agent),
            acting: None,
            policy: Workspace::default(),
            value: Workspace::default(),
            d_logits: Vec::new(),
            d_values: Vec::new(),
            advantages: Vec::new(),
        };
        Self {
            policy: network.towers()[0].mlp.clone(),
            value: network.towers()[1].mlp.clone(),
            config: config.clone(),
            seeds: agents.iter().map(seed).collect(),
        }
    }
}

impl PpoUpdater for FusedPpo {
    fn act(&mut self, inputs: &[BitBatch], logits: &mut [f32]) {
        let per_seed = logits.len() / self.seeds.len();
        for ((seed, inputs), logits) in self.seeds.iter_mut().zip(inputs).zip(logits.chunks_exact_mut(per_seed)) {
            let parameters = &seed.agent.parameters;
            let acting = seed.acting.get_or_insert_with(|| Prepared::new(&self.policy, parameters, inputs.constant()));
            for (i, out) in logits.chunks_exact_mut(Action::COUNT).enumerate() {
                out.copy_from_slice(acting.forward_one(parameters, inputs.sample(i)));
            }
        }
    }

    fn forward(&mut self, inputs: &[&BitBatch]) -> Vec<Outputs> {
        let indices: Vec<u32> = (0..inputs.iter().map(|batch| batch.len()).max().unwrap_or(0) as u32).collect();
        let of_seed = |(seed, inputs): (&mut Seed, &&BitBatch)| {
            let mut outputs = Outputs::default();
            for part in indices[..inputs.len()].chunks(FORWARD_BATCH) {
                let (parameters, batch) = (&seed.agent.parameters, inputs.select(part));
                outputs.logits.extend_from_slice(self.policy.forward(parameters, batch, &mut seed.policy));
                outputs.values.extend_from_slice(self.value.forward(parameters, batch, &mut seed.value));
            }
            outputs
        };
        self.seeds.iter_mut().zip(inputs).map(of_seed).collect()
    }

    fn load(&mut self, _rollouts: &[&Rollout]) {
        self.seeds.iter_mut().for_each(|seed| seed.acting = None);
    }

    fn minibatch(&mut self, rollouts: &[&Rollout], indices: &[&[u32]]) -> Vec<PpoLoss> {
        let seeds = self.seeds.iter_mut().zip(rollouts.iter().zip(indices));
        seeds
            .map(|(seed, (rollout, indices))| seed.minibatch(&self.policy, &self.value, &self.config, rollout, indices))
            .collect()
    }

    fn norms(&self, seed: usize) -> GradientNorms {
        self.seeds[seed].agent.norms()
    }

    fn save(&self, seed: usize, agent: &mut AgentState) {
        self.seeds[seed].agent.save(agent);
    }
}

impl Seed {
    fn minibatch(&mut self, policy: &Mlp, value: &Mlp, c: &PpoConfig, rollout: &Rollout, indices: &[u32]) -> PpoLoss {
        self.normalize(c, rollout, indices);
        let batch = rollout.inputs.select(indices);
        let logits = policy.forward(&self.agent.parameters, batch, &mut self.policy);
        self.d_logits.clear();
        let mut loss = PpoLoss::default();
        let share = 1.0 / indices.len() as f32;
        for ((logits, &advantage), &i) in logits.chunks_exact(Action::COUNT).zip(&self.advantages).zip(indices) {
            let (action, old) = (usize::from(rollout.actions[i as usize]), rollout.log_probs[i as usize]);
            let sample = PolicySample::new(logits, action, old, advantage, c);
            loss.policy -= share * sample.surrogate;
            loss.entropy -= share * sample.entropy;
            loss.approx_kl += share * ((sample.ratio - 1.0) - sample.log_ratio);
            loss.clip_fraction += share * f32::from((sample.ratio - 1.0).abs() > c.clip_range as f32);
            self.d_logits.extend(sample.gradient(action, c).map(|d| share * d));
        }
        let values = value.forward(&self.agent.parameters, batch, &mut self.value);
        self.d_values.clear();
        for (value, &i) in values.iter().zip(indices) {
            let error = value - rollout.returns[i as usize];
            loss.value += share * error * error;
            self.d_values.push(share * c.vf_coef as f32 * 2.0 * error);
        }
        loss.total = loss.policy + c.ent_coef as f32 * loss.entropy + c.vf_coef as f32 * loss.value;

        let FusedAgent { parameters, gradient, .. } = &mut self.agent;
        policy.backward(parameters, batch, &self.d_logits, &mut self.policy, gradient);
        value.backward(parameters, batch, &self.d_values, &mut self.value, gradient);
        loss.grad_norm = self.agent.descend();
        loss
    }

    /// The minibatch's advantages: mean 0 and unbiased standard deviation 1, if the config says so.
    fn normalize(&mut self, c: &PpoConfig, rollout: &Rollout, indices: &[u32]) {
        self.advantages.clear();
        self.advantages.extend(indices.iter().map(|&i| rollout.advantages[i as usize]));
        if !c.normalize_advantage || indices.len() < 2 {
            return;
        }
        let count = indices.len() as f64;
        let mean = self.advantages.iter().map(|&a| f64::from(a)).sum::<f64>() / count;
        let squares: f64 = self.advantages.iter().map(|&a| (f64::from(a) - mean).powi(2)).sum();
        let scale = 1.0 / ((squares / (count - 1.0)).sqrt() as f32 + 1e-8);
        self.advantages.iter_mut().for_each(|a| *a = (*a - mean as f32) * scale);
    }
}

/// The policy's part of the loss for one sample.
struct PolicySample {
    log_probs: [f32; Action::COUNT],
    probs: [f32; Action::COUNT],
    log_ratio: f32,
    ratio: f32,
    /// min(r·A, clip(r)·A).
    surrogate: f32,
    /// ∂surrogate/∂ln π(a|s).
    slope: f32,
    entropy: f32,
}

impl PolicySample {
    fn new(logits: &[f32], action: usize, old_log_prob: f32, advantage: f32, c: &PpoConfig) -> Self {
        let log_probs = log_softmax(logits);
        let probs = log_probs.map(f32::exp);
        let log_ratio = log_probs[action] - old_log_prob;
        let ratio = log_ratio.exp();
        let (low, high) = ((1.0 - c.clip_range) as f32, (1.0 + c.clip_range) as f32);
        let (plain, clipped) = (advantage * ratio, advantage * ratio.clamp(low, high));
        // Where the clipped branch is the smaller one, the ratio lies outside and nothing depends on it. A NaN ratio
        // must stay visible: it belongs to neither case, so that `min`, which would hide it, cannot be used.
        let (surrogate, slope) = if clipped < plain { (clipped, 0.0) } else { (plain, plain) };
        let entropy = -probs.iter().zip(&log_probs).map(|(p, l)| p * l).sum::<f32>();
        Self { log_probs, probs, log_ratio, ratio, surrogate, slope, entropy }
    }

    /// ∂(−surrogate − ent_coef·H)/∂zⱼ = −slope·(δₐⱼ − pⱼ) + ent_coef·pⱼ·(ln pⱼ + H).
    fn gradient(&self, action: usize, c: &PpoConfig) -> [f32; Action::COUNT] {
        std::array::from_fn(|j| {
            let taken = if j == action { 1.0 } else { 0.0 };
            let bonus = c.ent_coef as f32 * self.probs[j] * (self.log_probs[j] + self.entropy);
            bonus - self.slope * (taken - self.probs[j])
        })
    }
}
