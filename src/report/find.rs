//! Runs below a folder, and what else is there.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use crate::run::{lock, manifest};

/// Folders below a given one that may hold runs: two of the user's, command, arm, curriculum, seed.
const DEPTH: usize = 6;

/// What is below a folder, in no particular order.
#[derive(Debug, Default)]
pub struct Found {
    /// Directories with a `manifest.json`.
    pub runs: Vec<PathBuf>,
    /// Directories that hold no run as far as can be seen, and why.
    pub others: Vec<(PathBuf, NoRun)>,
}

/// Why a directory is no run.
#[derive(Debug)]
pub enum NoRun {
    /// It cannot be listed.
    Unreadable(io::Error),
    /// A process took it, and has not written the manifest yet, or never did.
    NotBegun,
    /// Neither it nor anything in it is a run.
    Foreign,
}

/// Looks for runs in and below `directory`, which may itself be one; links are not followed.
///
/// # Errors
/// A `directory` that cannot be listed; those below it are part of what is found.
pub fn find_runs(directory: &Path) -> io::Result<Found> {
    let mut found = Found::default();
    if !found.take(directory)? {
        found.list(directory, DEPTH)?;
    }
    Ok(found)
}

impl Found {
    /// Takes a directory that is a run; tells whether it is one.
    fn take(&mut self, directory: &Path) -> io::Result<bool> {
        let is_run = directory.join(manifest::FILE).try_exists()?;
        if is_run {
            self.runs.push(directory.to_owned());
        } else if directory.join(lock::NAME).try_exists()? {
            self.others.push((directory.to_owned(), NoRun::NotBegun));
            return Ok(true);
        }
        Ok(is_run)
    }

    /// Looks into the folders of a directory; tells whether there was anything. A folder with nothing to tell of in it
    /// is named alone, not with all that is in it.
    fn list(&mut self, directory: &Path, depth: usize) -> io::Result<bool> {
        let (mut any, mut foreign) = (false, Vec::new());
        for entry in fs::read_dir(directory)? {
            let entry = entry?;
            if !entry.file_type()?.is_dir() {
                continue;
            }
            let path = entry.path();
            let below = self.take(&path).and_then(|taken| Ok(taken || (depth > 1 && self.list(&path, depth - 1)?)));
            match below {
                Ok(true) => any = true,
                Ok(false) => foreign.push((path, NoRun::Foreign)),
                Err(error) => {
                    any = true;
                    self.others.push((path, NoRun::Unreadable(error)));
                }
            }
        }
        if any {
            self.others.extend(foreign);
        }
        Ok(any)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn runs_are_found_and_the_rest_is_named() {
        let folder = tempfile::tempdir().unwrap();
        let root = folder.path();
        let make = |path: &str| fs::create_dir_all(root.join(path)).unwrap();
        for path in ["train/ppo/level-0/seed-0/checkpoints", "train/ppo/level-0/seed-1", "notes/a/b", "sb3/x"] {
            make(path);
        }
        fs::write(root.join("train/ppo/level-0/seed-0/manifest.json"), "{}").unwrap();
        fs::write(root.join("train/ppo/level-0/seed-1/.lock"), "").unwrap();
        let mut found = find_runs(root).unwrap();
        found.others.sort_by(|a, b| a.0.cmp(&b.0));
        assert_eq!(found.runs, [root.join("train/ppo/level-0/seed-0")]);
        let [(notes, NoRun::Foreign), (sb3, NoRun::Foreign), (seed, NoRun::NotBegun)] = &found.others[..] else {
            panic!("{:?}", found.others);
        };
        assert_eq!(
            [notes, sb3, seed],
            [&root.join("notes"), &root.join("sb3"), &root.join("train/ppo/level-0/seed-1")]
        );

        let run = root.join("train/ppo/level-0/seed-0");
        assert_eq!(find_runs(&run).unwrap().runs, [run]);
        let nothing = find_runs(&root.join("notes")).unwrap();
        assert!(nothing.runs.is_empty() && nothing.others.is_empty());
        assert!(find_runs(&root.join("absent")).is_err());
    }
}
