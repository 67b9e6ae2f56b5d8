//! Plasticity measures at both ends of each stage: how an agent comes to a level, and what training on it leaves behind.

use std::collections::{BTreeMap, BTreeSet};

use rl_stats::Bootstrap;
use serde::Serialize;

use super::groups::{ArmStage, Group};
use super::logs::MeasureLog;
use super::over_seeds::OverSeeds;
use super::run::Run;

/// A plasticity measure at one end of a stage.
#[derive(Clone, Debug, Serialize)]
pub struct PlasticityEnd {
    /// The measure's column in `plasticity.csv`.
    pub measure: String,
    /// The stage's number.
    pub stage: u16,
    /// Index into the levels.
    pub level: usize,
    /// Its value there, over the seeds that have finished the stage and have one.
    #[serde(flatten)]
    pub value: OverSeeds,
}

/// Every measure where `end` reads it of each stage's log; what no seed has is left out.
pub(super) fn of_group(
    group: &Group,
    stages: &[ArmStage],
    names: &[&str],
    bootstrap: &Bootstrap,
    end: fn(&MeasureLog) -> &[Option<f64>],
) -> Vec<PlasticityEnd> {
    let measures: BTreeSet<&String> = group.runs.iter().flat_map(|run| run.logs.plasticity.keys()).collect();
    let mut all = Vec::new();
    for measure in measures {
        for stage in stages {
            let last = |run: &Run| {
                let log = run.logs.plasticity.get(measure)?;
                (stage.stage < run.manifest.stages_done).then(|| end(log)[usize::from(stage.stage)]).flatten()
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
