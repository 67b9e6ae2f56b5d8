//! What steps, observations and plans cost: `cargo bench -p coverage-env`, best on an idle core (`taskset -c 0`).
//!
//! Elements are steps of one environment.

use std::hint::black_box;
use std::sync::Arc;
use std::time::Duration;

use chacha20::ChaCha8Rng;
use chacha20::rand_core::SeedableRng;
use coverage_env::planner::{AStar, Optimal};
use coverage_env::{Action, CoverageEnv, Level, MAX_STEPS, Planner, Scene, VecEnv, sensor};
use coverage_env::{generator::LevelSpec, random::below};
use criterion::{Criterion, Throughput, criterion_group, criterion_main};

const ENVIRONMENTS: usize = 64;

/// Random actions, drawn beforehand: choosing them is not the environment's work.
struct Drawn {
    actions: Vec<Action>,
    next: usize,
}

impl Drawn {
    fn new() -> Self {
        let mut rng = ChaCha8Rng::seed_from_u64(0);
        Self { actions: (0..1 << 16).map(|_| Action::ALL[below(&mut rng, 4) as usize]).collect(), next: 0 }
    }

    /// One for each of `count` environments.
    fn next(&mut self, count: usize) -> &[Action] {
        // Not a multiple of the environments, so that one environment's actions do not repeat with the next round.
        self.next = (self.next + count + 1) % (self.actions.len() - count);
        &self.actions[self.next..][..count]
    }
}

fn environments(level: &Arc<Level>) -> VecEnv<ChaCha8Rng> {
    VecEnv::new(Arc::clone(level), MAX_STEPS, (0..ENVIRONMENTS as u64).map(ChaCha8Rng::seed_from_u64).collect())
}

fn steps(criterion: &mut Criterion) {
    let level = Arc::new(Level::resolve("0").expect("a built-in level"));
    let mut actions = Drawn::new();
    let mut group = criterion.benchmark_group("environment");

    group.throughput(Throughput::Elements(ENVIRONMENTS as u64));
    let mut env = environments(&level);
    group.bench_function("step", |bencher| {
        bencher.iter(|| {
            black_box(env.step(actions.next(ENVIRONMENTS)));
        });
    });
    // Which sensor it is, is known only when it runs; so it is in training.
    let sensor = black_box(sensor::by_name("full")).expect("a sensor");
    let inputs = sensor.inputs(&level);
    let mut floats = vec![0.0; ENVIRONMENTS * inputs];
    group.bench_function("step_and_floats", |bencher| {
        bencher.iter(|| {
            env.step(actions.next(ENVIRONMENTS));
            for (state, out) in env.states().iter().zip(floats.chunks_exact_mut(inputs)) {
                sensor.write(Scene::new(&level, state), out);
            }
            black_box(&floats);
        });
    });
    let mut active = Vec::new();
    group.bench_function("step_and_active_inputs", |bencher| {
        bencher.iter(|| {
            env.step(actions.next(ENVIRONMENTS));
            active.clear();
            for state in env.states() {
                sensor.push_active(Scene::new(&level, state), &mut active);
            }
            black_box(&active);
        });
    });

    group.throughput(Throughput::Elements(1));
    let mut single = CoverageEnv::new(Arc::clone(&level), MAX_STEPS);
    let mut rng = ChaCha8Rng::seed_from_u64(0);
    group.bench_function("single_step", |bencher| {
        bencher.iter(|| {
            if black_box(single.step(actions.next(1)[0])).is_done() {
                single.reset(&mut rng);
            }
        });
    });
    let state = single.state().clone();
    group.bench_function("floats", |bencher| {
        bencher.iter(|| sensor.write(Scene::new(&level, black_box(&state)), black_box(&mut floats[..inputs])));
    });
    group.finish();
}

/// Plans from every start cell of a level.
fn plans(criterion: &mut Criterion) {
    let spec = LevelSpec { height: 16, width: 16, wall_density: 0.2, num_targets: 16, seed: 0 };
    let generated = Arc::new(spec.generate().expect("room for all"));
    let builtin = Arc::new(Level::resolve("0").expect("a built-in level"));
    let mut group = criterion.benchmark_group("plans_from_every_start");
    group.sample_size(10);
    for (name, level) in [("level_0", builtin), ("16x16_with_16_targets", generated)] {
        for planner in [&mut Optimal::new() as &mut dyn Planner, &mut AStar] {
            group.bench_function(format!("{}/{name}", planner.name()), |bencher| {
                bencher.iter(|| {
                    for &start in level.starts() {
                        black_box(planner.plan(&level, start, MAX_STEPS).expect("a plan"));
                    }
                });
            });
        }
    }
    group.finish();
}

fn short() -> Criterion {
    Criterion::default().warm_up_time(Duration::from_secs(1)).measurement_time(Duration::from_secs(3))
}

criterion_group! { name = benches; config = short(); targets = steps, plans }
criterion_main!(benches);
