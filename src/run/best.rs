//! The best agent of each stage, where it is to be kept.

use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result};

use super::checkpoint::Checkpoint;
use super::{learning, snapshot};
use crate::results::Policy;

/// The path of the checkpoint of a stage's best agent within a run.
pub(super) fn best_checkpoint(run: &Path, stage: u16) -> PathBuf {
    run.join("checkpoints").join(format!("best-{stage}.safetensors"))
}

/// The agent of a stage that is kept.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Best(Option<Kept>);

#[derive(Clone, Copy, Debug)]
struct Kept {
    stage: u16,
    /// Its greedy mean return on the stage's level.
    mean: f64,
}

impl Best {
    /// That of a stage.
    pub(super) fn new(stage: u16, mean: f64) -> Self {
        Self(Some(Kept { stage, mean }))
    }

    /// Whether an agent of a stage earns more; the first of equals is kept.
    pub(super) fn is_beaten(self, stage: u16, mean: f64) -> bool {
        self.0.is_none_or(|kept| kept.stage != stage || mean > kept.mean)
    }

    /// What a run that goes on in `stage` has kept of it, once its logs are cut back, and what the user should know.
    ///
    /// The file counts, if the log says what its agent earned. Otherwise it is newer than the state from which the run goes on,
    /// and is removed: whatever has been best is reached again, and written with the same bytes. One that cannot be read is
    /// put aside.
    ///
    /// # Errors
    /// Those of the file system, and a log that cannot be read.
    pub(super) fn find(run: &Path, stage: u16) -> Result<(Self, Option<String>)> {
        let path = best_checkpoint(run, stage);
        if !path.exists() {
            return Ok((Self::default(), None));
        }
        let kept = match Checkpoint::read(&path) {
            Ok(kept) => kept,
            Err(problem) => {
                let aside = snapshot::set_aside(&path).with_context(|| format!("cannot rename {}", path.display()))?;
                let what = format!(
                    "{problem}; the best agent is looked for anew, and the file is kept as {}",
                    aside.display()
                );
                return Ok((Self::default(), Some(what)));
            }
        };
        let rows = learning::read(run)?;
        let is_its = |row: &&learning::Row| {
            (row.stage, row.cumulative, row.policy) == (stage, kept.agent.counters.timesteps, Policy::Greedy)
                && Some(&row.level) == kept.origin.level.as_ref()
        };
        if let Some(row) = rows.iter().find(is_its) {
            return Ok((Self::new(stage, row.mean), None));
        }
        fs::remove_file(&path).with_context(|| format!("cannot remove {}", path.display()))?;
        Ok((Self::default(), None))
    }
}
