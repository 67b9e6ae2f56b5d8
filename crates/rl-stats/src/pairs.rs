//! Two algorithms: unpaired as rliable compares them, and paired by seed.

use crate::aggregate::mean_of;
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

/// [`probability_of_improvement`] with its interval: the runs of `x` and of `y` are resampled by themselves.
///
/// # Panics
/// If the two have not the same number of tasks.
pub fn estimate_probability_of_improvement(bootstrap: &Bootstrap, x: &[Vec<f64>], y: &[Vec<f64>]) -> Estimate {
    let both = [x, y].concat();
    bootstrap.estimate(&both, |both| {
        let (x, y) = both.split_at(x.len());
        probability_of_improvement(x, y)
    })
}

/// The share of pairs `(x, y)`, one per seed, in which `x` is above `y`, a tie counting half.
///
/// Unlike [`probability_of_improvement`] it compares each seed with itself alone.
pub fn paired_improvement_share(pairs: &[(f64, f64)]) -> f64 {
    mean_of(pairs.iter().map(|&(x, y)| above(x, y)))
}

/// [`paired_improvement_share`] with its interval over pairs.
pub fn estimate_paired_improvement_share(bootstrap: &Bootstrap, pairs: &[(f64, f64)]) -> Estimate {
    estimate_mean(bootstrap, pairs.iter().map(|&(x, y)| above(x, y)).collect())
}

/// The mean of the paired differences `x − y`, with its interval over pairs.
pub fn estimate_paired_difference(bootstrap: &Bootstrap, pairs: &[(f64, f64)]) -> Estimate {
    estimate_mean(bootstrap, pairs.iter().map(|(x, y)| x - y).collect())
}

/// The mean of one value per run, with its interval over runs.
pub fn estimate_mean(bootstrap: &Bootstrap, values: Vec<f64>) -> Estimate {
    bootstrap.estimate(&[values], crate::aggregate::mean)
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
        assert_eq!(paired_improvement_share(&pairs), 0.75);
        let (x, y): (Vec<f64>, Vec<f64>) = pairs[..2].iter().copied().unzip();
        assert_eq!(probability_of_improvement(&[x], &[y]), 0.75);
        let difference = estimate_paired_difference(&Bootstrap::default(), &pairs[..2]);
        // The seeds differ widely, their differences not at all.
        assert_eq!((difference.value, difference.interval), (1.0, Some(Interval { low: 1.0, high: 1.0 })));
    }
}
