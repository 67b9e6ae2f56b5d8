//! A study: many experiments from one queue.

use std::collections::BTreeSet;
use std::fs;
use std::process::Command;

use rustix::process::Signal;
use serde_json::json;

use crate::sandbox::{RunFiles, Sandbox};
use crate::stops::Training;

/// Two arms, one of them trained in both ways.
const STUDY: &str = "
name: tiny
levels: [a.yaml, b.yaml]
arms:
  - {config: ppo.yaml, trains: [curriculum, from scratch]}
  - {config: dqn.yaml, trains: [from scratch]}
";

/// Its experiments.
const EXPERIMENTS: [&str; 5] = ["ppo/curriculum", "ppo/level-a", "ppo/level-b", "dqn/level-a", "dqn/level-b"];

fn sandbox() -> Sandbox {
    let sandbox = Sandbox::new();
    sandbox.write("study.yaml", STUDY);
    sandbox
}

#[test]
fn every_run_is_what_it_is_alone() {
    let sandbox = sandbox();
    let command = "study study.yaml --seeds 0,1 --jobs 3";
    let stderr = sandbox.succeeds(command).stderr;
    assert!(stderr.contains("tiny: 10 runs of 5 experiments, 3072 timesteps to go"), "{stderr}");
    sandbox.succeeds("curriculum --config ppo.yaml --levels a.yaml,b.yaml --seeds 0,1 --out alone");
    for (algo, level) in [("ppo", "a"), ("ppo", "b"), ("dqn", "a"), ("dqn", "b")] {
        sandbox.succeeds(&format!("train --config {algo}.yaml --level {level}.yaml --seeds 0,1 --out alone"));
    }
    for experiment in EXPERIMENTS {
        assert!(stderr.contains(&format!("2 of 2 seeds finished in runs/tiny/{experiment}\n")), "{stderr}");
        for seed in [0, 1] {
            let run = |out: &str| RunFiles(sandbox.path(out).join(experiment).join(format!("seed-{seed}")));
            run("runs/tiny").reproducible().assert_same(&run("alone").reproducible());
        }
    }

    assert!(sandbox.fails(2, command).contains("--resume"));
    let again = sandbox.succeeds(&format!("{command} --resume")).stderr;
    assert!(again.contains("0 timesteps to go") && again.contains("nothing is left"), "{again}");
    let more = sandbox.succeeds("study study.yaml --num-seeds 3 --resume").stderr;
    assert!(more.contains("1536 timesteps to go"), "{more}");
    assert!(more.contains("3 of 3 seeds finished in runs/tiny/dqn/level-b\n"), "{more}");
}

#[test]
fn a_signal_saves_the_seeds_of_all_experiments() {
    let sandbox = Sandbox::new();
    let levels = ["a", "b", "c"];
    let files = "[a.yaml, b.yaml, c.yaml]";
    sandbox.write(
        "study.yaml",
        format!("name: long\nlevels: {files}\narms: [{{config: ppo.yaml, trains: [from scratch]}}]\n"),
    );
    let [a, b, c] = levels.map(|level| sandbox.run(&format!("long/ppo/level-{level}/seed-0")));
    let options = "--seeds 0 --timesteps 30000";
    let command = format!("study study.yaml {options} --checkpoint-updates 8 --jobs 2");
    let mut training = Training::begin(&sandbox, &format!("{command} --verbose"));
    // There is one seed: two threads have work only where they take it from two experiments.
    let mut saved = BTreeSet::new();
    while saved.len() < 2 {
        saved.insert(training.next_save_of_any().0);
    }
    training.send(Signal::TERM);
    let output = training.output();
    let stderr = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(130), "{stderr}");
    assert!(stderr.contains("2 seeds saved in runs/long, 1 not begun"), "{stderr}");
    for run in [&a, &b] {
        assert_eq!(run.manifest()["status"], json!({ "state": "interrupted" }));
    }
    assert!(!c.0.exists(), "a run that waits is not begun");

    let (_, line) = stderr.split_once("go on with\n").expect("the command line");
    let again = Command::new("sh").args(["-c", line.trim()]).current_dir(sandbox.path(".")).output();
    assert!(again.expect("there is a shell").status.success(), "{line}");
    for (run, level) in [a, b, c].iter().zip(levels) {
        sandbox.succeeds(&format!("train --config ppo.yaml --level {level}.yaml {options} --out alone"));
        let alone = RunFiles(sandbox.path("alone").join(format!("ppo/level-{level}/seed-0")));
        run.reproducible().assert_same(&alone.reproducible());
    }
}

#[test]
fn a_seed_that_fails_keeps_no_other_from_training() {
    let sandbox = sandbox();
    // A folder stands where a file of one run is to be.
    let run = sandbox.path("runs/tiny/ppo/level-a/seed-0");
    fs::create_dir_all(run.join("evaluations.csv.partial/occupied")).expect("writable");
    let error = sandbox.fails(1, "study study.yaml --seeds 0,1 --jobs 2");
    assert!(error.contains("error: 1 seed failed:\n  ppo, level-a, seed 0: cannot write"), "{error}");
    for experiment in EXPERIMENTS {
        let finished = if experiment == "ppo/level-a" { 1 } else { 2 };
        let line = format!("{finished} of 2 seeds finished in runs/tiny/{experiment}\n");
        assert!(error.contains(&line), "{line} is not in\n{error}");
    }
}

#[test]
fn an_estimate_trains_nothing() {
    let sandbox = sandbox();
    let stdout = sandbox.succeeds("study study.yaml --num-seeds 1 --jobs 3 --estimate").stdout;
    assert!(stdout.contains("tiny: 5 runs of 5 experiments, 1536 timesteps to go: about "), "{stdout}");
    assert!(stdout.contains("on 3 threads") && stdout.contains("dqn ") && stdout.contains("ppo "), "{stdout}");
    assert!(!sandbox.path("runs").exists());
}
