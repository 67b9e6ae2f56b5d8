//! What a gradient step and an action cost: `cargo bench -p bit-mlp --bench steps`, best on an
//! idle core (`taskset -c 0`).

mod setup;

use std::hint::black_box;

use bit_mlp::{Activation, Mlp, Prepared, Workspace, tanh_in_place};
use criterion::{Criterion, criterion_group, criterion_main};
use setup::{Agent, dqn_network, ppo_towers, random_params, samples};

fn ppo(criterion: &mut Criterion) {
    let [policy, value] = ppo_towers();
    let mut agent = Agent::new(value.range().end);
    let rollout = samples(2_048);
    let selection: Vec<u32> = (0..64).map(|index| index * 31).collect();
    let minibatch = rollout.select(&selection);
    let mut workspace = Workspace::default();
    let mut d_outputs = Vec::new();

    let mut group = criterion.benchmark_group("ppo");
    group.bench_function("minibatch", |bencher| {
        bencher.iter(|| {
            agent.gradient(&policy, minibatch, &mut workspace, &mut d_outputs);
            agent.gradient(&value, minibatch, &mut workspace, &mut d_outputs);
            agent.adam()
        });
    });
    group.bench_function("forward", |bencher| {
        bencher.iter(|| policy.forward(&agent.params, minibatch, &mut workspace)[0]);
    });
    let d_logits = vec![0.1; minibatch.len() * policy.outputs()];
    policy.forward(&agent.params, minibatch, &mut workspace);
    group.bench_function("backward", |bencher| {
        bencher.iter(|| policy.backward(&agent.params, minibatch, &d_logits, &mut workspace, &mut agent.grads));
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
    let mlp = dqn_network();
    let mut agent = Agent::new(mlp.num_parameters());
    let target = random_params(mlp.num_parameters());
    let (batch, next) = (samples(32), samples(32));
    let mut workspace = Workspace::default();
    let mut target_workspace = Workspace::default();
    let mut d_outputs = Vec::new();
    criterion.bench_function("dqn/minibatch", |bencher| {
        bencher.iter(|| {
            black_box(mlp.forward(&target, next.all(), &mut target_workspace));
            agent.gradient(&mlp, batch.all(), &mut workspace, &mut d_outputs);
            agent.adam()
        });
    });
}

/// A minibatch of one tower, its clipping and Adam, and one action, with hidden layers of 64 to 512.
fn width(criterion: &mut Criterion) {
    let batch = samples(64);
    let mut group = criterion.benchmark_group("width");
    for width in [64, 128, 256, 512] {
        let mlp = Mlp::new(&[256, width, width, 4], Activation::Tanh, 0);
        let mut agent = Agent::new(mlp.num_parameters());
        let mut workspace = Workspace::default();
        let mut d_outputs = Vec::new();
        group.bench_function(format!("gradient/{width}"), |bencher| {
            bencher.iter(|| agent.gradient(&mlp, batch.all(), &mut workspace, &mut d_outputs));
        });
        group.bench_function(format!("adam/{width}"), |bencher| bencher.iter(|| agent.adam()));
        let mut prepared = Prepared::new(&mlp, &agent.params, batch.constant());
        group.bench_function(format!("forward_one/{width}"), |bencher| {
            bencher.iter(|| prepared.forward_one(&agent.params, batch.sample(3))[0]);
        });
    }
    group.finish();
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

criterion_group!(benches, ppo, dqn, width, tanh);
criterion_main!(benches);
