//! Trainings that are stopped before their end.

use std::fs;
use std::process::{Child, Command, Output, Stdio};
use std::thread::sleep;
use std::time::{Duration, Instant};

use serde_json::Value;

use crate::sandbox::{Reproducible, RunFiles, Sandbox};

/// Timesteps of a stage that is long enough to be stopped in its midst.
const LONG: u32 = 30_000;

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

/// A signal.
#[derive(Clone, Copy, Debug)]
pub enum Signal {
    Interrupt,
    Terminate,
    User1,
}

impl Signal {
    /// Sends it.
    pub fn send(self, training: &Training) {
        let name = match self {
            Self::Interrupt => "-INT",
            Self::Terminate => "-TERM",
            Self::User1 => "-USR1",
        };
        let sent = Command::new("kill").args([name, &training.id().to_string()]).status();
        assert!(sent.expect("there is kill").success(), "the process was there");
    }
}

/// Starts training and sends a signal once `run` is well within its second stage, or its only one; returns what the
/// training printed.
#[track_caller]
pub fn stop_within(sandbox: &Sandbox, command: &str, run: &RunFiles, signal: Signal) -> Output {
    let mut training = Training::begin(sandbox, command);
    training.wait_until(|| {
        let ended = |stages: &[Value]| match stages {
            [_only] => 0,
            // PPO ends a stage with its rollout, of less than 100 timesteps here.
            stages => 100 + stages[0]["timesteps"].as_u64().expect("a number"),
        };
        let within = |name: &String| timesteps(name) > ended(run.manifest()["stages"].as_array().expect("a list"));
        snapshots(run).len() == 2 && snapshots(run).iter().all(within)
    });
    signal.send(&training);
    let output = training.output();
    let stderr = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(130), "{stderr}");
    assert!(!snapshots(run).is_empty(), "{:?}", run.files());
    output
}

/// A command at work; it ends with the test, however that ends.
pub struct Training(Option<Child>);

impl Training {
    /// Starts it.
    pub fn begin(sandbox: &Sandbox, command: &str) -> Self {
        let child = sandbox.command(command).stderr(Stdio::piped()).stdout(Stdio::piped()).spawn();
        Self(Some(child.expect("it starts")))
    }

    /// Its process.
    pub fn id(&self) -> u32 {
        self.0.as_ref().expect("it has not been waited for").id()
    }

    /// Waits until something holds, which it does before the process ends.
    #[track_caller]
    pub fn wait_until(&mut self, mut holds: impl FnMut() -> bool) {
        let child = self.0.as_mut().expect("it has not been waited for");
        let deadline = Instant::now() + Duration::from_secs(120);
        while !holds() {
            assert!(child.try_wait().expect("a child can be asked").is_none(), "it ended too early");
            assert!(Instant::now() < deadline, "what is waited for comes within two minutes");
            sleep(Duration::from_millis(1));
        }
    }

    /// Waits for its end; returns what it printed.
    pub fn output(mut self) -> Output {
        let child = self.0.take().expect("it has not been waited for");
        child.wait_with_output().expect("it ends")
    }
}

impl Drop for Training {
    fn drop(&mut self) {
        if let Some(child) = &mut self.0 {
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
