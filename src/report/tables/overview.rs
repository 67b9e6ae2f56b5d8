//! All levels at once, arms against each other, and what the comparison is of.

use rl_stats::Estimate;
use serde_json::Value;

use super::super::analysis::{Aggregates, Analysis, Arm, Difference, Improvement, LeftOut, LevelOutcome, Missing};
use super::super::{Cell, Table};
use super::{count, interval_note, level_names};

fn head(names: &[&str]) -> Vec<String> {
    names.iter().map(|&name| name.to_owned()).collect()
}

/// Normalised returns right after training, over all levels.
pub(super) fn aggregates(analysis: &Analysis) -> Table {
    let with_results = || {
        let arms = analysis.arms.iter().enumerate();
        arms.filter_map(|(arm, a)| Some((arm, a, a.aggregates.as_ref()?)))
    };
    // Some levels may have been finished by fewer seeds than others.
    let seeds = |arm: &Arm, a: &Aggregates| {
        let counts = a.levels.iter().filter_map(|&level| Some(arm.levels[level].as_ref()?.seeds.len()));
        let most = counts.max().unwrap_or(0);
        if a.mean.runs == most { count(most) } else { format!("{}–{most}", a.mean.runs).into() }
    };
    let row = |(_, arm, a): (usize, &Arm, &Aggregates)| {
        let estimates = [&a.mean, &a.median, &a.interquartile_mean, &a.optimality_gap];
        let fixed: [Cell; 3] = [arm.name.as_str().into(), seeds(arm, a), level_names(analysis, &a.levels).into()];
        fixed.into_iter().chain(estimates.map(|estimate| Cell::estimate(estimate, 3))).collect()
    };
    Table {
        title: "Normalised return right after training, over levels".to_owned(),
        columns: head(&["arm", "seeds", "levels", "mean", "median", "IQM", "optimality gap"]),
        rows: with_results().map(row).collect(),
        notes: vec![
            "0 is the worst return there is, 1 the proved mean optimum. Seeds are resampled level by level.".to_owned(),
            interval_note(analysis, with_results().map(|(arm, _, a)| (arm, &a.mean))),
        ],
    }
}

/// What is missing to the optimum, in return and in steps, level by level.
pub(super) fn optimality_gap(analysis: &Analysis) -> Table {
    let (mut rows, mut shown) = (Vec::new(), Vec::new());
    for (index, arm) in analysis.arms.iter().enumerate() {
        for (level, outcome) in analysis.levels.iter().zip(&arm.levels) {
            let Some(outcome) = outcome else { continue };
            let solved = |outcome: &LevelOutcome| Cell::Number(100.0 * outcome.solved_share, 1);
            let seeds = outcome.seeds.len();
            let estimate = |estimate: &Option<Estimate>, decimals: usize| {
                let runs = estimate.as_ref().map_or(0, |estimate| estimate.runs);
                Cell::estimate(estimate, decimals).of_seeds(runs, seeds)
            };
            rows.push(vec![
                arm.name.as_str().into(),
                level.name.as_str().into(),
                count(seeds),
                solved(outcome),
                estimate(&outcome.optimality_gap, 3),
                estimate(&outcome.steps, 2),
                estimate(&outcome.steps_solved, 2),
            ]);
            shown.push((index, &outcome.return_mean));
        }
    }
    let columns =
        ["arm", "level", "seeds", "solved %", "gap in return", "steps / optimal", "steps / optimal where solved"];
    Table {
        title: "Distance to the proved optimum right after training".to_owned(),
        columns: head(&columns),
        rows,
        notes: vec![
            "Gap in return: 1 - normalised return. An unsolved start counts the step limit.".to_owned(),
            interval_note(analysis, shown.into_iter()),
        ],
    }
}

/// Arms against each other.
pub(super) fn improvement(analysis: &Analysis) -> Table {
    let name = |arm: usize| Cell::from(analysis.arms[arm].name.as_str());
    let row = |improvement: &Improvement| {
        let levels = level_names(analysis, &improvement.levels);
        vec![name(improvement.x), name(improvement.y), levels.into(), Cell::estimate(&improvement.probability, 3)]
    };
    let of_arm = |(arm, levels): (usize, &Vec<usize>)| {
        let outcomes = levels.iter().filter_map(|&level| analysis.arms[arm].levels[level].as_ref());
        outcomes.map(|outcome| (arm, &outcome.return_mean)).collect::<Vec<_>>()
    };
    let compared = analysis.improvements.iter().flat_map(|i| [(i.x, &i.levels), (i.y, &i.levels)]);
    Table {
        title: "Probability that a run of X earns more right after training than a run of Y".to_owned(),
        columns: head(&["X", "Y", "levels", "P(X > Y)"]),
        rows: analysis.improvements.iter().map(row).collect(),
        notes: vec![
            "Unpaired, ties half, averaged over levels.".to_owned(),
            interval_note(analysis, compared.flat_map(of_arm)),
        ],
    }
}

/// The settings that are not the same in all arms: a row per setting, a column per arm.
pub(super) fn settings(analysis: &Analysis) -> Table {
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
        columns: ["setting".to_owned()].into_iter().chain(analysis.arms.iter().map(|arm| arm.name.clone())).collect(),
        rows: analysis.differences.iter().map(row).collect(),
        notes: Vec::new(),
    }
}

/// What should be there and is not.
pub(super) fn missing(analysis: &Analysis) -> Table {
    let row = |missing: &Missing| {
        let arm = analysis.arms[missing.arm].name.as_str();
        vec![
            arm.into(),
            Cell::Text(missing.seed.to_string()),
            missing.levels.join(", ").into(),
            missing.why.as_str().into(),
        ]
    };
    let unread = |left_out: &LeftOut| {
        vec![left_out.path.display().to_string().into(), Cell::Missing, Cell::Missing, left_out.why.as_str().into()]
    };
    Table {
        title: "Missing: stages and runs that have no result".to_owned(),
        columns: head(&["arm", "seed", "levels", "why"]),
        rows: analysis.missing.iter().map(row).chain(analysis.left_out.iter().map(unread)).collect(),
        notes: Vec::new(),
    }
}
