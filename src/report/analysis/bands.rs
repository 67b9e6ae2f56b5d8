//! Curves over seeds, point by point, with intervals from the same resampled seeds at every point.

use std::collections::BTreeMap;

use rl_stats::few::interval_of_mean_from;
use rl_stats::{Bootstrap, Interval, Resamples};

/// Makes intervals of many points; the draws for a number of seeds are made once.
pub(super) struct Bands {
    bootstrap: Bootstrap,
    drawn: BTreeMap<usize, Resamples>,
}

impl Bands {
    pub(super) fn new(bootstrap: Bootstrap) -> Self {
        Self { bootstrap, drawn: BTreeMap::new() }
    }

    /// The mean of one value per seed, with its interval; none of no values, no interval of one.
    pub(super) fn mean(&mut self, values: &[f64]) -> Option<(f64, Option<Interval>)> {
        let value = values.iter().sum::<f64>() / values.len() as f64;
        let Bootstrap { resamples, confidence, seed } = self.bootstrap;
        value.is_finite().then(|| {
            let drawn = self.drawn.entry(values.len());
            let drawn = drawn.or_insert_with_key(|&n| Resamples::draw(&[n], resamples, seed));
            (value, interval_of_mean_from(drawn, confidence, values))
        })
    }
}
