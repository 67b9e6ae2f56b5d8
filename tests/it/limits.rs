//! Sizes that no machine has: each is refused by name, before any memory is taken.

use std::fs::File;
use std::io::Write;

use crate::sandbox::{PROGRAM, Sandbox};

/// Address space in KiB that suffices for starting the program, and little more.
#[cfg(target_os = "linux")]
const ADDRESS_SPACE: u32 = 1 << 18;

/// Fails with exit code 2, names all of `expected`, and has not taken much memory.
#[track_caller]
fn refused(sandbox: &Sandbox, arguments: &str, expected: &[&str]) {
    let error = sandbox.fails(2, arguments);
    for part in expected {
        assert!(error.contains(part), "{arguments}: {part:?} is not in\n{error}");
    }
    #[cfg(target_os = "linux")]
    {
        let limited = format!("ulimit -v {ADDRESS_SPACE}; exec {} {arguments}", PROGRAM);
        let output = std::process::Command::new("sh").args(["-c", &limited]).current_dir(sandbox.path(".")).output();
        let output = output.expect("there is a shell");
        let stderr = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{arguments}, with little memory: {stderr}");
        assert!(stderr.contains(expected[0]), "{arguments}, with little memory: {stderr}");
    }
}

/// A file of `size` bytes that begins with `start`; the rest is a hole.
fn sparse(sandbox: &Sandbox, name: &str, start: &[u8], size: u64) {
    let mut file = File::create(sandbox.path(name)).expect("the folder is writable");
    file.write_all(start).expect("the file is writable");
    file.set_len(size).expect("the file can have a hole");
}

#[test]
fn settings() {
    let sandbox = Sandbox::new();
    let cases: [(&str, &str, &[&str]); 9] = [
        ("ppo", "hidden=[1000000000]", &["hidden: expected", "from 1 to 4096", "1000000000"]),
        (
            "ppo",
            "hidden=[4096,4096,4096,4096,4096,4096,4096,4096]",
            &["hidden: [4096", "237064197 parameters", "at most 2 GiB"],
        ),
        ("ppo", "num_envs=1000000000", &["num_envs: expected an integer from 1 to 4096", "got 1000000000"]),
        ("ppo", "n_steps=1000000000", &["n_steps: expected an integer from 1 to 1048576", "got 1000000000"]),
        ("ppo", "n_steps=1048576 --set num_envs=4096", &["n_steps × num_envs", "4294967296", "at most 4194304"]),
        ("ppo", "batch_size=1000000000", &["batch_size: expected an integer from 1 to 1048576"]),
        ("dqn", "buffer_size=1000000000", &["buffer_size: expected an integer from 1 to 10000000"]),
        ("dqn", "gradient_steps=1000000000", &["gradient_steps: expected an integer from 1 to 10000"]),
        ("dqn", "timesteps=1e30", &["timesteps: expected an integer from 1 to", "got 1e+30"]),
    ];
    for (algo, set, expected) in cases {
        refused(&sandbox, &format!("train --algo {algo} --level 0 --set {set}"), expected);
    }
    // What an 8×8 map has room for is too much on a large one.
    let large = sandbox.succeeds("levels generate --height 128 --width 128 --targets 3 --wall-density 0");
    sandbox.write("large.yaml", large.stdout);
    let train = "train --level large.yaml";
    refused(
        &sandbox,
        &format!("{train} --algo dqn --set buffer_size=10000000"),
        &["buffer_size: 10000000", "16384 cells"],
    );
    let set = "--set n_steps=1048576 --set max_steps=1000000";
    refused(&sandbox, &format!("{train} --algo ppo {set}"), &["n_steps × num_envs", "1048576 samples", "16384 cells"]);
    assert!(!sandbox.path("runs").exists(), "nothing is begun");
}

#[test]
fn numbers_of_things() {
    let sandbox = Sandbox::new();
    let most = "at most 10000 are possible";
    refused(&sandbox, "train --algo ppo --level 0 --seeds 0..1000000000", &["--seeds", "1000000000", most]);
    for seeds in ["0,5..18446744073709551615", "7,0..18446744073709551615", "0..18446744073709551615"] {
        refused(&sandbox, &format!("train --algo ppo --level 0 --seeds {seeds}"), &["--seeds", most]);
    }
    refused(&sandbox, "study --estimate --seeds 0..10000,10000", &["--seeds", "makes more than 10000 numbers"]);
    refused(&sandbox, "baseline astar --levels 0..1000000000", &["--levels", "1000000000", most]);
    refused(&sandbox, "baseline random --episodes 1000000000", &["--episodes", "10000000"]);
    refused(&sandbox, "train --algo ppo --level 0 --jobs 1000000000", &["--jobs", "1000000000"]);
    refused(&sandbox, "levels generate --height 1000000000", &["1000000000 x 8", "at most 16384"]);
    refused(&sandbox, "levels generate --height 1000000000 --width 1000000000", &["1000000000 x", "at most 16384"]);
    refused(&sandbox, "levels generate --height 18446744073709551615 --width 3", &["18446744073709551615", "16384"]);
    refused(&sandbox, "levels generate --targets 1000000000", &["1000000000 targets"]);
}

#[test]
fn files() {
    let sandbox = Sandbox::new();
    const GIB: u64 = 1 << 30;
    let header = (10 * GIB).to_le_bytes();
    sparse(&sandbox, "header.safetensors", &header, 3 * GIB);
    sparse(&sandbox, "short.safetensors", &header, 100);
    sparse(&sandbox, "large.safetensors", &header, 10 * GIB);
    let limit = "at most 67108864 are possible";
    for name in ["header.safetensors", "short.safetensors"] {
        refused(&sandbox, &format!("eval {name}"), &[name, "its header is said to have 10737418240 bytes", limit]);
    }
    refused(&sandbox, "eval large.safetensors", &["large.safetensors", "10737418240 bytes are too many"]);
    sparse(&sandbox, "level.yaml", b"map: |\n", 10 * GIB);
    refused(&sandbox, "levels show level.yaml", &["level.yaml", "larger than 1048576 bytes"]);
    sparse(&sandbox, "config.yaml", b"extends: ppo\n", 10 * GIB);
    refused(&sandbox, "train --level 0 --config config.yaml", &["config.yaml", "larger than 1048576 bytes"]);
    refused(&sandbox, "study config.yaml --estimate", &["config.yaml", "larger than 1048576 bytes"]);
    sandbox.write("wide.yaml", format!("map: |\n  T{}\n", ".".repeat(1_000_000)));
    refused(&sandbox, "levels show wide.yaml", &["wide.yaml", "more than 16384 cells"]);
    if cfg!(unix) {
        refused(&sandbox, "eval /dev/zero", &["/dev/zero", "it is not a file"]);
        for read in ["levels show /dev/zero", "train --level 0 --config /dev/zero", "study /dev/zero --estimate"] {
            refused(&sandbox, read, &["/dev/zero", "larger than"]);
        }
    }
}
