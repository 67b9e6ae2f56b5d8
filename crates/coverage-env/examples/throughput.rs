//! Steps per second on one core: `cargo run --release -p coverage-env --example throughput [LEVEL]`.

use std::hint::black_box;
use std::sync::Arc;
use std::time::Instant;

use chacha20::ChaCha8Rng;
use chacha20::rand_core::SeedableRng;
use coverage_env::planner::{AStar, Optimal};
use coverage_env::{Action, CoverageEnv, Level, LevelError, MAX_STEPS, Observation, Planner, VecEnv};
use coverage_env::{generator::LevelSpec, random::below};

const ENVIRONMENTS: usize = 64;
const ROUNDS: usize = 3_000;
/// Short repetitions, of which the fastest counts: the others were disturbed.
const REPETITIONS: usize = 200;

fn main() -> Result<(), LevelError> {
    let level = std::env::args().nth(1).unwrap_or_else(|| "0".into());
    let level = Arc::new(Level::resolve(&level)?);
    println!("level {}, {} environments, random actions", level.name(), ENVIRONMENTS);

    // Drawn beforehand: the cost of choosing actions is not the environment's.
    let mut rng = ChaCha8Rng::seed_from_u64(0);
    let drawn: Vec<Action> = (0..1 << 16).map(|_| Action::ALL[below(&mut rng, 4) as usize]).collect();
    let rngs = || (0..ENVIRONMENTS as u64).map(ChaCha8Rng::seed_from_u64).collect();
    let actions = |round: usize| &drawn[round * 61 % (drawn.len() - ENVIRONMENTS)..][..ENVIRONMENTS];

    let mut env = VecEnv::new(Arc::clone(&level), MAX_STEPS, rngs());
    rate("steps, without observations", || {
        for round in 0..ROUNDS {
            black_box(env.step(actions(round)));
        }
    });

    let mut env = VecEnv::new(Arc::clone(&level), MAX_STEPS, rngs());
    let inputs = Observation::len(&level);
    let mut array = vec![0.0; ENVIRONMENTS * inputs];
    rate("steps, with [4, H, W] observations", || {
        for round in 0..ROUNDS {
            env.step(actions(round));
            for (state, out) in env.states().iter().zip(array.chunks_exact_mut(inputs)) {
                Observation::new(&level, state).write(out);
            }
            black_box(&array);
        }
    });

    let mut env = VecEnv::new(Arc::clone(&level), MAX_STEPS, rngs());
    let mut active = Vec::new();
    rate("steps, with active inputs", || {
        for round in 0..ROUNDS {
            env.step(actions(round));
            active.clear();
            for state in env.states() {
                Observation::new(&level, state).push_active(&mut active);
            }
            black_box(&active);
        }
    });

    let mut single = CoverageEnv::new(Arc::clone(&level), MAX_STEPS);
    rate("steps, of a single environment", || {
        for index in 0..ROUNDS * ENVIRONMENTS {
            if black_box(single.step(drawn[index % drawn.len()])).is_done() {
                single.reset(&mut rng);
            }
        }
    });

    for (side, targets) in [(16, 16), (16, 20), (32, 22)] {
        let spec = LevelSpec { height: side, width: side, wall_density: 0.2, num_targets: targets, seed: 0 };
        let level = spec.generate().expect("room for all");
        for planner in [&mut Optimal::new() as &mut dyn Planner, &mut AStar] {
            let begin = Instant::now();
            for &start in level.starts() {
                black_box(planner.plan(&level, start, MAX_STEPS).expect("a plan"));
            }
            println!("{} from every start of {}: {:.2?}", planner.name(), level.name(), begin.elapsed());
        }
    }
    Ok(())
}

/// Prints how many environment steps a second `rounds` makes at best.
fn rate(what: &str, mut rounds: impl FnMut()) {
    let fastest = (0..REPETITIONS).map(|_| {
        let begin = Instant::now();
        rounds();
        begin.elapsed().as_secs_f64()
    });
    let steps = (ENVIRONMENTS * ROUNDS) as f64 / fastest.fold(f64::INFINITY, f64::min);
    println!("{:6.1} million {what} per second", steps / 1e6);
}
