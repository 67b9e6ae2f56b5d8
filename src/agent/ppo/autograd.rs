//! PPO's loss with libtorch and autograd: the reference, for any network on any device.

use bit_mlp::{BitBatch, GradientNorms};
use tch::{Device, Kind, Tensor};

use super::{Outputs, PpoLoss, PpoUpdater, Rollout};
use crate::agent::network::Network;
use crate::agent::stacked::{Stacked, stack, to_vec};
use crate::agent::state::AgentState;
use crate::config::{OptimizerConfig, PpoConfig};

/// S seeds of PPO as stacked tensors.
pub struct AutogradPpo {
    stacked: Stacked,
    config: PpoConfig,
    rollouts: Option<Loaded>,
}

/// The rollouts of all seeds on the device; R = T·N samples.
struct Loaded {
    /// `[S, R]` each.
    actions: Tensor,
    log_probs: Tensor,
    advantages: Tensor,
    returns: Tensor,
}

impl AutogradPpo {
    /// Agents side by side on `device`.
    pub fn new(
        network: Network,
        device: Device,
        config: &PpoConfig,
        optimizer: &OptimizerConfig,
        agents: &[AgentState],
    ) -> Self {
        let stacked = Stacked::new(network, device, optimizer.clone(), agents);
        Self { stacked, config: config.clone(), rollouts: None }
    }

    /// Policy logits `[S, B, 4]` and values `[S, B]`.
    fn outputs(&self, inputs: &Tensor) -> (Tensor, Tensor) {
        let towers = self.stacked.towers(self.stacked.parameters());
        let [policy, value] = &towers[..] else { unreachable!("PPO has a policy and a value tower") };
        (self.stacked.forward(policy, inputs), self.stacked.forward(value, inputs).squeeze_dim(2))
    }
}

impl PpoUpdater for AutogradPpo {
    fn act(&mut self, inputs: &[BitBatch], logits: &mut [f32]) {
        let _guard = tch::no_grad_guard();
        let batches: Vec<_> = inputs.iter().map(BitBatch::all).collect();
        let towers = self.stacked.towers(self.stacked.parameters());
        logits.copy_from_slice(&to_vec(&self.stacked.forward(&towers[0], &self.stacked.dense(&batches))));
    }

    fn forward(&mut self, inputs: &[&BitBatch]) -> Vec<Outputs> {
        let _guard = tch::no_grad_guard();
        let batches: Vec<_> = inputs.iter().map(|batch| batch.all()).collect();
        let (logits, values) = self.outputs(&self.stacked.dense(&batches));
        (0..inputs.len() as i64)
            .map(|s| Outputs { logits: to_vec(&logits.get(s)), values: to_vec(&values.get(s)) })
            .collect()
    }

    fn load(&mut self, rollouts: &[&Rollout]) {
        let device = self.stacked.device();
        let rows = |of: fn(&Rollout) -> &[f32]| stack(rollouts.iter().map(|&r| of(r)), device);
        self.rollouts = Some(Loaded {
            actions: stack(rollouts.iter().map(|r| r.actions.as_slice()), device).to_kind(Kind::Int64),
            log_probs: rows(|r| &r.log_probs),
            advantages: rows(|r| &r.advantages),
            returns: rows(|r| &r.returns),
        });
    }

    fn minibatch(&mut self, rollouts: &[&Rollout], indices: &[&[u32]]) -> Vec<PpoLoss> {
        let Some(loaded) = &self.rollouts else { unreachable!("an update begins with load") };
        let c = &self.config;
        let device = self.stacked.device();
        let wide: Vec<Vec<i64>> = indices.iter().map(|row| row.iter().map(|&i| i.into()).collect()).collect();
        let index = stack(wide.iter().map(Vec::as_slice), device);
        let pick = |tensor: &Tensor| tensor.gather(1, &index, false);
        let batches: Vec<_> = rollouts.iter().zip(indices).map(|(r, index)| r.inputs.select(index)).collect();
        let (logits, values) = self.outputs(&self.stacked.dense(&batches));

        let mut advantages = pick(&loaded.advantages);
        if c.normalize_advantage && indices[0].len() > 1 {
            let mean = advantages.mean_dim(1, true, Kind::Float);
            advantages = (&advantages - mean) / (advantages.std_dim(1, true, true) + 1e-8);
        }
        let log_probs_all = logits.log_softmax(-1, Kind::Float);
        let log_probs = log_probs_all.gather(2, &pick(&loaded.actions).unsqueeze(2), false).squeeze_dim(2);
        let log_ratio = log_probs - pick(&loaded.log_probs);
        let ratio = log_ratio.exp();
        let clipped = ratio.clamp(1.0 - c.clip_range, 1.0 + c.clip_range);
        let mean = |tensor: Tensor| tensor.mean_dim(1, false, Kind::Float);
        let policy = -mean((&advantages * &ratio).minimum(&(&advantages * clipped)));
        let value = mean((values - pick(&loaded.returns)).square());
        let entropy = mean((log_probs_all.exp() * &log_probs_all).sum_dim_intlist(-1, false, Kind::Float));
        let total = &policy + c.ent_coef * &entropy + c.vf_coef * &value;
        let grad_norms = self.stacked.descend(&total);

        let (ratio, log_ratio) = (ratio.detach(), log_ratio.detach());
        let approx_kl = mean(&ratio - 1.0 - log_ratio);
        let clip_fraction = mean((ratio - 1.0).abs().gt(c.clip_range).to_kind(Kind::Float));
        let terms = Tensor::stack(&[policy, value, entropy, total, approx_kl, clip_fraction], 1).detach();
        let terms = to_vec(&terms);
        let loss = |(t, &grad_norm): (&[f32], &f32)| PpoLoss {
            policy: t[0],
            value: t[1],
            entropy: t[2],
            total: t[3],
            approx_kl: t[4],
            clip_fraction: t[5],
            grad_norm,
        };
        terms.chunks_exact(6).zip(&grad_norms).map(loss).collect()
    }

    fn norms(&self, seed: usize) -> GradientNorms {
        self.stacked.norms(seed)
    }

    fn save(&self, seed: usize, agent: &mut AgentState) {
        self.stacked.save(seed, agent);
    }
}
