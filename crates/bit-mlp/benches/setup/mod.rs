//! The paper's networks and what they are trained on, for the benches.

use bit_mlp::{Activation, AdamConfig, Batch, BitBatch, Decayed, Mlp, Moments, Workspace, clip_and_adam};
use chacha20::ChaCha8Rng;
use rand::{RngExt, SeedableRng};

/// Samples like those of an 8×8 level: 63 constant inputs, the agent's cell and 2 to 40 visited
/// cells.
pub fn samples(count: usize) -> BitBatch {
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let mut batch = BitBatch::default();
    batch.set_constant(&(0..55).chain(128..136).collect::<Vec<_>>());
    for _ in 0..count {
        let visited: u16 = rng.random_range(2..40);
        batch.push_with(|active| {
            active.push(64 + rng.random_range(0..64));
            active.extend((0..64).filter(|_| rng.random_range(0..64) < visited).map(|cell| 192 + cell));
        });
    }
    batch
}

/// `len` parameters, small enough that no activation saturates.
pub fn random_params(len: usize) -> Vec<f32> {
    let mut rng = ChaCha8Rng::seed_from_u64(2);
    (0..len).map(|_| rng.random_range(-0.1..0.1)).collect()
}

/// PPO's policy and value towers.
pub fn ppo_towers() -> [Mlp; 2] {
    let policy = Mlp::new(&[256, 64, 64, 4], Activation::Tanh, 0);
    let value = Mlp::new(&[256, 64, 64, 1], Activation::Tanh, policy.range().end.next_multiple_of(16));
    [policy, value]
}

/// DQN's network.
pub fn dqn_network() -> Mlp {
    Mlp::new(&[256, 64, 64, 4], Activation::Relu, 0)
}

/// The parameters of one agent and what training them needs.
pub struct Agent {
    pub params: Vec<f32>,
    pub grads: Vec<f32>,
    exp_avg: Vec<f32>,
    exp_avg_sq: Vec<f32>,
    step: u64,
}

impl Agent {
    pub fn new(len: usize) -> Self {
        let zeros = vec![0.0; len];
        Self { params: random_params(len), grads: zeros.clone(), exp_avg: zeros.clone(), exp_avg_sq: zeros, step: 0 }
    }

    /// Forward and backward of one network, with its outputs for the loss gradient.
    pub fn gradient(&mut self, mlp: &Mlp, batch: Batch<'_>, workspace: &mut Workspace, d_outputs: &mut Vec<f32>) {
        d_outputs.clear();
        d_outputs.extend_from_slice(mlp.forward(&self.params, batch, workspace));
        mlp.backward(&self.params, batch, d_outputs, workspace, &mut self.grads);
    }

    /// A clipped step; returns the norm of the gradient.
    pub fn adam(&mut self) -> f32 {
        self.step += 1;
        let moments = Moments { exp_avg: &mut self.exp_avg, exp_avg_sq: &mut self.exp_avg_sq, step: self.step };
        clip_and_adam(&mut self.params, &self.grads, moments, 0.5, Decayed::All, &AdamConfig::default())
    }
}
