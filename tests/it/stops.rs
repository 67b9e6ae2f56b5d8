//! Trainings that are stopped before their end. With `--verbose` a training says when it has saved a run: tests wait for
//! that line, and for nothing else.

use std::fs;
use std::process::{Child, Command, Output, Stdio};

use rustix::process::{Pid, Signal, WaitOptions, kill_process, waitpid};

use crate::lines::{Lines, ended};
use crate::sandbox::{Reproducible, RunFiles, Sandbox};

/// Timesteps of a stage that is long enough to be stopped in its midst.
pub const LONG: u32 = 30_000;

/// Three stages, saved often; seeds are for the caller to choose.
pub fn command(algo: &str, out: &str) -> String {
    command_of(algo, out, LONG)
}

/// As [`command`], with stages of this many timesteps.
pub fn command_of(algo: &str, out: &str, timesteps: u32) -> String {
    // Every 512 timesteps of PPO, whose rollouts have 64 here, and every 2,048 of DQN.
    let updates = if algo == "dqn" { 1 } else { 8 };
    let options = format!("--levels a.yaml,b.yaml,c.yaml --checkpoint-updates {updates}");
    format!("curriculum --config {algo}.yaml {options} --timesteps {timesteps} --out {out}")
}

/// The runs of seeds 0 and 1.
pub fn runs(sandbox: &Sandbox, algo: &str, out: &str) -> [RunFiles; 2] {
    [0, 1].map(|seed| RunFiles(sandbox.path(out).join(algo).join("curriculum").join(format!("seed-{seed}"))))
}

/// What seeds 0 and 1 end with where nothing stops them.
pub fn undisturbed(sandbox: &Sandbox, algo: &str) -> [Reproducible; 2] {
    sandbox.succeeds(&format!("{} --seeds 0..2", command(algo, "undisturbed")));
    runs(sandbox, algo, "undisturbed").map(|run| run.reproducible())
}

/// Starts training and sends a signal once `run` is well within its second stage, or its only one; returns what the
/// training printed.
#[track_caller]
pub fn stop_within(sandbox: &Sandbox, command: &str, run: &RunFiles, signal: Signal) -> Output {
    let mut training = Training::begin(sandbox, &format!("{command} --verbose"));
    let mut saved = 0;
    while saved < 2 {
        let timesteps = training.next_save(run);
        // A run has its manifest before it is saved for the first time.
        let ended = match run.manifest()["stages"].as_array().expect("a list").as_slice() {
            [_only] => 0,
            // PPO ends a stage with its rollout, of less than 100 timesteps here.
            stages => 100 + stages[0]["timesteps"].as_u64().expect("a number"),
        };
        saved += u32::from(timesteps > ended);
    }
    training.send(signal);
    let output = training.output();
    let stderr = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(130), "{stderr}");
    assert!(!snapshots(run).is_empty(), "{:?}", run.files());
    output
}

/// A command at work; it ends with the test, however that ends.
pub struct Training {
    child: Option<Child>,
    /// What it prints to stderr.
    lines: Lines,
}

impl Training {
    /// Starts it.
    pub fn begin(sandbox: &Sandbox, command: &str) -> Self {
        Self::of(&mut sandbox.command(command))
    }

    /// Starts a command.
    pub fn of(command: &mut Command) -> Self {
        let mut child = command.stderr(Stdio::piped()).stdout(Stdio::piped()).spawn().expect("it starts");
        let lines = Lines::of(child.stderr.take().expect("a pipe"));
        Self { child: Some(child), lines }
    }

    fn id(&self) -> Pid {
        Pid::from_child(self.child.as_ref().expect("it has not been waited for"))
    }

    /// Waits until a run has been saved once more, which is before the training ends; returns its timesteps by then.
    #[track_caller]
    pub fn next_save(&mut self, run: &RunFiles) -> u64 {
        loop {
            let (saved, timesteps) = self.next_save_of_any();
            if run.0.ends_with(saved) {
                return timesteps;
            }
        }
    }

    /// Waits until some run has been saved; returns its path and its timesteps by then.
    #[track_caller]
    pub fn next_save_of_any(&mut self) -> (String, u64) {
        let said = |line: &str| {
            let (run, timesteps) = line.strip_suffix(" timesteps")?.split_once(": saved after ")?;
            Some((run.to_owned(), timesteps.parse().ok()?))
        };
        self.lines.wait_for(said)
    }

    /// Sends a signal.
    pub fn send(&self, signal: Signal) {
        kill_process(self.id(), signal).expect("it has not been waited for");
    }

    /// Sends several signals, so that it does nothing from the first to the last.
    pub fn send_at_once(&self, signals: &[Signal]) {
        self.send(Signal::STOP);
        let (_, status) =
            waitpid(Some(self.id()), WaitOptions::UNTRACED).expect("it is a child").expect("it is waited for");
        assert!(status.stopped(), "it ended too early: {status:?}");
        signals.iter().for_each(|&signal| self.send(signal));
        self.send(Signal::CONT);
    }

    /// Waits for its end; returns what it printed.
    pub fn output(mut self) -> Output {
        let child = self.child.take().expect("it has not been waited for");
        let mut output = ended(child);
        output.stderr = self.lines.rest().into_bytes();
        output
    }
}

impl Drop for Training {
    fn drop(&mut self) {
        if let Some(child) = &mut self.child {
            // It may have ended on its own.
            let _ = child.kill().and_then(|()| child.wait());
        }
    }
}

/// The snapshots of a run, the latest last.
pub fn snapshots(run: &RunFiles) -> Vec<String> {
    let Ok(entries) = fs::read_dir(run.0.join("checkpoints/latest")) else { return Vec::new() };
    let names = entries.filter_map(|entry| entry.ok()?.file_name().into_string().ok());
    let mut names: Vec<String> = names.filter(|name| name.ends_with(".safetensors")).collect();
    names.sort_by_key(|name| timesteps(name));
    names
}

/// The cumulative timesteps that a snapshot's name tells.
fn timesteps(name: impl AsRef<str>) -> u64 {
    let name = name.as_ref();
    name.trim_end_matches(".safetensors").parse().expect("a number")
}
