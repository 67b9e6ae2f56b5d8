//! `progress.csv`: a log that only grows, and is cut back to the last finished stage on resume.

use std::fs::{File, OpenOptions};
use std::io::{self, BufRead, BufReader, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use anyhow::{Context, Result};

use crate::agent::{Metrics, Stage};

/// The columns before those of the algorithm.
const COLUMNS: [&str; 6] =
    ["stage", "level", "time/total_timesteps", "cumulative_timesteps", "time/time_elapsed", "time/fps"];

/// The open log.
pub(super) struct ProgressLog {
    path: PathBuf,
    file: File,
    /// Whether the header stands already.
    header: bool,
}

impl ProgressLog {
    /// Opens the log for appending, cut back to the rows of the first `stages_done` stages.
    pub(super) fn open(path: &Path, stages_done: u16) -> Result<Self> {
        let open = || -> io::Result<(File, u64)> {
            let mut file = OpenOptions::new().read(true).write(true).create(true).truncate(false).open(path)?;
            let length = kept_length(&file, stages_done)?;
            file.set_len(length)?;
            file.seek(SeekFrom::End(0))?;
            Ok((file, length))
        };
        let (file, length) = open().with_context(|| format!("cannot open {}", path.display()))?;
        Ok(Self { path: path.to_owned(), file, header: length > 0 })
    }

    /// Adds one row.
    pub(super) fn append(
        &mut self,
        stage: &Stage,
        timesteps: u64,
        cumulative: u64,
        elapsed: f64,
        metrics: &Metrics,
    ) -> Result<()> {
        let mut csv = csv::Writer::from_writer(Vec::new());
        if !self.header {
            csv.write_record(COLUMNS.iter().copied().chain(metrics.iter().map(|(name, _)| *name)))?;
            self.header = true;
        }
        let fps = cumulative as f64 / elapsed.max(1e-9);
        let own = [
            stage.index.to_string(),
            stage.level.name().to_owned(),
            timesteps.to_string(),
            cumulative.to_string(),
            format!("{elapsed:.3}"),
            format!("{fps:.0}"),
        ];
        csv.write_record(own.into_iter().chain(metrics.iter().map(|(_, value)| value.to_string())))?;
        // One write per row: a kill can cut a row short, but never mix two.
        self.file.write_all(&csv.into_inner()?).with_context(|| format!("cannot write {}", self.path.display()))
    }

    /// Makes all rows so far durable.
    pub(super) fn sync(&self) -> Result<()> {
        self.file.sync_data().with_context(|| format!("cannot write {}", self.path.display()))
    }
}

/// The length of the header and the rows of the first `stages_done` stages.
fn kept_length(file: &File, stages_done: u16) -> io::Result<u64> {
    let mut kept = 0;
    let mut line = Vec::new();
    let mut reader = BufReader::new(file);
    for row in 0_u64.. {
        line.clear();
        let length = reader.read_until(b'\n', &mut line)?;
        let stage = || std::str::from_utf8(&line).ok()?.split(',').next()?.parse::<u16>().ok();
        let whole = line.ends_with(b"\n");
        if length == 0 || !whole || stages_done == 0 || (row > 0 && stage().is_none_or(|stage| stage >= stages_done)) {
            break;
        }
        kept += length as u64;
    }
    Ok(kept)
}

#[cfg(test)]
mod tests {
    use super::*;
    use coverage_env::Level;
    use std::sync::Arc;

    #[test]
    fn a_log_is_cut_back_to_finished_stages() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("progress.csv");
        let level = Arc::new(Level::from_map("a,b", "T..").unwrap());
        let stage = |index| Stage { index, level: level.clone(), timesteps: 10 };
        let write = |log: &mut ProgressLog, index| {
            log.append(&stage(index), 10, 10 * u64::from(index), 1.5, &vec![("train/loss", 0.25)]).unwrap();
        };
        let mut log = ProgressLog::open(&path, 0).unwrap();
        write(&mut log, 0);
        write(&mut log, 0);
        let one_stage = std::fs::read_to_string(&path).unwrap();
        write(&mut log, 1);
        let two_stages = std::fs::read_to_string(&path).unwrap();
        assert_eq!(two_stages.lines().nth(1), Some("0,\"a,b\",10,0,1.500,0,0.25"));
        std::fs::write(&path, two_stages.clone() + "1,\"a,").unwrap();
        drop(ProgressLog::open(&path, 2).unwrap());
        assert_eq!(std::fs::read_to_string(&path).unwrap(), two_stages);
        let mut log = ProgressLog::open(&path, 1).unwrap();
        assert_eq!(std::fs::read_to_string(&path).unwrap(), one_stage);
        write(&mut log, 1);
        assert_eq!(std::fs::read_to_string(&path).unwrap(), two_stages);
        drop(ProgressLog::open(&path, 0).unwrap());
        assert_eq!(std::fs::read_to_string(&path).unwrap(), "");
    }
}
