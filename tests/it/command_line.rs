//! What a user who errs is told.

use std::process::Command;

use crate::sandbox::{PROGRAM, Sandbox};

/// Each command fails with exit code 2 and names all of what follows it.
#[track_caller]
fn refused(cases: &[(&str, &[&str])]) {
    let sandbox = Sandbox::new();
    sandbox.write("unknown.yaml", "extends: ppo\nlearning_rat: 1e-3\n");
    sandbox.write("value.yaml", "extends: ppo\n\ngamma: high\n");
    sandbox.write("syntax.yaml", "extends: ppo\ngamma: [0.5\n");
    sandbox.write("twice.yaml", "extends: ppo\ngamma: 0.5\ngamma: 0.6\n");
    sandbox.write("text.yaml", "just some text\n");
    sandbox.write("preset.yaml", "extends: ppo-l3\n");
    sandbox.write("latin1.yaml", b"extends: ppo\nname: caf\xE9\n");
    sandbox.write("ragged.yaml", "map: |\n  ..T\n  .\n");
    sandbox.write("letter.yaml", "map: |\n  .T.\n  .x.\n");
    for (command, expected) in cases {
        let error = sandbox.fails(2, command);
        for part in *expected {
            assert!(error.contains(part), "{command}: {part:?} is not in\n{error}");
        }
    }
    assert!(!sandbox.path("runs").exists(), "nothing is begun");
}

#[test]
fn settings() {
    refused(&[
        (
            "train --level 0 --algo ppo --set learning_rat=1",
            &["--set learning_rat=1", "\"learning_rat\"", "did you mean \"learning_rate\"?"],
        ),
        (
            "train --level 0 --algo dqn --set n_steps=4",
            &["unknown key \"n_steps\" for algorithm dqn", "it is one of ppo"],
        ),
        (
            "train --level 0 --algo dqn --set buffer_size=2 --set num_envs=4",
            &["--set num_envs=4", "buffer_size: expected", "4 (num_envs) or more, got 2"],
        ),
        (
            "train --level 0 --algo ppo --set gamma=1.5",
            &["--set gamma=1.5", "gamma: expected a number from 0 to 1, got 1.5"],
        ),
        ("train --level 0 --algo ppo --set n_steps=0", &["n_steps: expected an integer from 1 to", "got 0"]),
        (
            "train --level 0 --algo ppo --set learning_rate=-1e-3",
            &["learning_rate: expected a number above 0, got -0.001"],
        ),
        ("train --level 0 --algo ppo --set hidden=64", &["hidden: expected a list of 0 to 8 integers", "got 64"]),
        ("train --level 0 --algo ppo --set l2=ridge", &["l2: expected one of none, adamw, adam, loss, got \"ridge\""]),
        ("train --level 0 --algo ppo --set l2_coef=1", &["--set l2_coef=1", "l2 is none", "l2=adamw"]),
        ("train --level 0 --algo ppo --set gamma", &["--set gamma", "expected key=value"]),
        ("train --level 0 --algo ppo --timesteps 0", &["timesteps: expected an integer from 1 to", "got 0"]),
        ("train --level 0 --algo ppo --set name=../up", &["name: expected", "\"../up\""]),
        ("train --level 0 --algo pop", &["--algo", "unknown preset \"pop\"", "did you mean \"ppo\"?", "ppo-l2-dohare"]),
        ("train --level 0", &["no algorithm chosen", "--algo", "ppo"]),
    ]);
}

#[test]
fn settings_in_files() {
    refused(&[
        (
            "train --level 0 --config unknown.yaml",
            &["unknown.yaml:2:", "\"learning_rat\"", "did you mean \"learning_rate\"?"],
        ),
        (
            "train --level 0 --config value.yaml",
            &["value.yaml:3:", "gamma: expected a number from 0 to 1, got \"high\""],
        ),
        ("train --level 0 --config syntax.yaml", &["syntax.yaml:", "not a list of `key: value` settings"]),
        ("train --level 0 --config twice.yaml", &["twice.yaml:3:1: ", "duplicate", "gamma"]),
        ("train --level 0 --config text.yaml", &["text.yaml:1:", "not a list of `key: value` settings"]),
        ("train --level 0 --config preset.yaml", &["preset.yaml:1:", "unknown preset \"ppo-l3\"", "ppo-l2"]),
        ("train --level 0 --config latin1.yaml", &["latin1.yaml", "UTF-8"]),
        ("train --level 0 --config absent.yaml", &["absent.yaml", "cannot read the config file"]),
        ("train --level 0 --algo dqn --config ppo.yaml", &["ppo.yaml:", "extends \"ppo\"", "--algo says \"dqn\""]),
    ]);
}

#[test]
fn levels() {
    refused(&[
        ("train --algo ppo --level 7", &["7", "level"]),
        ("baseline astar --levels 0..9", &["5", "level"]),
        ("baseline astar --levels 3..3", &["--levels", "\"3..3\" is an empty range"]),
        ("baseline astar --levels 0,,1", &["--levels", "\"0,,1\" names an empty level"]),
        ("baseline astar --levels absent.yaml", &["absent.yaml"]),
        ("baseline astar --levels ragged.yaml", &["ragged.yaml", "row"]),
        ("baseline astar --levels letter.yaml", &["letter.yaml", "row", "column", "'x'"]),
        ("levels check 0 letter.yaml", &["letter.yaml", "1 of 2 levels are not valid"]),
        ("levels generate --height 1 --width 1", &["no such level is possible"]),
        ("curriculum --algo ppo --levels a.yaml,narrow.yaml", &["level a is 3×4", "level narrow is 2×3", "--levels"]),
    ]);
}

#[test]
fn seeds_and_numbers() {
    refused(&[
        ("train --level 0 --algo ppo --seeds=", &["--seeds", "expected a number, or a range such as 0..10"]),
        ("train --level 0 --algo ppo --seeds 5..5", &["--seeds", "\"5..5\" is an empty range"]),
        ("train --level 0 --algo ppo --seeds=-1", &["--seeds", "\"-1\": expected a number"]),
        ("train --level 0 --algo ppo --seeds 1,x", &["--seeds", "\"x\": expected a number"]),
        ("train --level 0 --algo ppo --seeds 0..99999999", &["--seeds", "at most"]),
        ("train --level 0 --algo ppo --jobs 0", &["--jobs", "'0'"]),
        ("train --level 0 --algo ppo --timesteps=-5", &["--timesteps", "'-5'"]),
        ("train --level 0 --algo ppo --device tpu", &["--device", "cpu, cuda or cuda:N"]),
        ("train --level 0 --algo ppo --device cuda:99", &["--device cuda:99", "CUDA devices"]),
        ("train --level 0 --algo ppo --device cuda:18446744073709551615", &["--device cuda:184", "CUDA devices"]),
        ("train --level 0 --algo ppo --device cuda:18446744073709551616", &["--device", "cpu, cuda or cuda:N"]),
        ("baseline astar --episodes 0", &["--episodes", "'0'"]),
        ("baseline astar --episodes=-3", &["--episodes", "'-3'"]),
        ("baseline astar --exhaustive --episodes 3", &["--exhaustive", "--episodes"]),
        ("baseline wander", &["'wander'", "astar", "optimal", "random"]),
        ("baseline astar --format xml", &["--format", "markdown"]),
        ("evaluate", &["'evaluate'", "eval"]),
    ]);
}

#[test]
fn models() {
    refused(&[
        ("eval absent.safetensors", &["absent.safetensors", "cannot read the checkpoint"]),
        ("eval a.yaml", &["a.yaml", "not a checkpoint of cpp-rl"]),
        ("eval .", &["holds no run"]),
        ("compare .", &["holds no run"]),
        ("compare absent", &["absent", "cannot read the directory"]),
    ]);
    let sandbox = Sandbox::new();
    sandbox.succeeds("train --config ppo.yaml --level a.yaml");
    let run = "runs/train/ppo/level-a/seed-0";
    let error = sandbox.fails(2, &format!("eval {run} --stage 1"));
    assert!(error.contains("stages 0 to 0 of this run are done") && error.contains("--stage"), "{error}");
    let error = sandbox.fails(2, &format!("eval {run} --levels narrow.yaml"));
    assert!(error.contains("3×4") && error.contains("narrow is 2×3") && error.contains("--levels"), "{error}");
    let error = sandbox.fails(2, &format!("eval {run}/checkpoints/stage-0.safetensors --stage 0"));
    assert!(error.contains("drop --stage"), "{error}");
    sandbox.run("train/ppo/level-a/seed-0").unfinish(0);
    assert!(sandbox.fails(2, &format!("eval {run}")).contains("no stage of this run is done yet"));
}

#[test]
fn help_and_version_succeed() {
    let sandbox = Sandbox::new();
    let commands = ["train", "curriculum", "study", "eval", "baseline", "runs", "compare", "levels"];
    let help = sandbox.succeeds("--help").stdout;
    for command in commands {
        assert!(help.contains(command));
        assert!(sandbox.succeeds(&format!("{command} --help")).stdout.contains("Usage: cpp-rl"));
    }
    assert!(sandbox.succeeds("--version").stdout.contains(env!("CARGO_PKG_VERSION")));
}

/// As after `cargo install`: a program alone in its folder.
#[test]
fn without_libtorchs_program_its_engine_is_refused_with_the_remedy() {
    let sandbox = Sandbox::new();
    std::fs::copy(PROGRAM, sandbox.path("alone")).expect("the folder is writable");
    let train = "train --config ppo.yaml --level a.yaml --quiet";
    for (option, named) in [("--set engine=libtorch", "engine=libtorch"), ("--device cuda", "--device cuda:0")] {
        let mut command = Command::new(sandbox.path("alone"));
        command.args(train.split(' ')).args(option.split(' ')).current_dir(sandbox.path("."));
        let output = command.output().expect("it starts");
        let error = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{error}");
        assert!(error.contains(&format!("{named} needs the program cpp-rl-libtorch")), "{error}");
        assert!(error.contains("./scripts/cpp-rl") && error.contains("-p torch-engine"), "{error}");
    }
    assert!(!sandbox.path("runs").exists(), "nothing is begun");
}
