//! Runs side by side: what each arm earns on each level right after training on it (the study's Table 5).

use std::cmp::Reverse;
use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::{Context, Result};
use coverage_env::Level;
use serde::Serialize;
use serde_json::{Map, Value};

use super::study::{Planned, deviation_note, planned_cell};
use super::{Cell, Table};
use crate::dose::WEAK;
use crate::error::UserError;
use crate::results::mean_std;
use crate::run::evaluations::{self, Phase, Row, level_result};
use crate::run::manifest::{Manifest, StageEntry, Status};

/// The folder of runs through a whole curriculum; others hold runs on one level afresh.
const CURRICULUM: &str = "curriculum";
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
    /// The settings that are not the same in all arms.
    pub differences: Vec<Difference>,
    /// What a reader must know.
    pub warnings: Vec<String>,
}

/// Runs that differ in nothing but their seeds.
#[derive(Clone, Debug, Serialize)]
pub struct Arm {
    /// The preset's name, with what tells it from another arm of that name.
    pub name: String,
    /// One result per level, in the order of [`Comparison::levels`].
    pub levels: Vec<Option<ArmLevel>>,
}

/// One setting that is not the same in all arms.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Difference {
    /// Its key.
    pub key: String,
    /// Its value in each arm, in their order; null where the arm has no such setting.
    pub values: Vec<Value>,
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

/// Runs that may be pooled: they differ in their seeds alone.
struct Group<'a> {
    name: String,
    settings: Map<String, Value>,
    runs: Vec<&'a Loaded>,
}

impl Loaded {
    /// Everything that a run's results depend on beside its seed.
    fn settings(&self) -> Map<String, Value> {
        let m = &self.manifest;
        let mut settings = m.config.clone();
        settings.insert("kernel".to_owned(), m.kernel.clone().into());
        settings.insert("device".to_owned(), m.device.clone().into());
        // A penalty that is not there has no coefficient, and covers nothing.
        if settings.get("l2").and_then(Value::as_str) == Some("none") {
            settings.remove("l2_coef");
            settings.remove("l2_covers");
        }
        let stage = |s: &StageEntry| Value::from(format!("{} × {}", s.level, s.timesteps));
        // The afresh runs of one arm have a stage each, on levels of their own, and belong together.
        if m.curriculum == CURRICULUM {
            settings.insert("stages".to_owned(), m.stages.iter().map(stage).collect());
        }
        settings
    }

    fn arm(&self) -> String {
        let afresh = if self.manifest.curriculum == CURRICULUM { "" } else { " (afresh)" };
        format!("{}{afresh}", self.manifest.arm)
    }
}

impl Comparison {
    /// Reads all runs in and below these directories.
    ///
    /// # Errors
    /// A directory without runs, files that cannot be read, two runs that are the same seed of the same arm, and levels
    /// of one name with differing maps.
    pub fn read(directories: &[PathBuf]) -> Result<Self> {
        let mut paths = BTreeSet::new();
        for directory in directories {
            let mut found = BTreeSet::new();
            find_runs(directory, DEPTH, &mut found)?;
            if found.is_empty() {
                let message = "holds no run: give a run's directory (with a manifest.json) or a folder of runs";
                return Err(UserError::new(format!("{} {message}", directory.display())).into());
            }
            paths.extend(found);
        }
        let load = |path: PathBuf| -> Result<Loaded> {
            Ok(Loaded { manifest: Manifest::read(&path)?, rows: evaluations::read(&path)?, path })
        };
        let runs: Vec<Loaded> = paths.into_iter().map(load).collect::<Result<_>>()?;
        Ok(Self::new(&runs)?)
    }

    fn new(runs: &[Loaded]) -> Result<Self, UserError> {
        let mut warnings = Vec::new();
        for run in runs.iter().filter(|run| run.manifest.status != Status::Finished) {
            let (done, stages) = (run.manifest.stages_done, run.manifest.stages.len());
            let why = if let Status::Failed(why) = &run.manifest.status { why } else { "unfinished" };
            warnings.push(format!("{}: {done} of {stages} stages are done ({why})", run.path.display()));
        }
        let levels = trained_levels(runs)?;
        let groups = groups(runs)?;
        warnings.extend(groups.iter().filter_map(weak_dose));
        let arm = |group: &Group| Arm {
            name: group.name.clone(),
            levels: levels.iter().map(|trained| ArmLevel::new(&group.runs, &trained.level)).collect(),
        };
        Ok(Self {
            planners: levels.iter().map(Trained::planned).collect(),
            arms: groups.iter().map(arm).collect(),
            differences: arm_differences(&groups),
            levels: levels.into_iter().map(|trained| trained.level).collect(),
            warnings,
        })
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
        let note = if most == Some(1) {
            deviation_note(1)
        } else {
            "Mean ± population standard deviation over seeds, each the mean over every start cell; where an arm has \
             one seed, over its start cells."
                .to_owned()
        };
        Table {
            title: "Return on each level right after training on it".to_owned(),
            columns: ["arm".to_owned(), "seeds".to_owned()].into_iter().chain(levels).collect(),
            rows,
            notes: vec![note],
        }
    }

    /// The settings that are not the same in all arms: a row per setting, a column per arm.
    pub fn settings_table(&self) -> Table {
        let show = |value: &Value| match value {
            Value::Null => Cell::Missing,
            Value::String(text) => text.clone().into(),
            value => value.to_string().into(),
        };
        let row = |difference: &Difference| {
            [difference.key.as_str().into()].into_iter().chain(difference.values.iter().map(show)).collect()
        };
        Table {
            title: "Settings in which the arms differ".to_owned(),
            columns: ["setting".to_owned()].into_iter().chain(self.arms.iter().map(|arm| arm.name.clone())).collect(),
            rows: self.differences.iter().map(row).collect(),
            notes: Vec::new(),
        }
    }
}

/// Sorts runs into arms; arms of one name are told apart by the settings in which they differ.
fn groups(runs: &[Loaded]) -> Result<Vec<Group<'_>>, UserError> {
    let mut groups: Vec<Group> = Vec::new();
    for run in runs {
        let (name, settings) = (run.arm(), run.settings());
        match groups.iter_mut().find(|group| group.name == name && group.settings == settings) {
            Some(group) => group.runs.push(run),
            None => groups.push(Group { name, settings, runs: vec![run] }),
        }
    }
    for group in &groups {
        let mut seen: BTreeMap<(u64, &str), &Loaded> = BTreeMap::new();
        for run in &group.runs {
            let key = (run.manifest.seed, run.manifest.curriculum.as_str());
            if let Some(other) = seen.insert(key, run) {
                return Err(UserError::new(format!(
                    "{} and {} are the same seed of the same arm: give one of them",
                    other.path.display(),
                    run.path.display()
                )));
            }
        }
    }
    let names: Vec<String> = groups.iter().map(|group| group.name.clone()).collect();
    let labels: Vec<String> = groups
        .iter()
        .map(|group| {
            let namesakes: Vec<&Group> = groups.iter().filter(|other| other.name == group.name).collect();
            let keys = differing_keys(&namesakes);
            let show = |key: &String| format!("{key}={}", group.settings.get(key).unwrap_or(&Value::Null));
            match namesakes.len() {
                1 => group.name.clone(),
                _ => format!("{} [{}]", group.name, keys.iter().map(show).collect::<Vec<_>>().join(", ")),
            }
        })
        .collect();
    groups.iter_mut().zip(labels).for_each(|(group, label)| group.name = label);
    let mut order: Vec<usize> = (0..groups.len()).collect();
    order.sort_by(|&a, &b| (&names[a], &groups[a].name).cmp(&(&names[b], &groups[b].name)));
    let mut slots: Vec<Option<Group>> = groups.into_iter().map(Some).collect();
    Ok(order.into_iter().filter_map(|i| slots[i].take()).collect())
}

/// The keys whose values are not the same in all of these groups, names aside.
fn differing_keys(groups: &[&Group]) -> Vec<String> {
    let keys: BTreeSet<&String> = groups.iter().flat_map(|group| group.settings.keys()).collect();
    let differs = |key: &&&String| groups.iter().any(|g| g.settings.get(**key) != groups[0].settings.get(**key));
    keys.iter().filter(differs).filter(|key| **key != "name").map(|key| (*key).clone()).collect()
}

/// The settings in which arms differ, with every arm's value.
fn arm_differences(groups: &[Group]) -> Vec<Difference> {
    let all: Vec<&Group> = groups.iter().collect();
    let values = |key: &String| groups.iter().map(|g| g.settings.get(key).cloned().unwrap_or(Value::Null)).collect();
    differing_keys(&all).into_iter().map(|key| Difference { values: values(&key), key }).collect()
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

/// A level as its runs had it.
#[derive(Clone, Debug, PartialEq)]
struct Trained {
    level: String,
    map: String,
    max_steps: u32,
}

impl Trained {
    fn planned(&self) -> Planned {
        let level = Level::from_map(self.level.clone(), &self.map).ok().map(Arc::new);
        level.map_or(Planned { astar: None, optimal: None }, |level| Planned::new(&level, self.max_steps))
    }
}

/// Every trained level, in the order of the longest curriculum that has it.
fn trained_levels(runs: &[Loaded]) -> Result<Vec<Trained>, UserError> {
    let mut levels: Vec<Trained> = Vec::new();
    let mut runs: Vec<&Loaded> = runs.iter().collect();
    runs.sort_by_key(|run| Reverse(run.manifest.stages.len()));
    for run in runs {
        for stage in &run.manifest.stages {
            let max_steps = run.manifest.max_steps();
            let here = Trained { level: stage.level.clone(), map: stage.map.clone(), max_steps };
            match levels.iter().find(|known| known.level == here.level) {
                None => levels.push(here),
                Some(known) if *known != here => {
                    return Err(UserError::new(format!(
                        "{}: its level {} has another map or step limit than others': compare runs on the same levels",
                        run.path.display(),
                        stage.level
                    )));
                }
                Some(_) => {}
            }
        }
    }
    Ok(levels)
}

/// Warns of an L2 penalty that cannot have acted.
fn weak_dose(group: &Group) -> Option<String> {
    let doses = || group.runs.iter().map(|run| &run.manifest.dose);
    let number = |key: &str| doses().find_map(|dose| dose.get(key)?.as_f64());
    let name = &group.name;
    match doses().find_map(|dose| dose.get("l2")?.as_str())? {
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
            let ratios = doses().filter_map(|dose| dose.get("l2_ratio")?.as_array()).flatten();
            let largest = ratios.filter_map(Value::as_f64).fold(f64::NAN, f64::max);
            (largest < WEAK).then(|| {
                format!(
                    "{name}: its L2 may be too weak to act: its gradient is at most {:.2}% of the loss's on average of \
                     a stage",
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
