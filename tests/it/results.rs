//! What the commands print: results of planners and of trained agents, in every format.

use std::fs::{self, File};
use std::process::Stdio;

use assert_cmd::assert::OutputAssertExt;
use serde_json::{Value, json};

use crate::sandbox::Sandbox;

const FORMATS: [&str; 5] = ["table", "markdown", "csv", "json", "latex"];

fn keys(object: &Value) -> Vec<&str> {
    object.as_object().expect("an object").keys().map(String::as_str).collect()
}

/// The paper's A* and the true optimum from every start of levels 0 to 2, measured independently.
fn planner_returns() -> Value {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/crates/coverage-env/tests/fixtures/planner_returns.json");
    serde_json::from_str(&fs::read_to_string(path).expect("the fixture is there")).expect("the fixture is JSON")
}

#[test]
fn planners_earn_what_was_measured_independently() {
    let sandbox = Sandbox::new();
    let expected = planner_returns();
    let [astar, optimal] = ["astar", "optimal"].map(|policy| sandbox.json(&format!("baseline {policy} --levels 0..3")));
    for (i, level) in ["0", "1", "2"].into_iter().enumerate() {
        let expected = expected[level].as_array().expect("a list of starts");
        let episodes = |evaluation: &Value| evaluation["levels"][i]["episodes"].as_array().expect("episodes").clone();
        let (astar, optimal) = (episodes(&astar), episodes(&optimal));
        assert_eq!((astar.len(), optimal.len()), (expected.len(), expected.len()));
        for ((astar, optimal), expected) in astar.iter().zip(&optimal).zip(expected) {
            assert_eq!((&optimal["start"], &astar["start"]), (&expected["start"], &expected["start"]));
            assert_eq!(optimal["return"], expected["optimal"], "from {}", expected["start"]);
            assert!(astar["return"].as_i64() <= optimal["return"].as_i64(), "from {}", expected["start"]);
        }
        let sum = |list: &[Value], key: &str| list.iter().filter_map(|e| e[key].as_f64()).sum::<f64>();
        let difference = (sum(&astar, "return") - sum(expected, "greedy_astar")) / expected.len() as f64;
        // The paper's code breaks ties in the order of a Python set.
        assert!(difference.abs() <= 0.75, "level {level}: {difference}");
    }
}

#[test]
fn a_baseline_prints_as_designed() {
    let sandbox = Sandbox::new();
    let evaluation = sandbox.json("baseline optimal --levels narrow.yaml");
    fn episode(start: [usize; 2], earned: i64, length: u32) -> Value {
        json!({ "start": start, "return": earned, "length": length, "solved": true })
    }
    // From (0, 0) right, right; from (0, 1) right; from (1, 0) up first; from (1, 2) up.
    let episodes = [episode([0, 0], 31, 2), episode([0, 1], 32, 1), episode([1, 0], 30, 3), episode([1, 2], 32, 1)];
    let mean = (31.0 + 32.0 + 30.0 + 32.0) / 4.0;
    let std = f64::sqrt(11.0) / 4.0;
    let level = json!({
        "level": "narrow", "mean": mean, "std": std, "min": 30, "max": 32, "solved_share": 1.0, "episodes": episodes
    });
    assert_eq!(evaluation, json!({ "policy": "optimal", "levels": [level] }));
    let order = ["level", "mean", "std", "min", "max", "solved_share", "episodes"];
    assert_eq!(keys(&evaluation["levels"][0]), order);
    assert_eq!(keys(&evaluation), ["policy", "levels"]);
}

#[test]
fn drawn_starts_and_random_moves_depend_on_the_seed_alone() {
    let sandbox = Sandbox::new();
    let random = |seed: u32| sandbox.json(&format!("baseline random --levels 0,1 --episodes 30 --seed {seed}"));
    let first = random(1);
    assert_eq!(first, random(1));
    assert_ne!(first, random(2));
    assert_eq!(first["levels"][1]["episodes"].as_array().map(Vec::len), Some(30));
    let exhaustive = sandbox.json("baseline random --levels 0 --exhaustive");
    assert_eq!(exhaustive["levels"][0]["episodes"].as_array().map(Vec::len), Some(55));
}

#[test]
fn every_command_prints_every_format() {
    let sandbox = Sandbox::new();
    sandbox.succeeds("train --config ppo.yaml --level a.yaml --seeds 0..2");
    sandbox.succeeds("curriculum --config ppo.yaml --levels a.yaml,b.yaml");
    let commands = [
        "baseline astar --levels a.yaml,b.yaml",
        "eval runs/train/ppo/level-a/seed-0 runs/train/ppo/level-a/seed-1",
        "compare runs",
        "train --resume --config ppo.yaml --level a.yaml --seeds 0..2",
        "curriculum --resume --config ppo.yaml --levels a.yaml,b.yaml",
        "levels list",
    ];
    for command in commands {
        for format in FORMATS {
            let stdout = sandbox.succeeds(&format!("{command} --format {format}")).stdout;
            let fits = match format {
                "table" => stdout.contains("-----"),
                "markdown" => stdout.contains("| --- | ---: |"),
                "csv" => stdout.lines().next().is_some_and(|head| head.matches(',').count() >= 2),
                "json" => stdout.lines().all(|line| serde_json::from_str::<Value>(line).is_ok()) || is_json(&stdout),
                _ => stdout.contains("\\toprule") && stdout.contains("\\end{tabular}"),
            };
            assert!(fits && !stdout.is_empty(), "{command} --format {format}:\n{stdout}");
        }
    }
}

fn is_json(text: &str) -> bool {
    serde_json::from_str::<Value>(text).is_ok()
}

#[test]
fn runs_stages_and_checkpoints_are_evaluated() {
    let sandbox = Sandbox::new();
    sandbox.succeeds("curriculum --config ppo.yaml --levels a.yaml,b.yaml --seeds 4");
    let run = "runs/curriculum/ppo/curriculum/seed-4";
    let last = sandbox.json(&format!("eval {run}"));
    assert_eq!(keys(&last), ["policy", "run", "stage", "seed", "levels"]);
    assert_eq!((&last["policy"], &last["run"]), (&json!("ppo"), &json!(run)));
    assert_eq!((&last["stage"], &last["seed"]), (&json!(1), &json!(4)));
    let names = |evaluation: &Value| {
        let levels = evaluation["levels"].as_array().expect("levels");
        levels.iter().map(|level| level["level"].as_str().expect("a name").to_owned()).collect::<Vec<_>>()
    };
    assert_eq!(names(&last), ["a", "b"]);
    assert_eq!(sandbox.json(&format!("eval {run} --stage 1")), last);

    // A stage's checkpoint earns what evaluations.csv says it earned then.
    let first = sandbox.json(&format!("eval {run} --stage 0"));
    let rows = sandbox.run("curriculum/ppo/curriculum/seed-4").text("evaluations.csv");
    for level in first["levels"].as_array().expect("levels") {
        for episode in level["episodes"].as_array().expect("episodes") {
            let [row, column] = [&episode["start"][0], &episode["start"][1]];
            let (name, length) = (level["level"].as_str().expect("a name"), &episode["length"]);
            let line =
                format!("after,0,{name},{row} {column},{},{length},{},greedy", episode["return"], episode["solved"]);
            assert!(rows.lines().any(|row| row == line), "{line} is not in\n{rows}");
        }
    }

    // A checkpoint alone does not hold the map of its level.
    let file = format!("{run}/checkpoints/stage-0.safetensors");
    let error = sandbox.fails(2, &format!("eval {file}"));
    assert!(error.contains("was trained on level a") && error.contains("--levels"), "{error}");
    let checkpoint = sandbox.json(&format!("eval {file} --levels a.yaml --max-steps 20"));
    assert_eq!(names(&checkpoint), ["a"]);
    assert_eq!(checkpoint["levels"][0], first["levels"][0]);
    assert_eq!((&checkpoint["stage"], &checkpoint["seed"]), (&json!(0), &json!(4)));

    let several = sandbox.json(&format!("eval {run} {run}/checkpoints/stage-1.safetensors --levels c.yaml"));
    assert_eq!(several["evaluations"].as_array().map(Vec::len), Some(2));
    assert_eq!(names(&several["evaluations"][0]), ["c"]);
}

#[test]
fn stochastic_evaluations_can_be_repeated() {
    let sandbox = Sandbox::new();
    for algo in ["ppo", "dqn"] {
        sandbox.succeeds(&format!("train --config {algo}.yaml --level c.yaml"));
        let run = format!("runs/train/{algo}/level-c/seed-0");
        let eval = |options: &str| sandbox.json(&format!("eval {run} {options}"))["levels"].clone();
        let sampled = eval("--stochastic --episodes 40 --seed 1");
        assert_eq!(sampled, eval("--stochastic --episodes 40 --seed 1"));
        assert_ne!(sampled, eval("--stochastic --episodes 40 --seed 2"));
        // The same starts, chosen and sampled actions.
        assert_ne!(sampled, eval("--episodes 40 --seed 1"), "{algo}");
        assert_eq!(eval("--exhaustive"), eval(""));
    }
}

#[test]
fn runs_are_compared() {
    let sandbox = Sandbox::new();
    sandbox.succeeds("curriculum --config ppo.yaml --levels a.yaml,b.yaml --seeds 0..2");
    sandbox
        .write("eps.yaml", fs::read_to_string(sandbox.path("ppo.yaml")).expect("text") + "name: eps\nadam_eps: 1e-8\n");
    sandbox.succeeds("curriculum --config eps.yaml --levels a.yaml,b.yaml --seeds 0");
    sandbox.run("curriculum/eps/curriculum/seed-0").unfinish(1);
    let comparison = sandbox.json("compare runs --out tables");
    let levels = comparison["levels"].as_array().expect("levels");
    assert_eq!(levels.iter().map(|level| &level["name"]).collect::<Vec<_>>(), ["a", "b"]);
    // Nothing but eps differs, and it is told for every arm.
    assert_eq!(comparison["differences"], json!([{ "key": "adam_eps", "values": [1e-8, 1e-5] }]));
    let warnings = comparison["warnings"].to_string();
    assert!(warnings.contains("eps/curriculum/seed-0: 1 of 2 stages are done (unfinished)"), "{warnings}");

    // The mean over seeds of what each earned right after training on the level.
    let arm = comparison["arms"].as_array().expect("arms").iter().find(|arm| arm["name"] == "ppo").expect("ppo");
    let mean = |seed: u32| {
        let evaluation = sandbox.json(&format!("eval runs/curriculum/ppo/curriculum/seed-{seed} --stage 1"));
        evaluation["levels"][1]["mean"].as_f64().expect("a mean")
    };
    let (first, second) = (mean(0), mean(1));
    let near = |actual: &Value, expected: f64| actual.as_f64().is_some_and(|actual| (actual - expected).abs() < 1e-9);
    assert!(near(&arm["levels"][1]["mean"], (first + second) / 2.0), "{arm}");
    assert!(near(&arm["levels"][1]["std"], (first - second).abs() / 2.0), "{arm}");
    let optimal = sandbox.json("baseline optimal --levels b.yaml --max-steps 20")["levels"][0]["mean"].as_f64();
    assert!(near(&levels[1]["optimal"]["mean"], optimal.expect("a mean")), "{}", levels[1]);

    for name in ["tables.md", "tables.tex", "report.json", "tables/right-after-training.csv", "tables/matrix-ppo.csv"] {
        assert!(sandbox.path("tables").join(name).is_file(), "{name}");
    }
    assert!(sandbox.fails(2, "compare tables").contains("tables holds no run"));
}

#[test]
fn runs_of_one_name_but_differing_settings_are_never_pooled() {
    let sandbox = Sandbox::new();
    sandbox.succeeds("train --config ppo.yaml --level a.yaml --out one");
    sandbox.succeeds("train --config ppo.yaml --level a.yaml --out two --set learning_rate=0.01");
    let comparison = sandbox.json("compare one two");
    let names: Vec<&str> =
        comparison["arms"].as_array().expect("arms").iter().filter_map(|a| a["name"].as_str()).collect();
    assert_eq!(names, ["ppo (from scratch) [learning_rate=0.001]", "ppo (from scratch) [learning_rate=0.01]"]);

    sandbox.succeeds("train --config ppo.yaml --level a.yaml --out three");
    let error = sandbox.fails(2, "compare one three");
    assert!(error.contains("one/ppo/level-a/seed-0 and three/ppo/level-a/seed-0 are the same seed"), "{error}");
    sandbox.json("compare one one/ppo");
}

#[test]
fn a_curriculum_prints_one_document() {
    let sandbox = Sandbox::new();
    let tables = sandbox.json("curriculum --config ppo.yaml --levels a.yaml,b.yaml");
    assert_eq!(tables["tables"].as_array().map(Vec::len), Some(2));
    // Once more from the finished runs.
    assert_eq!(sandbox.json("curriculum --config ppo.yaml --levels a.yaml,b.yaml --resume"), tables);
}

#[test]
fn a_reader_that_goes_away_is_no_error() {
    let sandbox = Sandbox::new();
    let mut command = sandbox.command("baseline astar --format json");
    let mut child = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().expect("it starts");
    drop(child.stdout.take());
    let output = child.wait_with_output().expect("it ends");
    assert!(output.status.success() && output.stderr.is_empty(), "{output:?}");
}

#[cfg(target_os = "linux")]
#[test]
fn results_that_cannot_be_written_are_an_error() {
    let sandbox = Sandbox::new();
    let full = || File::options().write(true).open("/dev/full").expect("Linux has it");
    let output = sandbox.command("levels list").stdout(full()).assert().code(1).get_output().stderr.clone();
    let stderr = String::from_utf8_lossy(&output);
    assert!(stderr.contains("cannot write to stdout") && !stderr.contains("panicked"), "{stderr}");
    // Nobody reads what is shown on the way: the training is none the worse for it.
    sandbox.command("train --config ppo.yaml --level a.yaml").stderr(full()).assert().success();
}
