//! DQN's loss with its gradient derived by hand, on the CPU.

use bit_mlp::{BitBatch, GradientNorms, Mlp, Prepared, Workspace};
use coverage_env::Action;

use super::{DqnLoss, DqnUpdater, Transitions};
use crate::agent::fused::FusedAgent;
use crate::agent::network::Network;
use crate::agent::state::AgentState;
use crate::config::OptimizerConfig;

/// S seeds of DQN, one after another.
pub struct FusedDqn {
    q: Mlp,
    gamma: f32,
    seeds: Vec<Seed>,
}

struct Seed {
    agent: FusedAgent,
    target: Vec<f32>,
    /// The network, made ready for single observations; stale after an update.
    acting: Prepared,
    stale: bool,
    online: Workspace,
    /// Of the target network.
    frozen: Workspace,
    /// Targets `[B]` and the gradient with respect to the action values `[B, 4]`.
    targets: Vec<f32>,
    d_values: Vec<f32>,
}

impl FusedDqn {
    /// Agents as they come out of the stage before.
    pub fn new(network: &Network, gamma: f64, optimizer: &OptimizerConfig, agents: &[AgentState]) -> Self {
        let q = network.acting();
        let seed = |agent: &AgentState| Seed {
            agent: FusedAgent::new(network, optimizer, agent),
            target: agent.target.as_ref().unwrap_or(&agent.parameters).clone(),
            acting: Prepared::new(q, &agent.parameters, &[]),
            stale: true,
            online: Workspace::default(),
            frozen: Workspace::default(),
            targets: Vec::new(),
            d_values: Vec::new(),
        };
        Self { q: q.clone(), gamma: gamma as f32, seeds: agents.iter().map(seed).collect() }
    }
}

impl DqnUpdater for FusedDqn {
    fn act(&mut self, inputs: &[BitBatch], values: &mut [f32]) {
        let per_seed = values.len() / self.seeds.len();
        for ((seed, inputs), values) in self.seeds.iter_mut().zip(inputs).zip(values.chunks_exact_mut(per_seed)) {
            let parameters = &seed.agent.parameters;
            if std::mem::take(&mut seed.stale) {
                seed.acting.refresh(parameters, inputs.constant());
            }
            for (i, out) in values.chunks_exact_mut(Action::COUNT).enumerate() {
                out.copy_from_slice(seed.acting.forward_one(parameters, inputs.sample(i)));
            }
        }
    }

    fn minibatch(&mut self, transitions: &[&Transitions]) -> Vec<DqnLoss> {
        let seeds = self.seeds.iter_mut().zip(transitions);
        seeds.map(|(seed, transitions)| seed.minibatch(&self.q, self.gamma, transitions)).collect()
    }

    fn copy_target(&mut self) {
        self.seeds.iter_mut().for_each(|seed| seed.target.copy_from_slice(&seed.agent.parameters));
    }

    fn norms(&self, seed: usize) -> GradientNorms {
        self.seeds[seed].agent.norms()
    }

    fn save(&self, seed: usize, agent: &mut AgentState) {
        self.seeds[seed].agent.save(agent);
        agent.target = Some(self.seeds[seed].target.clone());
    }
}

impl Seed {
    fn minibatch(&mut self, q: &Mlp, gamma: f32, transitions: &Transitions) -> DqnLoss {
        let next = q.forward(&self.target, transitions.next.all(), &mut self.frozen);
        self.targets.clear();
        self.targets.extend(transitions.targets(next, gamma));

        let batch = transitions.inputs.all();
        let values = q.forward(&self.agent.parameters, batch, &mut self.online);
        let share = 1.0 / self.targets.len() as f32;
        let mut loss = 0.0;
        self.d_values.clear();
        self.d_values.resize(values.len(), 0.0);
        let samples = values.chunks_exact(Action::COUNT).zip(self.d_values.chunks_exact_mut(Action::COUNT));
        for ((values, d_values), (&action, target)) in samples.zip(transitions.actions.iter().zip(&self.targets)) {
            let error = values[usize::from(action)] - target;
            // Smooth L1 with β = 1: half the square within ±1, |error| − ½ beyond; its slope is the error, clipped.
            loss += share * if error.abs() < 1.0 { 0.5 * error * error } else { error.abs() - 0.5 };
            d_values[usize::from(action)] = share * error.clamp(-1.0, 1.0);
        }
        let FusedAgent { parameters, gradient, .. } = &mut self.agent;
        q.backward(parameters, batch, &self.d_values, &mut self.online, gradient);
        self.stale = true;
        DqnLoss { loss, grad_norm: self.agent.descend() }
    }
}
