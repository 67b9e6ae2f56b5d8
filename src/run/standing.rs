//! Where a run stands: the newest state that is whole.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result};

use super::checkpoint::{Checkpoint, CheckpointError};
use super::logs::{self, Marks};
use super::manifest::Manifest;
use super::snapshot::{self, SavedSnapshot};
use super::{Plan, stage_checkpoint};
use crate::agent::Stage;
use crate::agent::network::Network;
use crate::agent::snapshot::Snapshot;
use crate::agent::state::AgentState;
use crate::dose::StageDose;
use crate::error::UserError;

/// Where a run goes on.
#[derive(Debug)]
pub enum Standing {
    /// Nothing is done.
    Fresh,
    /// After a stage, with this agent.
    Between(Box<AgentState>),
    /// In the midst of a stage, which has measured this dose.
    Within(Box<Snapshot>, StageDose),
    /// Nowhere: all stages are done.
    Finished,
}

impl Standing {
    /// Timesteps of all stages so far.
    pub fn timesteps(&self) -> u64 {
        match self {
            Self::Between(agent) => agent.counters.timesteps,
            Self::Within(snapshot, _) => snapshot.agent.counters.timesteps,
            Self::Fresh | Self::Finished => 0,
        }
    }
}

/// What was found of a run.
pub(super) struct Found {
    pub standing: Standing,
    /// How far its files had grown.
    pub marks: Marks,
    /// Seconds spent on it, where that is not the manifest's to say.
    pub seconds: Option<f64>,
    /// The file that it goes on from.
    pub file: Option<PathBuf>,
    /// What the user should know.
    pub notices: Vec<String>,
}

/// Finds the newest whole state of a run: a snapshot of the running stage, else the end of the stage before.
///
/// `extended` says that the run was done and is to go on.
///
/// # Errors
/// Names the file that would be needed and is damaged.
pub(super) fn find(
    run: &Path,
    manifest: &Manifest,
    plan: &Plan<'_>,
    network: &Network,
    extended: bool,
) -> Result<Found> {
    let done = manifest.stages_done;
    let mut notices = Vec::new();
    if let Some(stage) = plan.stages.get(usize::from(done)) {
        for timesteps in snapshot::list(run).with_context(|| format!("cannot list {}", run.display()))? {
            let file = snapshot::path(run, timesteps);
            match whole(run, &file, manifest, plan, stage, network) {
                Ok(None) => {}
                Ok(Some(saved)) => {
                    notices.extend(damaged_stages(run, done));
                    return Ok(Found {
                        standing: Standing::Within(Box::new(saved.snapshot), saved.dose),
                        marks: saved.marks,
                        seconds: Some(saved.seconds),
                        file: Some(file),
                        notices,
                    });
                }
                Err(problem) => {
                    notices.push(format!("{}: {problem}; going on from what was saved before", file.display()));
                }
            }
        }
        if extended {
            return Err(UserError::new(format!(
                "{} cannot be extended, since no snapshot of its end is whole: start a new run with --out\n  {}",
                run.display(),
                notices.join("\n  ")
            ))
            .into());
        }
    }
    let Some(last) = done.checked_sub(1) else {
        let (standing, marks) = (Standing::Fresh, Marks::new());
        return Ok(Found { standing, marks, seconds: None, file: None, notices });
    };
    let agent = last_agent(run, last, manifest)?;
    let finished = usize::from(done) == plan.stages.len();
    let marks = match manifest.marks.get(usize::from(last)) {
        Some(marks) => marks.clone(),
        None if finished => Marks::new(),
        None => {
            let message = "was begun by a version of cpp-rl that this one cannot go on from: finish it with that version, \
                           or start a new run with --out";
            return Err(UserError::new(format!("{} {message}", run.display())).into());
        }
    };
    logs::check(run, &marks)
        .map_err(|problem| UserError::new(format!("{problem}: put it back, or start a new run with --out")))?;
    let standing = if finished { Standing::Finished } else { Standing::Between(Box::new(agent)) };
    Ok(Found { standing, marks, seconds: None, file: Some(stage_checkpoint(run, last)), notices })
}

/// A snapshot of `stage`, if it and all that it relies on is whole; nothing if it is one of an earlier stage.
fn whole(
    run: &Path,
    file: &Path,
    manifest: &Manifest,
    plan: &Plan<'_>,
    stage: &Stage,
    network: &Network,
) -> Result<Option<SavedSnapshot>, String> {
    let saved = SavedSnapshot::read(file, network)?;
    if saved.stage < stage.index {
        return Ok(None);
    }
    let agent = &saved.snapshot.agent;
    if agent.seed != manifest.seed || file != snapshot::path(run, agent.counters.timesteps) {
        return Err("not a snapshot that this run wrote".to_owned());
    }
    saved.snapshot.check(plan.config, stage).map_err(|error| error.to_string())?;
    logs::check(run, &saved.marks)?;
    Ok(Some(saved))
}

/// What to say of finished stages whose checkpoints are damaged: the run goes on without them.
fn damaged_stages(run: &Path, done: u16) -> impl Iterator<Item = String> {
    let checkpoints = (0..done).map(|stage| Checkpoint::read(&stage_checkpoint(run, stage)));
    checkpoints.filter_map(Result::err).map(|error| format!("{error}; the run does not need it to go on"))
}

/// The agent after stage `last`, if its checkpoint is this run's.
fn last_agent(run: &Path, last: u16, manifest: &Manifest) -> Result<AgentState, CheckpointError> {
    let file = stage_checkpoint(run, last);
    let Checkpoint { agent, origin, has_adam, .. } = Checkpoint::read(&file)?;
    let level = manifest.stages.get(usize::from(last)).map(|stage| stage.level.clone());
    if !has_adam || (origin.seed, origin.stage, origin.level) != (Some(manifest.seed), Some(last), level) {
        let message = "not the checkpoint that this run wrote: put it back, or start a new run with --out";
        return Err(CheckpointError::new(&file, message));
    }
    Ok(agent)
}
