//! Runs as they lie on the disk, reduced while they are read.

use std::collections::{BTreeMap, BTreeSet};
use std::io;
use std::path::{Path, PathBuf};

use anyhow::Result;
use serde::Serialize;

use super::Protocol;
use super::arms::{Group, are_counterparts};
use super::levels::LevelInfo;
use super::logs::Logs;
use crate::error::UserError;
use crate::report::find::{NoRun, find_runs};
use crate::results::{Episode, LevelResult};
use crate::run::evaluations::{self, Phase, Row};
use crate::run::manifest::{Manifest, Status, Versions};

/// The folder of runs through a whole curriculum; others hold runs on one level afresh.
const CURRICULUM: &str = "curriculum";

/// One run that was found.
#[derive(Clone, Debug, Serialize)]
pub struct RunInfo {
    /// Its directory.
    pub path: PathBuf,
    /// Index into the arms.
    pub arm: usize,
    /// Its seed.
    pub seed: u64,
    /// The levels it trains on, in order.
    pub levels: Vec<String>,
    /// Stages finished.
    pub stages_done: u16,
    /// Stages in all.
    pub stages: usize,
    /// How it stands.
    pub status: Status,
    /// Rows of `progress.csv`.
    pub log_rows: u64,
    /// Those among them without a mean return (NaN), which curves step over.
    pub rows_without_return: u64,
    /// Rows of `plasticity.csv`.
    pub plasticity_rows: u64,
    /// Measures that have no value (NaN) in some of them, with how many those are.
    pub plasticity_without_value: BTreeMap<String, u64>,
    /// Rows of logs that are cut off or no numbers, which are left out.
    pub damaged_rows: u64,
    /// The versions of cpp-rl that it was made by, over all its starts.
    pub versions: Vec<String>,
    /// The instruction sets that its fused kernel used: results on another one differ by rounding.
    pub instruction_sets: Vec<String>,
}

/// A directory that should hold a run, and why it is left out.
#[derive(Clone, Debug, Serialize)]
pub struct LeftOut {
    /// The directory.
    pub path: PathBuf,
    /// What is wrong, with the file's name.
    pub why: String,
}

/// Something that should be there and is not.
#[derive(Clone, Debug, Serialize)]
pub struct Missing {
    /// Index into the arms.
    pub arm: usize,
    /// The seed.
    pub seed: u64,
    /// The levels whose stage is not done.
    pub levels: Vec<String>,
    /// Why, as far as it is known.
    pub why: String,
}

/// A run's directory and manifest.
pub(super) struct Found {
    pub(super) path: PathBuf,
    pub(super) manifest: Manifest,
}

/// A directory that should hold a run, and why it cannot be read.
type Unread = (PathBuf, anyhow::Error);

/// What is kept of a run: its size depends on the numbers of its stages and measures alone.
pub(super) struct Run {
    pub(super) path: PathBuf,
    pub(super) manifest: Manifest,
    pub(super) protocol: Protocol,
    /// By stage (none before the first) and level; finished stages only.
    pub(super) evaluations: BTreeMap<(Option<u16>, String), Evaluated>,
    pub(super) logs: Logs,
}

/// One evaluation of one level, over every start cell.
#[derive(Clone, Debug)]
pub(super) struct Evaluated {
    pub(super) mean: f64,
    pub(super) std: f64,
    pub(super) solved_share: f64,
    /// Mean length over all starts, an unsolved one counting the step limit.
    pub(super) length: f64,
    pub(super) normalised: Option<f64>,
    /// Mean length over the mean optimal length.
    pub(super) steps: Option<f64>,
    /// The same over the solved starts alone; none where none is solved.
    pub(super) steps_solved: Option<f64>,
}

/// Finds all runs in and below these directories, and what should be one and cannot be read.
pub(super) fn find(directories: &[PathBuf]) -> Result<(Vec<Found>, Vec<Unread>)> {
    let (mut paths, mut others) = (BTreeSet::new(), BTreeMap::new());
    for directory in directories {
        let cannot = |path: &Path, error: &io::Error| {
            UserError::new(format!("cannot read the directory {}: {error}", path.display()))
        };
        let found = find_runs(directory).map_err(|error| cannot(directory, &error))?;
        let is_foreign = |(_, other): &(PathBuf, NoRun)| matches!(other, NoRun::Foreign);
        let nothing = found.runs.is_empty() && found.others.iter().all(is_foreign);
        for (path, other) in found.others {
            let why = match other {
                NoRun::Unreadable(error) => cannot(&path, &error),
                NoRun::NotBegun => UserError::new(format!(
                    "{}: no manifest: the run has not begun, or was killed before it did",
                    path.display()
                )),
                NoRun::Foreign => continue,
            };
            others.insert(path, why);
        }
        if nothing {
            let message = "holds no run: give a run's directory (with a manifest.json) or a folder of runs";
            return Err(UserError::new(format!("{} {message}", directory.display())).into());
        }
        paths.extend(found.runs);
    }
    let (mut runs, mut left_out) = (Vec::new(), Vec::new());
    left_out.extend(others.into_iter().map(|(path, why)| (path, why.into())));
    for path in paths {
        match Manifest::read(&path) {
            Ok(manifest) => runs.push(Found { path, manifest }),
            Err(error) => left_out.push((path, error)),
        }
    }
    Ok((runs, left_out))
}

impl LeftOut {
    pub(super) fn new((path, error): &Unread) -> Self {
        Self { path: path.clone(), why: format!("{error:#}") }
    }
}

impl Run {
    /// Reads and reduces a run's evaluations and logs.
    pub(super) fn read(found: Found, levels: &[LevelInfo]) -> Result<Self> {
        let Found { path, manifest } = found;
        // What a killed process evaluated after its last finished stage is cut back on resume, and no result.
        let mut rows = evaluations::read(&path)?;
        rows.retain(|row| row.phase == Phase::Before || row.stage < manifest.stages_done);
        let protocol = if manifest.curriculum == CURRICULUM { Protocol::Curriculum } else { Protocol::Afresh };
        let logs = Logs::read(&path, &manifest.stages, levels)?;
        Ok(Self { evaluations: reduce(rows, levels), logs, protocol, path, manifest })
    }

    /// The number of the stage on this level, if it is done.
    pub(super) fn finished_stage(&self, level: &str) -> Option<u16> {
        let stage = self.manifest.stages.iter().position(|stage| stage.level == level)? as u16;
        (stage < self.manifest.stages_done).then_some(stage)
    }

    fn trains_on(&self, level: &str) -> bool {
        self.manifest.stages.iter().any(|stage| stage.level == level)
    }

    /// Tells of a run that is not finished, or whose logs are not whole.
    pub(super) fn warnings(&self) -> Vec<String> {
        let (done, stages) = (self.manifest.stages_done, self.manifest.stages.len());
        let path = self.path.display();
        let mut warnings = Vec::new();
        if let Some(why) = self.why_unfinished() {
            warnings.push(format!("{path}: {done} of {stages} stages are done ({why})"));
        }
        let Logs { rows, rows_without_return, damaged_rows, .. } = self.logs;
        if rows == 0 && done > 0 {
            warnings.push(format!("{path}: its progress.csv has no rows, so that it has no learning curve"));
        }
        if rows_without_return > 0 {
            warnings.push(format!("{path}: {rows_without_return} of {rows} rows of progress.csv have no mean return"));
        }
        let without_value: Vec<String> =
            self.plasticity_without_value().into_iter().map(|(measure, rows)| format!("{measure} {rows}")).collect();
        if !without_value.is_empty() {
            let (rows, each) = (self.logs.plasticity_rows, without_value.join(", "));
            warnings
                .push(format!("{path}: measures without a value in some of the {rows} rows of plasticity.csv: {each}"));
        }
        if damaged_rows > 0 {
            warnings.push(format!("{path}: {damaged_rows} rows of its logs are cut off or no numbers, and left out"));
        }
        warnings
    }

    /// The measures that have no value in some rows of `plasticity.csv`, with how many those are.
    fn plasticity_without_value(&self) -> BTreeMap<String, u64> {
        let logs = self.logs.plasticity.iter().filter(|(_, log)| log.rows_without_value > 0);
        logs.map(|(measure, log)| (measure.clone(), log.rows_without_value)).collect()
    }

    /// The versions of cpp-rl that it was made by; older manifests do not list its starts.
    pub(super) fn versions(&self) -> Vec<String> {
        let describe = |v: &Versions| format!("cpp-rl {} (commit {}, libtorch {})", v.cpp_rl, v.git, v.libtorch);
        let starts = self.manifest.starts.iter().map(|start| &start.versions);
        distinct([&self.manifest.versions].into_iter().chain(starts).map(describe))
    }

    /// The instruction sets of all starts that say theirs.
    pub(super) fn instruction_sets(&self) -> Vec<String> {
        distinct(self.manifest.starts.iter().map(|start| start.instruction_set.clone()))
    }

    fn why_unfinished(&self) -> Option<&str> {
        match &self.manifest.status {
            Status::Finished => None,
            Status::Running => Some("unfinished"),
            Status::Interrupted => Some("interrupted"),
            Status::Failed(why) => Some(why),
        }
    }
}

/// Each text once, sorted.
fn distinct(texts: impl Iterator<Item = String>) -> Vec<String> {
    texts.collect::<BTreeSet<String>>().into_iter().collect()
}

/// Sums up evaluations by stage and level.
fn reduce(rows: Vec<Row>, levels: &[LevelInfo]) -> BTreeMap<(Option<u16>, String), Evaluated> {
    let mut episodes: BTreeMap<(Option<u16>, String), Vec<Episode>> = BTreeMap::new();
    for row in rows {
        let stage = (row.phase == Phase::After).then_some(row.stage);
        episodes.entry((stage, row.level)).or_default().push(row.episode);
    }
    let evaluated = |(key, episodes): ((Option<u16>, String), Vec<Episode>)| {
        let level = levels.iter().find(|level| level.name == key.1);
        let evaluated = Evaluated::new(&LevelResult::new(&key.1, episodes), level);
        (key, evaluated)
    };
    episodes.into_iter().map(evaluated).collect()
}

impl Evaluated {
    fn new(result: &LevelResult, level: Option<&LevelInfo>) -> Self {
        let optimal = level.and_then(|level| level.optimal.as_ref());
        let optimum = |e: &Episode| optimal?.starts.iter().find(|o| o.start == e.start).map(|o| f64::from(o.length));
        let ratio = |episodes: &[&Episode]| -> Option<f64> {
            let best: f64 = episodes.iter().map(|e| optimum(e)).sum::<Option<f64>>()?;
            let steps: f64 = episodes.iter().map(|e| f64::from(e.length)).sum();
            (!episodes.is_empty()).then_some(steps / best)
        };
        let all: Vec<&Episode> = result.episodes.iter().collect();
        let solved: Vec<&Episode> = all.iter().copied().filter(|episode| episode.solved).collect();
        Self {
            mean: result.mean,
            std: result.std,
            solved_share: result.solved_share,
            length: all.iter().map(|e| f64::from(e.length)).sum::<f64>() / all.len() as f64,
            normalised: level.and_then(|level| level.normalised(result.mean)),
            steps: ratio(&all),
            steps_solved: ratio(&solved),
        }
    }
}

/// Every run, arm by arm.
pub(super) fn infos(groups: &[Group]) -> Vec<RunInfo> {
    let of_group = |(arm, group): (usize, &Group)| group.runs.iter().map(|run| RunInfo::new(arm, run)).collect();
    groups.iter().enumerate().flat_map::<Vec<RunInfo>, _>(of_group).collect()
}

impl RunInfo {
    fn new(arm: usize, run: &Run) -> Self {
        Self {
            path: run.path.clone(),
            arm,
            seed: run.manifest.seed,
            levels: run.manifest.stages.iter().map(|stage| stage.level.clone()).collect(),
            stages_done: run.manifest.stages_done,
            stages: run.manifest.stages.len(),
            status: run.manifest.status.clone(),
            log_rows: run.logs.rows,
            rows_without_return: run.logs.rows_without_return,
            plasticity_rows: run.logs.plasticity_rows,
            plasticity_without_value: run.plasticity_without_value(),
            damaged_rows: run.logs.damaged_rows,
            versions: run.versions(),
            instruction_sets: run.instruction_sets(),
        }
    }
}

/// Stages that are not done in runs that are there, levels that other seeds of an arm were trained on afresh, and seeds
/// that only the counterpart of an arm has: the curriculum's of runs afresh, and the reverse.
pub(super) fn missing(groups: &[Group], levels: &[LevelInfo]) -> Vec<Missing> {
    let mut missing = Vec::new();
    for (arm, group) in groups.iter().enumerate() {
        for run in &group.runs {
            let stages = &run.manifest.stages[usize::from(run.manifest.stages_done).min(run.manifest.stages.len())..];
            if !stages.is_empty() {
                let why = run.why_unfinished().unwrap_or("unfinished").to_owned();
                let levels = stages.iter().map(|stage| stage.level.clone()).collect();
                missing.push(Missing { arm, seed: run.manifest.seed, levels, why });
            }
        }
        let trained = |level: &&LevelInfo| group.runs.iter().any(|run| run.trains_on(&level.name));
        let counterparts = groups.iter().filter(|other| are_counterparts(group, other));
        let seeds: BTreeSet<u64> = counterparts.chain([group]).flat_map(Group::seeds).collect();
        for seed in seeds {
            let of_seed = || group.runs.iter().filter(|run| run.manifest.seed == seed);
            let absent = |level: &&LevelInfo| !of_seed().any(|run| run.trains_on(&level.name));
            let absent: Vec<String> =
                levels.iter().filter(trained).filter(absent).map(|level| level.name.clone()).collect();
            if !absent.is_empty() {
                missing.push(Missing { arm, seed, levels: absent, why: "no such run".to_owned() });
            }
        }
    }
    missing
}
