//! The fused engine computes what libtorch's does; and seeds side by side do not mix.

use std::sync::Arc;

use bit_mlp::{Activation, BitBatch};
use coverage_env::generator::LevelSpec;
use coverage_env::random::{below, unit_f32};
use coverage_env::sensor::Full;
use coverage_env::{Action, Level, Scene, Sensor, VecEnv};
use cpp_rl::agent::config::{self, Config};
use cpp_rl::agent::dqn::{DqnLoss, Replay, ReplayState, Transitions};
use cpp_rl::agent::engine::{Device, Engine, FusedEngine, Loss};
use cpp_rl::agent::ppo::{PpoConfig, PpoLoss, PpoTerms, Rollout};
use cpp_rl::agent::state::AgentState;
use cpp_rl::config::Choice;
use cpp_rl::random::{Purpose, Stream};
use proptest::prelude::*;
use proptest::test_runner::RngSeed;
use torch_engine::TorchEngine;

use crate::numbers::{assert_close, assert_within};

/// Updates made one after another.
const UPDATES: usize = 4;

/// The same cases each time: an update is not continuous (at the clip range, at ReLU's zero), so that a case in very
/// many differs for a good reason.
fn few_cases() -> ProptestConfig {
    ProptestConfig { cases: 40, rng_seed: RngSeed::Fixed(7), failure_persistence: None, ..ProptestConfig::default() }
}

/// What a random case is made of.
#[derive(Clone, Debug)]
struct Setting {
    level: Arc<Level>,
    config: Config,
    seeds: u64,
    /// Of everything else that is random.
    seed: u64,
}

/// Levels that are seldom square, networks of 0 to 2 hidden layers of every kind, every L2 penalty on both ranges, and
/// three pairs of Adam's betas.
fn settings(algo: &'static str) -> impl Strategy<Value = Setting> {
    let level = (2..6_usize, 2..7_usize, 0.0..0.3, 1..4_usize, any::<u64>());
    let activation = prop::sample::select(Activation::ALL).prop_map(|(name, _)| name);
    let network = (prop::collection::vec(1..9_usize, 0..3), activation, any::<bool>());
    let l2 = prop::sample::select(vec!["none", "adamw", "adam", "loss"]);
    let covers = prop::sample::select(vec!["all", "weights"]);
    let betas = prop::sample::select(vec![(0.9, 0.999), (0.99, 0.99), (0.0, 0.5)]);
    let optimizer = (l2, covers, betas, 1e-3..0.5, 0.05..5.0, 0.8..1.0);
    let mitigations = prop::sample::select(vec!["", "parseval, spectral"]);
    let seeds = (1..4_u64, any::<u64>());
    let parts = (level, network, optimizer, mitigations, seeds);
    parts.prop_filter_map("no such level", move |(level, network, optimizer, mitigations, seeds)| {
        let (height, width, wall_density, num_targets, seed) = level;
        let level = LevelSpec { height, width, wall_density, num_targets, seed }.generate().ok()?;
        let (l2, covers, (beta1, beta2), coef, max_grad_norm, gamma) = optimizer;
        // A norm over two units divides their difference by about itself: where that is small, it magnifies rounding.
        let least = if network.2 { 3 } else { 0 };
        let widths: Vec<usize> = network.0.iter().map(|width| width + least).collect();
        let mut sets = vec![
            format!("hidden={widths:?}"),
            format!("activation={}", network.1),
            format!("layer_norm={}", network.2),
            format!("l2={l2}"),
            format!("l2_covers={covers}"),
            format!("max_grad_norm={max_grad_norm}"),
            format!("gamma={gamma}"),
            format!("adam_beta1={beta1}"),
            format!("adam_beta2={beta2}"),
            format!("mitigations=[{mitigations}]"),
            // Where a gradient vanishes but for rounding, Adam's step is the sign of that rounding unless ε is larger.
            "adam_eps=1e-3".to_owned(),
            "learning_rate=1e-2".to_owned(),
        ];
        sets.extend((l2 != "none").then(|| format!("l2_coef={coef}")));
        let config = config::resolve(Some(algo), None, &sets, None).expect("valid settings");
        Some(Setting { level: Arc::new(level), config, seeds: seeds.0, seed: seeds.1 })
    })
}

impl Setting {
    fn stream(&self, purpose: Purpose) -> Stream {
        Stream::new(self.seed, 0, purpose)
    }

    /// Agents in the midst of training: no parameter, moment or target parameter is 0.
    fn agents(&self) -> Vec<AgentState> {
        let agent = |seed| {
            let mut agent = self.config.agent(&self.level, seed);
            let mut stream = Stream::new(self.seed, 0, Purpose::Environment(seed as u32));
            let mut draw = |list: &mut Vec<f32>, scale: f32| {
                list.iter_mut().for_each(|v| *v = scale * (2.0 * unit_f32(&mut stream) - 1.0));
            };
            draw(&mut agent.parameters, 1.0);
            draw(&mut agent.adam.exp_avg, 0.1);
            draw(&mut agent.adam.exp_avg_sq, 0.01);
            agent.adam.exp_avg_sq.iter_mut().for_each(|v| *v = v.abs());
            agent.kept.copies.values_mut().for_each(|copy| draw(copy, 1.0));
            agent.adam.step = 5;
            agent
        };
        (0..self.seeds).map(agent).collect()
    }

    /// Environments of one seed, which a random policy steps.
    fn environments(&self, seed: u64) -> VecEnv<Stream> {
        let streams = (0..2).map(|i| Stream::new(seed, 0, Purpose::Environment(i))).collect();
        VecEnv::new(self.level.clone(), 7, streams)
    }

    /// A rollout of a random policy; its log-probabilities, advantages and returns are drawn.
    fn rollout(&self, seed: u64, steps: usize) -> Rollout {
        let mut stream = Stream::new(seed, 1, Purpose::Actions);
        let mut envs = self.environments(seed);
        let mut rollout = Rollout::new(envs.len(), &Full, &self.level);
        let mut current = rollout.inputs.clone();
        for _ in 0..steps {
            current.clear();
            let push = |state| current.push_with(|rows| Full.push_active(Scene::new(&self.level, state), rows));
            envs.states().iter().for_each(push);
            let actions: Vec<Action> = envs.states().iter().map(|_| uniform(&mut stream)).collect();
            rollout.push_observations(&current, &actions);
            envs.step(&actions);
            rollout.push_steps(&envs);
        }
        rollout.finish(&envs);
        let mut draw = |low: f32, high: f32| {
            (0..rollout.rewards.len()).map(|_| low + (high - low) * unit_f32(&mut stream)).collect::<Vec<f32>>()
        };
        (rollout.log_probs, rollout.advantages, rollout.returns) = (draw(-2.5, -0.5), draw(-3.0, 3.0), draw(-5.0, 5.0));
        rollout
    }

    /// A replay buffer that a random policy filled; every second seed's has transitions of an earlier stage as well.
    fn replay(&self, seed: u64) -> Replay {
        let mut stream = Stream::new(seed, 1, Purpose::Actions);
        let mut envs = self.environments(seed);
        let mut fill = |replay: &mut Replay, steps: usize| {
            for _ in 0..steps {
                let actions: Vec<Action> = envs.states().iter().map(|_| uniform(&mut stream)).collect();
                replay.begin(envs.states(), &actions);
                envs.step(&actions);
                replay.end(&envs);
            }
        };
        let mut replay = Replay::new(50, &self.level);
        fill(&mut replay, 40);
        if seed % 2 == 1 {
            let state = ReplayState::beginning(replay.past(&Full), 50, &self.level);
            replay = Replay::restore(50, &self.level, &Full, &state);
            fill(&mut replay, 10);
        }
        replay
    }
}

fn uniform(stream: &mut Stream) -> Action {
    Action::ALL[below(stream, Action::COUNT as u32) as usize]
}

fn fused(setting: &Setting, agents: &[AgentState]) -> Box<dyn Engine> {
    Box::new(FusedEngine::new(setting.config.parts(&setting.level, agents.to_vec())))
}

fn libtorch(setting: &Setting, agents: &[AgentState]) -> Box<dyn Engine> {
    Box::new(TorchEngine::new(setting.config.parts(&setting.level, agents.to_vec()), Device::Cpu))
}

/// The agents as they are now.
fn saved(engine: &dyn Engine, agents: &[AgentState]) -> Vec<AgentState> {
    let mut agents = agents.to_vec();
    agents.iter_mut().enumerate().for_each(|(s, agent)| engine.save(s, agent));
    agents
}

/// Updates of all seeds on their rollouts; returns each update's terms and norms, and the agents at the end.
fn train_ppo(
    mut engine: Box<dyn Engine>,
    config: &PpoConfig,
    rollouts: &[&Rollout],
    minibatches: &[Vec<u32>],
    agents: &[AgentState],
) -> (Vec<(PpoTerms, f32)>, Vec<AgentState>) {
    let mut all = Vec::new();
    for indices in minibatches {
        let mut losses: Vec<PpoLoss<'_>> = rollouts.iter().map(|r| PpoLoss::new(config, r, indices)).collect();
        let norms = engine.descend(&mut losses.iter_mut().map(|loss| loss as _).collect::<Vec<&mut dyn Loss<'_>>>());
        all.extend(losses.iter().map(|loss| loss.terms).zip(norms));
    }
    (all, saved(&*engine, agents))
}

/// Updates of all seeds on their transitions, with a target copy after the second.
fn train_dqn(
    mut engine: Box<dyn Engine>,
    config: &Config,
    transitions: &[Vec<&Transitions>],
    agents: &[AgentState],
) -> (Vec<[f32; 2]>, Vec<AgentState>) {
    let mut all = Vec::new();
    for (i, transitions) in transitions.iter().enumerate() {
        let mut losses: Vec<DqnLoss<'_>> =
            transitions.iter().map(|transitions| DqnLoss::new(config.shared.gamma as f32, transitions)).collect();
        let norms = engine.descend(&mut losses.iter_mut().map(|loss| loss as _).collect::<Vec<&mut dyn Loss<'_>>>());
        all.extend(losses.iter().zip(norms).map(|(loss, norm)| [loss.value, norm]));
        if i == 1 {
            engine.copy("target");
        }
    }
    (all, saved(&*engine, agents))
}

/// Weights and moments agree but for the order of sums.
///
/// That is some 1e-6 of a gradient's largest entry; Adam's step makes it up to learning_rate / adam_eps = 10 times as
/// much, and each of the updates builds on the one before.
fn assert_same_agents(actual: &[AgentState], expected: &[AgentState]) {
    for (actual, expected) in actual.iter().zip(expected) {
        assert_close("parameters", &actual.parameters, &expected.parameters, 1e-4);
        assert_close("exp_avg", &actual.adam.exp_avg, &expected.adam.exp_avg, 1e-4);
        assert_close("exp_avg_sq", &actual.adam.exp_avg_sq, &expected.adam.exp_avg_sq, 1e-4);
        assert_eq!(actual.adam.step, expected.adam.step);
        for (name, copy) in &actual.kept.copies {
            assert_close(name, copy, &expected.kept.copies[name], 1e-4);
        }
    }
}

fn assert_same_ppo_losses(actual: &[(PpoTerms, f32)], expected: &[(PpoTerms, f32)]) {
    let terms = |(terms, norm): &(PpoTerms, f32)| {
        [terms.policy, terms.value, terms.entropy, terms.total, terms.approx_kl, terms.clip_fraction, *norm]
    };
    for (actual, expected) in actual.iter().zip(expected) {
        for (i, (a, e)) in terms(actual).into_iter().zip(terms(expected)).enumerate() {
            assert_within(&format!("term {i}"), &[a], &[e], 1e-4 * e.abs() + 1e-5);
        }
    }
}

fn assert_same_dqn_losses(actual: &[[f32; 2]], expected: &[[f32; 2]]) {
    for (actual, expected) in actual.iter().zip(expected) {
        assert_close("loss", actual, expected, 1e-4);
    }
}

proptest! {
    #![proptest_config(few_cases())]

    #[test]
    fn ppo_is_the_same_with_both_engines(
        setting in settings("ppo"),
        batch_size in 1..20_usize,
        (clip_range, ent_coef, vf_coef) in (0.05..0.5, 0.0..0.1, 0.1..1.0),
        normalize: bool,
    ) {
        let defaults = PpoConfig::default();
        let ppo = PpoConfig { clip_range, ent_coef, vf_coef, normalize_advantage: normalize, ..defaults };
        let rollouts: Vec<Rollout> = (0..setting.seeds).map(|seed| setting.rollout(seed, 12)).collect();
        let rollouts: Vec<&Rollout> = rollouts.iter().collect();
        let mut stream = setting.stream(Purpose::Minibatches);
        let minibatches: Vec<Vec<u32>> =
            (0..UPDATES).map(|_| (0..batch_size).map(|_| below(&mut stream, 24)).collect()).collect();
        let agents = setting.agents();
        let (losses, reference) = train_ppo(libtorch(&setting, &agents), &ppo, &rollouts, &minibatches, &agents);
        let (fused_losses, fused_agents) = train_ppo(fused(&setting, &agents), &ppo, &rollouts, &minibatches, &agents);
        assert_same_ppo_losses(&fused_losses, &losses);
        assert_same_agents(&fused_agents, &reference);
        prop_assert!(reference[0].parameters != agents[0].parameters);

        for make in [fused, libtorch] {
            let (_, together) = train_ppo(make(&setting, &agents), &ppo, &rollouts, &minibatches, &agents);
            for (s, agent) in agents.iter().enumerate() {
                let agent = std::slice::from_ref(agent);
                let (_, alone) = train_ppo(make(&setting, agent), &ppo, &rollouts[s..=s], &minibatches, agent);
                assert_same_agents(&alone, &together[s..=s]);
            }
        }
    }

    #[test]
    fn dqn_is_the_same_with_both_engines(setting in settings("dqn"), batch_size in 1..20_usize) {
        let mut stream = setting.stream(Purpose::Minibatches);
        let replays: Vec<Replay> = (0..setting.seeds).map(|seed| setting.replay(seed)).collect();
        let mut draw = |replay: &Replay| {
            let mut transitions = Transitions::new(&Full, &setting.level);
            replay.sample(batch_size, &mut stream, &mut transitions);
            transitions
        };
        let transitions: Vec<Vec<Transitions>> =
            (0..UPDATES).map(|_| replays.iter().map(&mut draw).collect()).collect();
        let of_seeds = |seeds: std::ops::Range<usize>| -> Vec<Vec<&Transitions>> {
            transitions.iter().map(|update| update[seeds.clone()].iter().collect()).collect()
        };
        let (agents, all) = (setting.agents(), of_seeds(0..setting.seeds as usize));
        let (losses, reference) = train_dqn(libtorch(&setting, &agents), &setting.config, &all, &agents);
        let (fused_losses, fused_agents) = train_dqn(fused(&setting, &agents), &setting.config, &all, &agents);
        assert_same_dqn_losses(&fused_losses, &losses);
        assert_same_agents(&fused_agents, &reference);
        prop_assert!(reference[0].parameters != agents[0].parameters);

        for make in [fused, libtorch] {
            let (_, together) = train_dqn(make(&setting, &agents), &setting.config, &all, &agents);
            for (s, agent) in agents.iter().enumerate() {
                let agent = std::slice::from_ref(agent);
                let (_, alone) = train_dqn(make(&setting, agent), &setting.config, &of_seeds(s..s + 1), agent);
                assert_same_agents(&alone, &together[s..=s]);
            }
        }
    }

    /// The observations beyond a rollout are as many as its episodes that were cut off, a number of each seed's own:
    /// seeds with fewer are padded where they are computed together.
    #[test]
    fn forward_passes_of_unequal_length_do_not_mix(setting in settings("ppo"), lengths in [1..40_usize, 1..40, 1..40]) {
        let agents = setting.agents();
        let rollouts: Vec<Rollout> =
            (0..setting.seeds).map(|seed| setting.rollout(seed, lengths[seed as usize])).collect();
        let inputs: Vec<&BitBatch> = rollouts.iter().map(|rollout| &rollout.inputs).collect();
        for tower in 0..2 {
            let fused = fused(&setting, &agents).forward(tower, &inputs);
            let together = libtorch(&setting, &agents).forward(tower, &inputs);
            for (s, agent) in agents.iter().enumerate() {
                let alone = &libtorch(&setting, std::slice::from_ref(agent)).forward(tower, &inputs[s..=s])[0];
                prop_assert_eq!(alone.len(), 2 * lengths[s] * [Action::COUNT, 1][tower]);
                for outputs in [&fused[s], &together[s]] {
                    assert_within("outputs", outputs, alone, 1e-5);
                }
            }
        }
    }
}
