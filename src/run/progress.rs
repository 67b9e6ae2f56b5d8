//! `progress.csv` and `plasticity.csv`: logs that only grow, and are cut back to the last finished stage on resume.

use std::fs::{File, OpenOptions};
use std::io::{self, BufRead, BufReader, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use anyhow::{Context, Result};

use crate::agent::Stage;

/// Where a row stands: the first columns of a log, of which the very first tells the stage.
pub(super) type Place = Vec<(&'static str, String)>;

/// The first columns of `progress.csv`; `elapsed` is in seconds.
pub(super) fn progress_place(stage: &Stage, timesteps: u64, cumulative: u64, elapsed: f64) -> Place {
    let fps = cumulative as f64 / elapsed.max(1e-9);
    vec![
        ("stage", stage.index.to_string()),
        ("level", stage.level.name().to_owned()),
        ("time/total_timesteps", timesteps.to_string()),
        ("cumulative_timesteps", cumulative.to_string()),
        ("time/time_elapsed", format!("{elapsed:.3}")),
        ("time/fps", format!("{fps:.0}")),
    ]
}

/// The first columns of `plasticity.csv`.
pub(super) fn plasticity_place(stage: &Stage, timesteps: u64, cumulative: u64) -> Place {
    vec![
        ("stage", stage.index.to_string()),
        ("level", stage.level.name().to_owned()),
        ("timesteps", timesteps.to_string()),
        ("cumulative_timesteps", cumulative.to_string()),
    ]
}

/// An open log.
pub(super) struct StageLog {
    path: PathBuf,
    file: File,
    /// Whether the header stands already.
    header: bool,
}

impl StageLog {
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

    /// Adds one row: where it stands, then names and values that are the same names in every row.
    pub(super) fn append<N: AsRef<str>>(&mut self, place: &Place, values: &[(N, f64)]) -> Result<()> {
        let mut csv = csv::Writer::from_writer(Vec::new());
        if !self.header {
            let place = place.iter().map(|(name, _)| *name);
            csv.write_record(place.chain(values.iter().map(|(name, _)| name.as_ref())))?;
            self.header = true;
        }
        let place = place.iter().map(|(_, cell)| cell.clone());
        csv.write_record(place.chain(values.iter().map(|(_, value)| value.to_string())))?;
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
        let stage = |index| Stage { index, level: level.clone(), timesteps: 10, horizon: 10 };
        let write = |log: &mut StageLog, index| {
            let place = progress_place(&stage(index), 10, 10 * u64::from(index), 1.5);
            log.append(&place, &[("train/loss", 0.25)]).unwrap();
        };
        let mut log = StageLog::open(&path, 0).unwrap();
        write(&mut log, 0);
        write(&mut log, 0);
        let one_stage = std::fs::read_to_string(&path).unwrap();
        write(&mut log, 1);
        let two_stages = std::fs::read_to_string(&path).unwrap();
        assert_eq!(two_stages.lines().nth(1), Some("0,\"a,b\",10,0,1.500,0,0.25"));
        std::fs::write(&path, two_stages.clone() + "1,\"a,").unwrap();
        drop(StageLog::open(&path, 2).unwrap());
        assert_eq!(std::fs::read_to_string(&path).unwrap(), two_stages);
        let mut log = StageLog::open(&path, 1).unwrap();
        assert_eq!(std::fs::read_to_string(&path).unwrap(), one_stage);
        write(&mut log, 1);
        assert_eq!(std::fs::read_to_string(&path).unwrap(), two_stages);
        drop(StageLog::open(&path, 0).unwrap());
        assert_eq!(std::fs::read_to_string(&path).unwrap(), "");
    }
}
