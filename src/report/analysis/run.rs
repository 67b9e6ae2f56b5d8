//! One run, reduced while it is read.

use std::collections::{BTreeMap, BTreeSet};
use std::path::PathBuf;

use anyhow::Result;
use serde::Serialize;

use super::found::Found;
use super::levels::LevelInfo;
use super::logs::Logs;
use crate::experiment::curriculum::LEVEL;
use crate::results::{Episode, LevelResult, Policy};
use crate::run::evaluations::{self, Phase, Row};
use crate::run::manifest::{Manifest, Status, Versions};

/// How an arm's runs meet their levels.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Protocol {
    /// One level after another.
    Curriculum,
    /// Each level by a new agent.
    FromScratch,
    /// The rest of a sequence under a treatment, from a checkpoint of a run through it.
    Fork,
}

/// What is kept of a run: its size depends on the numbers of its stages and measures alone.
pub(super) struct Run {
    pub(super) path: PathBuf,
    pub(super) manifest: Manifest,
    pub(super) protocol: Protocol,
    /// Of the greedy policy, by stage (none before the first) and level; finished stages only.
    pub(super) evaluations: BTreeMap<(Option<u16>, String), Evaluated>,
    /// The same of the sampled policy; runs of earlier versions have none.
    pub(super) sampled: BTreeMap<(Option<u16>, String), Evaluated>,
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

impl Run {
    /// Reads and reduces a run's evaluations and logs.
    pub(super) fn read(found: Found, levels: &[LevelInfo]) -> Result<Self> {
        let Found { path, manifest } = found;
        // What a killed process evaluated after its last finished stage is cut back on resume, and no result.
        let mut rows = evaluations::read(&path)?;
        rows.retain(|row| row.phase == Phase::Before || row.stage < manifest.stages_done);
        let protocol = match &manifest.fork {
            Some(_) => Protocol::Fork,
            None if manifest.curriculum.starts_with(LEVEL) => Protocol::FromScratch,
            None => Protocol::Curriculum,
        };
        let logs = Logs::read(&path, &manifest.stages, levels)?;
        let (greedy, sampled) = rows.into_iter().partition(|row| row.policy == Policy::Greedy);
        Ok(Self {
            evaluations: reduce(greedy, levels),
            sampled: reduce(sampled, levels),
            logs,
            protocol,
            path,
            manifest,
        })
    }

    /// The number of the stage on this level, if it is done.
    pub(super) fn finished_stage(&self, level: &str) -> Option<u16> {
        let (stage, _) = self.manifest.own_stages().find(|(_, stage)| stage.level == level)?;
        (stage < self.manifest.stages_done).then_some(stage)
    }

    pub(super) fn trains_on(&self, level: &str) -> bool {
        self.manifest.own_stages().any(|(_, stage)| stage.level == level)
    }

    /// How many of its own stages are done, and how many there are.
    pub(super) fn stages_done(&self) -> (u16, usize) {
        (self.manifest.stages_done.saturating_sub(self.manifest.first_stage()), self.manifest.own_stages().count())
    }

    /// Tells of a run that is not finished, or whose logs are not whole.
    pub(super) fn warnings(&self) -> Vec<String> {
        let (done, stages) = self.stages_done();
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
    pub(super) fn plasticity_without_value(&self) -> BTreeMap<String, u64> {
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

    pub(super) fn why_unfinished(&self) -> Option<&str> {
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
            length: result.length(),
            normalised: level.and_then(|level| level.normalised(result.mean)),
            steps: ratio(&all),
            steps_solved: ratio(&solved),
        }
    }
}
