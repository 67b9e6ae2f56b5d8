//! Plasticity measures at the end of each stage: what the training on a level leaves behind.

use std::collections::{BTreeMap, BTreeSet};

use rl_stats::Bootstrap;
use serde::Serialize;

use super::arms::Group;
use super::curves::runs_of;
use super::runs::Run;
use super::{Arm, ArmStage, OverSeeds};

/// A plasticity measure at the end of a stage.
#[derive(Clone, Debug, Serialize)]
pub struct PlasticityEnd {
    /// The measure's column in `plasticity.csv`.
    pub measure: String,
    /// Index into the levels.
    pub level: usize,
    /// The last row's value, over the seeds that have finished the stage and have one.
    #[serde(flatten)]
    pub value: OverSeeds,
}

/// Every measure at the end of every stage; what no seed has is left out.
pub(super) fn of_group(
    group: &Group,
    stages: &[ArmStage],
    names: &[&str],
    bootstrap: &Bootstrap,
) -> Vec<PlasticityEnd> {
    let measures: BTreeSet<&String> = group.runs.iter().flat_map(|run| run.logs.plasticity.keys()).collect();
    let mut all = Vec::new();
    for measure in measures {
        for stage in stages {
            let last = |run: &Run| {
                let log = run.logs.plasticity.get(measure)?;
                (stage.stage < run.manifest.stages_done).then(|| log.ends[usize::from(stage.stage)]).flatten()
            };
            let runs = runs_of(group, stage, names[stage.level]);
            let seeds: BTreeMap<u64, f64> =
                runs.into_iter().filter_map(|(seed, run)| Some((seed, last(run)?))).collect();
            let end = |value| PlasticityEnd { measure: measure.clone(), level: stage.level, value };
            all.extend(OverSeeds::new(seeds, bootstrap).map(end));
        }
    }
    all
}

/// The differences curriculum − afresh at the end of each stage, of the seeds that have both.
pub(super) fn differences(curriculum: &Arm, afresh: &Arm, bootstrap: &Bootstrap) -> Vec<PlasticityEnd> {
    let of_end = |end: &PlasticityEnd| {
        let same = |other: &&PlasticityEnd| other.measure == end.measure && other.level == end.level;
        let other = &afresh.plasticity_ends.iter().find(same)?.value.seeds;
        let pair = |(seed, value): (&u64, &f64)| Some((*seed, value - other.get(seed)?));
        let value = OverSeeds::new(end.value.seeds.iter().filter_map(pair).collect(), bootstrap)?;
        Some(PlasticityEnd { value, ..end.clone() })
    };
    curriculum.plasticity_ends.iter().filter_map(of_end).collect()
}
