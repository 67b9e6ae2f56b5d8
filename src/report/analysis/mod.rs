//! What a set of runs says, as one typed result. Tables, figures and files are made from an [`Analysis`] and from
//! nothing else.
//!
//! Runs are seeds. Intervals are over seeds, never over episodes; one seed has none. Returns are normalised to the
//! share (R + max_steps) / (R_opt + max_steps) of the way from the worst return there is to the proved mean optimum.
//! docs/metrics.md defines every measure.
//!
//! Its files depend on each other in one direction: `found` → `levels` → `logs` → `run` → `groups` → `outcome`,
//! `matrix`, `curves`, `ends` → `arm`, `seed_values`.

mod arm;
mod bands;
mod conventions;
mod curves;
mod ends;
mod found;
mod groups;
mod inventory;
mod levels;
mod logs;
mod matrix;
mod outcome;
mod over_seeds;
mod pairs;
mod run;
mod seed_values;

use std::path::PathBuf;

use anyhow::Result;
use serde::Serialize;

pub use arm::Arm;
pub use conventions::{Conventions, FORMAT, THRESHOLDS};
pub use curves::{Band, Curve, PlasticitySeries, SeriesPoint};
pub use ends::PlasticityEnd;
pub use found::LeftOut;
pub use groups::{ArmStage, Difference, Treatment};
pub use inventory::{Missing, RunInfo};
pub use levels::{LevelInfo, PlannedStart, Planner};
pub use matrix::{Matrix, MatrixCell, MatrixRow};
pub use outcome::{LevelOutcome, SeedOutcome, ThresholdTimes, optimality_gap};
pub use over_seeds::OverSeeds;
pub use pairs::{ForkPair, Pair};
pub use run::Protocol;
pub use seed_values::SeedValue;

use super::foreign::ForeignCurve;
use super::parallel;
use super::published::{PAPER, Published};
use crate::error::UserError;
use bands::Bands;
use run::Run;

/// What a set of runs says.
#[derive(Clone, Debug, Serialize)]
pub struct Analysis {
    /// Version of these fields.
    pub format: u32,
    /// How the numbers were made.
    pub conventions: Conventions,
    /// The levels trained on, in the order of the curricula.
    pub levels: Vec<LevelInfo>,
    /// Runs that differ in their seeds alone, an arm each. Runs through a curriculum and runs from scratch are arms of
    /// their own.
    pub arms: Vec<Arm>,
    /// Each curriculum with the runs from scratch of the same settings.
    pub pairs: Vec<Pair>,
    /// Each arm of forks with the runs that they come from, and with those from scratch.
    pub forks: Vec<ForkPair>,
    /// The settings that are not the same in all arms.
    pub differences: Vec<Difference>,
    /// Every run that was found.
    pub runs: Vec<RunInfo>,
    /// What should be there and is not.
    pub missing: Vec<Missing>,
    /// Directories whose run cannot be read, or has not begun.
    pub left_out: Vec<LeftOut>,
    /// What the paper printed, where its levels are compared.
    pub published: Option<Published>,
    /// Learning curves of other programs, where someone gave them.
    pub foreign_curves: Vec<ForeignCurve>,
    /// What a reader must know.
    pub warnings: Vec<String>,
    /// Every number of every seed that tables are made of; `seeds.csv` has them.
    #[serde(skip)]
    pub seed_values: Vec<SeedValue>,
}

impl Analysis {
    /// Reads all runs in and below these directories. Logs are streamed: what is kept of a run does not grow with its
    /// length. A run that cannot be read is left out, and named.
    ///
    /// # Errors
    /// A directory without runs, no run that can be read, two runs that are the same seed of the same arm, and levels
    /// of one name with differing maps.
    pub fn read(directories: &[PathBuf]) -> Result<Self> {
        let (found, mut left_out) = found::find(directories)?;
        let levels = levels::of_runs(&found)?;
        let mut runs = Vec::new();
        let read = parallel::map(&found, |found| Run::read(found.clone(), &levels));
        for (found, read) in found.into_iter().zip(read) {
            match read {
                Ok(run) => runs.push(run),
                Err(error) => left_out.push((found.path, error)),
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
        let groups = groups::groups(runs)?;
        let conventions = Conventions::default();
        // Resampling takes most of an analysis's time.
        let arms = parallel::map(&groups, |group| {
            let mut bands = Bands::new(conventions.curve_bootstrap);
            Arm::new(group, &levels, &conventions.bootstrap, &mut bands)
        });
        let mut warnings: Vec<String> = runs.iter().flat_map(Run::warnings).collect();
        warnings.extend(left_out.iter().map(|LeftOut { why, .. }| format!("left out: {why}")));
        warnings.extend(groups.iter().filter_map(groups::weak_dose));
        warnings.extend(groups::mixed_versions(&groups));
        let pairs = pairs::of_arms(&arms);
        let is_of_paper = |level: &LevelInfo| PAPER.column(&level.map, level.max_steps).is_some();
        Ok(Self {
            format: FORMAT,
            forks: pairs::of_forks(&groups, &arms, &pairs),
            pairs,
            differences: groups::differences(&groups),
            seed_values: seed_values::of_groups(&groups, &levels),
            runs: inventory::infos(&groups),
            missing: inventory::missing(&groups, &levels),
            left_out,
            published: levels.iter().any(is_of_paper).then_some(PAPER),
            foreign_curves: Vec::new(),
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

    /// The paper's column of a level: of one with its map and step limit, whatever it is called.
    pub fn paper_column(&self, level: usize) -> Option<usize> {
        let LevelInfo { map, max_steps, .. } = &self.levels[level];
        self.published.as_ref()?.column(map, *max_steps)
    }

    /// How many stages an arm has in common with the paper's sequence: all of it, or all that the arm has where it is
    /// shorter. What the arm learned before these is what the paper's models had learned. 0 for runs from scratch, and for
    /// another order of the levels, even one that begins as the paper's does.
    pub fn stages_of_paper(&self, arm: &Arm) -> usize {
        let stages = arm.stages.iter().enumerate();
        let shared = stages.take_while(|(place, stage)| self.paper_column(stage.level) == Some(*place)).count();
        let whole = arm.stages.len().min(PAPER.levels.len());
        if arm.protocol == Protocol::Curriculum && shared == whole { shared } else { 0 }
    }
}
