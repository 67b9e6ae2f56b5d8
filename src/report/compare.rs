//! Runs side by side: what each arm earns on each level right after training on it (the study's Table 5).

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::{Context, Result};
use coverage_env::Level;
use serde::Serialize;
use serde_json::Value;

use super::study::{Planned, deviation_note, planned_cell};
use super::{Cell, Table, mean_std};
use crate::error::UserError;
use crate::run::differences;
use crate::run::evaluations::{self, Phase, Row, level_result};
use crate::run::manifest::{Manifest, Status};
use crate::training::WEAK;

/// Folders below a given one that may hold runs: arm, curriculum, seed.
const DEPTH: usize = 4;

/// Everything that a comparison found.
#[derive(Clone, Debug, Serialize)]
pub struct Comparison {
    /// The levels, in the order of the curricula.
    pub levels: Vec<String>,
    /// A row of the table each.
    pub arms: Vec<Arm>,
    /// What the planners earn on each level.
    pub planners: Vec<Planned>,
    /// Settings in which arms differ: `a | b: key: value → value`.
    pub differences: Vec<String>,
    /// What a reader must know.
    pub warnings: Vec<String>,
}

/// The runs of one preset, in a curriculum or on levels afresh.
#[derive(Clone, Debug, Serialize)]
pub struct Arm {
    /// The preset's name, with `(afresh)` for runs on single levels.
    pub name: String,
    /// One result per level, in the order of [`Comparison::levels`].
    pub levels: Vec<Option<ArmLevel>>,
}

/// What an arm earns on a level right after training on it.
#[derive(Clone, Debug, Serialize)]
pub struct ArmLevel {
    /// Mean over seeds of the mean over every start cell.
    pub mean: f64,
    /// Population standard deviation: over seeds, or over start cells where there is one seed.
    pub std: f64,
    /// Share of start cells solved, over all seeds.
    pub solved_share: f64,
    /// Each seed's mean.
    pub seeds: BTreeMap<u64, f64>,
}

/// A run as it lies on the disk.
struct Loaded {
    path: PathBuf,
    manifest: Manifest,
    rows: Vec<Row>,
}

impl Loaded {
    fn arm(&self) -> String {
        let afresh = if self.manifest.curriculum == "curriculum" { "" } else { " (afresh)" };
        format!("{}{afresh}", self.manifest.arm)
    }
}

impl Comparison {
    /// Reads all runs in and below these directories.
    ///
    /// # Errors
    /// A directory without runs, and files that cannot be read.
    pub fn read(directories: &[PathBuf]) -> Result<Self> {
        let mut paths = BTreeSet::new();
        for directory in directories {
            let before = paths.len();
            find_runs(directory, DEPTH, &mut paths)?;
            if paths.len() == before {
                let message = "holds no run: give a run's directory (with a manifest.json) or a folder of runs";
                return Err(UserError::new(format!("{} {message}", directory.display())).into());
            }
        }
        let load = |path: PathBuf| -> Result<Loaded> {
            Ok(Loaded { manifest: Manifest::read(&path)?, rows: evaluations::read(&path)?, path })
        };
        let runs: Vec<Loaded> = paths.into_iter().map(load).collect::<Result<_>>()?;
        Ok(Self::new(&runs))
    }

    fn new(runs: &[Loaded]) -> Self {
        let mut warnings = Vec::new();
        for run in runs.iter().filter(|run| run.manifest.status != Status::Finished) {
            let (done, stages) = (run.manifest.stages_done, run.manifest.stages.len());
            let why = if let Status::Failed(why) = &run.manifest.status { why } else { "unfinished" };
            warnings.push(format!("{}: {done} of {stages} stages are done ({why})", run.path.display()));
        }
        let maps = maps(runs, &mut warnings);
        let mut arms: BTreeMap<String, Vec<&Loaded>> = BTreeMap::new();
        runs.iter().for_each(|run| arms.entry(run.arm()).or_default().push(run));
        for (name, runs) in &arms {
            let other = runs.iter().find(|run| run.manifest.config != runs[0].manifest.config);
            if let Some(other) = other {
                let keys = differences(&runs[0].manifest.config, &other.manifest.config).join("; ");
                warnings.push(format!("{name}: its runs have differing settings and are pooled all the same: {keys}"));
            }
            warnings.extend(weak_dose(name, runs));
        }
        let planned = |(name, map): (&String, &(String, u32))| {
            let level = Level::from_map(name.clone(), &map.0).ok().map(Arc::new);
            level.map_or(Planned { astar: None, optimal: None }, |level| Planned::new(&level, map.1))
        };
        Self {
            planners: maps.iter().map(|(name, map)| planned((name, map))).collect(),
            arms: arms
                .iter()
                .map(|(name, runs)| Arm {
                    name: name.clone(),
                    levels: maps.iter().map(|(level, _)| ArmLevel::new(runs, level)).collect(),
                })
                .collect(),
            differences: arm_differences(&arms),
            levels: maps.into_iter().map(|(name, _)| name).collect(),
            warnings,
        }
    }

    /// The study's Table 5: a row per arm, a column per level.
    pub fn table(&self) -> Table {
        let arm = |arm: &Arm| {
            let cells = arm
                .levels
                .iter()
                .map(|level| level.as_ref().map_or(Cell::Missing, |level| Cell::MeanStd(level.mean, level.std)));
            let seeds: BTreeSet<u64> =
                arm.levels.iter().flatten().flat_map(|level| level.seeds.keys().copied()).collect();
            [arm.name.as_str().into(), Cell::Number(seeds.len() as f64, 0)].into_iter().chain(cells).collect()
        };
        let mut rows: Vec<Vec<Cell>> = self.arms.iter().map(arm).collect();
        let planner = |name: &str, of: fn(&Planned) -> Option<f64>| {
            let cells = self.planners.iter().map(|planned| planned_cell(of(planned)));
            [name.into(), "".into()].into_iter().chain(cells).collect::<Vec<Cell>>()
        };
        rows.push(planner("A*", |planned| planned.astar));
        rows.push(planner("optimal", |planned| planned.optimal));
        let levels = self.levels.iter().map(|level| format!("level {level}"));
        let most = self.arms.iter().flat_map(|arm| &arm.levels).flatten().map(|level| level.seeds.len()).max();
        let mut notes = vec![if most == Some(1) {
            deviation_note(1)
        } else {
            "Mean ± population standard deviation over seeds, each the mean over every start cell; where an arm has \
             one seed, over its start cells."
                .to_owned()
        }];
        notes.extend(self.differences.iter().map(|difference| format!("Settings: {difference}")));
        notes.extend(self.warnings.iter().map(|warning| format!("Warning: {warning}")));
        Table {
            title: "Return on each level right after training on it".to_owned(),
            columns: ["arm".to_owned(), "seeds".to_owned()].into_iter().chain(levels).collect(),
            rows,
            notes,
        }
    }
}

impl ArmLevel {
    fn new(runs: &[&Loaded], level: &str) -> Option<Self> {
        let mut results = BTreeMap::new();
        for run in runs {
            let stage = run.manifest.stages.iter().position(|stage| stage.level == level);
            let result = stage.and_then(|stage| level_result(&run.rows, Phase::After, stage as u16, level));
            if let Some(result) = result {
                results.insert(run.manifest.seed, result);
            }
        }
        let seeds: BTreeMap<u64, f64> = results.iter().map(|(seed, result)| (*seed, result.mean)).collect();
        let shares: Vec<f64> = results.values().map(|result| result.solved_share).collect();
        let (mean, std) = match results.values().collect::<Vec<_>>()[..] {
            [] => return None,
            [one] => (one.mean, one.std),
            _ => mean_std(&seeds.values().copied().collect::<Vec<_>>()),
        };
        Some(Self { mean, std, solved_share: mean_std(&shares).0, seeds })
    }
}

/// Every trained level's map and step limit, in the order of the first curriculum that has it.
fn maps(runs: &[Loaded], warnings: &mut Vec<String>) -> Vec<(String, (String, u32))> {
    let mut maps: Vec<(String, (String, u32))> = Vec::new();
    let longest_first = {
        let mut runs: Vec<&Loaded> = runs.iter().collect();
        runs.sort_by_key(|run| std::cmp::Reverse(run.manifest.stages.len()));
        runs
    };
    for run in longest_first {
        let max_steps = run.manifest.config.get("max_steps").and_then(Value::as_u64).unwrap_or(0) as u32;
        for stage in &run.manifest.stages {
            match maps.iter().find(|(name, _)| *name == stage.level) {
                None => maps.push((stage.level.clone(), (stage.map.clone(), max_steps))),
                Some((_, known)) if *known != (stage.map.clone(), max_steps) => {
                    let path = run.path.display();
                    warnings
                        .push(format!("{path}: its level {} has another map or step limit than others'", stage.level));
                }
                Some(_) => {}
            }
        }
    }
    maps
}

/// The settings in which each arm differs from the first.
fn arm_differences(arms: &BTreeMap<String, Vec<&Loaded>>) -> Vec<String> {
    let mut arms = arms.iter();
    let Some((first_name, first)) = arms.next() else { return Vec::new() };
    let of_arm = |(name, runs): (&String, &Vec<&Loaded>)| {
        let keys = differences(&first[0].manifest.config, &runs[0].manifest.config);
        let keys: Vec<String> = keys.into_iter().filter(|key| !key.starts_with("name:")).collect();
        let keys = if keys.is_empty() { "none".to_owned() } else { keys.join("; ") };
        format!("{first_name} | {name}: {keys}")
    };
    arms.map(of_arm).collect()
}

/// Warns of an L2 penalty that cannot have acted.
fn weak_dose(name: &str, runs: &[&Loaded]) -> Option<String> {
    let dose = &runs[0].manifest.dose;
    let number = |key: &str| dose.get(key).and_then(Value::as_f64);
    match dose.get("l2")?.as_str()? {
        "adamw" => {
            let (planned, shrink) = (number("planned_shrink")?, number("shrink")?);
            (1.0 - shrink < WEAK).then(|| {
                format!(
                    "{name}: its L2 is too weak to act: over all stages it was to shrink the weights by {:.2}%, and in \
                     32-bit arithmetic it shrinks them by {:.2}%",
                    100.0 * (1.0 - planned),
                    100.0 * (1.0 - shrink)
                )
            })
        }
        "adam" | "loss" => {
            let ratios: Vec<f64> = dose.get("l2_ratio")?.as_array()?.iter().filter_map(Value::as_f64).collect();
            let largest = ratios.iter().copied().fold(f64::NAN, f64::max);
            (largest < WEAK).then(|| {
                format!(
                    "{name}: its L2 is too weak to act: its gradient is at most {:.2}% of the loss's",
                    100.0 * largest
                )
            })
        }
        _ => None,
    }
}

/// Collects the directories that hold a manifest, in and below `directory`.
fn find_runs(directory: &Path, depth: usize, found: &mut BTreeSet<PathBuf>) -> Result<()> {
    if directory.join("manifest.json").is_file() {
        found.insert(directory.to_owned());
        return Ok(());
    }
    if depth == 0 {
        return Ok(());
    }
    let entries = fs::read_dir(directory)
        .map_err(|e| UserError::new(format!("cannot read the directory {}: {e}", directory.display())))?;
    for entry in entries {
        let entry = entry.with_context(|| format!("cannot read {}", directory.display()))?;
        if entry.file_type().is_ok_and(|kind| kind.is_dir()) {
            find_runs(&entry.path(), depth - 1, found)?;
        }
    }
    Ok(())
}
