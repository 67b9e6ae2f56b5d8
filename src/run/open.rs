//! Taking a run's directory: a new one, or one that is continued.

use std::path::{Path, PathBuf};
use std::time::Instant;

use anyhow::{Context, Result};

use super::best::Best;
use super::checkpoint::FileError;
use super::evaluations::{self, Evaluations};
use super::lock::Lock;
use super::logs::Logs;
use super::manifest::{self, Start, Status};
use super::rows::LogColumns;
use super::standing::{self, Found, Standing};
use super::{Plan, RunDir, atomic, settings, snapshot, stage_checkpoint};
use crate::error::UserError;

/// A run's directory as it was found.
pub struct Opened {
    /// The directory.
    pub dir: RunDir,
    /// Where the run goes on.
    pub standing: Standing,
    /// What the user should know, such as that a damaged file was passed over.
    pub notices: Vec<String>,
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
        refuse_lost_manifest(path, plan.curriculum.begins)?;
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
            manifest.evaluate_every = plan.evaluate_every;
            manifest.versions = start.versions.clone();
            manifest.host = start.host.clone();
            manifest.starts.push(start);
            manifest.write(path)?;
        }
        let evaluated = marks.get(evaluations::FILE).copied().unwrap_or_default();
        let evaluations = match standing {
            Standing::Finished => Evaluations::finished(path, evaluated)?,
            _ => Evaluations::beginning(path, evaluated)?,
        };
        let since = (Instant::now(), seconds.unwrap_or(manifest.seconds));
        let (logs, columns, best) = match standing {
            Standing::Finished => (Logs::closed(path), LogColumns::default(), Best::default()),
            _ => {
                let logs = Logs::cut_back(path, &marks)?;
                let (best, notice) =
                    if plan.keep_best { Best::find(path, manifest.stages_done)? } else { Default::default() };
                notices.extend(notice);
                (logs, LogColumns::of_run(path)?, best)
            }
        };
        let dir = Self {
            path: path.to_owned(),
            manifest,
            logs,
            columns,
            evaluations,
            best,
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
fn refuse_lost_manifest(run: &Path, begins: u16) -> Result<()> {
    let snapshots = snapshot::list(run).with_context(|| format!("cannot list {}", run.display()))?;
    if run.join(manifest::FILE).exists() || (snapshots.is_empty() && !stage_checkpoint(run, begins).exists()) {
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
