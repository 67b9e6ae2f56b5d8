//! A run's directory: the only code that writes under `runs/`.
//!
//! After a kill a run is continued from its newest snapshot (`checkpoints/latest/`) or stage checkpoint. Each says how far
//! the logs had grown. On resume the logs are cut back to that, and what follows is written again with the same bytes.
//! All other files appear whole or not at all. docs/reliability.md explains it for users.

mod agent_file;
mod atomic;
mod best;
pub mod checkpoint;
mod container;
pub mod evaluations;
mod first_agent;
mod learning;
pub mod lock;
pub mod logs;
pub mod manifest;
mod open;
mod plan;
pub mod retention;
mod rows;
mod settings;
mod snapshot;
mod standing;
mod tensorboard;

use std::fs;
use std::path::{Path, PathBuf};
use std::time::Instant;

use anyhow::{Context, Result};
use coverage_env::Sensor;
use event_file::SessionStatus;
use tracing::debug;

use crate::agent::algorithm::Algorithm;
use crate::agent::network::Network;
use crate::agent::snapshot::Snapshot;
use crate::agent::state::AgentState;
use crate::agent::{Metrics, Stage};
use crate::dose::StageDose;
use crate::measure::probe::Measurement;
use crate::results::{LevelResult, Policy};
use best::{Best, best_checkpoint};
use checkpoint::{Checkpoint, Origin};
use evaluations::{Evaluations, Phase, Row};
use lock::Lock;
use logs::{LEARNING, Logs, Marks, PLASTICITY, PROGRESS, TENSORBOARD};
use manifest::{Manifest, Status};
use rows::{LogColumns, When};
use snapshot::SavedSnapshot;

pub use atomic::{write as write_file, write_with as write_file_with};
pub use lock::is_held;
pub use open::Opened;
pub use plan::{Parents, Plan};
pub use settings::differences;
pub use standing::Standing;

/// What writes the files.
const SOURCE: &str = concat!("cpp-rl ", env!("CARGO_PKG_VERSION"));
/// Snapshots kept of the running stage; a run that may be extended has one at its end.
const KEPT_SNAPSHOTS: usize = 2;

/// The directory of one run, locked for this process.
pub struct RunDir {
    path: PathBuf,
    manifest: Manifest,
    logs: Logs,
    columns: LogColumns,
    evaluations: Evaluations,
    best: Best,
    algorithm: Box<dyn Algorithm>,
    sensor: &'static dyn Sensor,
    network: Network,
    extensible: bool,
    /// What the running stage has measured of the L2 penalty.
    dose: StageDose,
    /// The newest file to go on from.
    newest: Option<PathBuf>,
    /// When this process took the run up, and the seconds spent before.
    since: (Instant, f64),
    _lock: Lock,
}

/// The path of a stage's checkpoint within a run.
pub fn stage_checkpoint(run: &Path, stage: u16) -> PathBuf {
    run.join("checkpoints").join(format!("stage-{stage}.safetensors"))
}

impl RunDir {
    /// Where it is.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Stages finished so far.
    pub fn stages_done(&self) -> u16 {
        self.manifest.stages_done
    }

    /// Timesteps that the schedules of a stage span, where the run was extended.
    pub fn horizon(&self, stage: u16) -> Option<u64> {
        self.manifest.stages.get(usize::from(stage))?.horizon
    }

    /// Everything evaluated so far.
    pub fn evaluations(&self) -> &[Row] {
        self.evaluations.rows()
    }

    /// The newest file that a start could go on from.
    pub fn newest_checkpoint(&self) -> Option<&Path> {
        self.newest.as_deref()
    }

    /// Writes the resolved config.
    ///
    /// # Errors
    /// Those of the file system.
    pub fn write_config(&self, yaml: &str) -> Result<()> {
        let path = self.path.join("config.yaml");
        atomic::write(&path, yaml.as_bytes()).with_context(|| format!("cannot write {}", path.display()))
    }

    /// Appends a row to `progress.csv`: `timesteps` of the stage, `cumulative` ones of all stages, and `metrics`.
    ///
    /// # Errors
    /// Those of the file system.
    pub fn log(&mut self, stage: &Stage, timesteps: u64, cumulative: u64, metrics: &Metrics) -> Result<()> {
        let when = When { timesteps, cumulative, seconds: self.seconds() };
        let row = rows::progress(&mut self.columns.progress, stage, when, metrics)?;
        self.logs.append(PROGRESS, &row)?;
        self.dose.measure(metrics);
        let stage = ("stage", f64::from(stage.index));
        let metrics = [stage].into_iter().chain(metrics.iter().copied());
        self.tensorboard(&tensorboard::progress(cumulative, when.fps(), metrics))
    }

    /// Appends a row to `plasticity.csv`: `timesteps` of the stage, `cumulative` ones of all stages, and the measures.
    ///
    /// # Errors
    /// Those of the file system.
    pub fn log_plasticity(
        &mut self,
        stage: &Stage,
        timesteps: u64,
        cumulative: u64,
        measurement: &Measurement,
    ) -> Result<()> {
        let when = When { timesteps, cumulative, seconds: self.seconds() };
        let row = rows::plasticity(&mut self.columns.plasticity, stage, when, &measurement.measures)?;
        self.logs.append(PLASTICITY, &row)?;
        self.tensorboard(&tensorboard::plasticity(cumulative, measurement))
    }

    /// Appends records to TensorBoard's log.
    fn tensorboard(&mut self, records: &[u8]) -> Result<()> {
        if self.logs.is_empty(TENSORBOARD) {
            self.logs.append(TENSORBOARD, &tensorboard::beginning(&self.manifest))?;
        }
        self.logs.append(TENSORBOARD, records)
    }

    /// Appends rows to `learning.csv`: what both policies earn in the midst of a stage, after `timesteps` of the stage and
    /// `cumulative` ones of all stages.
    ///
    /// # Errors
    /// Those of the file system.
    pub fn log_learning(
        &mut self,
        stage: &Stage,
        timesteps: u64,
        cumulative: u64,
        results: &[(Policy, LevelResult)],
    ) -> Result<()> {
        let when = When { timesteps, cumulative, seconds: self.seconds() };
        let rows = rows::learning(&mut self.columns.learning, stage, when, results)?;
        self.logs.append(LEARNING, &rows)?;
        self.tensorboard(&tensorboard::learning(cumulative, results))
    }

    /// Keeps an agent in the midst of a stage, if none of the stage has had such a greedy `mean` return on its level.
    ///
    /// # Errors
    /// Those of the file system.
    pub fn keep_best(&mut self, stage: &Stage, agent: &AgentState, mean: f64) -> Result<()> {
        if self.best.is_beaten(stage.index, mean) {
            let path = best_checkpoint(&self.path, stage.index);
            let written = self.checkpoint(stage, agent).write(&path);
            written.with_context(|| format!("cannot write {}", path.display()))?;
            self.best = Best::new(stage.index, mean);
        }
        Ok(())
    }

    /// Writes results of all levels, `stage` stages being done (`Before`) or the stage just trained (`After`), after
    /// these timesteps of all stages.
    ///
    /// # Errors
    /// Those of the file system.
    pub fn evaluated(
        &mut self,
        phase: Phase,
        stage: u16,
        cumulative: u64,
        results: &[(Policy, LevelResult)],
    ) -> Result<()> {
        self.evaluations.add(&self.path, phase, stage, results)?;
        self.tensorboard(&tensorboard::evaluation(cumulative, results))
    }

    /// Saves a run within a stage. If the process ends, the run continues from there.
    ///
    /// # Errors
    /// Those of the file system; what was saved before is then still whole.
    pub fn save(&mut self, stage: &Stage, snapshot: Snapshot) -> Result<()> {
        self.logs.sync()?;
        let timesteps = snapshot.agent.counters.timesteps;
        let before = timesteps - snapshot.position.timesteps;
        let saved = SavedSnapshot {
            stage: stage.index,
            snapshot,
            dose: self.dose,
            seconds: self.seconds(),
            marks: self.marks(),
        };
        let path = snapshot::path(&self.path, timesteps);
        saved.write(&path, &self.network).with_context(|| format!("cannot write {}", path.display()))?;
        self.newest = Some(path);
        self.retain(KEPT_SNAPSHOTS, before)?;
        debug!("{}: saved after {timesteps} timesteps", self.path.display());
        Ok(())
    }

    /// Ends a stage: its checkpoint, then the manifest that counts it.
    ///
    /// # Errors
    /// Those of the file system.
    pub fn finish_stage(&mut self, stage: &Stage, agent: &AgentState) -> Result<()> {
        let is_last = usize::from(stage.index) + 1 == self.manifest.stages.len();
        if is_last {
            self.tensorboard(&tensorboard::end(SessionStatus::Success))?;
        }
        self.logs.sync()?;
        let path = stage_checkpoint(&self.path, stage.index);
        self.checkpoint(stage, agent).write(&path).with_context(|| format!("cannot write {}", path.display()))?;
        self.newest = Some(path);
        self.manifest.stages_done = stage.index + 1;
        self.manifest.marks.truncate(stage.index.into());
        self.manifest.marks.push(self.marks());
        if let Some(dose) = &mut self.manifest.dose {
            dose.end_stage(std::mem::take(&mut self.dose), &agent.parameters);
        }
        if is_last {
            self.manifest.status = Status::Finished;
        }
        self.write_manifest()?;
        self.retain(1, agent.counters.timesteps)
    }

    /// Records that a signal stopped the run, whose state has been saved.
    ///
    /// # Errors
    /// Those of the file system.
    pub fn interrupt(&mut self) -> Result<()> {
        self.manifest.status = Status::Interrupted;
        self.write_manifest()
    }

    /// Records why the run cannot go on, and closes its logs.
    ///
    /// # Errors
    /// Those of the file system.
    pub fn fail(&mut self, why: &str) -> Result<()> {
        // What ended the run may also prevent this write. The manifest is what counts.
        let _ = self.tensorboard(&tensorboard::end(SessionStatus::Failure));
        // Other runs of this process need open files too.
        self.logs = Logs::closed(&self.path);
        self.manifest.status = Status::Failed(why.to_owned());
        self.write_manifest()
    }

    /// The checkpoint of an agent of this stage.
    fn checkpoint(&self, stage: &Stage, agent: &AgentState) -> Checkpoint {
        Checkpoint {
            algorithm: self.algorithm.clone(),
            sensor: self.sensor,
            network: self.network.clone(),
            agent: agent.clone(),
            has_adam: true,
            origin: Origin {
                height: stage.level.height(),
                width: stage.level.width(),
                seed: Some(agent.seed),
                stage: Some(stage.index),
                level: Some(stage.level.name().to_owned()),
                source: SOURCE.to_owned(),
            },
        }
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

    /// How far all files have grown that are added to.
    fn marks(&self) -> Marks {
        let mut marks = self.logs.marks();
        marks.extend(self.evaluations.mark().map(|mark| (evaluations::FILE.to_owned(), mark)));
        marks
    }

    /// Removes the snapshots of stages that ended, the last of them after `ended` timesteps, and all but the `keep` last.
    fn retain(&self, keep: usize, ended: u64) -> Result<()> {
        // A run that may be extended goes on in its only stage, ended or not.
        let ended = if self.extensible { 0 } else { ended };
        let remove = || {
            let superseded = retention::superseded(&snapshot::list(&self.path)?, keep, ended);
            superseded.into_iter().try_for_each(|timesteps| fs::remove_file(snapshot::path(&self.path, timesteps)))
        };
        remove().with_context(|| format!("cannot tidy up {}", snapshot::folder(&self.path).display()))
    }
}
