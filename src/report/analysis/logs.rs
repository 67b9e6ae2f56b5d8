//! `progress.csv` and `plasticity.csv`, streamed: rows go into sums over stretches of training, and none is kept.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use csv::StringRecord;
use rl_stats::curve::Curve as CurveSummary;

use super::conventions::THRESHOLDS;
use super::levels::LevelInfo;
use crate::error::UserError;
use crate::run::logs::{PLASTICITY, PROGRESS};
use crate::run::manifest::StageEntry;

/// Points of a learning curve per stage, at most.
const CURVE_BINS: usize = 100;
/// Points of a plasticity measure per stage, at most.
const PLASTICITY_BINS: usize = 25;
/// The columns of `plasticity.csv` before the measures.
const PLASTICITY_COLUMNS: [&str; 4] = ["stage", "level", "timesteps", "cumulative_timesteps"];

/// What is kept of a run's logs.
pub(super) struct Logs {
    /// The learning curve of every stage.
    pub(super) stages: Vec<StageLog>,
    /// By measure; empty where none were logged.
    pub(super) plasticity: BTreeMap<String, MeasureLog>,
    /// Rows of `plasticity.csv` after updates.
    pub(super) plasticity_rows: u64,
    /// Rows of `progress.csv`.
    pub(super) rows: u64,
    /// Those without a mean return.
    pub(super) rows_without_return: u64,
    /// Rows of both files that are cut off or no numbers.
    pub(super) damaged_rows: u64,
}

/// The learning curve of one stage.
pub(super) struct StageLog {
    /// Of returns.
    pub(super) bins: Bins,
    /// Of normalised returns; none where the optimum is unknown.
    pub(super) summary: Option<CurveSummary>,
}

/// A plasticity measure during all stages.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct MeasureLog {
    /// By stage.
    pub(super) bins: Vec<Bins>,
    /// The value before the first update of each stage; none where that has none (NaN), or there is no such row.
    pub(super) begins: Vec<Option<f64>>,
    /// The value in the last row of each stage; none where that has none (NaN), or there is no row.
    pub(super) ends: Vec<Option<f64>>,
    /// Rows after an update that have no value.
    pub(super) rows_without_value: u64,
}

/// A series cut into stretches of equal numbers of timesteps.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Bins {
    /// Timesteps of a stretch.
    width: f64,
    /// Stretches in all.
    count: usize,
    /// Those that have rows, by their place, ascending: plasticity is measured in few of them.
    bins: Vec<(usize, Bin)>,
}

/// The rows of one stretch.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Bin {
    /// Sums over its rows of the stage's timesteps and of the timesteps of all stages so far.
    pub(super) timesteps: f64,
    pub(super) cumulative: f64,
    pub(super) rows: f64,
    /// Sum and number of its values; rows without one (NaN) left out.
    value: f64,
    values: f64,
}

impl Bins {
    fn new(count: usize, timesteps: u64) -> Self {
        Self { width: (timesteps as f64 / count as f64).max(1.0), count, bins: Vec::new() }
    }

    /// Takes in a row; those beyond the planned end (a rollout is always whole) belong to the last stretch.
    fn push(&mut self, timesteps: f64, cumulative: f64, value: f64) {
        let place = ((timesteps - 1.0).max(0.0) / self.width) as usize;
        let place = place.min(self.count - 1);
        let at = self.bins.binary_search_by_key(&place, |(own, _)| *own).unwrap_or_else(|at| {
            self.bins.insert(at, (place, Bin::default()));
            at
        });
        let bin = &mut self.bins[at].1;
        bin.timesteps += timesteps;
        bin.cumulative += cumulative;
        bin.rows += 1.0;
        if !value.is_nan() {
            bin.value += value;
            bin.values += 1.0;
        }
    }
}

impl Bins {
    /// The stretch at a place, if it has rows.
    pub(super) fn at(&self, place: usize) -> Option<&Bin> {
        let at = self.bins.binary_search_by_key(&place, |(own, _)| *own).ok()?;
        Some(&self.bins[at].1)
    }

    /// The places of the stretches that have rows, ascending.
    pub(super) fn places(&self) -> impl Iterator<Item = usize> {
        self.bins.iter().map(|(place, _)| *place)
    }
}

impl Bin {
    /// The mean of its values; none where it has none.
    pub(super) fn mean(&self) -> Option<f64> {
        (self.values > 0.0).then(|| self.value / self.values)
    }
}

impl Logs {
    /// Reads both logs of a run; an absent file is one without rows.
    pub(super) fn read(run: &Path, stages: &[StageEntry], levels: &[LevelInfo]) -> Result<Self> {
        let levels: Vec<Option<&LevelInfo>> =
            stages.iter().map(|stage| levels.iter().find(|level| level.name == stage.level)).collect();
        let log = |(stage, level): (&StageEntry, &Option<&LevelInfo>)| StageLog {
            bins: Bins::new(CURVE_BINS, stage.timesteps),
            summary: level.is_some_and(|level| level.optimal.is_some()).then(|| CurveSummary::new(&THRESHOLDS)),
        };
        let mut logs = Self {
            stages: stages.iter().zip(&levels).map(log).collect(),
            plasticity: BTreeMap::new(),
            plasticity_rows: 0,
            rows: 0,
            rows_without_return: 0,
            damaged_rows: 0,
        };
        logs.read_progress(&run.join(PROGRESS), &levels)?;
        logs.read_plasticity(&run.join(PLASTICITY), stages)?;
        Ok(logs)
    }

    fn read_progress(&mut self, path: &Path, levels: &[Option<&LevelInfo>]) -> Result<()> {
        let Some(mut log) = Log::open(path)? else { return Ok(()) };
        let columns = ["stage", "time/total_timesteps", "cumulative_timesteps", "rollout/ep_rew_mean"];
        let columns = columns.into_iter().map(|name| log.column(name)).collect::<Result<Vec<usize>, _>>()?;
        while let Some(row) = log.next(&columns)? {
            let entry = row.as_deref().and_then(|row| {
                let [stage, timesteps, cumulative, value] = row else { return None };
                let stage = place(*stage, *timesteps, levels.len())?;
                Some((&mut self.stages[stage], levels[stage], *timesteps, *cumulative, *value))
            });
            let Some((log, level, timesteps, cumulative, value)) = entry else {
                self.damaged_rows += 1;
                continue;
            };
            self.rows += 1;
            self.rows_without_return += u64::from(value.is_nan());
            log.bins.push(timesteps, cumulative, value);
            if let Some((summary, level)) = log.summary.as_mut().zip(level) {
                summary.push(timesteps, level.normalised(value).unwrap_or(f64::NAN));
            }
        }
        Ok(())
    }

    fn read_plasticity(&mut self, path: &Path, stages: &[StageEntry]) -> Result<()> {
        let Some(mut log) = Log::open(path)? else { return Ok(()) };
        let own = ["stage", "timesteps", "cumulative_timesteps"];
        let mut columns = own.into_iter().map(|name| log.column(name)).collect::<Result<Vec<usize>, _>>()?;
        let is_measure = |(_, name): &(usize, &str)| !PLASTICITY_COLUMNS.contains(name);
        let measures: Vec<(usize, &str)> = log.head.iter().enumerate().filter(is_measure).collect();
        let empty = MeasureLog {
            bins: stages.iter().map(|stage| Bins::new(PLASTICITY_BINS, stage.timesteps)).collect(),
            begins: vec![None; stages.len()],
            ends: vec![None; stages.len()],
            rows_without_value: 0,
        };
        let mut series: Vec<(String, MeasureLog)> =
            measures.iter().map(|(_, name)| ((*name).to_owned(), empty.clone())).collect();
        columns.extend(measures.iter().map(|(place, _)| place));
        while let Some(row) = log.next(&columns)? {
            let entry = row.as_deref().and_then(|row| {
                let [stage, timesteps, cumulative, values @ ..] = row else { return None };
                Some((place(*stage, *timesteps, stages.len())?, *timesteps, *cumulative, values))
            });
            let Some((stage, timesteps, cumulative, values)) = entry else {
                self.damaged_rows += 1;
                continue;
            };
            // Nothing was trained yet: such a row is no point of a curve, and has no measures of an update.
            if timesteps == 0.0 {
                let known = |value: f64| (!value.is_nan()).then_some(value);
                series.iter_mut().zip(values).for_each(|((_, log), &value)| log.begins[stage] = known(value));
                continue;
            }
            self.plasticity_rows += 1;
            for ((_, log), &value) in series.iter_mut().zip(values) {
                log.bins[stage].push(timesteps, cumulative, value);
                log.ends[stage] = (!value.is_nan()).then_some(value);
                log.rows_without_value += u64::from(value.is_nan());
            }
        }
        self.plasticity = series.into_iter().collect();
        Ok(())
    }
}

/// The index of a row's stage, if the run has such a stage and the row a time.
fn place(stage: f64, timesteps: f64, stages: usize) -> Option<usize> {
    (stage >= 0.0 && timesteps >= 0.0 && (stage as usize) < stages).then_some(stage as usize)
}

/// A log that is read row by row.
struct Log {
    path: PathBuf,
    /// Where a last row ends that has no line end: a kill has cut it off, perhaps in the middle of a number.
    cut: Option<u64>,
    head: StringRecord,
    reader: csv::Reader<File>,
    record: StringRecord,
}

impl Log {
    /// Opens a log; `None` where there is none, or not even a header.
    fn open(path: &Path) -> Result<Option<Self>> {
        let unreadable = || format!("cannot read {}", path.display());
        let mut file = match File::open(path) {
            Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(None),
            file => file.with_context(unreadable)?,
        };
        let cut = unended(&mut file).with_context(unreadable)?;
        // Rows that were cut off are shorter.
        let mut reader = csv::ReaderBuilder::new().flexible(true).from_reader(file);
        let head = reader.headers().with_context(unreadable)?.clone();
        let log = Self { path: path.to_owned(), cut, head, reader, record: StringRecord::new() };
        Ok((!log.head.is_empty()).then_some(log))
    }

    fn column(&self, name: &str) -> Result<usize, UserError> {
        let place = self.head.iter().position(|column| column == name);
        place.ok_or_else(|| UserError::new(format!("{} has no column {name}", self.path.display())))
    }

    /// The numbers of the next row in these columns, an empty field being NaN; `Some(None)` for a row that is cut off
    /// or no numbers, `None` after the last.
    fn next(&mut self, columns: &[usize]) -> Result<Option<Option<Vec<f64>>>> {
        let more = self.reader.read_record(&mut self.record);
        if !more.with_context(|| format!("cannot read {}", self.path.display()))? {
            return Ok(None);
        }
        let number = |&column: &usize| match self.record.get(column)? {
            "" => Some(f64::NAN),
            field => field.parse().ok(),
        };
        let whole = self.record.len() == self.head.len() && self.cut != Some(self.reader.position().byte());
        Ok(Some(whole.then(|| columns.iter().map(number).collect::<Option<Vec<f64>>>()).flatten()))
    }
}

/// The length of a file that does not end with a line's end; it is left at its beginning.
fn unended(file: &mut File) -> io::Result<Option<u64>> {
    let length = file.seek(SeekFrom::End(0))?;
    let mut last = [b'\n'];
    if length > 0 {
        file.seek(SeekFrom::End(-1))?;
        file.read_exact(&mut last)?;
    }
    file.rewind()?;
    Ok((last != [b'\n']).then_some(length))
}
