//! Evaluations in the midst of stages, as `train`, `curriculum` and `study` take them.

use std::sync::Arc;

use anyhow::Result;
use clap::Args;
use coverage_env::Level;

use super::parse_level_names;
use crate::error::UserError;
use crate::experiment::Curriculum;
use crate::experiment::curriculum::distinct;
use crate::training::evaluation::Midway;

/// When and where agents are evaluated in the midst of stages. It changes no other result.
#[derive(Clone, Debug, Args)]
pub(super) struct MidwayArgs {
    /// Evaluate in the midst of stages, after every N timesteps (learning.csv). It changes no other result.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..))]
    evaluate_every: Option<u64>,
    /// Where --evaluate-every evaluates: levels of the training, ids, ranges or paths [default: the level being trained].
    #[arg(long, value_name = "SPEC", requires = "evaluate_every")]
    evaluate_levels: Option<String>,
    /// Keep each stage's agent with the highest greedy mean return on its level among those that --evaluate-every evaluates
    /// (checkpoints/best-<stage>.safetensors).
    #[arg(long, requires = "evaluate_every")]
    keep_best: bool,
}

impl MidwayArgs {
    /// Those of a training through `curriculum`.
    ///
    /// # Errors
    /// Levels that are not there, and those that do not fit the ones of the curriculum.
    pub(super) fn of(&self, curriculum: &Curriculum) -> Result<Midway> {
        let every = self.evaluate_every.unwrap_or(0);
        let levels = self.evaluate_levels.as_deref().map_or_else(|| Ok(Vec::new()), |spec| levels(spec, curriculum))?;
        Ok(Midway { every, levels, keep_best: self.keep_best })
    }
}

/// The levels that a text names, each once: those of the curriculum by their names, others by id or path.
fn levels(spec: &str, curriculum: &Curriculum) -> Result<Vec<Arc<Level>>> {
    let flagged = |problem: String| UserError::new(format!("--evaluate-levels: {problem}"));
    let mut levels: Vec<Arc<Level>> = Vec::new();
    for name in parse_level_names(spec, "--evaluate-levels")? {
        let own = curriculum.levels.iter().find(|level| level.name() == name).cloned();
        let level = own.map_or_else(|| Level::resolve(&name).map(Arc::new), Ok);
        levels.push(level.map_err(|error| flagged(error.to_string()))?);
    }
    distinct(&[&curriculum.levels[..], &levels].concat()).map_err(|error| flagged(error.to_string()))?;
    Ok(distinct(&levels)?)
}
