//! The study's learning curves, to lie beside those of runs. They are no part of cpp-rl: who has them names the file.

use std::collections::BTreeMap;
use std::path::Path;

use anyhow::Result;
use serde::{Deserialize, Serialize};

use crate::error::UserError;

/// What the names of runs through a curriculum end with, after the preset's.
const CURRICULUM: &str = "-curriculum";

/// Returns during the training of one of the study's models on one level: one seed.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PublishedCurve {
    /// The preset that repeats the model.
    pub preset: String,
    /// The level's place in the study's curriculum.
    pub level: usize,
    /// Tells repeated runs apart.
    pub repeat: u32,
    /// Timesteps on the level, and the mean return of the last 100 episodes; ascending.
    pub points: Vec<(f64, f64)>,
}

/// A row of the file.
#[derive(Deserialize)]
struct Row {
    run: String,
    level: usize,
    repeat: u32,
    timesteps: f64,
    ep_rew_mean: f64,
}

/// Reads the curves of runs through the curriculum; others are passed over.
///
/// # Errors
/// A file that cannot be read, or has not the columns `run`, `level`, `repeat`, `timesteps` and `ep_rew_mean`.
pub fn read(path: &Path) -> Result<Vec<PublishedCurve>> {
    let problem = |error: csv::Error| UserError::new(format!("{}: {error}", path.display()));
    let mut curves: BTreeMap<(String, usize, u32), Vec<(f64, f64)>> = BTreeMap::new();
    for row in csv::Reader::from_path(path).map_err(problem)?.deserialize() {
        let row: Row = row.map_err(problem)?;
        if let Some(preset) = row.run.strip_suffix(CURRICULUM) {
            let key = (preset.to_owned(), row.level, row.repeat);
            curves.entry(key).or_default().push((row.timesteps, row.ep_rew_mean));
        }
    }
    let curve = |((preset, level, repeat), mut points): ((String, usize, u32), Vec<(f64, f64)>)| {
        points.sort_by(|a, b| a.0.total_cmp(&b.0));
        PublishedCurve { preset, level, repeat, points }
    };
    Ok(curves.into_iter().map(curve).collect())
}
