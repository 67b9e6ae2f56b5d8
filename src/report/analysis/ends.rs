//! Plasticity measures at the end of each stage: what the training on a level leaves behind.

use std::collections::{BTreeMap, BTreeSet};

use rl_stats::Bootstrap;
use serde::Serialize;

use super::groups::{ArmStage, Group};
use super::over_seeds::OverSeeds;
use super::run::Run;

/// A plasticity measure at the end of a stage.
#[derive(Clone, Debug, Serialize)]
pub struct PlasticityEnd {
    /// The measure's column in `plasticity.csv`.
    pub measure: String,
    /// The stage's number.
    pub stage: u16,
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
            let runs = group.runs_on(stage, names[stage.level]);
            let seeds: BTreeMap<u64, f64> =
                runs.into_iter().filter_map(|(seed, run)| Some((seed, last(run)?))).collect();
            let end = |value| PlasticityEnd { measure: measure.clone(), stage: stage.stage, level: stage.level, value };
            all.extend(OverSeeds::new(seeds, bootstrap).map(end));
        }
    }
    all
}
