//! How the numbers of a report are made.

use rl_stats::Bootstrap;
use serde::Serialize;

/// Version of the fields of `report.json`.
pub const FORMAT: u32 = 3;

/// Shares of the optimum whose first attainment is timed.
pub const THRESHOLDS: [f64; 2] = [0.5, 0.9];

/// How the numbers were made: stands in every report.
#[derive(Clone, Debug, Serialize)]
pub struct Conventions {
    /// Of all intervals but those of curves.
    pub bootstrap: Bootstrap,
    /// Of curves, point by point.
    pub curve_bootstrap: Bootstrap,
    /// Normalised returns whose first attainment is timed.
    pub thresholds: Vec<f64>,
}

impl Default for Conventions {
    fn default() -> Self {
        Self {
            bootstrap: Bootstrap::default(),
            curve_bootstrap: Bootstrap { resamples: 1000, ..Bootstrap::default() },
            thresholds: THRESHOLDS.to_vec(),
        }
    }
}
