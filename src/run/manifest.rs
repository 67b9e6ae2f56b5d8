//! `manifest.json`: what ran, where, with what, and how it ended.

use std::path::Path;

use anyhow::{Context, Result};
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};

use super::container::NO_CRC;
use super::logs::Marks;
use super::{Plan, atomic};
use crate::agent::Stage;
use crate::agent::config::Config;
use crate::agent::engine;
use crate::dose::Dose;
use crate::error::UserError;
use crate::text_file::{self, TextError};

/// Its name within the run.
pub const FILE: &str = "manifest.json";
/// The version of the manifest's fields, which a reader must know. Format 1 is read as well: it calls `engine` `kernel`, and
/// its value `libtorch` `autograd`.
pub const FORMAT: u32 = 2;
/// The oldest version that is read.
const OLDEST_FORMAT: u32 = 1;

/// A larger file is none of ours; maps of many stages and a long history of starts fit.
const MAX_FILE_BYTES: u64 = 1 << 28;

/// What is known of one run.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Manifest {
    /// Version of this file's fields.
    pub format: u32,
    /// How the run stands.
    pub status: Status,
    /// The arm's name.
    pub arm: String,
    /// `curriculum`, the name of another sequence, or `level-<L>`.
    pub curriculum: String,
    /// The seed's number.
    pub seed: u64,
    /// Stages in the order of training.
    pub stages: Vec<StageEntry>,
    /// Stages finished so far.
    pub stages_done: u16,
    /// How far the other files had grown at the end of each finished stage; older versions did not say.
    #[serde(default)]
    pub marks: Vec<Marks>,
    /// Names of the levels it is evaluated on.
    pub levels: Vec<String>,
    /// What it goes on from, if it is a fork. Its stages are those of the whole sequence: it trains those after `after` alone.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub fork: Option<ForkEntry>,
    /// Every setting, resolved.
    pub config: Map<String, Value>,
    /// What the L2 penalty amounts to.
    pub dose: Option<Dose>,
    /// What computes its networks.
    #[serde(alias = "kernel")]
    pub engine: Engine,
    /// `cpu` or `cuda:N`.
    pub device: String,
    /// Timesteps between two rows of `plasticity.csv`; 0 for none. It changes nothing else in a run.
    #[serde(default)]
    pub plasticity_interval: u64,
    /// Timesteps between two evaluations in `learning.csv`; 0 for none. It changes nothing else in a run.
    #[serde(default)]
    pub evaluate_every: u64,
    /// Versions of everything that matters.
    pub versions: Versions,
    /// The machine.
    pub host: Host,
    /// The command as it was typed.
    pub command: Vec<String>,
    /// Every start of the run, the first one first; older versions did not say.
    #[serde(default)]
    pub starts: Vec<Start>,
    /// When the run was started, UTC.
    pub started: String,
    /// When this file was written, UTC.
    pub updated: String,
    /// Seconds spent so far, over all starts.
    pub seconds: f64,
}

/// What a fork goes on from, and how.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct ForkEntry {
    /// The parent's directory, as it was given.
    pub parent: String,
    /// The number of the parent's stage whose agent it goes on with.
    pub after: u16,
    /// The treatment's name.
    pub name: String,
    /// The treatment as it was written; empty for one that changes nothing.
    pub treatment: Map<String, Value>,
}

/// What computes the networks of a run.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Engine {
    /// Gradients derived by hand, on the CPU.
    Fused,
    /// libtorch, on any device.
    #[serde(alias = "autograd")]
    Libtorch,
}

impl Engine {
    /// As manifests record it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Fused => "fused",
            Self::Libtorch => "libtorch",
        }
    }
}

/// How a run stands.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase", tag = "state", content = "why")]
pub enum Status {
    /// It runs, or was killed.
    Running,
    /// A signal stopped it, and its state is saved.
    Interrupted,
    /// All stages are done.
    Finished,
    /// It cannot go on, and why.
    Failed(String),
}

/// One stage of a run.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct StageEntry {
    /// The level's name.
    pub level: String,
    /// The level's map, rows joined by newlines.
    pub map: String,
    /// Timesteps asked for.
    pub timesteps: u64,
    /// Timesteps that schedules span, where the run was extended: those first asked for.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub horizon: Option<u64>,
}

/// One start of a run.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Start {
    /// When, UTC.
    pub time: String,
    /// The command as it was typed.
    pub command: Vec<String>,
    /// Versions of everything that matters.
    pub versions: Versions,
    /// The machine.
    pub host: Host,
    /// The instruction set of its fused engine: results on another one differ by rounding.
    pub instruction_set: String,
    /// Timesteps of all stages that had been done.
    pub timesteps: u64,
}

/// Versions of everything that matters.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Versions {
    /// This program.
    pub cpp_rl: String,
    /// Its commit, `-dirty` if the tree had changes.
    pub git: String,
    /// libtorch as it was built against; `none` where it is not linked.
    pub libtorch: String,
}

/// The machine.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Host {
    /// Its name.
    pub name: String,
    /// Operating system and architecture.
    pub platform: String,
    /// Cores that this process may use.
    pub cores: usize,
}

impl Versions {
    /// Those of this program.
    pub fn here() -> Self {
        let text = str::to_owned;
        Self {
            cpp_rl: text(env!("CARGO_PKG_VERSION")),
            git: text(env!("CPP_RL_GIT")),
            libtorch: text(engine::libtorch().map_or("none", |libtorch| libtorch.version())),
        }
    }
}

impl Host {
    /// This machine.
    pub fn here() -> Self {
        let name = std::env::var("HOSTNAME").ok();
        let name = name.or_else(|| std::fs::read_to_string("/etc/hostname").ok());
        Self {
            name: name.map_or_else(|| "unknown".to_owned(), |name| name.trim().to_owned()),
            platform: format!("{} {}", std::env::consts::OS, std::env::consts::ARCH),
            cores: std::thread::available_parallelism().map_or(1, usize::from),
        }
    }
}

impl Start {
    /// This start, by `command`, of a run of which `timesteps` are done.
    pub fn here(command: &[String], timesteps: u64) -> Self {
        Self {
            time: now(),
            command: command.to_vec(),
            versions: Versions::here(),
            host: Host::here(),
            instruction_set: bit_mlp::instruction_set().to_owned(),
            timesteps,
        }
    }
}

impl Manifest {
    /// That of a run that begins now.
    pub(super) fn new(plan: &Plan<'_>) -> Self {
        let Plan { config, curriculum, .. } = *plan;
        let stage = |stage: &Stage| StageEntry {
            level: stage.level.name().to_owned(),
            map: stage.level.to_map(),
            timesteps: stage.timesteps,
            horizon: None,
        };
        Self {
            format: FORMAT,
            status: Status::Running,
            arm: config.name.clone(),
            curriculum: curriculum.name.clone(),
            seed: plan.seed,
            stages: curriculum.stages.iter().map(stage).collect(),
            stages_done: curriculum.begins,
            marks: vec![Marks::new(); curriculum.begins.into()],
            fork: plan.parents.map(|parents| ForkEntry {
                parent: parents.of(plan.seed).display().to_string(),
                after: parents.fork.after,
                name: parents.fork.treatment.name.clone(),
                treatment: parents.fork.treatment.written.clone(),
            }),
            levels: curriculum.levels.iter().map(|level| level.name().to_owned()).collect(),
            config: config.to_json(),
            dose: Some(Dose::planned(config, curriculum)),
            engine: plan.engine,
            device: plan.device.clone(),
            versions: Versions::here(),
            host: Host::here(),
            command: plan.command.to_vec(),
            plasticity_interval: plan.plasticity_interval,
            evaluate_every: plan.evaluate_every,
            starts: Vec::new(),
            started: now(),
            updated: now(),
            seconds: 0.0,
        }
    }

    /// Plans the dose of what is left: a run that is extended makes more steps. What finished stages measured stays.
    pub(super) fn plan_dose(&mut self, plan: &Plan<'_>) {
        let planned = Dose::planned(plan.config, plan.curriculum);
        let measured = self.dose.take().unwrap_or_else(|| planned.clone());
        let mut dose = Dose { weight_norm: measured.weight_norm, l2_ratio: measured.l2_ratio, ..planned };
        dose.go_back(self.stages_done);
        self.dose = Some(dose);
    }

    /// Asks for more timesteps of the only stage, which is taken up again; schedules keep the horizon they had.
    pub(super) fn extend(&mut self, timesteps: u64) {
        for stage in &mut self.stages {
            // A stage whose timesteps a sequence said has others than the setting, which then stays as it is.
            if self.config.get("timesteps") == Some(&stage.timesteps.into()) {
                self.config.insert("timesteps".to_owned(), timesteps.into());
            }
            stage.horizon.get_or_insert(stage.timesteps);
            stage.timesteps = timesteps;
        }
        self.stages_done = 0;
        self.marks.clear();
    }

    /// The number of the first stage that it trains: 0, or of a fork the one after the checkpoint.
    pub fn first_stage(&self) -> u16 {
        self.fork.as_ref().map_or(0, |fork| fork.after.saturating_add(1))
    }

    /// The stages that it trains, with their numbers.
    pub fn own_stages(&self) -> impl Iterator<Item = (u16, &StageEntry)> {
        let numbered = self.stages.iter().enumerate().map(|(number, stage)| (number as u16, stage));
        numbered.skip(usize::from(self.first_stage()))
    }

    /// The step limit of its episodes.
    pub fn max_steps(&self) -> u32 {
        let limit = self.config.get("max_steps").and_then(Value::as_u64).and_then(|v| u32::try_from(v).ok());
        limit.unwrap_or(coverage_env::MAX_STEPS)
    }

    /// Reads `manifest.json` of a run's directory.
    ///
    /// # Errors
    /// A file that cannot be read, naming it.
    pub fn read(directory: &Path) -> Result<Self> {
        let path = directory.join(FILE);
        let text = text_file::read(&path, MAX_FILE_BYTES).map_err(|error| {
            let what = format!("cannot read {}", path.display());
            match error {
                TextError::Unreadable(error) => anyhow::Error::new(error).context(what),
                damage => UserError::new(format!("{what}: {damage}")).into(),
            }
        })?;
        check_crc(&text).map_err(|problem| UserError::new(format!("{}: {problem}", path.display())))?;
        let value: Value = serde_json::from_str(&text)
            .map_err(|e| UserError::new(format!("{} is not a manifest of cpp-rl: {e}", path.display())))?;
        match value.get("format").and_then(Value::as_u64) {
            Some(format) if !(OLDEST_FORMAT.into()..=FORMAT.into()).contains(&format) => Err(UserError::new(format!(
                "{}: manifest format {format}; this version of cpp-rl reads formats {OLDEST_FORMAT} to {FORMAT}",
                path.display()
            ))
            .into()),
            _ => {
                let mut manifest: Self = serde_json::from_value(value)
                    .map_err(|e| UserError::new(format!("{} is not a manifest of cpp-rl: {e}", path.display())))?;
                // What is written from now on has the names of today. Settings that are not possible any more stay as they
                // are: whoever goes on with the run is told.
                manifest.format = FORMAT;
                if let Ok(config) = Config::recorded(&manifest.config) {
                    manifest.config = config.to_json();
                }
                Ok(manifest)
            }
        }
    }

    /// Writes it into a run's directory.
    ///
    /// # Errors
    /// Those of the file system, naming the file.
    pub fn write(&mut self, directory: &Path) -> Result<()> {
        self.updated = now();
        let path = directory.join(FILE);
        let mut text = serde_json::to_string_pretty(&Sealed { crc32: NO_CRC, manifest: self })? + "\n";
        let crc = format!("{:08x}", crc32fast::hash(text.as_bytes()));
        text.replace_range(CRC_START.len()..CRC_START.len() + NO_CRC.len(), &crc);
        atomic::write(&path, text.as_bytes()).with_context(|| format!("cannot write {}", path.display()))
    }
}

/// The manifest as it stands in the file.
#[derive(Serialize)]
struct Sealed<'a> {
    crc32: &'static str,
    #[serde(flatten)]
    manifest: &'a Manifest,
}

/// How the file begins, up to the digits of its checksum.
const CRC_START: &str = "{\n  \"crc32\": \"";

/// Compares the checksum with the text, where it has one: it is taken while its own digits are zeros.
fn check_crc(text: &str) -> Result<(), &'static str> {
    let Some((digits, rest)) = text.strip_prefix(CRC_START).and_then(|rest| rest.split_at_checked(NO_CRC.len())) else {
        return Ok(());
    };
    if format!("{:08x}", crc32fast::hash(format!("{CRC_START}{NO_CRC}{rest}").as_bytes())) == digits {
        return Ok(());
    }
    Err(
        "its checksum does not fit its content: was it cut short, damaged or edited? (Without its line crc32 it is taken \
         as it is.)",
    )
}

/// The present time, UTC, to the second.
pub fn now() -> String {
    jiff::Timestamp::now().round(jiff::Unit::Second).unwrap_or_default().to_string()
}
