//! Everything that a set of runs says, as one typed result: tables, figures and files are made from an [`Analysis`] and
//! from nothing else.
//!
//! Runs are seeds. Intervals are over seeds, never over episodes; one seed has none. Returns are normalised to the share
//! (R + max_steps) / (R_opt + max_steps) of the way from the worst return there is to the proved mean optimum.
//! docs/metrics.md defines every measure.

mod against_afresh;
mod arms;
mod bands;
mod continual;
mod curves;
mod ends;
mod improvement;
mod levels;
mod logs;
mod matrix;
mod outcome;
mod runs;

use std::path::PathBuf;

use anyhow::Result;
use rl_stats::Bootstrap;
use serde::Serialize;
use serde_json::{Map, Value};

pub use against_afresh::{AgainstAfresh, LevelContrast, OverLevels, Paired, PairedTimes, TimeSummary};
pub use continual::{Continual, OverSeeds};
pub use curves::{Band, Curve, PlasticitySeries, SeriesPoint};
pub use ends::PlasticityEnd;
pub use improvement::Improvement;
pub use levels::{LevelInfo, PlannedStart, Planner};
pub use matrix::{Matrix, MatrixCell, MatrixRow};
pub use outcome::{Aggregates, LevelOutcome, SeedOutcome, ThresholdTimes};
pub use runs::{LeftOut, Missing, RunInfo};

use super::published::{self, Published};
use super::published_curves::PublishedCurve;
use crate::error::UserError;
use arms::Group;
use bands::Bands;
use runs::Run;

/// Version of the fields of `report.json`.
pub const FORMAT: u32 = 2;

/// Shares of the optimum whose first attainment is timed.
const THRESHOLDS: [f64; 2] = [0.5, 0.9];

/// What a set of runs says.
#[derive(Clone, Debug, Serialize)]
pub struct Analysis {
    /// Version of these fields.
    pub format: u32,
    /// How the numbers were made.
    pub conventions: Conventions,
    /// The levels trained on, in the order of the curricula.
    pub levels: Vec<LevelInfo>,
    /// Runs that differ in their seeds alone, an arm each; runs through a curriculum and runs afresh are arms of their own.
    pub arms: Vec<Arm>,
    /// Each curriculum beside the runs afresh of the same settings.
    pub against_afresh: Vec<AgainstAfresh>,
    /// Each two arms of one protocol, unpaired.
    pub improvements: Vec<Improvement>,
    /// The settings that are not the same in all arms.
    pub differences: Vec<Difference>,
    /// Every run that was found.
    pub runs: Vec<RunInfo>,
    /// What should be there and is not.
    pub missing: Vec<Missing>,
    /// Directories whose run cannot be read, or has not begun.
    pub left_out: Vec<LeftOut>,
    /// The published figures, where the study's levels are compared.
    pub published: Option<Published>,
    /// The published learning curves, where someone gave them.
    pub published_curves: Vec<PublishedCurve>,
    /// What a reader must know.
    pub warnings: Vec<String>,
}

/// How the numbers were made.
#[derive(Clone, Debug, Serialize)]
pub struct Conventions {
    /// Of all intervals but those of curves.
    pub bootstrap: Bootstrap,
    /// Of curves, point by point.
    pub curve_bootstrap: Bootstrap,
    /// Normalised returns whose first attainment is timed.
    pub thresholds: Vec<f64>,
}

/// How an arm's runs meet their levels.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Protocol {
    /// One level after another.
    Curriculum,
    /// Each level by a fresh agent.
    Afresh,
}

/// Runs that differ in nothing but their seeds.
#[derive(Clone, Debug, Serialize)]
pub struct Arm {
    /// Unique: the preset's name, `(afresh)`, and the settings that tell it from namesakes.
    pub name: String,
    /// The preset's name.
    pub preset: String,
    /// Through a curriculum or afresh.
    pub protocol: Protocol,
    /// Everything that the results depend on beside the seed.
    pub settings: Map<String, Value>,
    /// In the order of training; for runs afresh one per level, with `stage` 0 each.
    pub stages: Vec<ArmStage>,
    /// The seeds that have a run.
    pub seeds: Vec<u64>,
    /// What is earned on each level right after training on it, in the order of [`Analysis::levels`].
    pub levels: Vec<Option<LevelOutcome>>,
    /// The same over levels, normalised; none where nothing is finished or an optimum is unknown.
    pub aggregates: Option<Aggregates>,
    /// Returns on every level after every stage; curricula only.
    pub matrix: Option<Matrix>,
    /// Continual-learning measures; curricula only.
    pub continual: Option<Continual>,
    /// Learning curves, one per entry of `stages`.
    pub curves: Vec<Curve>,
    /// Plasticity measures during training, one per measure and entry of `stages`; empty where none were logged.
    pub plasticity: Vec<PlasticitySeries>,
    /// The same at the end of each stage.
    pub plasticity_ends: Vec<PlasticityEnd>,
}

/// One stage of an arm.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct ArmStage {
    /// Its number within a run.
    pub stage: u16,
    /// Index into [`Analysis::levels`].
    pub level: usize,
    /// Timesteps asked for.
    pub timesteps: u64,
}

/// One setting that is not the same in all arms.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Difference {
    /// Its key.
    pub key: String,
    /// Its value in each arm, in their order; null where the arm has no such setting.
    pub values: Vec<Value>,
}

impl Analysis {
    /// Reads all runs in and below these directories. Logs are streamed: what is kept of a run does not grow with its
    /// length. A run that cannot be read is left out, and named.
    ///
    /// # Errors
    /// A directory without runs, no run that can be read, two runs that are the same seed of the same arm, and levels of
    /// one name with differing maps.
    pub fn read(directories: &[PathBuf]) -> Result<Self> {
        let (found, mut left_out) = runs::find(directories)?;
        let levels = levels::of_runs(&found)?;
        let mut runs = Vec::new();
        for found in found {
            let path = found.path.clone();
            match Run::read(found, &levels) {
                Ok(run) => runs.push(run),
                Err(error) => left_out.push((path, error)),
            }
        }
        match left_out.pop() {
            // One run that cannot be read must not hide a hundred; of none but such there is nothing to compare.
            Some((_, error)) if runs.is_empty() => return Err(error),
            last => left_out.extend(last),
        }
        Ok(Self::new(levels, &runs, left_out.iter().map(LeftOut::new).collect())?)
    }

    fn new(levels: Vec<LevelInfo>, runs: &[Run], left_out: Vec<LeftOut>) -> Result<Self, UserError> {
        let groups = arms::groups(runs)?;
        let conventions = Conventions {
            bootstrap: Bootstrap::default(),
            curve_bootstrap: Bootstrap { resamples: 1000, ..Bootstrap::default() },
            thresholds: THRESHOLDS.to_vec(),
        };
        let mut bands = Bands::new(conventions.curve_bootstrap);
        let arms: Vec<Arm> =
            groups.iter().map(|group| Arm::new(group, &levels, &conventions.bootstrap, &mut bands)).collect();
        let mut warnings: Vec<String> = runs.iter().flat_map(Run::warnings).collect();
        warnings.extend(left_out.iter().map(|LeftOut { why, .. }| format!("left out: {why}")));
        warnings.extend(groups.iter().filter_map(arms::weak_dose));
        warnings.extend(arms::mixed_versions(&groups));
        Ok(Self {
            format: FORMAT,
            against_afresh: against_afresh::contrasts(&arms, &conventions.bootstrap),
            improvements: improvement::between(&arms, &conventions.bootstrap),
            differences: arms::differences(&groups),
            runs: runs::infos(&groups),
            missing: runs::missing(&groups, &levels),
            left_out,
            published: published::beside(&levels),
            published_curves: Vec::new(),
            conventions,
            levels,
            arms,
            warnings,
        })
    }

    /// The index of the level with this name.
    pub fn level(&self, name: &str) -> Option<usize> {
        self.levels.iter().position(|level| level.name == name)
    }
}

impl Arm {
    fn new(group: &Group, levels: &[LevelInfo], bootstrap: &Bootstrap, bands: &mut Bands) -> Self {
        let stages = group.stages(levels);
        let names: Vec<&str> = levels.iter().map(|level| level.name.as_str()).collect();
        let outcomes: Vec<Option<LevelOutcome>> =
            names.iter().map(|name| LevelOutcome::new(group.outcomes(name), bootstrap)).collect();
        let matrix = (group.protocol == Protocol::Curriculum).then(|| Matrix::new(group, levels, &stages, bootstrap));
        Self {
            name: group.name.clone(),
            preset: group.preset().to_owned(),
            protocol: group.protocol,
            settings: group.settings.clone(),
            seeds: group.seeds(),
            aggregates: Aggregates::new(&outcomes, bootstrap),
            continual: matrix.as_ref().and_then(|matrix| Continual::new(matrix, &stages, bootstrap)),
            curves: curves::learning(group, &stages, &names, bands),
            plasticity: curves::plasticity(group, &stages, &names, bands),
            plasticity_ends: ends::of_group(group, &stages, &names, bootstrap),
            levels: outcomes,
            matrix,
            stages,
        }
    }
}
