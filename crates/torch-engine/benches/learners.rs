//! What the learners do between two rows of the log, with the paper's settings on level 0, with both engines:
//! `cargo bench -p torch-engine`, best on an idle core (`taskset -c 0`).

use std::hint::black_box;
use std::sync::Arc;
use std::time::Duration;

use coverage_env::random::{below, shuffle};
use coverage_env::sensor::Full;
use coverage_env::{Action, BUILTIN_IDS, Level, MAX_STEPS, Scene, Sensor, VecEnv};
use cpp_rl::agent::config::{self, Config};
use cpp_rl::agent::dqn::{DqnConfig, DqnLoss, Replay, Transitions};
use cpp_rl::agent::engine::{self, Device, Engine, EngineKind};
use cpp_rl::agent::ppo::{PpoConfig, PpoLoss, Rollout};
use cpp_rl::agent::{self, Learner, Stage};
use cpp_rl::evaluate::{self, Choose, Starts};
use cpp_rl::random::{Purpose, Stream};
use criterion::{Criterion, SamplingMode, Throughput, criterion_group, criterion_main};

const ENGINES: [EngineKind; 2] = [EngineKind::Fused, EngineKind::Libtorch(Device::Cpu)];
/// Timesteps of a rollout, and between two rows of DQN's log.
const TIMESTEPS: u64 = 2048;

fn level(id: &str) -> Arc<Level> {
    Arc::new(Level::resolve(id).expect("a built-in level"))
}

/// One seed at the beginning of a stage that ends after every benchmark.
fn learner(config: &Config, kind: EngineKind) -> Box<dyn Learner> {
    let stage = Stage { index: 0, level: level("0"), timesteps: 1 << 50, horizon: 1 << 50 };
    let agents = vec![config.agent(&stage.level, 0)];
    agent::learner(config, &stage, agents, kind)
}

fn ppo(criterion: &mut Criterion) {
    let config = config::resolve(Some("ppo"), None, &[], None).expect("a preset");
    let settings = config.of::<PpoConfig>().expect("the preset is PPO's");
    // Without an epoch, an iteration is collecting and estimating alone.
    let without_update =
        Config { algorithm: Box::new(PpoConfig { n_epochs: 0, ..settings.clone() }), ..config.clone() };
    let rollout = rollout(settings.n_steps);
    let mut order: Vec<u32> = (0..rollout.len() as u32).collect();
    shuffle(&mut Stream::new(0, 0, Purpose::Minibatches), &mut order);
    let minibatches = || order.chunks(settings.batch_size);

    for kind in ENGINES {
        let mut group = criterion.benchmark_group(format!("ppo_{}", name_of(kind)));
        let mut engine = engine_of(&config, kind);
        let mut step = |indices| engine.descend(&mut [&mut PpoLoss::new(settings, &rollout, indices)]);
        let mut next = minibatches().cycle();
        group.bench_function("minibatch", |bencher| {
            bencher.iter(|| step(next.next().expect("a cycle has no end")));
        });
        group.sample_size(10).sampling_mode(SamplingMode::Flat).throughput(Throughput::Elements(TIMESTEPS));
        let mut learner_without = learner(&without_update, kind);
        group.bench_function("rollout", |bencher| bencher.iter(|| learner_without.advance()));
        group.bench_function("update", |bencher| {
            bencher.iter(|| {
                for indices in (0..settings.n_epochs).flat_map(|_| minibatches()) {
                    black_box(step(indices));
                }
            });
        });
        let mut learner = learner(&config, kind);
        group.bench_function("rollout_and_update", |bencher| bencher.iter(|| learner.advance()));
        group.finish();
    }
}

fn dqn(criterion: &mut Criterion) {
    let config = config::resolve(Some("dqn"), None, &[], None).expect("a preset");
    let settings = config.of::<DqnConfig>().expect("the preset is DQN's");
    // As it is for nine tenths of a training.
    let settings = DqnConfig { exploration_initial_eps: settings.exploration_final_eps, ..settings.clone() };
    let config = Config { algorithm: Box::new(settings.clone()), ..config.clone() };
    let replay = replay(settings.buffer_size);
    let mut stream = Stream::new(0, 0, Purpose::Minibatches);
    let mut transitions = Transitions::new(&Full, &level("0"));
    criterion.bench_function("dqn/draw_a_minibatch", |bencher| {
        bencher.iter(|| {
            replay.sample(settings.batch_size, &mut stream, &mut transitions);
            black_box(&transitions);
        });
    });

    for kind in ENGINES {
        let mut group = criterion.benchmark_group(format!("dqn_{}", name_of(kind)));
        let mut engine = engine_of(&config, kind);
        let mut step = || engine.descend(&mut [&mut DqnLoss::new(config.shared.gamma as f32, &transitions)]);
        group.bench_function("minibatch", |bencher| bencher.iter(&mut step));
        group.sample_size(10).sampling_mode(SamplingMode::Flat).throughput(Throughput::Elements(TIMESTEPS));
        let mut learner = learner(&config, kind);
        learner.advance(); // past learning_starts
        group.bench_function("2048_timesteps", |bencher| bencher.iter(|| learner.advance()));
        group.finish();
    }
}

/// Every start cell of the five levels. An agent from scratch solves none of them, so that every episode has its full 200
/// steps: the most that an evaluation can cost.
fn evaluation(criterion: &mut Criterion) {
    let levels: Vec<Arc<Level>> = BUILTIN_IDS.iter().map(|id| level(id)).collect();
    for algo in ["ppo", "dqn"] {
        let config = config::resolve(Some(algo), None, &[], None).expect("a preset");
        let network = config.network(&levels[0]);
        let agent = config.agent(&levels[0], 0);
        criterion.bench_function(&format!("evaluation_of_five_levels/{algo}"), |bencher| {
            bencher.iter(|| {
                for level in &levels {
                    let (starts, choose, parameters) = (Starts::Exhaustive, &mut Choose::Greedy, &agent.parameters);
                    black_box(evaluate::network(&network, &Full, parameters, level, MAX_STEPS, starts, choose));
                }
            });
        });
    }
}

fn name_of(kind: EngineKind) -> &'static str {
    if kind.joins_seeds() { "libtorch" } else { "fused" }
}

/// The engine of one agent from scratch.
fn engine_of(config: &Config, kind: EngineKind) -> Box<dyn Engine> {
    let level = level("0");
    engine::new(kind, config.parts(&level, vec![config.agent(&level, 0)]))
}

/// One environment on level 0, and a policy that draws its actions uniformly.
struct Wandering {
    envs: VecEnv<Stream>,
    actions: Stream,
}

impl Wandering {
    fn new() -> Self {
        let starts = vec![Stream::new(0, 0, Purpose::Environment(0))];
        let envs = VecEnv::new(level("0"), MAX_STEPS, starts);
        Self { envs, actions: Stream::new(0, 0, Purpose::Actions) }
    }

    fn action(&mut self) -> [Action; 1] {
        [Action::ALL[below(&mut self.actions, Action::COUNT as u32) as usize]]
    }
}

/// A rollout of `steps`, with numbers of the usual size in place of estimates.
fn rollout(steps: usize) -> Rollout {
    let mut wandering = Wandering::new();
    let level = wandering.envs.level().clone();
    let mut rollout = Rollout::new(1, &Full, &level);
    let mut current = rollout.inputs.clone();
    for _ in 0..steps {
        current.clear();
        let state = &wandering.envs.states()[0];
        current.push_with(|active| Full.push_active(Scene::new(&level, state), active));
        let actions = wandering.action();
        rollout.push_observations(&current, &actions);
        wandering.envs.step(&actions);
        rollout.push_steps(&wandering.envs);
    }
    rollout.finish(&wandering.envs);
    rollout.log_probs = vec![-1.4; steps];
    rollout.advantages = rollout.rewards.iter().map(|reward| reward + 1.0).collect();
    rollout.returns = rollout.rewards.clone();
    rollout
}

/// A full replay buffer.
fn replay(capacity: usize) -> Replay {
    let mut wandering = Wandering::new();
    let mut replay = Replay::new(capacity, wandering.envs.level());
    for _ in 0..capacity {
        let actions = wandering.action();
        replay.begin(wandering.envs.states(), &actions);
        wandering.envs.step(&actions);
        replay.end(&wandering.envs);
    }
    replay
}

fn short() -> Criterion {
    engine::install(&torch_engine::LIBTORCH);
    Criterion::default().warm_up_time(Duration::from_secs(1)).measurement_time(Duration::from_secs(3))
}

criterion_group! { name = benches; config = short(); targets = ppo, dqn, evaluation }
criterion_main!(benches);
