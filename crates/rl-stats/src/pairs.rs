//! Two algorithms: unpaired as rliable compares them, and paired by seed.

use crate::aggregate::mean_of;
use crate::binomial::share_interval;
use crate::few::{FEW, interval_of_mean};
use crate::{Bootstrap, Estimate};

/// The probability that a run of `x` scores above a run of `y` on the same task, a tie counting half; averaged over
/// tasks. Runs are not paired.
///
/// It is the Mann–Whitney statistic U over the number of pairs of runs (Agarwal et al. 2021).
///
/// # Panics
/// If the two have not the same number of tasks.
pub fn probability_of_improvement(x: &[Vec<f64>], y: &[Vec<f64>]) -> f64 {
    assert_eq!(x.len(), y.len(), "both are scored on the same tasks");
    mean_of(x.iter().zip(y).map(|(x, y)| mean_of(x.iter().flat_map(|&x| y.iter().map(move |&y| above(x, y))))))
}

/// [`probability_of_improvement`] with its interval.
///
/// With fewer than [`FEW`] runs it is Clopper and Pearson's, of as many independent pairs as the smaller side has runs.
/// That is cautious: the mean over all pairs varies no more than the mean over so many separate ones (Hoeffding 1948).
/// Resampling would give no width where all runs of the one are above all of the other. With more runs both sides are
/// resampled by themselves.
///
/// # Panics
/// If the two have not the same number of tasks.
pub fn estimate_probability_of_improvement(bootstrap: &Bootstrap, x: &[Vec<f64>], y: &[Vec<f64>]) -> Estimate {
    let both = [x, y].concat();
    let runs = both.iter().map(Vec::len).min().unwrap_or(0);
    if runs < FEW {
        let value = probability_of_improvement(x, y);
        let interval =
            (runs > 1 && value.is_finite()).then(|| share_interval(bootstrap.confidence, value * runs as f64, runs));
        return Estimate { value, interval, runs };
    }
    bootstrap.estimate(&both, |both| {
        let (x, y) = both.split_at(x.len());
        probability_of_improvement(x, y)
    })
}

/// The share of pairs `(x, y)`, one per seed, in which `x` is above `y`, a tie counting half, with its exact interval.
///
/// Unlike [`probability_of_improvement`] it compares each seed with itself alone. The interval is Clopper and Pearson's
/// (1934): resampling pairs of which all or none are above would give an interval without width. A share that ties put
/// between two counts has the lower bound of the one and the upper bound of the other.
pub fn estimate_paired_improvement_share(confidence: f64, pairs: &[(f64, f64)]) -> Estimate {
    let above: Vec<f64> = pairs.iter().map(|&(x, y)| above(x, y)).collect();
    let value = mean_of(above.iter().copied());
    let (count, n) = (above.iter().sum::<f64>(), above.len());
    let interval = (n > 1 && value.is_finite()).then(|| share_interval(confidence, count, n));
    Estimate { value, interval, runs: n }
}

/// The mean of the paired differences `x − y`, with its interval over pairs.
pub fn estimate_paired_difference(bootstrap: &Bootstrap, pairs: &[(f64, f64)]) -> Estimate {
    estimate_mean(bootstrap, pairs.iter().map(|(x, y)| x - y).collect())
}

/// The mean of one value per run, with [`interval_of_mean`].
pub fn estimate_mean(bootstrap: &Bootstrap, values: Vec<f64>) -> Estimate {
    let value = mean_of(values.iter().copied());
    Estimate { value, interval: interval_of_mean(bootstrap, &values), runs: values.len() }
}

/// 1 if `x` is above `y`, ½ for a tie, 0 below; NaN if either is.
fn above(x: f64, y: f64) -> f64 {
    match x.partial_cmp(&y) {
        Some(std::cmp::Ordering::Greater) => 1.0,
        Some(std::cmp::Ordering::Equal) => 0.5,
        Some(std::cmp::Ordering::Less) => 0.0,
        None => f64::NAN,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Interval;

    #[test]
    fn improvement_is_as_counted_by_hand() {
        // Above: 3 > 1, 3 > 2, 2 > 1; a tie 2 = 2: (3 + ½) / 4. The second task: never.
        let (x, y) = ([vec![3.0, 2.0], vec![0.0, 0.0]], [vec![1.0, 2.0], vec![1.0, 1.0]]);
        assert_eq!(probability_of_improvement(&x, &y), 3.5 / 4.0 / 2.0);
        assert_eq!(probability_of_improvement(&y, &x), 1.0 - 3.5 / 4.0 / 2.0);
        assert!(probability_of_improvement(&[vec![f64::NAN, 1.0]], &[vec![0.0]]).is_nan());
    }

    #[test]
    fn pairs_are_compared_seed_by_seed() {
        let pairs = [(1.0, 0.0), (11.0, 10.0), (5.0, 5.0), (f64::INFINITY, f64::INFINITY)];
        assert_eq!(estimate_paired_improvement_share(0.95, &pairs).value, 0.75);
        let (x, y): (Vec<f64>, Vec<f64>) = pairs[..2].iter().copied().unzip();
        assert_eq!(probability_of_improvement(&[x], &[y]), 0.75);
        let difference = estimate_paired_difference(&Bootstrap::default(), &pairs[..2]);
        // The seeds differ widely, their differences not at all.
        assert_eq!((difference.value, difference.interval), (1.0, Some(Interval { low: 1.0, high: 1.0 })));
    }

    /// Resampling five runs that are all above five others would say [1, 1].
    #[test]
    fn few_runs_leave_room_beside_certainty() {
        let (x, y) = ([vec![2.0; 5], vec![2.0; 5]], [vec![1.0; 5], vec![1.0; 7]]);
        let all = estimate_probability_of_improvement(&Bootstrap::default(), &x, &y);
        let Interval { low, high } = all.interval.unwrap();
        assert_eq!((all.value, all.runs, high), (1.0, 5, 1.0));
        assert!((low - 0.025_f64.powf(0.2)).abs() < 1e-9, "{low}");
        // 0.6 · 5 is a little above 3, and still 3 of 5.
        let tied = share_interval(0.95, 0.6 * 5.0 + 1e-15, 5);
        assert_eq!((tied.low, tied.high), share(3, 5));
        let one = estimate_probability_of_improvement(&Bootstrap::default(), &[vec![1.0]], &[vec![0.0, 2.0]]);
        assert_eq!((one.value, one.interval), (0.5, None));
    }

    /// Of n pairs, so many above and the rest below.
    fn share(above: usize, n: usize) -> (f64, f64) {
        let pairs: Vec<(f64, f64)> = (0..n).map(|i| if i < above { (1.0, 0.0) } else { (0.0, 1.0) }).collect();
        let interval = estimate_paired_improvement_share(0.95, &pairs).interval.unwrap();
        (interval.low, interval.high)
    }

    fn near((low, high): (f64, f64), expected: (f64, f64)) -> bool {
        (low - expected.0).abs() < 5e-5 && (high - expected.1).abs() < 5e-5
    }

    /// Expected: scipy.stats.binomtest(k, n).proportion_ci(0.95, "exact").
    #[test]
    fn the_interval_of_a_share_is_exact() {
        // None of five: (1 - p)^5 = 0.025.
        assert!(near(share(0, 5), (0.0, 1.0 - 0.025_f64.powf(0.2))), "{:?}", share(0, 5));
        assert!(near(share(5, 5), (0.025_f64.powf(0.2), 1.0)), "{:?}", share(5, 5));
        assert!(near(share(7, 10), (0.3475, 0.9333)), "{:?}", share(7, 10));
        let (low, high) = share(1000, 2000);
        assert!((low - 0.478).abs() < 1e-3 && (high - 0.522).abs() < 1e-3, "{low} {high}");
    }

    #[test]
    fn ties_widen_the_interval_of_a_share() {
        let tied = estimate_paired_improvement_share(0.95, &[(1.0, 1.0); 5]);
        let Interval { low, high } = tied.interval.unwrap();
        assert_eq!((tied.value, low, high), (0.5, share(2, 5).0, share(3, 5).1));
        assert_eq!(estimate_paired_improvement_share(0.95, &[(1.0, 0.0)]).interval, None);
        assert_eq!(estimate_paired_improvement_share(0.95, &[(f64::NAN, 0.0), (1.0, 0.0)]).interval, None);
    }
}
