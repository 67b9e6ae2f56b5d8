//! What a gradient step and an action cost: `cargo bench -p bit-mlp`, best on an idle core
//! (`taskset -c 0`).

use std::hint::black_box;

use bit_mlp::{
    Activation, AdamConfig, Batch, BitBatch, Decayed, Mlp, Moments, Prepared, Workspace, clip_and_adam, tanh_in_place,
};
use chacha20::ChaCha8Rng;
use criterion::{Criterion, criterion_group, criterion_main};
use rand::{RngExt, SeedableRng};

/// Samples like those of an 8×8 level: 63 constant inputs, the agent's cell and 2 to 40 visited
/// cells.
fn samples(count: usize) -> BitBatch {
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

fn random_params(len: usize) -> Vec<f32> {
    let mut rng = ChaCha8Rng::seed_from_u64(2);
    (0..len).map(|_| rng.random_range(-0.1..0.1)).collect()
}

/// The parameters of one agent and what training them needs.
struct Agent {
    params: Vec<f32>,
    grads: Vec<f32>,
    exp_avg: Vec<f32>,
    exp_avg_sq: Vec<f32>,
    step: u64,
}

impl Agent {
    fn new(len: usize) -> Self {
        let zeros = vec![0.0; len];
        Self { params: random_params(len), grads: zeros.clone(), exp_avg: zeros.clone(), exp_avg_sq: zeros, step: 0 }
    }

    fn adam(&mut self) -> f32 {
        self.step += 1;
        let moments = Moments { exp_avg: &mut self.exp_avg, exp_avg_sq: &mut self.exp_avg_sq, step: self.step };
        clip_and_adam(&mut self.params, &self.grads, moments, 0.5, Decayed::All, &AdamConfig::default())
    }
}

/// Forward and backward of one network, with its outputs for the loss gradient.
fn gradient(mlp: &Mlp, agent: &mut Agent, batch: Batch<'_>, workspace: &mut Workspace, d_outputs: &mut Vec<f32>) {
    d_outputs.clear();
    d_outputs.extend_from_slice(mlp.forward(&agent.params, batch, workspace));
    mlp.backward(batch, d_outputs, workspace, &mut agent.grads);
}

fn ppo(criterion: &mut Criterion) {
    let policy = Mlp::new(&[256, 64, 64, 4], Activation::Tanh, 0);
    let value = Mlp::new(&[256, 64, 64, 1], Activation::Tanh, policy.range().end.next_multiple_of(16));
    let mut agent = Agent::new(value.range().end);
    let rollout = samples(2_048);
    let selection: Vec<u32> = (0..64).map(|index| index * 31).collect();
    let minibatch = rollout.select(&selection);
    let mut workspace = Workspace::default();
    let mut d_outputs = Vec::new();

    let mut group = criterion.benchmark_group("ppo");
    group.bench_function("minibatch", |bencher| {
        bencher.iter(|| {
            gradient(&policy, &mut agent, minibatch, &mut workspace, &mut d_outputs);
            gradient(&value, &mut agent, minibatch, &mut workspace, &mut d_outputs);
            agent.adam()
        });
    });
    group.bench_function("forward", |bencher| {
        bencher.iter(|| policy.forward(&agent.params, minibatch, &mut workspace)[0]);
    });
    let d_logits = vec![0.1; minibatch.len() * policy.outputs()];
    policy.forward(&agent.params, minibatch, &mut workspace);
    group.bench_function("backward", |bencher| {
        bencher.iter(|| policy.backward(minibatch, &d_logits, &mut workspace, &mut agent.grads));
    });
    group.bench_function("adam", |bencher| bencher.iter(|| agent.adam()));
    let mut prepared = Prepared::new(&policy, &agent.params, rollout.constant());
    let mut index = 0;
    group.bench_function("forward_one", |bencher| {
        bencher.iter(|| {
            index = (index + 1) % rollout.len();
            prepared.forward_one(&agent.params, rollout.sample(index))[0]
        });
    });
    group.finish();
}

fn dqn(criterion: &mut Criterion) {
    let mlp = Mlp::new(&[256, 64, 64, 4], Activation::Relu, 0);
    let mut agent = Agent::new(mlp.num_parameters());
    let target = random_params(mlp.num_parameters());
    let (batch, next) = (samples(32), samples(32));
    let mut workspace = Workspace::default();
    let mut target_workspace = Workspace::default();
    let mut d_outputs = Vec::new();
    criterion.bench_function("dqn/minibatch", |bencher| {
        bencher.iter(|| {
            black_box(mlp.forward(&target, next.all(), &mut target_workspace));
            gradient(&mlp, &mut agent, batch.all(), &mut workspace, &mut d_outputs);
            agent.adam()
        });
    });
}

fn tanh(criterion: &mut Criterion) {
    let inputs = random_params(64 * 64);
    let mut values = inputs.clone();
    criterion.bench_function("tanh/4096", |bencher| {
        bencher.iter(|| {
            values.copy_from_slice(&inputs);
            tanh_in_place(black_box(&mut values));
        });
    });
}

criterion_group!(benches, ppo, dqn, tanh);
criterion_main!(benches);
