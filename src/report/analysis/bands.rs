//! Curves over seeds, point by point, with intervals from the same resampled seeds at every point.

use std::collections::BTreeMap;

use rl_stats::{Bootstrap, Interval, Resamples, percentile_interval};

/// Makes intervals of many points; the draws for a number of seeds are made once.
pub(super) struct Bands {
    bootstrap: Bootstrap,
    drawn: BTreeMap<usize, Resamples>,
}

impl Bands {
    pub(super) fn new(bootstrap: Bootstrap) -> Self {
        Self { bootstrap, drawn: BTreeMap::new() }
    }

    /// A statistic of one value per seed, with its interval; none of no values, no interval of one.
    pub(super) fn point(
        &mut self,
        values: &[f64],
        statistic: impl Fn(&[Vec<f64>]) -> f64,
    ) -> Option<(f64, Option<Interval>)> {
        let scores = [values.to_vec()];
        let value = statistic(&scores);
        if values.is_empty() || !value.is_finite() {
            return None;
        }
        let Bootstrap { resamples, confidence, seed } = self.bootstrap;
        let drawn = self.drawn.entry(values.len()).or_insert_with_key(|&n| Resamples::draw(&[n], resamples, seed));
        let interval = || percentile_interval(&mut drawn.distribution(&scores, statistic), confidence);
        Some((value, (values.len() > 1).then(interval)))
    }
}
