//! Forks: agents that go on from the end of a stage under a treatment.

use coverage_env::Level;
use cpp_rl::agent::{self, Stage, config};
use cpp_rl::run::checkpoint::Checkpoint;
use rustix::process::Signal;
use serde_json::{Value, json};

use crate::sandbox::{RunFiles, Sandbox};
use crate::stops::{LONG, command, stop_within};

/// A study of three levels with forks after the first two stages.
fn study(algo: &str, fork: &str) -> String {
    format!(
        "name: s\nlevels: [a.yaml, b.yaml, c.yaml]\narms:\n  - config: {algo}.yaml\n    trains: [curriculum]\n    \
         fork: {fork}\n"
    )
}

/// The rows of a CSV file whose column `stage` is at least `from`, with `phase` as given, if the file has one.
fn rows(run: &RunFiles, from: u64, phase: &str) -> Vec<String> {
    let text = run.text("evaluations.csv");
    let mut reader = csv::Reader::from_reader(text.as_bytes());
    let headers = reader.headers().expect("a header").clone();
    let column = |name: &str| headers.iter().position(|header| header == name).expect("the column");
    let (stage, phases) = (column("stage"), column("phase"));
    let rows = reader.records().map(|row| row.expect("a row"));
    let wanted = rows.filter(|row| &row[phases] == phase && row[stage].parse::<u64>().expect("a number") >= from);
    wanted.map(|row| format!("{row:?}")).collect()
}

#[test]
fn an_empty_treatment_does_again_what_the_curriculum_did() {
    for algo in ["ppo", "ppo-l2", "dqn"] {
        let sandbox = Sandbox::new();
        sandbox.write(
            "s.yaml",
            study(algo, "[{after: [0, 1], treatments: {none: {}}}, {after: 0, stages: 2, treatments: {twice: {}}}]"),
        );
        sandbox.succeeds("study s.yaml --seeds 0..2 --jobs 3");
        for (folder, stages) in [("after-0+none", 1..2), ("after-1+none", 2..3), ("after-0+twice", 1..3)] {
            let parent = sandbox.run(&format!("s/{algo}/curriculum/seed-1"));
            let fork = sandbox.run(&format!("s/{algo}/curriculum+{folder}/seed-1"));
            for stage in stages.clone() {
                let name = format!("checkpoints/stage-{stage}.safetensors");
                assert!(parent.bytes(&name) == fork.bytes(&name), "{algo} {folder} {name}");
            }
            let of_stages = |run: &RunFiles| {
                let is_in = |row: &Vec<(String, String)>| {
                    let (_, stage) = row.iter().find(|(name, _)| name == "stage").expect("the column");
                    stages.contains(&stage.parse::<u64>().expect("a number"))
                };
                run.progress().into_iter().filter(is_in).collect::<Vec<_>>()
            };
            assert!(!fork.progress().is_empty());
            assert_eq!(of_stages(&parent), fork.progress(), "{algo} {folder}");
            let evaluated = rows(&fork, 0, "after");
            let from_parent = rows(&parent, stages.start, "after");
            assert!(!evaluated.is_empty());
            assert_eq!(evaluated, from_parent[..evaluated.len()]);
        }
    }
}

#[test]
fn everything_anew_trains_as_a_new_agent_with_the_streams_of_the_stage() {
    for algo in ["ppo", "dqn"] {
        let sandbox = Sandbox::new();
        sandbox.write("s.yaml", study(algo, "{after: 0, grid: {weights: [warm, fresh], optimizer: [warm, fresh]}}"));
        sandbox.succeeds("study s.yaml --seeds 3 --jobs 2");
        let checkpoint = |run: &str, stage: u16| {
            let path = sandbox.run(&format!("s/{algo}/{run}/seed-3/checkpoints/stage-{stage}.safetensors"));
            Checkpoint::read(&path.0).expect("a checkpoint").agent
        };
        let settings =
            config::resolve(None, Some(&sandbox.path(&format!("{algo}.yaml"))), &[], None).expect("settings");
        let level = Level::resolve(sandbox.path("b.yaml").to_str().expect("text")).expect("a level");
        let mut new = settings.agent(&level, 3);
        new.counters = checkpoint("curriculum", 0).counters;
        let stage = Stage { index: 1, level: level.into(), timesteps: 256, horizon: 256 };
        let mut learner = agent::learner(&settings, &stage, vec![new], cpp_rl::agent::engine::EngineKind::Fused);
        while learner.timesteps() < stage.timesteps {
            learner.advance();
        }
        let fresh = checkpoint("curriculum+after-0+weights-fresh+optimizer-fresh", 1);
        assert_eq!(&fresh, learner.agents()[0]);
        let others = ["curriculum+after-0+weights-fresh", "curriculum+after-0+optimizer-fresh", "curriculum"];
        assert!(others.iter().all(|run| checkpoint(run, 1).parameters != fresh.parameters));
    }
}

#[test]
fn a_stopped_fork_goes_on() {
    for algo in ["ppo", "dqn"] {
        let sandbox = Sandbox::new();
        sandbox.succeeds(&format!("{} --seeds 0", command(algo, "parents")));
        let updates = if algo == "dqn" { 1 } else { 8 };
        let fork = |out: &str| {
            let treatment = r#"{"optimizer":"fresh"}"#;
            let options = format!("--after 0 --stages 2 --treatment {treatment} --checkpoint-updates {updates}");
            let run = format!("{out}/{algo}/curriculum+after-0+optimizer-fresh/seed-0");
            (format!("fork parents {options} --out {out}"), RunFiles(sandbox.path(&run)))
        };
        let (whole, expected) = fork("whole");
        sandbox.succeeds(&whole);
        for signal in [Signal::TERM, Signal::KILL] {
            let out = format!("stopped-{signal:?}").replace(['(', ')'], "");
            let (stopped, run) = fork(&out);
            if signal == Signal::TERM {
                stop_within(&sandbox, &stopped, &run, signal);
            } else {
                let mut training = crate::stops::Training::begin(&sandbox, &format!("{stopped} --verbose"));
                // In the second of its stages.
                while training.next_save(&run) < u64::from(2 * LONG) + 1000 {}
                training.send(signal);
                training.output();
            }
            let refused = sandbox.fails(2, &stopped);
            assert!(refused.contains("holds a run already"), "{refused}");
            sandbox.succeeds(&format!("{stopped} --resume"));
            run.reproducible().assert_same(&expected.reproducible());
        }
        let manifest = expected.manifest();
        assert_eq!(manifest["fork"]["parent"], format!("parents/{algo}/curriculum/seed-0"));
        assert_eq!(manifest["fork"]["after"], 0);
        assert_eq!(manifest["fork"]["name"], "optimizer-fresh");
        assert_eq!(manifest["fork"]["treatment"], json!({ "optimizer": "fresh" }));
        // The stage of the parent is no stage of the fork's own.
        assert!(!expected.files().iter().any(|file| file.contains("stage-0")), "{:?}", expected.files());
    }
}

#[test]
fn a_fork_goes_on_with_its_own_treatment_alone() {
    let sandbox = Sandbox::new();
    let file = |treatment: &str| {
        sandbox.write("s.yaml", study("ppo", &format!("{{after: 0, treatments: {{mine: {treatment}}}}}")));
    };
    file("{scale: {policy.1: 0.5}}");
    sandbox.succeeds("study s.yaml --seeds 0");
    file("{scale: {policy.1: 0.25}}");
    let refused = sandbox.fails(2, "study s.yaml --seeds 0 --resume");
    let says = r#"fork: after 0 {"scale":{"policy.1":0.5}} → after 0 {"scale":{"policy.1":0.25}}"#;
    assert!(refused.contains(says), "{refused}");
}

#[test]
fn settings_of_a_treatment_are_the_forks_own() {
    let sandbox = Sandbox::new();
    let treatments = "{sure: {set: [ent_coef=0.5, \"mitigations=[redo]\"]}, slow: {set: [learning_rate=1e-5]}}";
    sandbox.write("s.yaml", study("ppo", &format!("{{after: 1, treatments: {treatments}}}")));
    sandbox.succeeds("study s.yaml --seeds 0");
    let config = |run: &str| sandbox.run(&format!("s/ppo/{run}/seed-0")).manifest()["config"].clone();
    let (sure, slow) = (config("curriculum+after-1+sure"), config("curriculum+after-1+slow"));
    assert_eq!((&sure["ent_coef"], &sure["mitigations"]), (&json!(0.5), &json!(["redo"])));
    assert_eq!((&slow["learning_rate"], &slow["name"]), (&json!(1e-5), &json!("ppo")));
    assert_eq!(config("curriculum")["learning_rate"], json!(1e-3));
    // A fork is listed as a run of its own, of which its own stages count.
    let runs = sandbox.json("runs runs/s");
    let runs = runs["runs"].as_array().or(runs.as_array()).expect("a list");
    let done = |run: &&Value| run["progress"] == json!(1.0);
    assert_eq!((runs.len(), runs.iter().filter(done).count()), (3, 3), "{runs:?}");
    let named = |name: &str| runs.iter().any(|run| run["curriculum"] == name);
    assert!(named("curriculum+after-1+sure") && named("curriculum"), "{runs:?}");
}

#[test]
fn what_cannot_be_forked_is_refused_with_its_place() {
    let sandbox = Sandbox::new();
    let cases = [
        ("{after: 2, treatments: {none: {}}}", "6:19: fork: after: expected an integer from 0 to 1, got 2"),
        ("{after: [0, 0], treatments: {none: {}}}", "0 stands twice"),
        ("{after: 1, stages: 2, treatments: {none: {}}}", "fork: stages: expected an integer from 1 to 1, got 2"),
        ("{treatments: {none: {}}}", "fork has no \"after\""),
        ("{after: 0}", "it has no treatment"),
        ("{after: 0, treatment: {}}", "unknown key \"treatment\" in fork; did you mean \"treatments\"?"),
        ("{after: 0, treatments: {x: {wieghts: fresh}}}", "did you mean \"weights\"?"),
        ("{after: 0, treatments: {x: {target: keep}}}", "unknown key \"target\" in a treatment"),
        ("{after: 0, treatments: {x: {weights: [polciy]}}}", "no tower or layer \"polciy\"; did you mean \"policy\"?"),
        ("{after: 0, treatments: {x: {scale: {policy.7: 2}}}}", "no tower or layer \"policy.7\""),
        ("{after: 0, treatments: {x: {scale: {policy.1: -1}}}}", "expected a number from 0 to 1e6, got -1"),
        ("{after: 0, treatments: {x: {scale: {policy.1: 1}}}}", "this treatment changes nothing: write {}"),
        ("{after: 0, treatments: {x: {weights: warm}}}", "this treatment changes nothing"),
        ("{after: 0, treatments: {x: {set: [gamma=0.99]}}}", "this treatment changes nothing"),
        ("{after: 0, treatments: {x: {set: [gama=0.9]}}}", "did you mean \"gamma\"?"),
        ("{after: 0, treatments: {x: {set: [name=y]}}}", "a fork keeps that of its parent"),
        ("{after: 0, treatments: {x: {set: [timesteps=9]}}}", "write timesteps in the fork"),
        ("{after: 0, treatments: {x: {set: [\"hidden=[4]\"]}}}", "the agent comes with [8], which cannot become [4]"),
        ("{after: 0, treatments: {\"a b\": {}}}", "fork: treatments: name: expected 1 to 64 letters"),
        ("{after: 0, grid: {scale: [{policy.1: 2}, {policy.1: 2}]}}", "policy.1-2 stands twice"),
        ("{after: 0, treatments: {none: {weights: fresh}}}", "none is the name of the control"),
        ("{after: 0, grid: {sacle: [{policy.1: 2}]}}", "did you mean \"scale\"?"),
    ];
    for (fork, says) in cases {
        sandbox.write("s.yaml", study("ppo", fork));
        let error = sandbox.fails(2, "study s.yaml");
        assert!(error.contains("s.yaml:6:") && error.contains(says), "{fork}: {error}");
    }
    sandbox.write("ppo.yaml", std::fs::read_to_string(sandbox.path("ppo.yaml")).expect("text") + "layer_norm: true\n");
    for tensor in ["scale", "shift"] {
        sandbox.write(
            "s.yaml",
            study("ppo", &format!("{{after: 0, treatments: {{x: {{scale: {{policy.0.{tensor}: 2}}}}}}}}")),
        );
        let error = sandbox.fails(2, "study s.yaml");
        let says = format!(
            "s.yaml:6:47: scale: policy.0.{tensor} is neither weight nor bias: scale policy.0, policy.0.weight or policy.0.bias"
        );
        assert!(error.contains(&says), "{error}");
    }
    sandbox.write("s.yaml", study("ppo", "{after: 0, treatments: {none: {}}}").replace("curriculum", "from scratch"));
    let error = sandbox.fails(2, "study s.yaml");
    assert!(error.contains("the arm has no curriculum to go on from"), "{error}");
    assert!(!sandbox.path("runs").exists());

    sandbox.succeeds("curriculum --config ppo.yaml --levels a.yaml,b.yaml --timesteps 64");
    sandbox.succeeds("train --config ppo.yaml --level a.yaml --timesteps 64");
    let parent = "runs/curriculum/ppo/curriculum/seed-0";
    let cases = [
        (
            format!("fork {parent} --after 1 --treatment {{}}"),
            "needs 3 stages, and the run has 2: the two together can be at most 1",
        ),
        (format!("fork {parent} --after 0 --treatment {{"), "--treatment:1"),
        (format!("fork {parent} --after 0 --treatment warm"), "expected a mapping"),
        ("fork runs/train/ppo/level-a/seed-0 --after 0 --treatment {}".to_owned(), "the run has one stage"),
        ("fork runs/train --after 0 --treatment {}".to_owned(), "the run has one stage"),
        ("fork nowhere --after 0 --treatment {}".to_owned(), "cannot list nowhere"),
        (format!("fork {parent} --after 0 --treatment {{}} --treatment {{}}"), "two of these forks would lie there"),
    ];
    for (command, says) in cases {
        let error = sandbox.fails(2, &command);
        assert!(error.contains(says), "{command}: {error}");
    }
    assert!(!sandbox.path("runs/fork").exists());
}

#[test]
fn a_fork_may_have_timesteps_of_its_own() {
    let sandbox = Sandbox::new();
    sandbox.write("s.yaml", study("ppo", "{after: 0, timesteps: 128, treatments: {none: {}}}"));
    sandbox.succeeds("study s.yaml --seeds 0");
    sandbox.succeeds(
        r#"fork runs/s --after 1 --timesteps 64 --treatment {} --treatment {"halved":{"scale":{"policy":0.5}}}"#,
    );
    assert_eq!(sandbox.run("fork/ppo/curriculum+after-1+halved/seed-0").manifest()["fork"]["name"], "halved");
    let timesteps = |run: RunFiles| {
        let stages = run.manifest()["stages"].clone();
        let of_stage = |stage: &Value| stage["timesteps"].as_u64().expect("a number");
        stages.as_array().expect("stages").iter().map(of_stage).collect::<Vec<_>>()
    };
    assert_eq!(timesteps(sandbox.run("s/ppo/curriculum+after-0+none/seed-0")), [256, 128]);
    assert_eq!(timesteps(sandbox.run("fork/ppo/curriculum+after-1+none/seed-0")), [256, 256, 64]);
    // What is said for everything counts for forks, too.
    sandbox.succeeds("study s.yaml --seeds 1 --timesteps 192");
    assert_eq!(timesteps(sandbox.run("s/ppo/curriculum+after-0+none/seed-1")), [192, 192]);
}

#[test]
fn a_fork_without_its_parents_stage_says_what_is_missing() {
    let sandbox = Sandbox::new();
    sandbox.write("s.yaml", study("ppo", "{after: 0, treatments: {none: {}}}"));
    sandbox.succeeds("study s.yaml --seeds 0");
    let gone = sandbox.path("runs/s/ppo/curriculum+after-0+none");
    std::fs::remove_dir_all(gone).expect("writable");
    let checkpoint = sandbox.path("runs/s/ppo/curriculum/seed-0/checkpoints/stage-0.safetensors");
    std::fs::remove_file(checkpoint).expect("writable");
    let error = sandbox.fails(2, "study s.yaml --seeds 0 --resume");
    assert!(error.contains("nothing to go on from") && error.contains("stage-0.safetensors"), "{error}");
    assert!(error.contains("train the parent, runs/s/ppo/curriculum/seed-0"), "{error}");
}
