//! What is seen on stderr: on a terminal, in a pipe, and with less or more of it.

use std::fs::{self, File};
use std::process::Command;

use crate::sandbox::{PROGRAM, Sandbox};

const TRAIN: &str = "train --config ppo.yaml --level a.yaml";

/// What a terminal is sent while the program runs on it; nothing where there is no `script` of util-linux.
fn on_a_terminal(sandbox: &Sandbox, arguments: &str) -> Option<String> {
    let command = format!("exec {} {arguments}", PROGRAM);
    let mut script = Command::new("script");
    script.args(["-qec", &command, "/dev/null"]).env("TERM", "xterm").current_dir(sandbox.path("."));
    let Ok(output) = script.output() else {
        eprintln!("skipped: there is no script(1) to make a terminal");
        return None;
    };
    let text = String::from_utf8_lossy(&output.stdout).into_owned();
    assert!(output.status.success(), "{text}");
    Some(text)
}

/// What was sent between control sequences and line ends.
fn pieces(sent: &str) -> Vec<String> {
    let mut text = String::new();
    let mut characters = sent.chars();
    while let Some(character) = characters.next() {
        if character == '\x1b' {
            // ESC [ parameters, up to a letter.
            let _ = characters.by_ref().find(char::is_ascii_alphabetic);
            text.push('\n');
        } else {
            text.push(character);
        }
    }
    text.split(['\r', '\n']).map(str::to_owned).collect()
}

#[test]
fn a_pipe_gets_plain_lines() {
    let sandbox = Sandbox::new();
    let stderr = sandbox.succeeds(&format!("{TRAIN} --seeds 0..8")).stderr;
    for seed in 0..8 {
        let done = format!("seed {seed}: stage 0 is done, the last is 0");
        assert_eq!(stderr.lines().filter(|line| *line == done).count(), 1, "{stderr}");
    }
    assert!(stderr.contains("8 of 8 seeds finished") && !stderr.contains(['\x1b', '\r']), "{stderr}");
}

#[test]
fn less_and_more_can_be_shown() {
    let sandbox = Sandbox::new();
    assert_eq!(sandbox.succeeds(&format!("{TRAIN} --quiet")).stderr, "");
    assert!(sandbox.succeeds(&format!("{TRAIN} --seeds 1 -v")).stderr.contains("learning_rate: "));
    let error = sandbox.fails(2, &format!("{TRAIN} --quiet"));
    assert!(error.starts_with("error: ") && error.contains("--resume"), "{error}");
}

#[test]
fn messages_and_bars_leave_each_other_whole() {
    let sandbox = Sandbox::new();
    for (seeds, bars) in [("0..3", true), ("10..30", false)] {
        let Some(sent) = on_a_terminal(&sandbox, &format!("{TRAIN} --timesteps 2048 --seeds {seeds} -v")) else {
            return;
        };
        let pieces = pieces(&sent);
        let first = seeds.split('.').next().expect("a number");
        let done = format!("seed {first}: stage 0 is done, the last is 0");
        assert!(pieces.contains(&done), "{pieces:#?}");
        let shown = |part: &str| pieces.iter().any(|piece| piece.contains('%') && piece.contains(part));
        for part in ["stage 1/1", "/s  ", " left", "return "] {
            assert!(shown(part), "{part} is not in {pieces:#?}");
        }
        assert_eq!(shown(&format!("seed {first} ")), bars, "{pieces:#?}");
        assert!(pieces.iter().any(|piece| piece.starts_with("policy ")), "the table begins a line: {pieces:#?}");
    }
}

#[test]
fn a_study_has_one_bar_and_a_line_for_each_experiment() {
    let sandbox = Sandbox::new();
    let arms = "[{config: ppo.yaml, trains: [afresh]}]";
    sandbox.write("study.yaml", format!("name: s\nlevels: [a.yaml, b.yaml]\narms: {arms}\n"));
    let Some(sent) = on_a_terminal(&sandbox, "study study.yaml --num-seeds 2 --timesteps 2048") else { return };
    let pieces = pieces(&sent);
    assert!(pieces.iter().any(|piece| piece.contains('%') && piece.contains("/4 runs")), "{pieces:#?}");
    assert!(!pieces.iter().any(|piece| piece.contains('%') && piece.contains("seed ")), "{pieces:#?}");
    for level in ["a", "b"] {
        let line = format!("2 of 2 seeds finished in runs/s/ppo/level-{level}");
        assert!(pieces.contains(&line), "{line} is not in {pieces:#?}");
    }
}

#[cfg(target_os = "linux")]
#[test]
fn results_that_cannot_be_printed_hide_no_failure() {
    let sandbox = Sandbox::new();
    // A folder stands where a file of one seed is to be.
    let run = sandbox.path("runs/train/ppo/level-a/seed-0");
    fs::create_dir_all(run.join("evaluations.csv.partial/occupied")).expect("writable");
    let full = File::options().write(true).open("/dev/full").expect("Linux has it");
    let output = sandbox.command(&format!("{TRAIN} --seeds 0..2")).stdout(full).output().expect("the program starts");
    let stderr = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(1), "{stderr}");
    assert!(stderr.contains("error: cannot write to stdout"), "{stderr}");
    assert!(stderr.contains("1 seed failed") && stderr.contains("seed 0: cannot write"), "{stderr}");
}
