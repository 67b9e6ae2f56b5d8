//! Rows of the logs: `progress.csv` has one per rollout of PPO, or per 2,048 timesteps of DQN; `plasticity.csv` one per
//! measurement, `learning.csv` one per evaluation, level and policy.

use std::fs::File;
use std::io;
use std::path::Path;

use anyhow::{Context, Result};

use super::logs::{LEARNING, PLASTICITY, PROGRESS};
use crate::agent::{Metrics, Stage};
use crate::results::{LevelResult, Policy};

/// The columns of a log: those of its first row.
///
/// A run that an earlier version began goes on with the columns that it has. A column that is new since then is left
/// out, and one that is gone is NaN.
#[derive(Debug, Default)]
pub(super) struct Columns(Option<Vec<String>>);

impl Columns {
    /// Those of the log at `path`; none yet where there is no log.
    ///
    /// # Errors
    /// A header that cannot be read.
    pub(super) fn of_log(path: &Path) -> Result<Self> {
        let unreadable = || format!("cannot read {}", path.display());
        let file = match File::open(path) {
            Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(Self::default()),
            file => file.with_context(unreadable)?,
        };
        let mut reader = csv::Reader::from_reader(file);
        let header = reader.headers().with_context(unreadable)?;
        Ok(Self((!header.is_empty()).then(|| header.iter().map(str::to_owned).collect())))
    }

    /// The bytes of one row, after those of the header if there is none yet.
    fn row(&mut self, cells: &[(&str, String)]) -> Result<Vec<u8>> {
        let mut csv = csv::Writer::from_writer(Vec::new());
        if self.0.is_none() {
            csv.write_record(cells.iter().map(|(name, _)| name))?;
        }
        let columns = self.0.get_or_insert_with(|| cells.iter().map(|(name, _)| (*name).to_owned()).collect());
        let cell = |column: &String| cells.iter().find(|(name, _)| name == column).map_or("NaN", |(_, cell)| cell);
        csv.write_record(columns.iter().map(cell))?;
        Ok(csv.into_inner()?)
    }
}

/// The columns of every log of a run.
#[derive(Debug, Default)]
pub(super) struct LogColumns {
    pub progress: Columns,
    pub plasticity: Columns,
    pub learning: Columns,
}

impl LogColumns {
    /// Those that the logs of a run begin with.
    ///
    /// # Errors
    /// A header that cannot be read.
    pub(super) fn of_run(run: &Path) -> Result<Self> {
        let of = |name| Columns::of_log(&run.join(name));
        Ok(Self { progress: of(PROGRESS)?, plasticity: of(PLASTICITY)?, learning: of(LEARNING)? })
    }
}

/// When a row is written.
#[derive(Clone, Copy, Debug)]
pub(super) struct When {
    /// Timesteps of the stage.
    pub timesteps: u64,
    /// Timesteps of all stages.
    pub cumulative: u64,
    /// Seconds spent on the run.
    pub seconds: f64,
}

impl When {
    /// Timesteps per second since the run began.
    pub(super) fn fps(self) -> f64 {
        self.cumulative as f64 / self.seconds.max(1e-9)
    }
}

/// The bytes of one row of `progress.csv`, after those of the header if there is none yet.
pub(super) fn progress(columns: &mut Columns, stage: &Stage, when: When, metrics: &Metrics) -> Result<Vec<u8>> {
    let place = [
        ("stage", stage.index.to_string()),
        ("level", stage.level.name().to_owned()),
        ("time/total_timesteps", when.timesteps.to_string()),
        ("cumulative_timesteps", when.cumulative.to_string()),
        ("time/time_elapsed", format!("{:.3}", when.seconds)),
        ("time/fps", format!("{:.0}", when.fps())),
    ];
    let metrics = metrics.iter().map(|(name, value)| (*name, value.to_string()));
    columns.row(&place.into_iter().chain(metrics).collect::<Vec<_>>())
}

/// The bytes of one row of `plasticity.csv`, after those of the header if there is none yet.
pub(super) fn plasticity(
    columns: &mut Columns,
    stage: &Stage,
    when: When,
    measures: &[(String, f64)],
) -> Result<Vec<u8>> {
    let place = [
        ("stage", stage.index.to_string()),
        ("level", stage.level.name().to_owned()),
        ("timesteps", when.timesteps.to_string()),
        ("cumulative_timesteps", when.cumulative.to_string()),
    ];
    let measures = measures.iter().map(|(name, value)| (name.as_str(), value.to_string()));
    columns.row(&place.into_iter().chain(measures).collect::<Vec<_>>())
}

/// The bytes of the rows of `learning.csv` of one evaluation, after those of the header if there is none yet.
pub(super) fn learning(
    columns: &mut Columns,
    stage: &Stage,
    when: When,
    results: &[(Policy, LevelResult)],
) -> Result<Vec<u8>> {
    let mut rows = Vec::new();
    for (policy, result) in results {
        rows.extend(columns.row(&[
            ("stage", stage.index.to_string()),
            ("timesteps", when.timesteps.to_string()),
            ("cumulative_timesteps", when.cumulative.to_string()),
            ("level", result.level.clone()),
            ("policy", policy.name().to_owned()),
            ("return", result.mean.to_string()),
            ("return_std", result.std.to_string()),
            ("solved_share", result.solved_share.to_string()),
            ("length", result.length().to_string()),
        ])?);
    }
    Ok(rows)
}

#[cfg(test)]
mod tests {
    use super::*;
    use coverage_env::Level;
    use std::sync::Arc;

    #[test]
    fn the_first_row_comes_after_the_header() {
        let level = Arc::new(Level::from_map("a,b", "T..").unwrap());
        let stage = Stage { index: 1, level, timesteps: 10, horizon: 10 };
        let when = When { timesteps: 10, cumulative: 30, seconds: 1.5 };
        let mut columns = Columns::default();
        let mut text =
            || String::from_utf8(progress(&mut columns, &stage, when, &vec![("train/loss", 0.25)]).unwrap()).unwrap();
        let row = "1,\"a,b\",10,30,1.500,20,0.25\n";
        let header = "stage,level,time/total_timesteps,cumulative_timesteps,time/time_elapsed,time/fps,train/loss\n";
        assert_eq!(text(), header.to_owned() + row);
        assert_eq!(text(), row);
    }

    #[test]
    fn a_log_keeps_the_columns_that_it_began_with() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("log.csv");
        let cells = |names: [&'static str; 3]| names.map(|name| (name, format!("\"{name}\"")));
        assert!(Columns::of_log(&path).unwrap().0.is_none());
        std::fs::write(&path, "").unwrap();
        assert!(Columns::of_log(&path).unwrap().0.is_none());
        std::fs::write(&path, "b,\"gone, long ago\",a\n1,2,3\n").unwrap();
        let row = Columns::of_log(&path).unwrap().row(&cells(["a", "new", "b"])).unwrap();
        assert_eq!(String::from_utf8(row).unwrap(), "\"\"\"b\"\"\",NaN,\"\"\"a\"\"\"\n");
    }
}
