//! The numbers of single seeds that a report's tables are made of, in long form: `seeds.csv`.

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::sync::Arc;

use rl_stats::Time;

use super::conventions::THRESHOLDS;
use super::groups::Group;
use super::levels::LevelInfo;
use super::run::{Evaluated, Run};

/// One number of one seed.
#[derive(Clone, Debug, PartialEq)]
pub struct SeedValue {
    /// Index into the arms.
    pub arm: usize,
    /// What its run went through: `curriculum`, the name of another sequence or `level-<L>`, as in its manifest.
    pub sequence: Arc<str>,
    /// The seed.
    pub seed: u64,
    /// The finished stage after which it was measured; none before the first.
    pub stage: Option<u16>,
    /// Index into the levels.
    pub level: usize,
    /// Its name: docs/metrics.md lists them.
    pub measure: Cow<'static, str>,
    /// Infinite for a time to a threshold that is never reached.
    pub value: f64,
}

/// All numbers of all runs: arm by arm, run by run, stage by stage, level by level.
pub(super) fn of_groups(groups: &[Group], levels: &[LevelInfo]) -> Vec<SeedValue> {
    let mut all = Vec::new();
    for (arm, group) in groups.iter().enumerate() {
        let mut runs: Vec<&Run> = group.runs.clone();
        runs.sort_by_key(|run| (&run.manifest.curriculum, run.manifest.seed));
        runs.into_iter().for_each(|run| of_run(arm, run, levels, &mut all));
    }
    all
}

fn of_run(arm: usize, run: &Run, levels: &[LevelInfo], all: &mut Vec<SeedValue>) {
    let (sequence, seed): (Arc<str>, u64) = (run.manifest.curriculum.as_str().into(), run.manifest.seed);
    let place: BTreeMap<&str, usize> =
        levels.iter().enumerate().map(|(place, level)| (level.name.as_str(), place)).collect();
    let mut push = |stage: Option<u16>, level: usize, measure: Cow<'static, str>, value: Option<f64>| {
        let sequence = Arc::clone(&sequence);
        all.extend(value.map(|value| SeedValue { arm, sequence, seed, stage, level, measure, value }));
    };
    for ((stage, level), evaluated) in &run.evaluations {
        // Levels that no run trains on have no place in any table.
        let Some(&level) = place.get(level.as_str()) else { continue };
        for (measure, value) in of_evaluation(evaluated) {
            push(*stage, level, Cow::Borrowed(measure), value);
        }
    }
    for ((stage, level), evaluated) in &run.sampled {
        let Some(&level) = place.get(level.as_str()) else { continue };
        for (measure, value) in of_evaluation(evaluated) {
            push(*stage, level, Cow::Owned(format!("sampled_{measure}")), value);
        }
    }
    let done = usize::from(run.manifest.stages_done);
    for (number, stage) in run.manifest.own_stages() {
        let number = usize::from(number);
        if number >= done {
            break;
        }
        let Some(&level) = place.get(stage.level.as_str()) else { continue };
        let after = Some(number as u16);
        push(after, level, Cow::Borrowed("timesteps"), Some(stage.timesteps as f64));
        let summary = run.logs.stages.get(number).and_then(|log| log.summary.as_ref());
        if let Some((summary, area)) = summary.and_then(|summary| Some((summary, summary.area()?))) {
            push(after, level, Cow::Borrowed("area"), Some(area));
            for (threshold, time) in THRESHOLDS.iter().zip(summary.times()) {
                push(after, level, Cow::Owned(format!("time_to_{threshold}")), Some(Time::to_f64(*time)));
            }
        }
        for (measure, log) in &run.logs.plasticity {
            let begin = log.begins.get(number).copied().flatten();
            push(after, level, Cow::Owned(format!("before/{measure}")), begin);
            push(after, level, Cow::Owned(measure.clone()), log.ends.get(number).copied().flatten());
        }
    }
}

fn of_evaluation(evaluated: &Evaluated) -> [(&'static str, Option<f64>); 7] {
    [
        ("return", Some(evaluated.mean)),
        ("return_std", Some(evaluated.std)),
        ("normalised_return", evaluated.normalised),
        ("solved_share", Some(evaluated.solved_share)),
        ("length", Some(evaluated.length)),
        ("steps", evaluated.steps),
        ("steps_solved", evaluated.steps_solved),
    ]
}
