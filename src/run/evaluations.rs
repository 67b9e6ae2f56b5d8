//! `evaluations.csv`: every evaluated episode of a run, before the first stage and after each stage.

use std::path::Path;
use std::{fs, io};

use anyhow::{Context, Result};
use serde::{Deserialize, Serialize};

use super::atomic;
use super::logs::Mark;
use crate::results::{Episode, LevelResult, Policy};

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
    /// Whose episode it is.
    pub policy: Policy,
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
    /// Up to version 0.1.0 there was no such column: all episodes were greedy.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    policy: Option<Policy>,
}

/// The file of a run that is being written.
#[derive(Debug)]
pub(super) struct Evaluations {
    rows: Vec<Row>,
    /// That of the file as it stands.
    mark: Mark,
    /// Whether the file names policies. One that an earlier version began does not, and goes on with its columns: what a
    /// snapshot says of its beginning must stay true.
    names_policies: bool,
}

impl Evaluations {
    /// The file of a run that goes on, of which only the beginning counts.
    ///
    /// # Errors
    /// A file that is not what a run writes, naming it and the line.
    pub(super) fn beginning(run: &Path, mark: Mark) -> Result<Self> {
        let rows = read_beginning(run, mark.bytes)?;
        let names_policies = rows.is_empty() || rows.iter().any(|row| row.policy == Policy::Sampled);
        Ok(Self { rows, mark, names_policies })
    }

    /// The file of a run that is done.
    ///
    /// # Errors
    /// As [`beginning`](Self::beginning).
    pub(super) fn finished(run: &Path, mark: Mark) -> Result<Self> {
        Ok(Self { rows: read(run)?, mark, names_policies: true })
    }

    /// Every row so far.
    pub(super) fn rows(&self) -> &[Row] {
        &self.rows
    }

    /// How far the file has grown; nothing where there is none.
    pub(super) fn mark(&self) -> Option<Mark> {
        (self.mark.bytes > 0).then_some(self.mark)
    }

    /// Adds these results, and writes the file whole.
    ///
    /// # Errors
    /// Those of the file system.
    pub(super) fn add(
        &mut self,
        run: &Path,
        phase: Phase,
        stage: u16,
        results: &[(Policy, LevelResult)],
    ) -> Result<()> {
        for (policy, result) in results {
            if self.names_policies || *policy == Policy::Greedy {
                let row = |episode: &Episode| Row {
                    phase,
                    stage,
                    level: result.level.clone(),
                    episode: episode.clone(),
                    policy: *policy,
                };
                self.rows.extend(result.episodes.iter().map(row));
            }
        }
        let mut csv = csv::Writer::from_writer(Vec::new());
        for row in &self.rows {
            csv.serialize(self.record(row))?;
        }
        let (path, content) = (run.join(FILE), csv.into_inner()?);
        atomic::write(&path, &content).with_context(|| format!("cannot write {}", path.display()))?;
        self.mark = Mark::of(&content);
        Ok(())
    }

    fn record(&self, row: &Row) -> Record {
        let [r, c] = row.episode.start;
        Record {
            phase: row.phase,
            stage: row.stage,
            level: row.level.clone(),
            start: format!("{r} {c}"),
            return_: row.episode.return_,
            length: row.episode.length,
            solved: row.episode.solved,
            policy: self.names_policies.then_some(row.policy),
        }
    }
}

/// Reads the file of a run; none is no rows.
///
/// # Errors
/// A file that is not what a run writes, naming it and the line.
pub fn read(run: &Path) -> Result<Vec<Row>> {
    read_beginning(run, u64::MAX)
}

/// Reads the first `bytes` of the file.
fn read_beginning(run: &Path, bytes: u64) -> Result<Vec<Row>> {
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
        let policy = record.policy.unwrap_or_default();
        rows.push(Row { phase: record.phase, stage: record.stage, level: record.level, episode, policy });
    }
    Ok(rows)
}

/// The result of one evaluation of one policy on one level, if there was one.
pub fn level_result(rows: &[Row], phase: Phase, stage: u16, level: &str, policy: Policy) -> Option<LevelResult> {
    let is_here = |row: &&Row| (row.phase, row.stage, row.policy) == (phase, stage, policy) && row.level == level;
    let episodes: Vec<Episode> = rows.iter().filter(is_here).map(|row| row.episode.clone()).collect();
    (!episodes.is_empty()).then(|| LevelResult::new(level, episodes))
}
