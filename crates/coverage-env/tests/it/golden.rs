//! The recorded trajectories in `tests/golden`; its README has the format and how to record anew.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use chacha20::ChaCha8Rng;
use chacha20::rand_core::SeedableRng;
use coverage_env::generator::LevelSpec;
use coverage_env::planner::{Optimal, Random};
use coverage_env::{Action, CoverageEnv, Level, MAX_STEPS, Planner};
use serde::{Deserialize, Serialize};

use crate::support::builtin;

#[derive(Serialize, Deserialize)]
struct Golden {
    name: String,
    map: Vec<String>,
    episodes: Vec<Episode>,
}

#[derive(Debug, PartialEq, Serialize, Deserialize)]
struct Episode {
    start: (usize, usize),
    max_steps: u32,
    steps: Vec<Record>,
}

#[derive(Debug, PartialEq, Serialize, Deserialize)]
struct Record {
    action: u8,
    reward: f32,
    terminated: bool,
    truncated: bool,
    agent: (usize, usize),
    visited: String,
}

/// Plays `actions` until the episode's end and writes down what happens.
fn record(level: &Arc<Level>, start: usize, max_steps: u32, actions: &[Action]) -> Episode {
    let mut env = CoverageEnv::new(Arc::clone(level), max_steps);
    env.reset_at(start).expect("a start");
    let mut steps: Vec<Record> = Vec::new();
    for &action in actions {
        let step = env.step(action);
        let bit = |cell| {
            if env.state().visited.contains(cell) { '1' } else { '0' }
        };
        steps.push(Record {
            action: action as u8,
            reward: step.reward,
            terminated: step.terminated,
            truncated: step.truncated,
            agent: level.position(env.state().agent.into()),
            visited: (0..level.len()).map(bit).collect(),
        });
        if step.is_done() {
            break;
        }
    }
    Episode { start: level.position(start), max_steps, steps }
}

/// What is worth recording on a level.
fn episodes(level: &Arc<Level>) -> Vec<Episode> {
    let (first, last) = (level.starts()[0], level.starts()[level.starts().len() - 1]);
    let optimal = |start| Optimal::new().plan(level, start, MAX_STEPS).expect("a plan");
    let mut random = Random::new(ChaCha8Rng::seed_from_u64(0));
    let random = random.plan(level, first, MAX_STEPS).expect("a plan");
    let just_enough = optimal(last).len() as u32;
    vec![
        record(level, first, MAX_STEPS, &optimal(first)),
        record(level, first, 40, &random),
        record(level, last, just_enough, &optimal(last)),
    ]
}

fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/golden")
}

#[test]
fn golden_trajectories_are_followed() {
    if std::env::var_os("UPDATE_GOLDEN").is_some() {
        write_anew();
    }
    let files = std::fs::read_dir(folder()).expect("the folder");
    let mut played = 0;
    for path in files.map(|entry| entry.expect("an entry").path()) {
        if path.extension().is_none_or(|extension| extension != "json") {
            continue;
        }
        let text = std::fs::read_to_string(&path).expect("a readable file");
        let golden: Golden = serde_json::from_str(&text).expect("a golden file");
        let level = Arc::new(Level::from_map(golden.name, &golden.map.join("\n")).expect("a map"));
        for episode in golden.episodes {
            let action = |step: &Record| Action::from_index(step.action).expect("an action");
            let actions: Vec<Action> = episode.steps.iter().map(action).collect();
            let start = level.index(episode.start.0, episode.start.1).expect("on the map");
            let now = record(&level, start, episode.max_steps, &actions);
            assert_eq!(now, episode, "{} from {:?}", path.display(), episode.start);
            played += 1;
        }
    }
    assert_eq!(played, 12);
}

fn write_anew() {
    let generate = |height, width, wall_density, num_targets| {
        let spec = LevelSpec { height, width, wall_density, num_targets, seed: 0 };
        Arc::new(spec.generate().expect("a level"))
    };
    for level in [builtin("0"), builtin("4"), generate(5, 11, 0.25, 5), generate(9, 4, 0.3, 4)] {
        let map: Vec<String> = level.to_map().lines().map(str::to_owned).collect();
        let golden = Golden { name: level.name().to_owned(), map, episodes: episodes(&level) };
        // A line for each step reads well, and so do differences.
        let text = serde_json::to_string(&golden).expect("plain data");
        let text = text.replace("{\"start\"", "\n{\"start\"").replace("{\"action\"", "\n{\"action\"");
        std::fs::write(folder().join(format!("{}.json", level.name())), text + "\n").expect("written");
    }
}
