//! Logs: files that only grow, and are cut back on resume to where they were when the state was saved.

use std::collections::BTreeMap;
use std::fs::{self, File, OpenOptions};
use std::io::{self, Read, Write};
use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use crc32fast::Hasher;
use serde::{Deserialize, Serialize};

use super::atomic::{create_directories, sync_directory};

/// The log of metrics.
pub const PROGRESS: &str = "progress.csv";
/// The log of plasticity.
pub const PLASTICITY: &str = "plasticity.csv";
/// The log of evaluations in the midst of stages.
pub const LEARNING: &str = "learning.csv";
/// TensorBoard's log. Its name is the same for every start, so that a resumed run goes on in the same file.
pub(super) const TENSORBOARD: &str = "tb/events.out.tfevents.0.cpp-rl";
/// Every log of a run; one more needs no more than its name here.
const NAMES: [&str; 4] = [PROGRESS, PLASTICITY, LEARNING, TENSORBOARD];

/// How far files had grown when a state was saved, by their names within the run.
pub type Marks = BTreeMap<String, Mark>;

/// A file's beginning: its length and checksum.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Mark {
    /// Bytes.
    pub bytes: u64,
    /// Their CRC-32.
    pub crc: u32,
}

impl Mark {
    /// That of a file with this content.
    pub(super) fn of(content: &[u8]) -> Self {
        Self { bytes: content.len() as u64, crc: crc32fast::hash(content) }
    }

    /// Checks that a file begins as it did; one that did not exist need not.
    ///
    /// # Errors
    /// In words, a file that is shorter or has changed.
    pub(super) fn check(self, path: &Path) -> Result<(), String> {
        if self.bytes == 0 {
            return Ok(());
        }
        let mut hasher = Hasher::new();
        let mut part = vec![0; 1 << 16];
        let mut left = self.bytes;
        let mut hash = || -> io::Result<()> {
            let mut file = File::open(path)?;
            while left > 0 {
                let wanted = part.len().min(usize::try_from(left).unwrap_or(usize::MAX));
                match file.read(&mut part[..wanted])? {
                    0 => break,
                    read => {
                        hasher.update(&part[..read]);
                        left -= read as u64;
                    }
                }
            }
            Ok(())
        };
        hash().map_err(|error| format!("cannot read {}: {error}", path.display()))?;
        match () {
            () if left > 0 => Err(format!("{} is {left} bytes too short", path.display())),
            () if hasher.finalize() != self.crc => Err(format!("{} was damaged or edited", path.display())),
            () => Ok(()),
        }
    }
}

/// Checks that all files of a run begin as they did.
///
/// # Errors
/// The first that does not, in words.
pub(super) fn check(run: &Path, marks: &Marks) -> Result<(), String> {
    marks.iter().try_for_each(|(name, mark)| mark.check(&run.join(name)))
}

/// The logs of one run, open for appending.
pub(super) struct Logs {
    run: PathBuf,
    logs: BTreeMap<&'static str, Log>,
}

/// One log; its file appears with the first line.
struct Log {
    file: Option<File>,
    /// Over everything so far.
    hasher: Hasher,
    bytes: u64,
}

impl Logs {
    /// Cuts all logs back to `marks`, which have been [checked](check); a log without a mark goes.
    ///
    /// # Errors
    /// Those of the file system.
    pub(super) fn cut_back(run: &Path, marks: &Marks) -> Result<Self> {
        let mut logs = BTreeMap::new();
        for name in NAMES {
            let path = run.join(name);
            let mark = marks.get(name).copied().unwrap_or_default();
            let log = Log::cut_back(&path, mark).with_context(|| format!("cannot cut back {}", path.display()))?;
            logs.insert(name, log);
        }
        Ok(Self { run: run.to_owned(), logs })
    }

    /// Logs of a run that is done, of which none is open.
    pub(super) fn closed(run: &Path) -> Self {
        Self { run: run.to_owned(), logs: BTreeMap::new() }
    }

    /// Whether nothing is in a log.
    pub(super) fn is_empty(&self, name: &'static str) -> bool {
        self.logs.get(name).is_none_or(|log| log.bytes == 0)
    }

    /// Appends to a log, in one write: a kill can cut it short, but never mix two.
    ///
    /// # Errors
    /// Those of the file system.
    pub(super) fn append(&mut self, name: &'static str, bytes: &[u8]) -> Result<()> {
        let path = self.run.join(name);
        let log = self.logs.entry(name).or_insert_with(|| Log::new(None, Mark::default()));
        log.append(&path, bytes).with_context(|| format!("cannot write {}", path.display()))
    }

    /// Makes everything so far durable.
    ///
    /// # Errors
    /// Those of the file system.
    pub(super) fn sync(&self) -> Result<()> {
        for (name, log) in &self.logs {
            let synced = log.file.as_ref().map_or(Ok(()), File::sync_data);
            synced.with_context(|| format!("cannot write {}", self.run.join(name).display()))?;
        }
        Ok(())
    }

    /// How far they have grown.
    pub(super) fn marks(&self) -> Marks {
        let written = self.logs.iter().filter(|(_, log)| log.bytes > 0);
        written.map(|(name, log)| ((*name).to_owned(), log.mark())).collect()
    }
}

impl Log {
    fn new(file: Option<File>, mark: Mark) -> Self {
        Self { file, hasher: Hasher::new_with_initial_len(mark.crc, mark.bytes), bytes: mark.bytes }
    }

    fn cut_back(path: &Path, mark: Mark) -> io::Result<Self> {
        if mark.bytes > 0 {
            let file = OpenOptions::new().append(true).open(path)?;
            file.set_len(mark.bytes)?;
            return Ok(Self::new(Some(file), mark));
        }
        match fs::remove_file(path) {
            Err(error) if error.kind() != io::ErrorKind::NotFound => Err(error),
            _ => Ok(Self::new(None, mark)),
        }
    }

    fn append(&mut self, path: &Path, bytes: &[u8]) -> io::Result<()> {
        if self.file.is_none() {
            let directory = path.parent().unwrap_or(Path::new("."));
            create_directories(directory)?;
            self.file = Some(OpenOptions::new().create(true).append(true).open(path)?);
            sync_directory(directory)?;
        }
        if let Some(file) = &mut self.file {
            file.write_all(bytes)?;
        }
        self.hasher.update(bytes);
        self.bytes += bytes.len() as u64;
        Ok(())
    }

    fn mark(&self) -> Mark {
        Mark { bytes: self.bytes, crc: self.hasher.clone().finalize() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn logs_grow_and_are_cut_back() {
        let directory = tempfile::tempdir().unwrap();
        let run = directory.path();
        let text = || fs::read_to_string(run.join(PROGRESS)).unwrap();
        let mut logs = Logs::cut_back(run, &Marks::new()).unwrap();
        assert!(logs.is_empty(PROGRESS) && logs.marks().is_empty());
        logs.append(PROGRESS, b"a,b\n").unwrap();
        logs.append(PROGRESS, b"1,2\n").unwrap();
        let marks = logs.marks();
        assert_eq!(marks[PROGRESS], Mark::of(b"a,b\n1,2\n"));
        logs.append(PROGRESS, b"3,").unwrap();

        check(run, &marks).unwrap();
        let mut logs = Logs::cut_back(run, &marks).unwrap();
        assert_eq!((text().as_str(), logs.is_empty(PROGRESS)), ("a,b\n1,2\n", false));
        logs.append(PROGRESS, b"4,5\n").unwrap();
        assert_eq!(logs.marks()[PROGRESS], Mark::of(text().as_bytes()));

        drop(Logs::cut_back(run, &Marks::new()).unwrap());
        assert!(!run.join(PROGRESS).exists());
    }

    #[test]
    fn a_damaged_log_is_noticed() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join(PROGRESS);
        let mark = Mark::of(b"a,b\n1,2\n");
        for (content, what) in [("a,b\n1,2\n3", ""), ("a,b\n1,2", "1 bytes too short"), ("a,b\n1,3\n", "damaged")] {
            fs::write(&path, content).unwrap();
            let said = mark.check(&path).err().unwrap_or_default();
            assert!(said.contains(what) && said.is_empty() == what.is_empty(), "{content:?}: {said}");
        }
        fs::remove_file(&path).unwrap();
        assert!(mark.check(&path).unwrap_err().contains("cannot read"));
        Mark::default().check(&path).unwrap();
    }
}
