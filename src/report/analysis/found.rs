//! Directories of runs, with their manifests, before anything else in them is read.

use std::collections::{BTreeMap, BTreeSet};
use std::io;
use std::path::{Path, PathBuf};

use anyhow::Result;
use serde::Serialize;

use crate::error::UserError;
use crate::report::find::{NoRun, find_runs};
use crate::run::manifest::Manifest;

/// A directory that should hold a run, and why it is left out.
#[derive(Clone, Debug, Serialize)]
pub struct LeftOut {
    /// The directory.
    pub path: PathBuf,
    /// What is wrong, with the file's name.
    pub why: String,
}

/// A run's directory and manifest.
#[derive(Clone)]
pub(super) struct Found {
    pub(super) path: PathBuf,
    pub(super) manifest: Manifest,
}

/// A directory that should hold a run, and why it cannot be read.
pub(super) type Unread = (PathBuf, anyhow::Error);

/// Finds all runs in and below these directories, and what should be one and cannot be read.
pub(super) fn find(directories: &[PathBuf]) -> Result<(Vec<Found>, Vec<Unread>)> {
    let (mut paths, mut others) = (BTreeSet::new(), BTreeMap::new());
    for directory in directories {
        let cannot = |path: &Path, error: &io::Error| {
            UserError::new(format!("cannot read the directory {}: {error}", path.display()))
        };
        let found = find_runs(directory).map_err(|error| cannot(directory, &error))?;
        let is_foreign = |(_, other): &(PathBuf, NoRun)| matches!(other, NoRun::Foreign);
        let nothing = found.runs.is_empty() && found.others.iter().all(is_foreign);
        for (path, other) in found.others {
            let why = match other {
                NoRun::Unreadable(error) => cannot(&path, &error),
                NoRun::NotBegun => UserError::new(format!(
                    "{}: no manifest: the run has not begun, or was killed before it did",
                    path.display()
                )),
                NoRun::Foreign => continue,
            };
            others.insert(path, why);
        }
        if nothing {
            let message = "holds no run: give a run's directory (with a manifest.json) or a folder of runs";
            return Err(UserError::new(format!("{} {message}", directory.display())).into());
        }
        paths.extend(found.runs);
    }
    let (mut runs, mut left_out) = (Vec::new(), Vec::new());
    left_out.extend(others.into_iter().map(|(path, why)| (path, why.into())));
    for path in paths {
        match Manifest::read(&path) {
            Ok(manifest) => runs.push(Found { path, manifest }),
            Err(error) => left_out.push((path, error)),
        }
    }
    Ok((runs, left_out))
}

impl LeftOut {
    pub(super) fn new((path, error): &Unread) -> Self {
        Self { path: path.clone(), why: format!("{error:#}") }
    }
}
