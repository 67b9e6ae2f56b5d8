//! What a run is to be.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use super::manifest::Engine;
use crate::agent::config::Config;
use crate::experiment::{Curriculum, Fork};

/// What a run is to be, as a start asks for it.
#[derive(Clone, Debug)]
pub struct Plan<'a> {
    /// Its settings.
    pub config: &'a Config,
    /// Its stages, and the levels that it is evaluated on.
    pub curriculum: &'a Curriculum,
    /// What it goes on from, if it is a fork.
    pub parents: Option<&'a Parents>,
    /// The seed's number.
    pub seed: u64,
    /// What computes its networks.
    pub engine: Engine,
    /// Where: `cpu` or `cuda:N`.
    pub device: String,
    /// Timesteps between two measurements of plasticity; 0 for none.
    pub plasticity_interval: u64,
    /// Timesteps between two evaluations in the midst of a stage; 0 for none.
    pub evaluate_every: u64,
    /// Whether the best agent of each stage is kept.
    pub keep_best: bool,
    /// The command as it was typed.
    pub command: &'a [String],
    /// Whether an existing run is continued.
    pub resume: bool,
}

/// What the runs of an experiment go on from.
#[derive(Clone, Debug)]
pub struct Parents {
    /// How they go on.
    pub fork: Fork,
    /// The directory of each seed's parent.
    pub directories: BTreeMap<u64, PathBuf>,
    /// The place of their experiment, where the same start trains them.
    pub experiment: Option<usize>,
}

impl Parents {
    /// The directory of a seed's parent.
    pub(super) fn of(&self, seed: u64) -> &Path {
        self.directories.get(&seed).map_or(Path::new(""), PathBuf::as_path)
    }
}
