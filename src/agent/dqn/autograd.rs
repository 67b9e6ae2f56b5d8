//! DQN's loss with libtorch and autograd: the reference, for any network on any device.

use bit_mlp::{BitBatch, GradientNorms};
use tch::{Device, Kind, Reduction, Tensor};

use super::{DqnLoss, DqnUpdater, Transitions};
use crate::agent::network::Network;
use crate::agent::stacked::{Stacked, stack, to_vec};
use crate::agent::state::AgentState;
use crate::config::OptimizerConfig;

/// S seeds of DQN as stacked tensors.
pub struct AutogradDqn {
    stacked: Stacked,
    /// Parameters of the target networks, `[S, P]`.
    target: Tensor,
    gamma: f64,
}

impl AutogradDqn {
    /// Agents side by side on `device`.
    pub fn new(
        network: Network,
        device: Device,
        gamma: f64,
        optimizer: &OptimizerConfig,
        agents: &[AgentState],
    ) -> Self {
        let target = stack(agents.iter().map(|a| a.target.as_deref().unwrap_or(&a.parameters)), device);
        Self { stacked: Stacked::new(network, device, optimizer.clone(), agents), target, gamma }
    }

    /// Action values `[S, B, 4]` with these parameters.
    fn values(&self, parameters: &Tensor, inputs: &Tensor) -> Tensor {
        self.stacked.forward(&self.stacked.towers(parameters)[0], inputs)
    }
}

impl DqnUpdater for AutogradDqn {
    fn act(&mut self, inputs: &[BitBatch], values: &mut [f32]) {
        let _guard = tch::no_grad_guard();
        let batches: Vec<_> = inputs.iter().map(BitBatch::all).collect();
        let dense = self.stacked.dense(&batches);
        values.copy_from_slice(&to_vec(&self.values(self.stacked.parameters(), &dense)));
    }

    fn minibatch(&mut self, transitions: &[&Transitions]) -> Vec<DqnLoss> {
        let device = self.stacked.device();
        let dense = |of: fn(&Transitions) -> &BitBatch| {
            let batches: Vec<_> = transitions.iter().map(|t| of(t).all()).collect();
            self.stacked.dense(&batches)
        };
        let targets = tch::no_grad(|| {
            let (best, _) = self.values(&self.target, &dense(|t| &t.next)).max_dim(2, false);
            let rewards = stack(transitions.iter().map(|t| t.rewards.as_slice()), device);
            let alive: Vec<Vec<f32>> =
                transitions.iter().map(|t| t.terminated.iter().map(|&t| f32::from(!t)).collect()).collect();
            rewards + stack(alive.iter().map(Vec::as_slice), device) * self.gamma * best
        });
        let actions = stack(transitions.iter().map(|t| t.actions.as_slice()), device).to_kind(Kind::Int64);
        let values = self.values(self.stacked.parameters(), &dense(|t| &t.inputs));
        let taken = values.gather(2, &actions.unsqueeze(2), false).squeeze_dim(2);
        let losses = taken.smooth_l1_loss(&targets, Reduction::None, 1.0).mean_dim(1, false, Kind::Float);
        let grad_norms = self.stacked.descend(&losses);
        let pairs = to_vec(&losses.detach()).into_iter().zip(grad_norms);
        pairs.map(|(loss, grad_norm)| DqnLoss { loss, grad_norm }).collect()
    }

    fn copy_target(&mut self) {
        self.target = self.stacked.parameters().detach().copy();
    }

    fn norms(&self, seed: usize) -> GradientNorms {
        self.stacked.norms(seed)
    }

    fn save(&self, seed: usize, agent: &mut AgentState) {
        self.stacked.save(seed, agent);
        agent.target = Some(to_vec(&self.target.get(seed as i64)));
    }
}
