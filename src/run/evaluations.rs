//! `evaluations.csv`: every evaluated episode of a run.

use std::path::Path;
use std::{fs, io};

use anyhow::{Context, Result};
use serde::{Deserialize, Serialize};

use super::atomic;
use crate::results::{Episode, LevelResult};

/// Its name within the run.
pub(super) const FILE: &str = "evaluations.csv";

/// When an evaluation was made.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Phase {
    /// Before the first stage.
    Before,
    /// After the stage it names.
    After,
}

/// One episode.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Row {
    /// When.
    pub phase: Phase,
    /// The stage just trained; 0 before the first.
    pub stage: u16,
    /// The level's name.
    pub level: String,
    /// The episode.
    pub episode: Episode,
}

/// A row as it stands in the file; `start` is `row column`.
#[derive(Serialize, Deserialize)]
struct Record {
    phase: Phase,
    stage: u16,
    level: String,
    start: String,
    #[serde(rename = "return")]
    return_: i64,
    length: u32,
    solved: bool,
}

/// Writes the file of a run, whole; returns its content.
pub(super) fn write(run: &Path, rows: &[Row]) -> Result<Vec<u8>> {
    let mut csv = csv::Writer::from_writer(Vec::new());
    for row in rows {
        let [r, c] = row.episode.start;
        csv.serialize(Record {
            phase: row.phase,
            stage: row.stage,
            level: row.level.clone(),
            start: format!("{r} {c}"),
            return_: row.episode.return_,
            length: row.episode.length,
            solved: row.episode.solved,
        })?;
    }
    let (path, content) = (run.join(FILE), csv.into_inner()?);
    atomic::write(&path, &content).with_context(|| format!("cannot write {}", path.display()))?;
    Ok(content)
}

/// Reads the file of a run; none is no rows.
///
/// # Errors
/// A file that is not what a run writes, naming it and the line.
pub fn read(run: &Path) -> Result<Vec<Row>> {
    read_beginning(run, u64::MAX)
}

/// Reads the first `bytes` of the file.
pub(super) fn read_beginning(run: &Path, bytes: u64) -> Result<Vec<Row>> {
    let path = run.join(FILE);
    let content = match fs::read(&path) {
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(Vec::new()),
        content => content.with_context(|| format!("cannot read {}", path.display()))?,
    };
    let beginning = &content[..content.len().min(usize::try_from(bytes).unwrap_or(usize::MAX))];
    rows(beginning).with_context(|| format!("cannot read {}", path.display()))
}

fn rows(content: &[u8]) -> Result<Vec<Row>> {
    let mut rows = Vec::new();
    for record in csv::Reader::from_reader(content).deserialize() {
        let record: Record = record?;
        let start = record.start.split_once(' ').and_then(|(r, c)| Some([r.parse().ok()?, c.parse().ok()?]));
        let start = start.with_context(|| format!("{:?} is not a start cell \"row column\"", record.start))?;
        let episode = Episode { start, return_: record.return_, length: record.length, solved: record.solved };
        rows.push(Row { phase: record.phase, stage: record.stage, level: record.level, episode });
    }
    Ok(rows)
}

/// The result of one evaluation of one level, if there was one.
pub fn level_result(rows: &[Row], phase: Phase, stage: u16, level: &str) -> Option<LevelResult> {
    let here = rows.iter().filter(|row| row.phase == phase && row.stage == stage && row.level == level);
    let episodes: Vec<Episode> = here.map(|row| row.episode.clone()).collect();
    (!episodes.is_empty()).then(|| LevelResult::new(level, episodes))
}
