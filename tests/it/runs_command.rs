//! What `cpp-rl runs` says of runs in every state.

use std::fs;
use std::process::Stdio;

use serde_json::{Value, json};

use crate::lines::{Lines, ended};
use crate::sandbox::Sandbox;
use crate::stops::Training;

/// The row of the run whose path ends so.
#[track_caller]
fn row(listing: &Value, path: &str) -> Value {
    let rows = listing["runs"].as_array().expect("a list");
    let found = rows.iter().find(|row| row["path"].as_str().is_some_and(|p| p.ends_with(path)));
    found.unwrap_or_else(|| panic!("{path} is not in {listing}")).clone()
}

/// Changes a run's manifest.
fn set_status(sandbox: &Sandbox, run: &str, status: Value) {
    let run = sandbox.run(run);
    let mut manifest = run.manifest();
    manifest["status"] = status;
    fs::write(run.0.join("manifest.json"), manifest.to_string()).expect("the run is writable");
}

#[test]
fn every_state_is_told() {
    let sandbox = Sandbox::new();
    sandbox.succeeds("curriculum --config ppo.yaml --levels a.yaml,b.yaml --seeds 0..5");
    let seed = |seed: u64| format!("curriculum/ppo/curriculum/seed-{seed}");
    set_status(&sandbox, &seed(1), json!({ "state": "failed", "why": "train/loss became NaN" }));
    set_status(&sandbox, &seed(2), json!({ "state": "interrupted" }));
    // Killed in the middle of its second stage, and in the middle of a row.
    sandbox.run(&seed(3)).unfinish(1);
    let log = sandbox.run(&seed(3)).text("progress.csv");
    let rows: Vec<&str> = log.split_inclusive('\n').collect();
    assert_eq!(rows.len(), 1 + 8);
    sandbox.write(&format!("runs/{}/progress.csv", seed(3)), rows[..1 + 6].concat() + "1,b,7");
    sandbox.write(&format!("runs/{}/manifest.json", seed(4)), "{\"short_name\": \"a web page's\"}");
    for folder in ["runs/notes/of/mine", "runs/curriculum/ppo/curriculum/seed-9"] {
        fs::create_dir_all(sandbox.path(folder)).expect("the folder is writable");
    }
    sandbox.write("runs/curriculum/ppo/curriculum/seed-9/.lock", "");

    let listing = sandbox.json("runs");
    assert_eq!(listing["runs"].as_array().expect("a list").len(), 7);
    let finished = row(&listing, &seed(0));
    assert_eq!((&finished["arm"], &finished["curriculum"]), (&json!("ppo"), &json!("curriculum")));
    assert_eq!(
        (&finished["seed"], &finished["status"], &finished["why"]),
        (&json!(0), &json!("finished"), &json!(null))
    );
    assert_eq!((&finished["stage"], &finished["stages"], &finished["progress"]), (&json!(1), &json!(2), &json!(1.0)));
    let last = sandbox.run(&seed(0)).progress().pop().expect("rows");
    let mean = last.into_iter().find(|(name, _)| name == "rollout/ep_rew_mean").expect("the column").1;
    assert_eq!(finished["mean_return"].as_f64(), mean.parse().ok());
    assert!(finished["timesteps_per_second"].as_f64().expect("a number") > 0.0);
    assert!((0.0..60.0).contains(&finished["age_seconds"].as_f64().expect("a number")));

    let failed = row(&listing, &seed(1));
    assert_eq!((&failed["status"], &failed["why"]), (&json!("failed"), &json!("train/loss became NaN")));
    assert_eq!(row(&listing, &seed(2))["status"], "interrupted");
    let killed = row(&listing, &seed(3));
    assert_eq!((&killed["status"], &killed["stage"], &killed["progress"]), (&json!("killed"), &json!(1), &json!(0.75)));
    let foreign = row(&listing, &seed(4));
    assert_eq!(foreign["status"], "unreadable");
    assert!(foreign["why"].as_str().is_some_and(|why| why.starts_with("manifest.json is not cpp-rl's: missing field")));
    assert_eq!(row(&listing, "runs/notes")["status"], "no run");
    assert_eq!(row(&listing, "seed-9")["status"], "not begun");

    let table = sandbox.succeeds("runs").stdout;
    assert!(
        table.contains("1 failed, 1 finished, 1 interrupted, 1 killed, 1 no run, 1 not begun, 1 unreadable"),
        "{table}"
    );
    assert!(table.contains(&format!("runs/{}: failed: train/loss became NaN", seed(1))), "{table}");
    assert!(table.lines().any(|line| line.contains("killed") && line.contains("2/2") && line.contains("75.0%")));
    assert_eq!(sandbox.succeeds("runs --format csv").stdout.lines().count(), 1 + 7);
}

#[test]
fn a_live_run_is_told_from_a_killed_one() {
    let sandbox = Sandbox::new();
    let training = "train --config ppo.yaml --level a.yaml --timesteps 1000000000 --checkpoint-updates 1 --verbose";
    let mut training = Training::begin(&sandbox, training);
    // An episode has 20 steps at most, and a rollout 64: whatever is saved, some have ended before.
    training.next_save_of_any();
    let live = sandbox.json("runs")["runs"][0].clone();
    assert!(live["mean_return"].is_number(), "{live}");
    assert_eq!((&live["status"], &live["stage"]), (&json!("running"), &json!(0)));
    assert!(live["progress"].as_f64().expect("a number") < 0.5);
    drop(training);
    assert_eq!(sandbox.json("runs")["runs"][0]["status"], "killed");
}

#[test]
fn watching_goes_on_until_nobody_reads() {
    let sandbox = Sandbox::new();
    sandbox.succeeds("train --config ppo.yaml --level a.yaml");
    let mut watch = sandbox.command("runs --watch 1").stdout(Stdio::piped()).spawn().expect("the program starts");
    let mut lines = Lines::of(watch.stdout.take().expect("a pipe"));
    for _ in 0..2 {
        let line = lines.wait_for(|line| line.contains("finished").then(|| line.to_owned()));
        assert!(!line.contains('\x1b'), "a log gets no control characters");
    }
    drop(lines);
    assert!(ended(watch).status.success(), "it ends once nobody reads");
}

#[test]
fn folders_without_runs() {
    let sandbox = Sandbox::new();
    let error = sandbox.fails(2, "runs");
    assert!(error.contains("cannot read the directory runs") && error.contains("--out"), "{error}");
    assert!(sandbox.fails(2, "runs --watch 0").contains("--watch"));
    fs::create_dir(sandbox.path("runs")).expect("the folder is writable");
    assert!(sandbox.succeeds("runs").stdout.contains("no runs"));
    assert_eq!(sandbox.json("runs"), json!({ "runs": [] }));
}
