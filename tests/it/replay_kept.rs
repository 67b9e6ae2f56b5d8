//! DQN's replay buffer, kept from one stage to the next.

use cpp_rl::agent::buffers::Buffers;
use cpp_rl::agent::state::AgentState;
use cpp_rl::run::checkpoint::Checkpoint;
use rustix::process::Signal;

use crate::sandbox::{RunFiles, Sandbox};
use crate::stops::{LONG, Training, stop_within};

/// The agent after a stage, and apart from it what it takes along.
fn agent(run: &RunFiles, stage: u16) -> (AgentState, Buffers) {
    let file = run.0.join(format!("checkpoints/stage-{stage}.safetensors"));
    let mut agent = Checkpoint::read(&file).expect("a checkpoint").agent;
    let buffers = std::mem::take(&mut agent.kept.buffers);
    (agent, buffers)
}

/// A study of two levels whose parent has these settings, with treatments after its first stage.
fn study(set: &str, treatments: &str) -> String {
    format!(
        "name: s\nlevels: [a.yaml, b.yaml]\narms:\n  - config: dqn.yaml\n    set: [{set}]\n    trains: [curriculum]\n    \
         fork: {{after: 0, treatments: {treatments}}}\n"
    )
}

#[test]
fn saving_the_buffer_changes_nothing_else() {
    let sandbox = Sandbox::new();
    let train = "curriculum --config dqn.yaml --levels a.yaml,b.yaml --seeds 0";
    sandbox.succeeds(&format!("{train} --out plain"));
    sandbox.succeeds(&format!("{train} --out saved --set replay_saved=true"));
    let [plain, saved] = ["plain", "saved"].map(|out| RunFiles(sandbox.path(&format!("{out}/dqn/curriculum/seed-0"))));
    for stage in 0..2 {
        let ((of_plain, none), (of_saved, buffers)) = (agent(&plain, stage), agent(&saved, stage));
        assert_eq!(of_plain, of_saved);
        assert!(none.is_empty());
        // All 100 that the buffer has room for, on maps of 48 inputs.
        assert_eq!(buffers.get("replay/inputs").map(|buffer| &buffer.shape[..]), Some(&[100, 2, 1][..]));
    }
    assert_eq!(plain.progress(), saved.progress());
    assert_eq!(plain.text("evaluations.csv"), saved.text("evaluations.csv"));
}

#[test]
fn a_fork_that_keeps_the_buffer_is_a_curriculum_that_does() {
    let sandbox = Sandbox::new();
    let kept = "set: [replay_kept=true]";
    let treatments = format!("{{none: {{}}, kept: {{{kept}}}, new: {{weights: fresh, optimizer: fresh, {kept}}}}}");
    sandbox.write("s.yaml", study("replay_saved=true", &treatments));
    sandbox.succeeds("study s.yaml --seeds 0..2 --jobs 2");
    sandbox.succeeds("curriculum --config dqn.yaml --levels a.yaml,b.yaml --seeds 1 --set replay_kept=true");
    let run = |name: &str| sandbox.run(&format!("s/dqn/{name}/seed-1"));
    let whole = sandbox.run("curriculum/dqn/curriculum/seed-1");
    let stage = |run: &RunFiles, stage: u16| run.bytes(&format!("checkpoints/stage-{stage}.safetensors"));
    let (parent, fork) = (run("curriculum"), run("curriculum+after-0+kept"));
    assert!(stage(&whole, 0) == stage(&parent, 0), "the first stage has nothing to keep");
    assert!(stage(&whole, 1) == stage(&fork, 1));
    assert!(stage(&run("curriculum+after-0+none"), 1) == stage(&parent, 1));
    let parameters = |name: &str| agent(&run(name), 1).0.parameters;
    let different = ["curriculum", "curriculum+after-0+kept", "curriculum+after-0+new"].map(parameters);
    assert!(different[0] != different[1] && different[1] != different[2] && different[0] != different[2]);
}

#[test]
fn a_kept_buffer_survives_a_kill() {
    let sandbox = Sandbox::new();
    // It is full in the midst of the second stage, so that transitions of two and three levels are sampled together.
    let options = "--levels a.yaml,b.yaml,c.yaml --seeds 0 --set buffer_size=50000 --set replay_saved=true";
    sandbox.succeeds(&format!("curriculum --config dqn.yaml {options} --timesteps {LONG} --out parents"));
    let fork = |out: &str| {
        let options =
            r#"--after 0 --stages 2 --treatment {"kept":{"set":["replay_kept=true"]}} --checkpoint-updates 1"#;
        let run = format!("{out}/dqn/curriculum+after-0+kept/seed-0");
        (format!("fork parents {options} --out {out}"), RunFiles(sandbox.path(&run)))
    };
    let (whole, expected) = fork("whole");
    sandbox.succeeds(&whole);
    for (out, signal) in [("stopped", Signal::TERM), ("killed", Signal::KILL)] {
        let (stopped, run) = fork(out);
        if signal == Signal::TERM {
            stop_within(&sandbox, &stopped, &run, signal);
        } else {
            let mut training = Training::begin(&sandbox, &format!("{stopped} --verbose"));
            // In the second of its stages.
            while training.next_save(&run) < u64::from(2 * LONG) + 1000 {}
            training.send(signal);
            training.output();
        }
        sandbox.succeeds(&format!("{stopped} --resume"));
        run.reproducible().assert_same(&expected.reproducible());
    }
}

#[test]
fn a_parent_without_a_buffer_is_refused_before_anything_is_trained() {
    let sandbox = Sandbox::new();
    let says =
        "set: replay_kept: the parent's checkpoints hold no replay buffer: train the parent with replay_saved=true";
    let treatments = "{kept: {set: [replay_kept=true]}}";
    sandbox.write("s.yaml", study("gamma=0.9", treatments));
    let error = sandbox.fails(2, "study s.yaml --seeds 0");
    assert!(error.contains(&format!("s.yaml:7:47: {says}")), "{error}");
    assert!(!sandbox.path("runs").exists());

    let train = "curriculum --config dqn.yaml --levels a.yaml,b.yaml --seeds 0";
    sandbox.succeeds(&format!("{train} --out plain"));
    sandbox.succeeds(&format!("{train} --out saved --set replay_saved=true"));
    let fork = |parents: &str| {
        format!(
            r#"fork {parents} --after 0 --treatment {{"kept":{{"set":["replay_kept=true"]}}}} --out {parents}-kept"#
        )
    };
    let error = sandbox.fails(2, &fork("plain"));
    assert!(error.contains(&format!("--treatment:1:16: {says}")), "{error}");

    // Its settings say that it has saved the buffer, but somebody has put another file there.
    let file = |out: &str| sandbox.path(&format!("{out}/dqn/curriculum/seed-0/checkpoints/stage-0.safetensors"));
    std::fs::copy(file("plain"), file("saved")).expect("writable");
    let error = sandbox.fails(2, &fork("saved"));
    assert!(error.contains("stage-0.safetensors: it holds no replay buffer"), "{error}");
    assert!(!sandbox.path("plain-kept").exists());
}
