//! Stopped and resumed, a run ends with the same bytes.

use std::fs::{self, File};
use std::os::unix::process::ExitStatusExt;
use std::sync::Arc;

use coverage_env::Level;
use coverage_env::random::below;
use cpp_rl::agent::config;
use cpp_rl::agent::engine::EngineKind;
use cpp_rl::agent::network::{Layout, Network};
use cpp_rl::agent::state::AgentState;
use cpp_rl::agent::{self, Stage};
use cpp_rl::random::{Purpose, Stream};
use cpp_rl::run::checkpoint::Checkpoint;
use rustix::process::Signal;

use crate::sandbox::{PROGRAM, RunFiles, Sandbox, engines, has_libtorch};
use crate::stops::{Training, command, command_of, runs, snapshots, stop_within, undisturbed};

/// Right after a snapshot of one seed, which finds the other anywhere; with another number of threads each time, and with
/// one seed or both.
#[test]
fn killed_at_the_nth_snapshot_and_resumed_it_ends_the_same() {
    let mut random = Stream::new(1, 0, Purpose::EvaluationStarts);
    // So few that 8 kills come before the end: PPO saves each seed some 170 times here, DQN 45 times.
    for (algo, at_most) in [("ppo", 10), ("ppo-l2", 10), ("dqn", 3)] {
        let sandbox = Sandbox::new();
        let expected = undisturbed(&sandbox, algo);
        for _ in 0..8 {
            let seeds = ["--seeds 0..2", "--seeds 1", "--seeds 0..2"][below(&mut random, 3) as usize];
            let options = format!("--resume --verbose --jobs {} {seeds}", 1 + below(&mut random, 3));
            let mut training = Training::begin(&sandbox, &format!("{} {options}", command(algo, "killed")));
            for _ in 0..=below(&mut random, at_most) {
                training.next_save_of_any();
            }
            // Which no process can put off.
            training.send(Signal::KILL);
            assert_eq!(training.output().status.signal(), Some(9), "it ended too early");
        }
        sandbox.succeeds(&format!("{} --seeds 0..2 --resume --jobs 2", command(algo, "killed")));
        for (run, expected) in runs(&sandbox, algo, "killed").iter().zip(&expected) {
            run.reproducible().assert_same(expected);
            let left = run.files();
            assert!(!left.iter().any(|file| file.contains("latest/") || file.ends_with(".partial")), "{left:?}");
        }
        let [killed, whole] = ["killed", "undisturbed"].map(|out| runs(&sandbox, algo, out));
        for (killed, whole) in killed.iter().zip(&whole) {
            assert_eq!(killed.text("plasticity.csv"), whole.text("plasticity.csv"));
        }
    }
}

#[test]
fn a_stopped_run_goes_on_in_the_midst_of_its_stage() {
    // Seeds in one tensor differ by rounding in other company, which is the same here.
    for &engine in engines() {
        let timesteps = if engine == "fused" { 30_000 } else { 3000 };
        let sandbox = Sandbox::new();
        let command =
            |out| format!("{} --seeds 0..2 --jobs 1 --set engine={engine}", command_of("ppo", out, timesteps));
        sandbox.succeeds(&command("undisturbed"));
        stop_within(&sandbox, &command("stopped"), &runs(&sandbox, "ppo", "stopped")[0], Signal::TERM);
        let printed = sandbox.succeeds(&format!("{} --resume", command("stopped")));
        assert!(printed.stderr.contains("seed 0 goes on after"), "{}", printed.stderr);
        for (run, expected) in runs(&sandbox, "ppo", "stopped").iter().zip(&runs(&sandbox, "ppo", "undisturbed")) {
            run.reproducible().assert_same(&expected.reproducible());
        }
        let starts = runs(&sandbox, "ppo", "stopped")[0].manifest()["starts"].clone();
        let timesteps: Vec<u64> =
            starts.as_array().expect("a list").iter().filter_map(|s| s["timesteps"].as_u64()).collect();
        assert_eq!((timesteps.len(), timesteps[0]), (2, 0));
        assert!(timesteps[1] > 0 && starts[1]["instruction_set"].is_string(), "{starts}");
    }
}

/// What an L2 penalty measures over a stage survives as well.
#[test]
fn the_dose_of_a_stopped_run_is_that_of_the_whole_stage() {
    let sandbox = Sandbox::new();
    let [command, whole] =
        ["stopped", "whole"].map(|out| format!("{} --seeds 0 --set l2=adam --set l2_coef=1e-3", command("ppo", out)));
    sandbox.succeeds(&whole);
    let run = |out| runs(&sandbox, "ppo", out).into_iter().next().expect("two");
    stop_within(&sandbox, &command, &run("stopped"), Signal::TERM);
    sandbox.succeeds(&format!("{command} --resume"));
    assert_eq!(run("stopped").manifest()["dose"], run("whole").manifest()["dose"]);
    run("stopped").reproducible().assert_same(&run("whole").reproducible());
}

#[test]
fn an_extended_training_goes_on_from_its_end() {
    let sandbox = Sandbox::new();
    let train = |out: &str, timesteps: u32, options: &str| {
        let command = format!("train --config ppo.yaml --level c.yaml --timesteps {timesteps} --out {out} {options}");
        sandbox.succeeds(&command);
        RunFiles(sandbox.path(out).join("ppo/level-c/seed-0"))
    };
    train("extended", 256, "");
    train("extended", 320, "--resume");
    let extended = train("extended", 640, "--resume");
    assert_eq!(snapshots(&extended), ["640.safetensors"]);
    // PPO has no schedule, so that no difference is left.
    extended.reproducible().assert_same(&train("whole", 640, "").reproducible());
    let manifest = extended.manifest();
    assert_eq!((&manifest["stages"][0]["horizon"], &manifest["stages"][0]["timesteps"]), (&256.into(), &640.into()));
    assert_eq!(manifest["config"]["timesteps"], 640);

    let shorter = "train --config ppo.yaml --level c.yaml --timesteps 256 --out extended --resume";
    assert!(sandbox.fails(2, shorter).contains("timesteps: 640 → 256"));
    let latest = extended.0.join("checkpoints/latest");
    fs::remove_dir_all(&latest).expect("writable");
    let error = sandbox.fails(2, &shorter.replace("256", "1024"));
    assert!(error.contains("cannot be extended") && error.contains("--out"), "{error}");
}

#[test]
fn an_extended_training_keeps_the_horizon_of_its_schedules() {
    let sandbox = Sandbox::new();
    let train = "train --config dqn.yaml --level c.yaml --set exploration_fraction=1 --set exploration_final_eps=0";
    sandbox.succeeds(&format!("{train} --timesteps 3000"));
    sandbox.succeeds(&format!("{train} --timesteps 6000 --resume"));
    let run = sandbox.run("train/dqn/level-c/seed-0");

    let config = config::resolve(None, Some(&run.0.join("config.yaml")), &[], None).expect("a run's settings");
    let level = Level::resolve(&sandbox.path("c.yaml").display().to_string()).expect("a level");
    let stage = Stage { index: 0, level: Arc::new(level), timesteps: 6000, horizon: 3000 };
    let mut learner = agent::learner(&config, &stage, vec![config.agent(&stage.level, 0)], EngineKind::Fused);
    while learner.timesteps() < stage.timesteps {
        learner.advance();
    }
    let checkpoint = Checkpoint::read(&run.0.join("checkpoints/stage-0.safetensors")).expect("a checkpoint");
    assert!(checkpoint.agent == *learner.agents()[0], "the agents differ");
    let rates: Vec<String> = run
        .progress()
        .into_iter()
        .flatten()
        .filter(|(name, _)| name.contains("exploration"))
        .map(|(_, value)| value)
        .collect();
    assert_eq!(rates[1..], ["0", "0", "0"], "after 3000, 4096 and 6000 timesteps");
}

#[test]
fn seeds_at_different_stages_go_on_together() {
    let sandbox = Sandbox::new();
    for &engine in engines() {
        let command = format!("{} --seeds 0..2 --set engine={engine} --jobs 1", command_of("ppo", engine, 256));
        sandbox.succeeds(&command);
        let runs = runs(&sandbox, "ppo", engine);
        let expected = [runs[0].reproducible(), runs[1].reproducible()];
        runs[0].unfinish(1);
        runs[1].unfinish(2);
        let printed = sandbox.succeeds(&format!("{command} --resume"));
        // Stacked seeds advance alone here: their numbers differ by rounding, as with any other company.
        assert_eq!(printed.stderr.contains("the others stand elsewhere"), engine == "libtorch", "{}", printed.stderr);
        if engine == "fused" {
            runs.iter().zip(&expected).for_each(|(run, expected)| run.reproducible().assert_same(expected));
        }
        assert!(runs.iter().all(|run| run.manifest()["stages_done"] == 3));
    }
}

/// Stacked seeds all have files open, more than the limit that can be raised; others have not.
#[test]
fn many_seeds_find_their_files() {
    let sandbox = Sandbox::new();
    for &engine in engines() {
        let limit = if engine == "fused" { "ulimit -n 32" } else { "ulimit -S -n 64" };
        let script = format!("{limit}; exec {PROGRAM} \"$@\"");
        let options = format!("--seeds 0..40 --jobs 2 --set engine={engine} --out {engine}");
        let words = format!("train --config ppo.yaml --level a.yaml --timesteps 64 {options}");
        let mut command = std::process::Command::new("sh");
        command.args(["-c", &script, "sh"]).args(words.split(' ')).current_dir(sandbox.path("."));
        let output = command.output().expect("there is a shell");
        assert!(output.status.success(), "{engine}: {}", String::from_utf8_lossy(&output.stderr));
    }
}

const SHORT: &str = "curriculum --config ppo.yaml --levels a.yaml,b.yaml";
const RUN: &str = "curriculum/ppo/curriculum/seed-0";

#[test]
fn a_finished_run_stays_as_it_is() {
    let sandbox = Sandbox::new();
    let first = sandbox.succeeds(SHORT);
    let (run, manifest) = (sandbox.run(RUN), sandbox.run(RUN).text("manifest.json"));
    let before = run.reproducible();
    let again = sandbox.succeeds(&format!("{SHORT} --resume"));
    assert_eq!(again.stdout, first.stdout);
    assert!(again.stderr.contains("1 of 1 seeds finished"), "{}", again.stderr);
    run.reproducible().assert_same(&before);
    assert_eq!(run.text("manifest.json"), manifest);
}

#[test]
fn other_settings_are_refused_by_name() {
    let sandbox = Sandbox::new();
    sandbox.succeeds(SHORT);
    let before = sandbox.run(RUN).reproducible();
    let mut refusals = vec![
        ("--set gamma=0.5 --set clip_range=0.3", vec!["gamma: 0.99 → 0.5", "clip_range: 0.2 → 0.3"]),
        ("--timesteps 512", vec!["timesteps: 256 → 512", "stages: a × 256, b × 256 → a × 512, b × 512"]),
        ("--levels b.yaml,a.yaml", vec!["stages: a × 256, b × 256 → b × 256, a × 256"]),
    ];
    if has_libtorch() {
        refusals.push(("--set engine=libtorch", vec!["engine: fused → libtorch"]));
    }
    for (options, differences) in refusals {
        let levels = if options.contains("--levels") { "" } else { "--levels a.yaml,b.yaml" };
        let error = sandbox.fails(2, &format!("curriculum --config ppo.yaml {levels} --resume {options}"));
        assert!(differences.iter().all(|difference| error.contains(difference)), "{error}");
        assert!(error.contains("--out") && error.contains("seed-0"), "{error}");
    }
    // A run that was moved is still that of its seed.
    let moved = sandbox.run(&RUN.replace("seed-0", "seed-7"));
    fs::rename(&sandbox.run(RUN).0, &moved.0).expect("writable");
    let error = sandbox.fails(2, &format!("{SHORT} --seeds 7 --resume"));
    assert!(error.contains("seed: 0 → 7"), "{error}");
    fs::rename(&moved.0, &sandbox.run(RUN).0).expect("writable");
    let map = fs::read_to_string(sandbox.path("b.yaml")).expect("text").replace("..#T", "...T");
    sandbox.write("b.yaml", map);
    assert!(sandbox.fails(2, &format!("{SHORT} --resume")).contains("a map has changed"));
    sandbox.run(RUN).reproducible().assert_same(&before);
}

/// Seventeen digits, which a reader of JSON that rounds reads as another number.
#[test]
fn settings_are_read_back_to_the_last_bit() {
    let sandbox = Sandbox::new();
    let command = format!("{SHORT} --set learning_rate=0.0022459276771779678");
    sandbox.succeeds(&command);
    sandbox.run(RUN).unfinish(1);
    sandbox.succeeds(&format!("{command} --resume"));
}

#[test]
fn a_damaged_run_is_refused_in_words() {
    let sandbox = Sandbox::new();
    sandbox.succeeds(SHORT);
    let run = sandbox.run(RUN);
    run.unfinish(1);
    let resume = format!("{SHORT} --resume");
    let path = run.0.join("checkpoints/stage-0.safetensors");
    let whole = fs::read(&path).expect("a checkpoint");

    let mut changed = whole.clone();
    *changed.last_mut().expect("not empty") ^= 1;
    fs::write(&path, &changed).expect("writable");
    let error = sandbox.fails(2, &resume);
    assert!(error.contains("stage-0.safetensors") && error.contains("checksum"), "{error}");
    assert!(error.contains("put it back") && error.contains("--out"), "{error}");

    fs::write(&path, &whole[..whole.len() / 2]).expect("writable");
    let error = sandbox.fails(2, &resume);
    assert!(error.contains("stage-0.safetensors") && error.contains("cut short"), "{error}");

    fs::remove_file(&path).expect("writable");
    let error = sandbox.fails(2, &resume);
    assert!(error.contains("stage-0.safetensors") && error.contains("cannot read the checkpoint"), "{error}");

    fs::write(&path, &whole).expect("writable");
    fs::write(run.0.join("manifest.json"), "{").expect("writable");
    let error = sandbox.fails(2, &resume);
    assert!(error.contains("manifest.json is not a manifest"), "{error}");
}

/// Seeds that are computed with another one do not fail with it.
#[test]
fn a_checkpoint_of_another_network_fails_its_own_seed_alone() {
    if !has_libtorch() {
        return; // The other engine trains each seed alone.
    }
    let sandbox = Sandbox::new();
    let command = format!("{SHORT} --set engine=libtorch --seeds 0..2 --jobs 1");
    sandbox.succeeds(&command);
    let runs = ["seed-0", "seed-1"].map(|seed| sandbox.run(&RUN.replace("seed-0", seed)));
    runs.iter().for_each(|run| run.unfinish(1));
    let path = runs[1].0.join("checkpoints/stage-0.safetensors");
    let mut checkpoint = Checkpoint::read(&path).expect("a checkpoint");
    let network = &checkpoint.network;
    let layout = Layout { hidden: vec![3], ..network.layout().clone() };
    checkpoint.network = Network::new(layout, checkpoint.algorithm.heads());
    checkpoint.agent = AgentState::new(&checkpoint.network, 1, &[]);
    checkpoint.write(&path).expect("writable");
    let error = sandbox.fails(2, &format!("{command} --resume"));
    assert!(
        error.contains(
            "stage-0.safetensors: not a checkpoint of this seed, stage and level that fits the run; put it back"
        ),
        "{error}"
    );
    assert_eq!(runs.map(|run| run.manifest()["stages_done"].clone()), [2, 1]);
}

#[test]
fn a_run_that_another_process_writes_is_refused() {
    let sandbox = Sandbox::new();
    sandbox.succeeds(SHORT);
    let run = sandbox.run(RUN);
    run.unfinish(1);
    let lock = File::options().write(true).open(run.0.join(".lock")).expect("a run has a lock");
    lock.lock().expect("nobody holds it");
    let error = sandbox.fails(75, &format!("{SHORT} --resume"));
    assert!(error.contains("seed-0 is being written by another process") && error.contains("--out"), "{error}");
    drop(lock);
    sandbox.succeeds(&format!("{SHORT} --resume"));
}

/// Whatever a mitigation keeps is read back from the run's files.
#[test]
fn a_mitigated_run_is_stopped_and_goes_on() {
    for algo in ["ppo", "dqn"] {
        let recycling = if algo == "ppo" { "continual-backprop" } else { "self-normalised-resets" };
        let keeping = format!("l2-init,spectral,parseval,normalise-project,{recycling}");
        for mitigation in ["shrink-perturb,redo", &keeping, "churn"] {
            let sandbox = Sandbox::new();
            let own = if mitigation.ends_with("redo") { "--set redo_interval=7 --set redo_threshold=0.8" } else { "" };
            let command = |out| format!("{} --seeds 0..2 --set mitigations=[{mitigation}] {own}", command(algo, out));
            sandbox.succeeds(command("whole").trim());
            let [stopped, whole] = ["stopped", "whole"].map(|out| runs(&sandbox, algo, out));
            stop_within(&sandbox, command("stopped").trim(), &stopped[0], Signal::TERM);
            sandbox.succeeds(&format!("{} --resume", command("stopped").trim()));
            for (stopped, whole) in stopped.iter().zip(&whole) {
                stopped.reproducible().assert_same(&whole.reproducible());
            }
        }
    }
}
