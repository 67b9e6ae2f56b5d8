//! A fresh folder for one test, and the program run in it.

use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::{env, fs, io, thread};

use assert_cmd::assert::OutputAssertExt;
use serde_json::Value;
use tempfile::TempDir;

/// The program under test.
pub const PROGRAM: &str = env!("CARGO_BIN_EXE_cpp-rl");

/// The engines that can be tested: `libtorch` where the program that links it is beside [`PROGRAM`].
///
/// # Panics
/// Where that program is absent although `CPP_RL_TEST_LIBTORCH=1` asks for its tests, as `scripts/test` does.
#[track_caller]
pub fn engines() -> &'static [&'static str] {
    if has_libtorch() { &["fused", "libtorch"] } else { &["fused"] }
}

/// Whether `engine=libtorch` can be tested; says so where a test must leave it out.
///
/// # Panics
/// As [`engines`].
#[track_caller]
pub fn has_libtorch() -> bool {
    let program = Path::new(PROGRAM).with_file_name(format!("cpp-rl-libtorch{}", env::consts::EXE_SUFFIX));
    if program.is_file() {
        return true;
    }
    let remedy = "build it: scripts/libtorch && cargo build --release -p torch-engine";
    let wanted = env::var("CPP_RL_TEST_LIBTORCH").is_ok_and(|value| value == "1");
    assert!(!wanted, "CPP_RL_TEST_LIBTORCH=1, but there is no {}: {remedy}", program.display());
    let test = thread::current().name().unwrap_or("a test").to_owned();
    // Not `eprintln!`: the harness shows what that prints only where a test fails.
    let _ = writeln!(io::stderr(), "{test}: without engine=libtorch, for lack of {}; {remedy}", program.display());
    false
}

/// Three small levels of one size, none of them square, and one of another size.
const LEVELS: [(&str, &str); 4] = [
    ("a.yaml", "name: a\nmap: |\n  ..#.\n  .T..\n  ...T\n"),
    ("b.yaml", "name: b\nmap: |\n  T...\n  ..#.\n  ..#T\n"),
    ("c.yaml", "name: c\nmap: |\n  ....\n  #TT.\n  ....\n"),
    ("narrow.yaml", "name: narrow\nmap: |\n  ..T\n  .#.\n"),
];

/// PPO that trains in no time: four rollouts a stage.
const PPO: &str = "
extends: ppo
timesteps: 256
n_steps: 64
batch_size: 32
n_epochs: 2
hidden: [8]
max_steps: 20
learning_rate: 1e-3
";

/// DQN that trains in no time, and copies its target network and overwrites its buffer on the way.
const DQN: &str = "
extends: dqn
timesteps: 256
learning_starts: 20
buffer_size: 100
batch_size: 8
target_update_interval: 60
hidden: [8]
max_steps: 20
learning_rate: 1e-3
";

/// A temporary folder with levels and the settings `ppo.yaml`, `ppo-l2.yaml` and `dqn.yaml`.
pub struct Sandbox(TempDir);

impl Sandbox {
    /// A fresh one.
    pub fn new() -> Self {
        let sandbox = Self(TempDir::new().expect("a temporary folder"));
        for (name, text) in LEVELS.into_iter().chain([("ppo.yaml", PPO), ("dqn.yaml", DQN)]) {
            sandbox.write(name, text);
        }
        sandbox.write("ppo-l2.yaml", PPO.replace("extends: ppo", "extends: ppo-l2"));
        sandbox
    }

    /// A path in it.
    pub fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    /// Writes a file.
    pub fn write(&self, name: &str, content: impl AsRef<[u8]>) {
        fs::write(self.path(name), content).expect("the folder is writable");
    }

    /// The program with these words as arguments, to be run in the folder.
    pub fn command(&self, arguments: &str) -> Command {
        let mut command = Command::new(PROGRAM);
        command.args(arguments.split_whitespace()).current_dir(self.0.path());
        command
    }

    /// Runs a command that succeeds; returns what it printed.
    #[track_caller]
    pub fn succeeds(&self, arguments: &str) -> Printed {
        Printed::new(self.command(arguments).assert().success().get_output())
    }

    /// Runs a command that ends with exit code `code` and no panic; returns what it printed to stderr.
    #[track_caller]
    pub fn fails(&self, code: i32, arguments: &str) -> String {
        let stderr = Printed::new(self.command(arguments).assert().code(code).get_output()).stderr;
        assert!(stderr.contains("error") && !stderr.contains("panicked"), "{stderr}");
        stderr
    }

    /// What a command that succeeds prints as JSON.
    #[track_caller]
    pub fn json(&self, arguments: &str) -> Value {
        let stdout = self.succeeds(&format!("{arguments} --format json")).stdout;
        serde_json::from_str(&stdout).unwrap_or_else(|error| panic!("{error} in {stdout}"))
    }

    /// A run below `runs`, such as `train/ppo/level-a/seed-0`.
    pub fn run(&self, name: &str) -> RunFiles {
        RunFiles(self.path("runs").join(name))
    }
}

/// What a command printed.
pub struct Printed {
    /// Results.
    pub stdout: String,
    /// Progress and errors.
    pub stderr: String,
}

impl Printed {
    fn new(output: &Output) -> Self {
        let text = |bytes: &[u8]| String::from_utf8(bytes.to_vec()).expect("output is UTF-8");
        Self { stdout: text(&output.stdout), stderr: text(&output.stderr) }
    }
}

/// The directory of a run.
pub struct RunFiles(pub PathBuf);

impl RunFiles {
    /// The bytes of a file.
    #[track_caller]
    pub fn bytes(&self, name: &str) -> Vec<u8> {
        fs::read(self.0.join(name)).unwrap_or_else(|error| panic!("{}/{name}: {error}", self.0.display()))
    }

    /// The text of a file.
    #[track_caller]
    pub fn text(&self, name: &str) -> String {
        String::from_utf8(self.bytes(name)).expect("the file is text")
    }

    /// The manifest.
    #[track_caller]
    pub fn manifest(&self) -> Value {
        serde_json::from_str(&self.text("manifest.json")).expect("the manifest is JSON")
    }

    /// Rewrites the manifest so that only the first `stages` stages are done, as a kill can leave it.
    pub fn unfinish(&self, stages: u16) {
        self.rewrite_manifest(|manifest| {
            manifest["stages_done"] = stages.into();
            manifest["status"] = serde_json::json!({ "state": "running" });
        });
    }

    /// Rewrites the manifest, without its checksum.
    pub fn rewrite_manifest(&self, change: impl FnOnce(&mut Value)) {
        let mut manifest = self.manifest();
        manifest.as_object_mut().expect("an object").remove("crc32");
        change(&mut manifest);
        fs::write(self.0.join("manifest.json"), manifest.to_string()).expect("the run is writable");
    }

    /// The rows of `progress.csv` by column, without the columns that tell of the clock.
    #[track_caller]
    pub fn progress(&self) -> Vec<Vec<(String, String)>> {
        let text = self.text("progress.csv");
        let mut reader = csv::Reader::from_reader(text.as_bytes());
        let columns: Vec<String> = reader.headers().expect("a header").iter().map(str::to_owned).collect();
        let row = |record: csv::StringRecord| {
            let cells = columns.iter().cloned().zip(record.iter().map(str::to_owned));
            cells.filter(|(name, _)| !["time/time_elapsed", "time/fps"].contains(&name.as_str())).collect()
        };
        reader.records().map(|record| row(record.expect("a row as long as the header"))).collect()
    }

    /// The number of the stage that the run began with.
    pub fn begins(&self) -> u64 {
        self.manifest()["fork"]["after"].as_u64().map_or(0, |after| after + 1)
    }

    /// Everything that the same seed must reproduce: stage checkpoints, evaluations, and progress but for the clock.
    #[track_caller]
    pub fn reproducible(&self) -> Reproducible {
        let stages = self.manifest()["stages_done"].as_u64().expect("a number");
        let checkpoint = |stage| self.bytes(&format!("checkpoints/stage-{stage}.safetensors"));
        Reproducible {
            checkpoints: (self.begins()..stages).map(checkpoint).collect(),
            evaluations: self.text("evaluations.csv"),
            progress: self.progress(),
        }
    }

    /// Every file below it but the lock, as relative paths in order.
    pub fn files(&self) -> Vec<String> {
        let mut files = Vec::new();
        list(&self.0, &mut files);
        let relative = |path: PathBuf| path.strip_prefix(&self.0).expect("below").display().to_string();
        let mut files: Vec<String> = files.into_iter().map(relative).filter(|name| name != ".lock").collect();
        files.sort();
        files
    }
}

/// What the same seed must reproduce.
#[derive(PartialEq)]
pub struct Reproducible {
    checkpoints: Vec<Vec<u8>>,
    evaluations: String,
    progress: Vec<Vec<(String, String)>>,
}

impl Reproducible {
    /// Asserts that another run has the same; says in which part it does not.
    #[track_caller]
    pub fn assert_same(&self, other: &Self) {
        assert!(!self.checkpoints.is_empty() && !self.evaluations.is_empty());
        assert_eq!(self.progress, other.progress);
        assert_eq!(self.evaluations, other.evaluations);
        assert!(self.checkpoints == other.checkpoints, "the checkpoints differ");
    }
}

fn list(directory: &Path, files: &mut Vec<PathBuf>) {
    for entry in fs::read_dir(directory).expect("a directory") {
        let path = entry.expect("an entry").path();
        if path.is_dir() { list(&path, files) } else { files.push(path) }
    }
}
