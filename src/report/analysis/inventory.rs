//! Which runs there are, and what should be there and is not.

use std::collections::{BTreeMap, BTreeSet};
use std::path::PathBuf;

use serde::Serialize;

use super::groups::{Group, are_counterparts};
use super::levels::LevelInfo;
use super::run::Run;
use crate::run::manifest::Status;

/// One run that was found.
#[derive(Clone, Debug, Serialize)]
pub struct RunInfo {
    /// Its directory.
    pub path: PathBuf,
    /// Index into the arms.
    pub arm: usize,
    /// Its seed.
    pub seed: u64,
    /// The levels it trains on, in order; of a fork those after its checkpoint.
    pub levels: Vec<String>,
    /// Stages finished, of those that it trains.
    pub stages_done: u16,
    /// Stages that it trains.
    pub stages: usize,
    /// How it stands.
    pub status: Status,
    /// Rows of `progress.csv`.
    pub log_rows: u64,
    /// Those among them without a mean return (NaN), which curves step over.
    pub rows_without_return: u64,
    /// Rows of `plasticity.csv` after updates.
    pub plasticity_rows: u64,
    /// Measures that have no value (NaN) in some of them, with how many those are.
    pub plasticity_without_value: BTreeMap<String, u64>,
    /// Rows of logs that are cut off or no numbers, which are left out.
    pub damaged_rows: u64,
    /// The versions of cpp-rl that it was made by, over all its starts.
    pub versions: Vec<String>,
    /// The instruction sets that its fused engine used: results on another one differ by rounding.
    pub instruction_sets: Vec<String>,
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

/// Every run, arm by arm.
pub(super) fn infos(groups: &[Group]) -> Vec<RunInfo> {
    let of_group = |(arm, group): (usize, &Group)| group.runs.iter().map(|run| RunInfo::new(arm, run)).collect();
    groups.iter().enumerate().flat_map::<Vec<RunInfo>, _>(of_group).collect()
}

impl RunInfo {
    fn new(arm: usize, run: &Run) -> Self {
        let (stages_done, stages) = run.stages_done();
        Self {
            path: run.path.clone(),
            arm,
            seed: run.manifest.seed,
            levels: run.manifest.own_stages().map(|(_, stage)| stage.level.clone()).collect(),
            stages_done,
            stages,
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

/// Stages that are not done in runs that are there, levels that other seeds of an arm were trained on from scratch, and
/// seeds that only the counterpart of an arm has: the curriculum's of runs from scratch, and the reverse.
pub(super) fn missing(groups: &[Group], levels: &[LevelInfo]) -> Vec<Missing> {
    let mut missing = Vec::new();
    for (arm, group) in groups.iter().enumerate() {
        for run in &group.runs {
            let to_do = run.manifest.own_stages().filter(|(number, _)| *number >= run.manifest.stages_done);
            let levels: Vec<String> = to_do.map(|(_, stage)| stage.level.clone()).collect();
            if !levels.is_empty() {
                let why = run.why_unfinished().unwrap_or("unfinished").to_owned();
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
