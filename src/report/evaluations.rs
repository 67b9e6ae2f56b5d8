//! What `eval` and `baseline` print.

use super::table::{Cell, Table};
use crate::results::{Evaluation, LevelResult};

/// Evaluations as a table: a row per policy and level.
pub fn evaluations(evaluations: &[Evaluation]) -> Table {
    let columns = ["policy", "level", "mean", "std", "min", "max", "solved", "episodes"];
    let row = |evaluation: &Evaluation, level: &LevelResult| {
        let mut policy = evaluation.policy.clone();
        if let Some(seed) = evaluation.seed {
            policy += &format!(" seed {seed}");
        }
        if let Some(stage) = evaluation.stage {
            policy += &format!(" stage {stage}");
        }
        vec![
            policy.into(),
            level.level.clone().into(),
            Cell::Number(level.mean, 3),
            Cell::Number(level.std, 3),
            Cell::Number(level.min as f64, 0),
            Cell::Number(level.max as f64, 0),
            Cell::Number(level.solved_share, 3),
            Cell::Number(level.episodes.len() as f64, 0),
        ]
    };
    let rows = evaluations.iter().flat_map(|e| e.levels.iter().map(move |level| row(e, level)));
    Table {
        title: String::new(),
        columns: columns.map(str::to_owned).to_vec(),
        rows: rows.collect(),
        notes: Vec::new(),
    }
}
