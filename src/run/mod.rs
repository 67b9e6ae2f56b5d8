//! A run's directory: the only code that writes under `runs/`.
//!
//! A finished stage is the unit that survives: its evaluations, then its checkpoint, and last the manifest's
//! `stages_done`, each whole or not at all. What a killed process wrote after that is cut back on resume, and since a
//! stage depends on its seed, its number and the agent before it alone, the resumed run ends with the same bytes.

mod atomic;
pub mod checkpoint;
mod container;
pub mod evaluations;
pub mod manifest;
mod progress;

use std::fs::{self, File, TryLockError};
use std::path::{Path, PathBuf};
use std::time::Instant;

use anyhow::{Context, Result};
use serde_json::{Map, Value};

use crate::agent::network::Network;
use crate::agent::state::AgentState;
use crate::agent::{Metrics, Stage};
use crate::error::UserError;
use crate::results::LevelResult;
use checkpoint::{Checkpoint, Origin};
use evaluations::{Phase, Row};
use manifest::{Manifest, Status};
use progress::{StageLog, plasticity_place, progress_place};

pub use atomic::write as write_file;

/// The directory of one run, locked for this process.
pub struct RunDir {
    path: PathBuf,
    manifest: Manifest,
    progress: StageLog,
    plasticity: StageLog,
    evaluations: Vec<Row>,
    /// When this process took the run up, and the seconds spent before.
    since: (Instant, f64),
    /// Held until the process ends, however it ends.
    _lock: File,
}

/// What was found where a run is to be.
pub enum Opened {
    /// Nothing: the run begins.
    Fresh(RunDir),
    /// Some stages: the run goes on after them, with this agent.
    Resumed(RunDir, Box<AgentState>),
    /// All stages.
    Finished(RunDir),
}

/// The path of a stage's checkpoint within a run.
pub fn stage_checkpoint(run: &Path, stage: u16) -> PathBuf {
    run.join("checkpoints").join(format!("stage-{stage}.safetensors"))
}

impl RunDir {
    /// Takes a run's directory: creates it, or continues it if `resume` is given.
    ///
    /// # Errors
    /// A run that is there already, is held by another process, or had other settings; and those of the file system.
    pub fn open(path: &Path, fresh: Manifest, resume: bool) -> Result<Opened> {
        fs::create_dir_all(path.join("checkpoints"))
            .with_context(|| format!("cannot create the run's directory {}", path.display()))?;
        let lock = lock(path)?;
        if !resume {
            Self::refuse_existing(path)?;
        }
        let exists = path.join("manifest.json").exists();
        let mut manifest = if exists { Manifest::read(path)? } else { fresh.clone() };
        refuse_changes(path, &manifest, &fresh)?;
        let done = manifest.stages_done;

        let agent = match done.checked_sub(1) {
            None => None,
            Some(last) => Some(last_agent(path, last, &manifest)?),
        };
        let mut evaluations = if exists { evaluations::read(path)? } else { Vec::new() };
        evaluations.retain(|row| row.stage < done);
        let finished = usize::from(done) == manifest.stages.len();
        if finished && manifest.status != Status::Finished {
            manifest.status = Status::Finished;
            manifest.write(path)?;
        } else if !finished {
            manifest.status = Status::Running;
            manifest.command.clone_from(&fresh.command);
            manifest.plasticity_interval = fresh.plasticity_interval;
            manifest.versions = fresh.versions;
            manifest.host = fresh.host;
            manifest.write(path)?;
        }
        let since = (Instant::now(), manifest.seconds);
        let progress = StageLog::open(&path.join("progress.csv"), done)?;
        let plasticity = StageLog::open(&path.join("plasticity.csv"), done)?;
        let dir = Self { path: path.to_owned(), manifest, progress, plasticity, evaluations, since, _lock: lock };
        Ok(match agent {
            _ if finished => Opened::Finished(dir),
            None => Opened::Fresh(dir),
            Some(agent) => Opened::Resumed(dir, Box::new(agent)),
        })
    }

    /// Refuses a directory that holds a run.
    ///
    /// # Errors
    /// Names the flags that resolve it.
    pub fn refuse_existing(path: &Path) -> Result<()> {
        if !path.join("manifest.json").exists() {
            return Ok(());
        }
        let message = "holds a run already: continue it with --resume, or choose another folder with --out";
        Err(UserError::new(format!("{} {message}", path.display())).into())
    }

    /// Starts the run's clock, which stood while it waited for its turn.
    pub fn take_up(&mut self) {
        self.since.0 = Instant::now();
    }

    /// Where it is.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Stages finished so far.
    pub fn stages_done(&self) -> u16 {
        self.manifest.stages_done
    }

    /// What is recorded of the L2 penalty's dose.
    pub fn dose(&self) -> &Value {
        &self.manifest.dose
    }

    /// Everything evaluated so far.
    pub fn evaluations(&self) -> &[Row] {
        &self.evaluations
    }

    /// Writes the resolved config.
    ///
    /// # Errors
    /// Those of the file system.
    pub fn write_config(&self, yaml: &str) -> Result<()> {
        let path = self.path.join("config.yaml");
        atomic::write(&path, yaml.as_bytes()).with_context(|| format!("cannot write {}", path.display()))
    }

    /// Appends a row to `progress.csv`: `timesteps` of the stage, and `metrics`.
    ///
    /// # Errors
    /// Those of the file system.
    pub fn log(&mut self, stage: &Stage, timesteps: u64, cumulative: u64, metrics: &Metrics) -> Result<()> {
        self.progress.append(&progress_place(stage, timesteps, cumulative, self.seconds()), metrics)
    }

    /// Appends a row to `plasticity.csv`: `timesteps` of the stage, and `measures`.
    ///
    /// # Errors
    /// Those of the file system.
    pub fn log_plasticity(
        &mut self,
        stage: &Stage,
        timesteps: u64,
        cumulative: u64,
        measures: &[(String, f64)],
    ) -> Result<()> {
        self.plasticity.append(&plasticity_place(stage, timesteps, cumulative), measures)
    }

    /// Writes results of all levels, `stage` stages being done (`Before`) or the stage just trained (`After`).
    ///
    /// # Errors
    /// Those of the file system.
    pub fn evaluated(&mut self, phase: Phase, stage: u16, results: &[LevelResult]) -> Result<()> {
        let rows = |result: &LevelResult| {
            let row = |episode| Row { phase, stage, level: result.level.clone(), episode };
            result.episodes.iter().cloned().map(row).collect::<Vec<_>>()
        };
        self.evaluations.extend(results.iter().flat_map(rows));
        evaluations::write(&self.path, &self.evaluations)
    }

    /// Ends a stage: its checkpoint, then the manifest that counts it.
    ///
    /// # Errors
    /// Those of the file system.
    pub fn finish_stage(&mut self, stage: &Stage, network: &Network, agent: &AgentState, dose: Value) -> Result<()> {
        self.progress.sync()?;
        self.plasticity.sync()?;
        let checkpoint = Checkpoint {
            network: network.clone(),
            agent: agent.clone(),
            has_adam: true,
            origin: Origin {
                height: stage.level.height(),
                width: stage.level.width(),
                seed: Some(agent.seed),
                stage: Some(stage.index),
                level: Some(stage.level.name().to_owned()),
                source: concat!("cpp-rl ", env!("CARGO_PKG_VERSION")).to_owned(),
            },
        };
        let path = stage_checkpoint(&self.path, stage.index);
        checkpoint.write(&path).with_context(|| format!("cannot write {}", path.display()))?;
        self.manifest.stages_done = stage.index + 1;
        self.manifest.dose = dose;
        if usize::from(self.manifest.stages_done) == self.manifest.stages.len() {
            self.manifest.status = Status::Finished;
        }
        self.write_manifest()
    }

    /// Records why the run cannot go on.
    ///
    /// # Errors
    /// Those of the file system.
    pub fn fail(&mut self, why: &str) -> Result<()> {
        self.manifest.status = Status::Failed(why.to_owned());
        self.write_manifest()
    }

    fn write_manifest(&mut self) -> Result<()> {
        self.manifest.seconds = self.seconds();
        self.manifest.write(&self.path)
    }

    /// Seconds spent on the run, over all starts.
    fn seconds(&self) -> f64 {
        let (start, before) = self.since;
        before + start.elapsed().as_secs_f64()
    }
}

/// The agent after stage `last`, if its checkpoint is this run's.
fn last_agent(path: &Path, last: u16, manifest: &Manifest) -> Result<AgentState> {
    let file = stage_checkpoint(path, last);
    let Checkpoint { agent, origin, has_adam, .. } = Checkpoint::read(&file)?;
    let level = manifest.stages.get(usize::from(last)).map(|stage| stage.level.clone());
    if !has_adam || (origin.seed, origin.stage, origin.level) != (Some(manifest.seed), Some(last), level) {
        let message = "is not the checkpoint that this run wrote: put it back, or start a new run with --out";
        return Err(UserError::new(format!("{} {message}", file.display())).into());
    }
    Ok(agent)
}

/// Keeps other processes out; the operating system lets go of the lock when this one ends, however it ends.
fn lock(path: &Path) -> Result<File> {
    let file = path.join(".lock");
    let lock = File::create(&file).with_context(|| format!("cannot create {}", file.display()))?;
    match lock.try_lock() {
        Ok(()) => Ok(lock),
        Err(TryLockError::WouldBlock) => Err(UserError::new(format!(
            "{} is being written by another process: wait for it, or choose another folder with --out",
            path.display()
        ))
        .into()),
        Err(TryLockError::Error(error)) => Err(error).with_context(|| format!("cannot lock {}", file.display())),
    }
}

/// Refuses to continue a run with anything but the settings it began with.
fn refuse_changes(path: &Path, old: &Manifest, new: &Manifest) -> Result<()> {
    let mut changes = differences(&old.config, &new.config);
    if old.stages != new.stages {
        let list = |m: &Manifest| m.stages.iter().map(|s| format!("{} × {}", s.level, s.timesteps)).collect::<Vec<_>>();
        let (old, new) = (list(old).join(", "), list(new).join(", "));
        changes.push(format!("stages: {old} → {new}{}", if old == new { " (a map has changed)" } else { "" }));
    }
    for (key, old, new) in [("kernel", &old.kernel, &new.kernel), ("device", &old.device, &new.device)] {
        if old != new {
            changes.push(format!("{key}: {old} → {new}"));
        }
    }
    if changes.is_empty() {
        return Ok(());
    }
    Err(UserError::new(format!(
        "{} was started with other settings:\n  {}\ncontinue it with its own settings, or start a new run with --out",
        path.display(),
        changes.join("\n  ")
    ))
    .into())
}

/// The keys in which two configs differ, as `key: old → new`.
pub fn differences(old: &Map<String, Value>, new: &Map<String, Value>) -> Vec<String> {
    let show = |value: Option<&Value>| value.map_or_else(|| "absent".to_owned(), Value::to_string);
    let keys = old.keys().chain(new.keys().filter(|key| !old.contains_key(*key)));
    keys.filter(|key| old.get(*key) != new.get(*key))
        .map(|key| format!("{key}: {} → {}", show(old.get(key)), show(new.get(key))))
        .collect()
}
