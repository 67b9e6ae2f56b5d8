//! `learning.csv`: what an agent earns in the midst of stages, as a reader sees it.

use std::fs::File;
use std::io;
use std::path::Path;

use anyhow::{Context, Result};
use serde::Deserialize;

use super::logs::LEARNING;
use crate::results::Policy;

/// One row: one policy on one level.
#[derive(Clone, Debug, PartialEq, Deserialize)]
pub(super) struct Row {
    /// The stage.
    pub stage: u16,
    /// Its timesteps so far.
    pub timesteps: u64,
    /// Those of all stages.
    #[serde(rename = "cumulative_timesteps")]
    pub cumulative: u64,
    /// The name of the level that was evaluated.
    pub level: String,
    /// Whose returns they are.
    pub policy: Policy,
    /// Mean return over every start cell.
    #[serde(rename = "return")]
    pub mean: f64,
}

/// Reads the file of a run; none is no rows.
///
/// # Errors
/// A file that is not what a run writes, naming it and the line.
pub(super) fn read(run: &Path) -> Result<Vec<Row>> {
    let path = run.join(LEARNING);
    let what = || format!("cannot read {}", path.display());
    let file = match File::open(&path) {
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(Vec::new()),
        file => file.with_context(what)?,
    };
    csv::Reader::from_reader(file).deserialize().collect::<Result<_, _>>().with_context(what)
}
