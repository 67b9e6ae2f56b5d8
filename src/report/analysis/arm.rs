//! An arm: everything that runs which differ in their seeds alone say together.

use rl_stats::Bootstrap;
use serde::Serialize;
use serde_json::{Map, Value};

use super::bands::Bands;
use super::curves::{self, Curve, PlasticitySeries};
use super::ends::{self, PlasticityEnd};
use super::groups::{ArmStage, Group, Treatment, same_but_stages};
use super::levels::LevelInfo;
use super::matrix::Matrix;
use super::outcome::LevelOutcome;
use super::run::Protocol;

/// Runs that differ in nothing but their seeds.
#[derive(Clone, Debug, Serialize)]
pub struct Arm {
    /// Unique: the preset's name, that of the sequence where it has several, `(from scratch)` or the treatment of forks,
    /// and the settings that tell it from namesakes.
    pub name: String,
    /// The preset's name.
    pub preset: String,
    /// Through a curriculum, from scratch, or forks.
    pub protocol: Protocol,
    /// The name of the sequence that its runs go through; none from scratch.
    pub sequence: Option<String>,
    /// What sets forks apart from the runs that they come from; none of others.
    pub treatment: Option<Treatment>,
    /// Everything that the results depend on beside the seed.
    pub settings: Map<String, Value>,
    /// In the order of training; for runs from scratch one per level, with `stage` 0 each; of forks those after their
    /// checkpoint.
    pub stages: Vec<ArmStage>,
    /// The seeds that have a run.
    pub seeds: Vec<u64>,
    /// What is earned on each level right after training on it, in the order of the analysis's levels.
    pub levels: Vec<Option<LevelOutcome>>,
    /// Returns on every level after every stage; curricula only.
    pub matrix: Option<Matrix>,
    /// Learning curves, one per entry of `stages`.
    pub curves: Vec<Curve>,
    /// Plasticity measures during training, one per measure and entry of `stages`; empty where none were logged.
    pub plasticity: Vec<PlasticitySeries>,
    /// The same at the beginning of each stage, before its first update.
    pub plasticity_begins: Vec<PlasticityEnd>,
    /// The same at the end of each stage.
    pub plasticity_ends: Vec<PlasticityEnd>,
}

impl Arm {
    /// Whether the two have the same preset and settings, and differ in their stages at most.
    pub fn differs_in_sequence_alone(&self, other: &Self) -> bool {
        self.preset == other.preset && same_but_stages(&self.settings, &other.settings)
    }

    pub(super) fn new(group: &Group, levels: &[LevelInfo], bootstrap: &Bootstrap, bands: &mut Bands) -> Self {
        let stages = group.stages(levels);
        let names: Vec<&str> = levels.iter().map(|level| level.name.as_str()).collect();
        let matrix = (group.protocol == Protocol::Curriculum).then(|| Matrix::new(group, levels, &stages, bootstrap));
        Self {
            name: group.name.clone(),
            preset: group.preset().to_owned(),
            protocol: group.protocol,
            sequence: group.sequence.clone(),
            treatment: group.treatment.clone(),
            settings: group.settings.clone(),
            seeds: group.seeds(),
            curves: curves::learning(group, &stages, &names, bands),
            plasticity: curves::plasticity(group, &stages, &names, bands),
            plasticity_ends: ends::of_group(group, &stages, &names, bootstrap, |log| &log.ends),
            plasticity_begins: ends::of_group(group, &stages, &names, bootstrap, |log| &log.begins),
            levels: names.iter().map(|name| LevelOutcome::of(group, name, bootstrap)).collect(),
            matrix,
            stages,
        }
    }
}
