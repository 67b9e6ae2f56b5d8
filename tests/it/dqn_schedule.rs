//! When DQN explores, updates and copies its target network.

use std::sync::Arc;

use coverage_env::Level;
use cpp_rl::agent::config::{self, Config};
use cpp_rl::agent::dqn::DqnConfig;
use cpp_rl::agent::dqn::Exploration;
use cpp_rl::agent::engine::EngineKind;
use cpp_rl::agent::state::AgentState;
use cpp_rl::agent::{self, Stage};

use crate::fixtures;

fn stage(index: u16, timesteps: u64) -> Stage {
    let level = Arc::new(Level::from_map("map", "..T\n.#.").expect("a valid map"));
    Stage { index, level, timesteps, horizon: timesteps }
}

/// The study's settings but for the network, which is small, and what `sets` says.
fn config(sets: &[&str]) -> Config {
    let small = ["hidden=[3]", "batch_size=2", "max_steps=10"];
    let sets: Vec<String> = small.iter().chain(sets).map(|&set| set.to_owned()).collect();
    config::resolve(Some("dqn"), None, &sets, None).expect("valid settings")
}

/// Trains one seed through `stage`, from `agent` or from scratch.
fn train(config: &Config, stage: &Stage, agent: Option<AgentState>) -> AgentState {
    let agent = agent.unwrap_or_else(|| config.agent(&stage.level, 5));
    let mut learner = agent::learner(config, stage, vec![agent], EngineKind::Fused);
    while learner.timesteps() < stage.timesteps {
        learner.advance();
    }
    assert_eq!(learner.timesteps(), stage.timesteps);
    learner.agents()[0].clone()
}

#[test]
fn epsilon_falls_as_in_stable_baselines3() {
    let fixture = fixtures::json("exploration");
    let rates = fixture["rates"].as_array().expect("a list");
    assert!(rates.len() > 10);
    for rate in rates {
        let number = |key: &str| rate[key].as_u64().expect("a number");
        let exploration = Exploration::new(&DqnConfig::default(), &stage(0, number("total")));
        let epsilon = exploration.epsilon(number("timestep"));
        let expected = rate["exploration_rate"].as_f64().expect("a number");
        // The same line, by way of 1 − timesteps/total there.
        assert!((epsilon - expected).abs() < 1e-12, "{rate}: {epsilon}");
    }
}

#[test]
fn epsilon_by_hand() {
    let dqn = DqnConfig {
        exploration_initial_eps: 0.9,
        exploration_final_eps: 0.1,
        exploration_fraction: 0.5,
        ..DqnConfig::default()
    };
    let near = |a: f64, b: f64| (a - b).abs() < 1e-12;
    let first = Exploration::new(&dqn, &stage(0, 200));
    assert!(near(first.epsilon(0), 0.9) && near(first.epsilon(50), 0.5) && near(first.epsilon(100), 0.1));
    assert!(first.epsilon(150) == 0.1);
    // "Without exploration" after the first stage: ε stays at its final value.
    let later = Exploration::new(&dqn, &stage(1, 200));
    assert!([0, 50, 199].iter().all(|&timesteps| later.epsilon(timesteps) == 0.1));
    let never = Exploration::new(&DqnConfig { exploration_fraction: 0.0, ..dqn }, &stage(0, 200));
    assert!(never.epsilon(0) == 0.1);
}

#[test]
fn the_first_update_follows_timestep_104() {
    let updates = |timesteps| {
        let agent = train(&config(&[]), &stage(0, timesteps), None);
        assert_eq!(agent.adam.step, agent.counters.updates);
        agent.counters.updates
    };
    // Every fourth timestep, but only once more than `learning_starts` = 100 are done.
    assert_eq!([96, 100, 104, 108, 1000].map(updates), [0, 0, 1, 2, 225]);
}

#[test]
fn a_million_timesteps_make_as_many_updates_as_in_stable_baselines3() {
    let config = config(&["hidden=[1]", "batch_size=1"]);
    let agent = train(&config, &stage(0, 1_000_000), None);
    let expected = fixtures::json("dqn_study")["adam_step"].as_u64();
    assert_eq!(Some(agent.counters.updates), expected);
    assert_eq!(agent.counters.target_calls, 1_000_000);
}

#[test]
fn learning_starts_anew_in_each_stage() {
    let config = config(&[]);
    let first = train(&config, &stage(0, 200), None);
    assert_eq!(first.counters.updates, 25);
    let second = train(&config, &stage(1, 200), Some(first));
    assert_eq!(second.counters.updates, 50);
    assert_eq!((second.counters.timesteps, second.counters.target_calls), (400, 400));
}

#[test]
fn the_target_network_is_copied_before_the_update_of_the_same_timestep() {
    // ε must not depend on how long the stage is, so that a longer one begins as a shorter one.
    let config = config(&["exploration_initial_eps=0.05"]);
    let fresh = train(&config, &stage(0, 4), None);
    let before = train(&config, &stage(0, 9_996), None);
    let after = train(&config, &stage(0, 10_000), None);
    assert_eq!(before.kept, fresh.kept, "no copy yet");
    assert_eq!(after.kept.copies["target"], before.parameters, "the weights after the update at timestep 9,996");
    assert_ne!(after.parameters, before.parameters, "and an update at timestep 10,000");
}

#[test]
fn the_count_of_calls_that_times_copies_goes_on_over_stages() {
    let config = config(&["exploration_initial_eps=0.05", "target_update_interval=300"]);
    let first = train(&config, &stage(0, 200), None);
    let initial = train(&config, &stage(0, 4), None).kept;
    assert_eq!(first.kept, initial);
    // Call 300 is timestep 100 of the second stage, where nothing has been learned yet.
    let second = train(&config, &stage(1, 100), Some(first.clone()));
    assert_eq!(second.kept.copies["target"], first.parameters);
}
