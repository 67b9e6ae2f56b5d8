//! A statistic that is one number per seed.

use std::collections::BTreeMap;

use rl_stats::pairs::estimate_mean;
use rl_stats::{Bootstrap, Estimate};
use serde::Serialize;

/// One number per seed.
#[derive(Clone, Debug, Serialize)]
pub struct OverSeeds {
    /// Their mean, with its interval over seeds.
    pub mean: Estimate,
    /// Each seed's.
    pub seeds: BTreeMap<u64, f64>,
}

impl OverSeeds {
    /// `None` of no seeds.
    pub(in crate::report) fn new(seeds: BTreeMap<u64, f64>, bootstrap: &Bootstrap) -> Option<Self> {
        (!seeds.is_empty()).then(|| Self { mean: estimate_mean(bootstrap, seeds.values().copied().collect()), seeds })
    }
}
