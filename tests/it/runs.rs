//! Training as a user starts it: the run directory, and what makes a run reproducible.

use std::fs;
use std::path::Path;

use cpp_rl::run::checkpoint::Checkpoint;
use serde_json::{Value, json};

use crate::sandbox::{PROGRAM, RunFiles, Sandbox, engines, has_libtorch};

const CURRICULUM: &str = "curriculum --config ppo.yaml --levels a.yaml,b.yaml";

#[test]
fn a_run_has_the_files_of_the_design() {
    let sandbox = Sandbox::new();
    sandbox.succeeds(&format!("{CURRICULUM} --seeds 3"));
    let run = sandbox.run("curriculum/ppo/curriculum/seed-3");
    let expected = [
        "checkpoints/stage-0.safetensors",
        "checkpoints/stage-1.safetensors",
        "config.yaml",
        "evaluations.csv",
        "manifest.json",
        "progress.csv",
    ];
    let files = run.files();
    assert!(expected.iter().all(|name| files.iter().any(|file| file == name)), "{files:?}");
    assert!(!files.iter().any(|file| file.ends_with(".partial")), "{files:?}");

    let manifest = run.manifest();
    let fixed = [
        ("status", json!({ "state": "finished" })),
        ("arm", json!("ppo")),
        ("curriculum", json!("curriculum")),
        ("seed", json!(3)),
        ("stages_done", json!(2)),
        ("levels", json!(["a", "b"])),
        ("format", json!(2)),
        ("engine", json!("fused")),
        ("device", json!("cpu")),
    ];
    for (key, value) in fixed {
        assert_eq!(manifest[key], value, "{key}");
    }
    assert_eq!(manifest["stages"][1], json!({ "level": "b", "map": "T...\n..#.\n..#T\n", "timesteps": 256 }));
    assert_eq!(manifest["config"]["n_steps"], json!(64));
    for key in ["versions", "host", "command", "started", "updated", "seconds"] {
        assert!(!manifest[key].is_null(), "{key}");
    }
}

#[test]
fn evaluations_cover_every_start_before_the_first_stage_and_after_each() {
    let sandbox = Sandbox::new();
    sandbox.succeeds(CURRICULUM);
    let text = sandbox.run("curriculum/ppo/curriculum/seed-0").text("evaluations.csv");
    assert_eq!(text.lines().next(), Some("phase,stage,level,start,return,length,solved,policy"));
    let starts = |path: &str| {
        let list = sandbox.json(&format!("baseline astar --levels {path}"))["levels"][0]["episodes"].clone();
        let start = |episode: &Value| format!("{} {}", episode["start"][0], episode["start"][1]);
        list.as_array().expect("episodes").iter().map(start).collect::<Vec<_>>()
    };
    let levels = [("a", starts("a.yaml")), ("b", starts("b.yaml"))];
    let mut expected = Vec::new();
    for (phase, stage) in [("before", 0), ("after", 0), ("after", 1)] {
        for policy in ["greedy", "sampled"] {
            for (level, starts) in &levels {
                expected.extend(starts.iter().map(|start| format!("{phase},{stage},{level},{start},{policy}")));
            }
        }
    }
    let place = |line: &str| {
        let cells: Vec<&str> = line.split(',').collect();
        [&cells[..4], &cells[7..]].concat().join(",")
    };
    assert_eq!(text.lines().skip(1).map(place).collect::<Vec<_>>(), expected);
}

#[test]
fn progress_has_a_row_per_rollout_with_stable_baselines3s_names() {
    let sandbox = Sandbox::new();
    // 200 timesteps are rounded up to four rollouts of 64.
    sandbox.succeeds(&format!("{CURRICULUM} --timesteps 200"));
    let rows = sandbox.run("curriculum/ppo/curriculum/seed-0").progress();
    let column = |name: &str| {
        let of_row = |row: &Vec<(String, String)>| {
            row.iter().find(|(key, _)| key == name).unwrap_or_else(|| panic!("{name} is a column")).1.clone()
        };
        rows.iter().map(of_row).collect::<Vec<_>>()
    };
    assert_eq!(column("stage"), ["0", "0", "0", "0", "1", "1", "1", "1"]);
    assert_eq!(column("level"), ["a", "a", "a", "a", "b", "b", "b", "b"]);
    assert_eq!(column("time/total_timesteps"), ["64", "128", "192", "256", "64", "128", "192", "256"]);
    assert_eq!(column("cumulative_timesteps"), ["64", "128", "192", "256", "320", "384", "448", "512"]);
    assert_eq!(column("train/n_updates"), ["2", "4", "6", "8", "10", "12", "14", "16"]);
    for name in [
        "rollout/ep_rew_mean",
        "rollout/ep_len_mean",
        "train/approx_kl",
        "train/clip_fraction",
        "train/entropy_loss",
        "train/explained_variance",
        "train/loss",
        "train/policy_gradient_loss",
        "train/value_loss",
    ] {
        assert!(column(name).iter().all(|value| value.parse::<f64>().is_ok_and(f64::is_finite)), "{name}");
    }
}

#[test]
fn the_same_command_makes_the_same_bytes() {
    let sandbox = Sandbox::new();
    for algo in ["ppo", "dqn"] {
        let train = |out: &str, levels: &str| {
            sandbox.succeeds(&format!("curriculum --config {algo}.yaml --levels {levels} --seeds 1 --out {out}"));
            RunFiles(sandbox.path(out).join(algo).join("curriculum/seed-1")).reproducible()
        };
        let first = train("first", "a.yaml,b.yaml");
        first.assert_same(&train("second", "a.yaml,b.yaml"));
        let other = train("third", "b.yaml,a.yaml");
        assert!(first != other, "another curriculum is another run");
    }
}

#[test]
fn a_seed_is_the_same_whatever_trains_beside_it() {
    let sandbox = Sandbox::new();
    for algo in ["ppo", "dqn"] {
        let train = |out: &str, options: &str| {
            sandbox.succeeds(&format!("train --config {algo}.yaml --level c.yaml --out {out} {options}"));
            let run = |seed| RunFiles(sandbox.path(out).join(algo).join("level-c").join(format!("seed-{seed}")));
            [run(3).reproducible(), run(if options.contains("..") { 4 } else { 3 }).reproducible()]
        };
        let [alone, _] = train("alone", "--seeds 3");
        let [one_job, other] = train("one", "--seeds 0..5 --jobs 1");
        let [two_jobs, _] = train("two", "--seeds 0..5 --jobs 2");
        alone.assert_same(&one_job);
        alone.assert_same(&two_jobs);
        assert!(alone != other, "seeds differ");
    }
}

#[test]
fn both_engines_train_alike() {
    if !has_libtorch() {
        return;
    }
    let sandbox = Sandbox::new();
    for algo in ["ppo", "dqn"] {
        let train = |engine: &str| {
            let command = format!("train --config {algo}.yaml --level b.yaml --timesteps 128 --seeds 0..2 --jobs 1");
            sandbox.succeeds(&format!("{command} --set engine={engine} --out {engine}"));
            let run = RunFiles(sandbox.path(engine).join(algo).join("level-b/seed-1"));
            assert_eq!(run.manifest()["engine"], json!(engine));
            run.progress()
        };
        let (fused, libtorch) = (train("fused"), train("libtorch"));
        assert_eq!(fused.len(), libtorch.len());
        for ((name, fused), (_, libtorch)) in fused.iter().flatten().zip(libtorch.iter().flatten()) {
            let same = match (fused.parse::<f64>(), libtorch.parse::<f64>()) {
                // Rounding in another order, over eight (PPO) or 27 (DQN) updates that build on one another.
                (Ok(a), Ok(b)) => (a - b).abs() <= 1e-4 * b.abs() + 1e-5 || (a.is_nan() && b.is_nan()),
                _ => fused == libtorch,
            };
            assert!(same, "{name}: {fused} fused, {libtorch} with libtorch");
        }
    }
}

#[test]
fn a_runs_config_starts_the_same_run_again() {
    let sandbox = Sandbox::new();
    sandbox.succeeds("train --config ppo.yaml --level a.yaml --set gamma=0.9");
    let run = sandbox.run("train/ppo/level-a/seed-0");
    fs::write(sandbox.path("again.yaml"), run.text("config.yaml")).expect("writable");
    sandbox.succeeds("train --config again.yaml --level a.yaml --out again");
    let again = RunFiles(sandbox.path("again/ppo/level-a/seed-0"));
    assert_eq!(again.text("config.yaml"), run.text("config.yaml"));
    again.reproducible().assert_same(&run.reproducible());
}

#[test]
fn an_existing_run_is_not_overwritten() {
    let sandbox = Sandbox::new();
    let command = "train --config ppo.yaml --level a.yaml --seeds";
    sandbox.succeeds(&format!("{command} 1"));
    let before = sandbox.run("train/ppo/level-a/seed-1").reproducible();
    let error = sandbox.fails(2, &format!("{command} 0..3"));
    assert!(error.contains("seed-1") && error.contains("--resume") && error.contains("--out"), "{error}");
    assert!(!sandbox.path("runs/train/ppo/level-a/seed-0").exists(), "nothing is begun");
    before.assert_same(&sandbox.run("train/ppo/level-a/seed-1").reproducible());
}

#[test]
fn a_seed_that_diverges_stops_and_says_why() {
    let sandbox = Sandbox::new();
    for (algo, engine) in engines().iter().flat_map(|engine| [("ppo", engine), ("dqn", engine)]) {
        let settings = format!("--set learning_rate=1e30 --set engine={engine} --out {engine}");
        let error = sandbox.fails(1, &format!("train --config {algo}.yaml --level a.yaml {settings}"));
        assert!(error.contains("seed 0: train/") && error.contains("by timestep"), "{error}");
        let run = RunFiles(sandbox.path(engine).join(algo).join("level-a/seed-0"));
        assert_eq!(run.manifest()["status"]["state"], json!("failed"));
        assert_eq!(run.manifest()["stages_done"], json!(0));
        let events = run.bytes("tb/events.out.tfevents.0.cpp-rl");
        assert!(String::from_utf8_lossy(&events).contains("_hparams_/session_end_info"), "TensorBoard is told too");
    }
}

#[test]
fn a_seed_that_diverges_does_not_stop_the_others() {
    for engine in engines() {
        let sandbox = Sandbox::new();
        let command = format!("{CURRICULUM} --set engine={engine} --seeds 0..3 --jobs 1");
        sandbox.succeeds(&command);
        let runs = [0, 1, 2].map(|seed| sandbox.run(&format!("curriculum/ppo/curriculum/seed-{seed}")));
        let undisturbed = runs[2].reproducible();
        // As if they had been killed in the last stage, which seed 1 begins with a weight that is no number.
        runs.iter().for_each(|run| run.unfinish(1));
        spoil(&runs[1].0.join("checkpoints/stage-0.safetensors"));
        let error = sandbox.fails(1, &format!("{command} --resume"));
        let (_, failures) = error.split_once("error: 1 seed failed:").expect("one of three");
        assert!(failures.trim_start().starts_with("seed 1: train/loss became NaN by timestep 320"), "{error}");
        let kept = "the last good checkpoint is runs/curriculum/ppo/curriculum/seed-1/checkpoints/stage-0.safetensors";
        assert!(failures.contains("(update 10)") && failures.contains(kept), "{error}");
        undisturbed.assert_same(&runs[2].reproducible());
        assert_eq!(runs[1].manifest()["stages_done"], json!(1), "what was done is kept");
    }
}

/// Makes a weight of a checkpoint NaN.
fn spoil(path: &Path) {
    let mut checkpoint = Checkpoint::read(path).expect("a whole checkpoint");
    checkpoint.agent.parameters[0] = f32::NAN;
    checkpoint.write(path).expect("writable");
}

#[test]
fn dqn_may_learn_nothing_for_a_while_in_any_stage() {
    let sandbox = Sandbox::new();
    // More than one row of the log, of 2,048 timesteps, without an update.
    let settings = "--timesteps 5000 --set learning_starts=4500";
    sandbox.succeeds(&format!("curriculum --config dqn.yaml --levels a.yaml,b.yaml {settings}"));
    let run = sandbox.run("curriculum/dqn/curriculum/seed-0");
    assert_eq!(run.manifest()["stages_done"], json!(2));
}

#[test]
fn a_disk_that_takes_no_more_is_an_error() {
    let sandbox = Sandbox::new();
    // A folder stands where a file is to be: of one seed at its first evaluation, after which it alone stops.
    let command = "train --config ppo.yaml --level a.yaml --seeds 0..2";
    let run = sandbox.path("runs/train/ppo/level-a/seed-0");
    fs::create_dir_all(run.join("evaluations.csv.partial/occupied")).expect("writable");
    let error = sandbox.fails(1, command);
    assert!(error.contains("seed 0: cannot write") && error.contains("evaluations.csv"), "{error}");
    assert!(error.contains("1 of 2 seeds finished"), "{error}");
    // A file stands where a folder is to be.
    sandbox.write("file", "");
    let error = sandbox.fails(1, &format!("{command} --out file"));
    assert!(error.contains("cannot create the run's directory file/ppo/level-a/seed-0"), "{error}");
}

#[cfg(target_os = "linux")]
#[test]
fn a_file_that_cannot_grow_is_an_error() {
    let sandbox = Sandbox::new();
    // Files of at most 1 KiB (two blocks of 512 bytes): enough for the settings, not for the evaluations.
    let script = format!("trap '' XFSZ; ulimit -f 2; exec {} $0 \"$@\"", PROGRAM);
    let words = "train --config ppo.yaml --level a.yaml".split(' ');
    let output = std::process::Command::new("sh")
        .args(["-c", &script])
        .args(words)
        .current_dir(sandbox.path("."))
        .output()
        .expect("there is a shell");
    let stderr = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(1), "{stderr}");
    assert!(stderr.contains("cannot write") && !stderr.contains("panicked"), "{stderr}");
    let left = sandbox.run("train/ppo/level-a/seed-0").files();
    assert!(!left.iter().any(|file| file.ends_with(".partial")), "{left:?}");
}
