//! A run's directory: the only code that writes under `runs/`.
//!
//! After a kill a run is continued from its newest snapshot (`checkpoints/latest/`) or stage checkpoint. Each says how far
//! the logs had grown. On resume the logs are cut back to that, and what follows is written again with the same bytes.
//! All other files appear whole or not at all. docs/reliability.md explains it for users.

mod agent_file;
mod atomic;
pub mod checkpoint;
mod container;
pub mod evaluations;
pub mod lock;
pub mod logs;
pub mod manifest;
mod parents;
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
use crate::agent::config::Config;
use crate::agent::network::Network;
use crate::agent::snapshot::Snapshot;
use crate::agent::state::AgentState;
use crate::agent::{Metrics, Stage};
use crate::dose::StageDose;
use crate::error::UserError;
use crate::experiment::Curriculum;
use crate::measure::probe::Measurement;
use crate::results::LevelResult;
use checkpoint::{Checkpoint, FileError, Origin};
use evaluations::{Phase, Row};
use lock::Lock;
use logs::{Logs, Mark, Marks, PLASTICITY, PROGRESS, TENSORBOARD};
use manifest::{Engine, Manifest, Start, Status};
use rows::{Columns, When};
use snapshot::SavedSnapshot;
use standing::Found;

pub use atomic::write as write_file;
pub use lock::is_held;
pub use parents::Parents;
pub use settings::differences;
pub use standing::Standing;

/// What writes the files.
const SOURCE: &str = concat!("cpp-rl ", env!("CARGO_PKG_VERSION"));
/// Snapshots kept of the running stage; a run that may be extended has one at its end.
const KEPT_SNAPSHOTS: usize = 2;

/// What a run is to be, as a start asks for it.
#[derive(Clone, Debug)]
pub struct Plan<'a> {
    /// Its settings.
    pub config: &'a Config,
    /// Its stages, and the levels that it is evaluated on.
    pub curriculum: &'a Curriculum,
    /// What it goes on from, if it is a fork.
    pub parents: Option<&'a Parents>,
    /// The seed's number.
    pub seed: u64,
    /// What computes its networks.
    pub engine: Engine,
    /// Where: `cpu` or `cuda:N`.
    pub device: String,
    /// Timesteps between two measurements of plasticity; 0 for none.
    pub plasticity_interval: u64,
    /// The command as it was typed.
    pub command: &'a [String],
    /// Whether an existing run is continued.
    pub resume: bool,
}

/// The directory of one run, locked for this process.
pub struct RunDir {
    path: PathBuf,
    manifest: Manifest,
    logs: Logs,
    /// Those of `progress.csv`.
    progress_columns: Columns,
    /// Those of `plasticity.csv`.
    plasticity_columns: Columns,
    evaluations: Vec<Row>,
    /// That of the file of evaluations as it stands.
    evaluated: Mark,
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

/// A run's directory as it was found.
pub struct Opened {
    /// The directory.
    pub dir: RunDir,
    /// Where the run goes on.
    pub standing: Standing,
    /// What the user should know, such as that a damaged file was passed over.
    pub notices: Vec<String>,
}

/// The path of a stage's checkpoint within a run.
pub fn stage_checkpoint(run: &Path, stage: u16) -> PathBuf {
    run.join("checkpoints").join(format!("stage-{stage}.safetensors"))
}

impl RunDir {
    /// Checks whether a run could be opened, without writing anything: an error in one of many runs should be known
    /// before the first of them begins.
    ///
    /// # Errors
    /// A run that is there already, is held by another process, or had other settings.
    pub fn look(path: &Path, plan: &Plan<'_>) -> Result<()> {
        settings::settle(path, plan)?;
        Lock::try_out(path)
    }

    /// Takes a run's directory: creates it, or continues it if the plan says so.
    ///
    /// # Errors
    /// As [`RunDir::look`]; a run of which too much is damaged; and those of the file system.
    pub fn open(path: &Path, plan: &Plan<'_>) -> Result<Opened> {
        let folder = snapshot::folder(path);
        let created = atomic::create_directories(&folder);
        created.with_context(|| format!("cannot create the run's directory {}", path.display()))?;
        let lock = Lock::take(path)?;
        refuse_lost_manifest(path)?;
        let (mut manifest, extended) = settings::settle(path, plan)?;
        for directory in [path, &path.join("checkpoints"), &folder] {
            atomic::sweep(directory).with_context(|| format!("cannot tidy up {}", directory.display()))?;
        }
        let network = plan.config.network(&plan.curriculum.stages[0].level);
        let Found { standing, marks, dose, seconds, file, damaged, mut notices } =
            standing::find(path, &manifest, plan, &network, extended)?;
        if let Standing::Finished = standing {
            if manifest.status != Status::Finished {
                manifest.status = Status::Finished;
                manifest.write(path)?;
            }
        } else {
            notices.extend(set_aside(damaged, &standing)?);
            manifest.plan_dose(plan);
            let start = Start::here(plan.command, standing.timesteps());
            notices.extend(manifest.starts.last().and_then(|last| other_instructions(path, last, &start)));
            manifest.status = Status::Running;
            manifest.command.clone_from(&start.command);
            manifest.plasticity_interval = plan.plasticity_interval;
            manifest.versions = start.versions.clone();
            manifest.host = start.host.clone();
            manifest.starts.push(start);
            manifest.write(path)?;
        }
        let evaluated = marks.get(evaluations::FILE).copied().unwrap_or_default();
        let evaluations = match standing {
            Standing::Finished => evaluations::read(path)?,
            _ => evaluations::read_beginning(path, evaluated.bytes)?,
        };
        let since = (Instant::now(), seconds.unwrap_or(manifest.seconds));
        let (logs, progress_columns, plasticity_columns) = match standing {
            Standing::Finished => (Logs::closed(path), Columns::default(), Columns::default()),
            _ => {
                let logs = Logs::cut_back(path, &marks)?;
                (logs, Columns::of_log(&path.join(PROGRESS))?, Columns::of_log(&path.join(PLASTICITY))?)
            }
        };
        let dir = Self {
            path: path.to_owned(),
            manifest,
            logs,
            progress_columns,
            plasticity_columns,
            evaluations,
            evaluated,
            algorithm: plan.config.algorithm.clone(),
            sensor: plan.config.shared.sensor,
            network,
            extensible: plan.curriculum.extensible,
            dose,
            newest: file,
            since,
            _lock: lock,
        };
        if let Standing::Finished = standing {
            // A kill may have come between the end of the last stage and this.
            dir.retain(1, u64::MAX)?;
        }
        Ok(Opened { dir, standing, notices })
    }

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
        &self.evaluations
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
        let row = rows::progress(&mut self.progress_columns, stage, when, metrics)?;
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
        let row = rows::plasticity(&mut self.plasticity_columns, stage, when, &measurement.measures)?;
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

    /// Writes results of all levels, `stage` stages being done (`Before`) or the stage just trained (`After`), after
    /// these timesteps of all stages.
    ///
    /// # Errors
    /// Those of the file system.
    pub fn evaluated(&mut self, phase: Phase, stage: u16, cumulative: u64, results: &[LevelResult]) -> Result<()> {
        let rows = |result: &LevelResult| {
            let row = |episode| Row { phase, stage, level: result.level.clone(), episode };
            result.episodes.iter().cloned().map(row).collect::<Vec<_>>()
        };
        self.evaluations.extend(results.iter().flat_map(rows));
        self.evaluated = Mark::of(&evaluations::write(&self.path, &self.evaluations)?);
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
        let checkpoint = Checkpoint {
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
        };
        let path = stage_checkpoint(&self.path, stage.index);
        checkpoint.write(&path).with_context(|| format!("cannot write {}", path.display()))?;
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
        if self.evaluated.bytes > 0 {
            marks.insert(evaluations::FILE.to_owned(), self.evaluated);
        }
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

/// Puts the damaged snapshots aside that were passed over; returns what to say of each.
fn set_aside(damaged: Vec<(PathBuf, FileError)>, standing: &Standing) -> Result<Vec<String>> {
    let instead = match standing {
        Standing::Fresh(_) => "the run starts from its beginning",
        _ => "the run goes on from an older save",
    };
    let each = damaged.into_iter().map(|(file, problem)| {
        let aside = snapshot::set_aside(&file).with_context(|| format!("cannot rename {}", file.display()))?;
        Ok(format!("{}: {problem}; {instead}, and the file is kept as {}", file.display(), aside.display()))
    });
    each.collect()
}

/// Refuses a directory with a run's checkpoints but without its manifest: a new run would overwrite them.
fn refuse_lost_manifest(run: &Path) -> Result<()> {
    let snapshots = snapshot::list(run).with_context(|| format!("cannot list {}", run.display()))?;
    if run.join(manifest::FILE).exists() || (snapshots.is_empty() && !stage_checkpoint(run, 0).exists()) {
        return Ok(());
    }
    let message = "holds checkpoints but no manifest.json: put it back, or choose another folder with --out";
    Err(UserError::new(format!("{} {message}", run.display())).into())
}

/// What to say where the machine computes with other instructions than at the last start.
fn other_instructions(run: &Path, last: &Start, now: &Start) -> Option<String> {
    let (last, now) = (&last.instruction_set, &now.instruction_set);
    (last != now)
        .then(|| format!("{} goes on with {now} instead of {last}: its numbers will differ by rounding", run.display()))
}
