//! Rows of the logs: `progress.csv` has one per rollout of PPO, or per 2,048 timesteps of DQN; `plasticity.csv` one per
//! measurement.

use anyhow::Result;

use crate::agent::{Metrics, Stage};

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
pub(super) fn progress(header: bool, stage: &Stage, when: When, metrics: &Metrics) -> Result<Vec<u8>> {
    let place = [
        ("stage", stage.index.to_string()),
        ("level", stage.level.name().to_owned()),
        ("time/total_timesteps", when.timesteps.to_string()),
        ("cumulative_timesteps", when.cumulative.to_string()),
        ("time/time_elapsed", format!("{:.3}", when.seconds)),
        ("time/fps", format!("{:.0}", when.fps())),
    ];
    csv_row(header, &place, metrics)
}

/// The bytes of one row of `plasticity.csv`, after those of the header if there is none yet.
pub(super) fn plasticity(header: bool, stage: &Stage, when: When, measures: &[(String, f64)]) -> Result<Vec<u8>> {
    let place = [
        ("stage", stage.index.to_string()),
        ("level", stage.level.name().to_owned()),
        ("timesteps", when.timesteps.to_string()),
        ("cumulative_timesteps", when.cumulative.to_string()),
    ];
    csv_row(header, &place, measures)
}

/// Where a row stands, then its values; their names are the same in every row.
fn csv_row<N: AsRef<str>>(header: bool, place: &[(&str, String)], values: &[(N, f64)]) -> Result<Vec<u8>> {
    let mut csv = csv::Writer::from_writer(Vec::new());
    if header {
        let place = place.iter().map(|(name, _)| *name);
        csv.write_record(place.chain(values.iter().map(|(name, _)| name.as_ref())))?;
    }
    let place = place.iter().map(|(_, cell)| cell.clone());
    csv.write_record(place.chain(values.iter().map(|(_, value)| value.to_string())))?;
    Ok(csv.into_inner()?)
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
        let text =
            |header| String::from_utf8(progress(header, &stage, when, &vec![("train/loss", 0.25)]).unwrap()).unwrap();
        assert_eq!(text(false), "1,\"a,b\",10,30,1.500,20,0.25\n");
        assert_eq!(
            text(true),
            "stage,level,time/total_timesteps,cumulative_timesteps,time/time_elapsed,time/fps,train/loss\n".to_owned()
                + &text(false)
        );
    }
}
