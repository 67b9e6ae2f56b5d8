//! Where a run stands: the newest state that is whole.

use std::fmt::Display;
use std::ops::Range;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result};

use super::checkpoint::{Checkpoint, FileError};
use super::first_agent::{first_agent, stage_agent};
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
    /// Nothing is done; this agent begins.
    Fresh(Box<AgentState>),
    /// After a stage, with this agent.
    Between(Box<AgentState>),
    /// Within a stage.
    Within(Box<Snapshot>),
    /// Nowhere: all stages are done.
    Finished,
}

impl Standing {
    /// Timesteps of all stages so far.
    pub fn timesteps(&self) -> u64 {
        match self {
            Self::Between(agent) => agent.counters.timesteps,
            Self::Within(snapshot) => snapshot.agent.counters.timesteps,
            Self::Fresh(_) | Self::Finished => 0,
        }
    }
}

/// What was found of a run.
pub(super) struct Found {
    pub standing: Standing,
    /// How far its files had grown.
    pub marks: Marks,
    /// What the running stage has measured of the L2 penalty.
    pub dose: StageDose,
    /// Seconds spent on it, where that is not the manifest's to say.
    pub seconds: Option<f64>,
    /// The file that it goes on from.
    pub file: Option<PathBuf>,
    /// Newer snapshots, which are damaged, and how.
    pub damaged: Vec<(PathBuf, FileError)>,
    /// What the user should know.
    pub notices: Vec<String>,
}

/// Finds the newest whole state of a run: a snapshot of the running stage, else the end of the stage before.
///
/// Only a snapshot with damaged bytes is passed over. A snapshot that may be good but cannot be used is an error: to
/// continue from another one would throw it away.
///
/// `extended` says that the run was done and is to go on.
///
/// # Errors
/// Names the file that would be needed and is damaged, or that somebody must mend or move away.
pub(super) fn find(
    run: &Path,
    manifest: &Manifest,
    plan: &Plan<'_>,
    network: &Network,
    extended: bool,
) -> Result<Found> {
    let done = manifest.stages_done;
    let mut damaged = Vec::new();
    if let Some(stage) = plan.curriculum.stages.get(usize::from(done)) {
        for timesteps in snapshot::list(run).with_context(|| format!("cannot list {}", run.display()))? {
            let file = snapshot::path(run, timesteps);
            let saved = match SavedSnapshot::read(&file, network) {
                Err(problem @ FileError::Damaged(_)) => {
                    damaged.push((file, problem));
                    continue;
                }
                saved => saved.map_err(|problem| unreadable(&file, &problem))?,
            };
            // Of a stage that has ended; it goes when the next one is saved.
            if saved.stage < stage.index {
                continue;
            }
            check(run, &file, &saved, manifest, plan, stage)?;
            return Ok(Found {
                standing: Standing::Within(Box::new(saved.snapshot)),
                dose: saved.dose,
                marks: saved.marks,
                seconds: Some(saved.seconds),
                file: Some(file),
                damaged,
                notices: damaged_stages(run, plan.curriculum.begins..done),
            });
        }
        if extended {
            let each = damaged.iter().map(|(file, problem)| format!("\n  {}: {problem}", file.display()));
            return Err(UserError::new(format!(
                "{} cannot be extended, since no snapshot of its end is whole: start a new run with --out{}",
                run.display(),
                each.collect::<String>()
            ))
            .into());
        }
    }
    let Some(last) = done.checked_sub(1).filter(|_| done > plan.curriculum.begins) else {
        let (standing, marks) = (Standing::Fresh(Box::new(first_agent(plan, network)?)), Marks::new());
        return Ok(Found {
            standing,
            marks,
            dose: StageDose::default(),
            seconds: None,
            file: None,
            damaged,
            notices: Vec::new(),
        });
    };
    let agent = stage_agent(run, last, plan, &plan.config.copies(), network).map_err(needed)?;
    let finished = usize::from(done) == plan.curriculum.stages.len();
    let marks = match manifest.marks.get(usize::from(last)) {
        Some(marks) => marks.clone(),
        None if finished => Marks::new(),
        None => {
            let message = "was begun by an older cpp-rl, and this version cannot continue it: finish it with that version, \
                           or start a new run with --out";
            return Err(UserError::new(format!("{} {message}", run.display())).into());
        }
    };
    logs::check(run, &marks).map_err(needed)?;
    let standing = if finished { Standing::Finished } else { Standing::Between(Box::new(agent)) };
    let file = Some(stage_checkpoint(run, last));
    Ok(Found { standing, marks, dose: StageDose::default(), seconds: None, file, damaged, notices: Vec::new() })
}

/// What to do about a snapshot that cannot be read but may be whole.
fn unreadable(file: &Path, problem: &FileError) -> UserError {
    let remedy = match problem {
        FileError::Unreadable(_) => "make it readable",
        _ => "continue it with the version of cpp-rl that wrote it",
    };
    refused(file, format_args!("{}: {problem}", file.display()), remedy)
}

/// Checks that a snapshot is this run's, and that all it relies on is whole.
fn check(
    run: &Path,
    file: &Path,
    saved: &SavedSnapshot,
    manifest: &Manifest,
    plan: &Plan<'_>,
    stage: &Stage,
) -> Result<(), UserError> {
    let agent = &saved.snapshot.agent;
    let foreign = |problem: &dyn Display| {
        refused(file, format_args!("{}: {problem}", file.display()), "start a new run with --out")
    };
    if agent.seed != manifest.seed || file != snapshot::path(run, agent.counters.timesteps) {
        return Err(foreign(&"not a snapshot that this run wrote"));
    }
    saved.snapshot.check(plan.config, stage).map_err(|problem| foreign(&problem))?;
    logs::check(run, &saved.marks).map_err(|problem| refused(file, problem, "put it back as it was"))
}

/// A snapshot that the run can neither use nor pass over: the user decides.
fn refused(file: &Path, problem: impl Display, remedy: &str) -> UserError {
    let otherwise = format!("or move {} away to continue from an older save", file.display());
    UserError::new(format!("{problem}; {remedy}, {otherwise}"))
}

/// What to say of finished stages whose checkpoints are damaged: the run goes on without them.
fn damaged_stages(run: &Path, done: Range<u16>) -> Vec<String> {
    let checkpoints = done.map(|stage| Checkpoint::read(&stage_checkpoint(run, stage)));
    checkpoints.filter_map(Result::err).map(|error| format!("{error}; the run continues without it")).collect()
}

/// What is wrong with a file that the run cannot go on without.
fn needed(problem: impl Display) -> UserError {
    UserError::new(format!("{problem}; put it back, or start a new run with --out"))
}
