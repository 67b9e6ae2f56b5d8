//! How far the engine is from what one core can do: `cargo bench -p bit-mlp --bench limits`, on an
//! idle core (`taskset -c 0`).
//!
//! Prints `name<TAB>value<TAB>unit`, a quantity a line: what the core reaches in arithmetic and in
//! memory traffic with the engine's own instruction set, what a minibatch must do by formula, and
//! what it takes. Peaks are the best of many short repetitions, since what disturbs a measurement
//! only slows it down; the minibatches are treated alike.

mod setup;

use std::hint::black_box;
use std::time::{Duration, Instant};

use bit_mlp::{BitBatch, Mlp, Workspace};
use pulp::{Arch, Simd, WithSimd};
use setup::{Agent, dqn_network, ppo_towers, random_params, samples};

const REPETITIONS: usize = 2_000;
const LONGEST: Duration = Duration::from_secs(1);

fn main() {
    // Cargo passes `--bench`, and `cargo test --benches` does not: there this only has to compile.
    if !std::env::args().any(|argument| argument == "--bench") {
        return;
    }
    let arch = Arch::new();
    // `V4(…)` is AVX-512, `V3(…)` AVX2 with FMA; what is in the brackets says no more.
    let name = format!("{arch:?}");
    print("instruction set", name.split('(').next().unwrap_or_default().to_owned(), "");
    let flop = arch.dispatch(Lanes) as f64 * 2.0 * (ACCUMULATORS * ROUNDS) as f64;
    let peak = flop / fastest(|| arch.dispatch(MultiplyAdd { factor: black_box(0.999) }));
    print("peak, fused multiply-adds of f32", giga(peak), "GFLOP/s");
    for (name, bytes) in [("L1", 16 << 10), ("L2", 512 << 10), ("L3", 8 << 20), ("memory", 256 << 20)] {
        bandwidth(arch, name, bytes);
    }

    let towers = ppo_towers();
    let ppo = samples(64);
    let mut work = Work::default();
    towers.iter().for_each(|tower| work.add_gradient(tower, &ppo));
    work.add_adam(towers.iter().map(Mlp::num_parameters).sum());
    let mut agent = Agent::new(towers[1].range().end);
    let mut workspaces = [Workspace::default(), Workspace::default()];
    let mut d_outputs = Vec::new();
    let seconds = fastest(|| {
        for (tower, workspace) in towers.iter().zip(&mut workspaces) {
            agent.gradient(tower, ppo.all(), workspace, &mut d_outputs);
        }
        agent.adam()
    });
    work.print("PPO minibatch of 64", seconds, peak);

    let q = dqn_network();
    let (batch, next) = (samples(32), samples(32));
    let mut work = Work::default();
    work.add_forward(&q, &next);
    work.add_gradient(&q, &batch);
    work.add_adam(q.num_parameters());
    let target = random_params(q.num_parameters());
    let mut agent = Agent::new(q.num_parameters());
    let [online, frozen] = &mut workspaces;
    let seconds = fastest(|| {
        black_box(q.forward(&target, next.all(), frozen));
        agent.gradient(&q, batch.all(), online, &mut d_outputs);
        agent.adam()
    });
    work.print("DQN minibatch of 32", seconds, peak);
}

fn print(name: &str, value: String, unit: &str) {
    println!("{name}\t{value}\t{unit}");
}

fn giga(rate: f64) -> String {
    format!("{:.1}", rate / 1e9)
}

/// Seconds of the fastest of many calls, or of as many as a second has room for.
fn fastest<T>(mut call: impl FnMut() -> T) -> f64 {
    let start = Instant::now();
    let mut fastest = f64::INFINITY;
    for _ in 0..REPETITIONS {
        let begin = Instant::now();
        black_box(call());
        fastest = fastest.min(begin.elapsed().as_secs_f64());
        if start.elapsed() > LONGEST {
            break;
        }
    }
    fastest
}

/// What a minibatch of the paper's shapes has to do, zeros left out: an input that is 0 costs
/// nothing, and inputs that are 1 in every sample are one row.
#[derive(Clone, Copy, Default)]
struct Work {
    /// Multiplications and additions of the dense layers.
    dense: f64,
    /// Additions of the first layer, whose inputs are bits.
    sparse: f64,
    /// Of the clipping and Adam.
    adam: f64,
    /// Bytes that the gradient and Adam move, at best once each: they exceed L1 and lie in L2.
    bytes: f64,
}

impl Work {
    /// 2·B·in·out for every dense layer, and B·active·out for the first.
    fn add_forward(&mut self, mlp: &Mlp, batch: &BitBatch) {
        let samples = batch.len() as f64;
        let active: usize = (0..batch.len()).map(|sample| batch.sample(sample).len()).sum();
        for (index, block) in mlp.blocks().iter().enumerate() {
            if index == 0 {
                self.sparse += ((active + batch.constant().len()) * block.width) as f64;
                self.bytes += ((active + batch.constant().len()) * block.width * 4) as f64;
            } else {
                self.dense += 2.0 * samples * block.weight.len() as f64;
            }
        }
    }

    /// The forward pass, as much again for the weights' gradient, and in dense layers for what
    /// they pass down; the gradient is written once.
    fn add_gradient(&mut self, mlp: &Mlp, batch: &BitBatch) {
        let before = *self;
        self.add_forward(mlp, batch);
        self.dense += 2.0 * (self.dense - before.dense);
        self.sparse += self.sparse - before.sparse;
        self.bytes += (mlp.num_parameters() * 4) as f64;
    }

    /// 2 for the norm and 16 for the step, root and quotient counted as one each; the gradient is
    /// read twice, parameters and moments are read and written.
    fn add_adam(&mut self, parameters: usize) {
        self.adam += (18 * parameters) as f64;
        self.bytes += (parameters * 4 * (2 + 2 * 3)) as f64;
    }

    fn print(&self, name: &str, seconds: f64, peak: f64) {
        let quantity =
            |what: &str, value: f64, unit: &str| print(&format!("{name}: {what}"), format!("{value:.1}"), unit);
        quantity("dense layers", self.dense / 1e6, "MFLOP");
        quantity("first layer", self.sparse / 1e6, "MFLOP");
        quantity("clipping and Adam", self.adam / 1e6, "MFLOP");
        quantity("bytes moved at least", self.bytes / 1e6, "MB");
        quantity("time", seconds * 1e6, "µs");
        let flop = self.dense + self.sparse + self.adam;
        quantity("arithmetic", flop / seconds / 1e9, "GFLOP/s");
        quantity("share of the peak", 100.0 * flop / seconds / peak, "%");
        quantity("dense layers alone at the peak", self.dense / peak * 1e6, "µs");
        quantity("traffic", self.bytes / seconds / 1e9, "GB/s");
    }
}

const ACCUMULATORS: usize = 12;
const ROUNDS: usize = 20_000;

/// Floats in a register.
struct Lanes;

impl WithSimd for Lanes {
    type Output = usize;

    #[inline(always)]
    fn with_simd<S: Simd>(self, _simd: S) -> usize {
        S::F32_LANES
    }
}

/// Independent chains of fused multiply-adds, as many as hide their latency, and nothing else.
struct MultiplyAdd {
    factor: f32,
}

impl WithSimd for MultiplyAdd {
    type Output = f32;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> f32 {
        let factor = simd.splat_f32s(self.factor);
        let mut sums = [factor; ACCUMULATORS];
        for _ in 0..ROUNDS {
            for sum in &mut sums {
                *sum = simd.mul_add_e_f32s(*sum, factor, factor);
            }
        }
        let total = sums.into_iter().fold(simd.splat_f32s(0.0), |total, sum| simd.add_f32s(total, sum));
        simd.reduce_sum_f32s(total)
    }
}

/// Prints how fast an array of so many bytes is read, and updated in place as Adam does.
fn bandwidth(arch: Arch, name: &str, bytes: usize) {
    let mut values = vec![1.0_f32; bytes / 4];
    // As many passes as make a repetition long enough for the clock.
    let passes = ((4 << 20) / bytes).max(1);
    let moved = (passes * bytes) as f64;
    let seconds = fastest(|| (0..passes).map(|_| arch.dispatch(Read { values: black_box(&values) })).sum::<f32>());
    print(&format!("reading from {name}"), giga(moved / seconds), "GB/s");
    let seconds = fastest(|| {
        (0..passes).for_each(|_| arch.dispatch(Update { values: black_box(&mut values) }));
    });
    print(&format!("reading and writing in {name}"), giga(2.0 * moved / seconds), "GB/s");
}

/// The sum of all values.
struct Read<'a> {
    values: &'a [f32],
}

impl WithSimd for Read<'_> {
    type Output = f32;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> f32 {
        let mut sums = [simd.splat_f32s(0.0); 8];
        for block in S::as_simd_f32s(self.values).0.as_chunks::<8>().0 {
            for (sum, &value) in sums.iter_mut().zip(block) {
                *sum = simd.add_f32s(*sum, value);
            }
        }
        simd.reduce_sum_f32s(sums.into_iter().fold(simd.splat_f32s(0.0), |total, sum| simd.add_f32s(total, sum)))
    }
}

/// Adds a little to every value.
struct Update<'a> {
    values: &'a mut [f32],
}

impl WithSimd for Update<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let little = simd.splat_f32s(1e-3);
        for value in S::as_mut_simd_f32s(self.values).0 {
            *value = simd.add_f32s(*value, little);
        }
    }
}
