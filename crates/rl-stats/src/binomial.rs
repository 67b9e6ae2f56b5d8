//! Exact intervals from the binomial distribution: of shares and of medians.

use crate::aggregate::median_run;
use crate::{Estimate, Interval};

/// A count of pairs this near a whole number is that number: what is missing to it is rounding.
const ROUNDING: f64 = 1e-9;

/// With fewer values than this a median has no interval of 95%: of 5, the lowest and the highest hold it with 93.75%.
pub const LEAST_OF_MEDIAN: usize = 6;

/// Clopper and Pearson's (1934) interval of `count` of `n`; from the lower bound of the count below to the upper bound of
/// the one above where it lies between two.
pub(crate) fn share_interval(confidence: f64, count: f64, n: usize) -> Interval {
    let tail = (1.0 - confidence) / 2.0;
    let upper = |count: f64| largest_share(count as usize, n, tail);
    let whole = count.round();
    let (below, above) = if (count - whole).abs() < ROUNDING { (whole, whole) } else { (count.floor(), count.ceil()) };
    // What is counted above is the rest that is not counted below.
    Interval { low: 1.0 - upper(n as f64 - below), high: upper(above) }
}

/// The median of one value per run, with [`median_interval`].
pub fn estimate_median(confidence: f64, values: Vec<f64>) -> Estimate {
    let (interval, runs) = (median_interval(&values, confidence), values.len());
    Estimate { value: median_run(&[values]), interval, runs }
}

/// The exact interval of the median of whatever distribution the values are drawn from, between two of the values
/// themselves (Thompson 1936): from the k-th lowest to the k-th highest, with the largest k for which either end misses
/// the median with a chance of at most half of what `confidence` leaves.
///
/// A median is above the k-th highest of n values where fewer than k are above it, with the chance P(B < k) of a binomial
/// B of n trials of probability ½. Values may be infinite, as times that are never reached are, and so may the bounds.
///
/// None of so few values that the chance is too large even from the lowest to the highest; see [`LEAST_OF_MEDIAN`]. None
/// with a NaN among the values, either.
pub fn median_interval(values: &[f64], confidence: f64) -> Option<Interval> {
    let (n, tail) = (values.len(), (1.0 - confidence) / 2.0);
    let fits = |k: &usize| at_most(k - 1, n, 0.5) <= tail * (1.0 + ROUNDING);
    let k = (1..=n / 2).take_while(fits).last().filter(|_| values.iter().all(|value| !value.is_nan()))?;
    let mut sorted = values.to_vec();
    sorted.sort_unstable_by(f64::total_cmp);
    Some(Interval { low: sorted[k - 1], high: sorted[n - k] })
}

/// The largest probability with which at most `count` of `n` trials succeed with a chance of at least `tail`.
fn largest_share(count: usize, n: usize, tail: f64) -> f64 {
    if count == n {
        return 1.0;
    }
    let (mut low, mut high) = (0.0, 1.0);
    // Bisection to the last bit.
    for _ in 0..f64::MANTISSA_DIGITS {
        let middle = (low + high) / 2.0;
        if at_most(count, n, middle) >= tail { low = middle } else { high = middle }
    }
    low
}

/// The chance of at most `count` successes in `n` trials of probability `p` in (0, 1).
fn at_most(count: usize, n: usize, p: f64) -> f64 {
    // Logarithms, or many trials would underflow.
    let mut term = n as f64 * (1.0 - p).ln();
    let mut sum = term.exp();
    for k in 0..count {
        term += ((n - k) as f64 / (k + 1) as f64).ln() + p.ln() - (1.0 - p).ln();
        sum += term.exp();
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Of 0, 1, 2, … the bounds are k − 1 and n − k.
    fn ranks(n: usize, confidence: f64) -> Option<(f64, f64)> {
        let values: Vec<f64> = (0..n).rev().map(|value| value as f64).collect();
        median_interval(&values, confidence).map(|Interval { low, high }| (low + 1.0, high + 1.0))
    }

    /// Of 10 values P(B ≤ 1) is 11/1024 and P(B ≤ 2) 56/1024; of 20 P(B ≤ 5) is 0.0207 and P(B ≤ 6) 0.0577.
    #[test]
    fn the_interval_of_a_median_lies_between_ranks_that_are_sure_enough() {
        let tables = [(6, (1.0, 6.0)), (8, (1.0, 8.0)), (9, (2.0, 8.0)), (10, (2.0, 9.0)), (16, (4.0, 13.0))];
        for (n, expected) in tables.into_iter().chain([(20, (6.0, 15.0)), (25, (8.0, 18.0)), (100, (40.0, 61.0))]) {
            assert_eq!(ranks(n, 0.95), Some(expected), "{n}");
        }
        // From the lowest to the highest of n: 1 − 2 / 2ⁿ.
        assert_eq!((0..LEAST_OF_MEDIAN).filter_map(|n| ranks(n, 0.95)).count(), 0);
        assert_eq!((ranks(5, 0.9375), ranks(5, 0.9376)), (Some((1.0, 5.0)), None));
    }

    #[test]
    fn what_is_never_reached_bounds_a_median_at_infinity() {
        let never = f64::INFINITY;
        let times = [never, 3.0, 1.0, never, 2.0, 4.0];
        assert_eq!(median_interval(&times, 0.95), Some(Interval { low: 1.0, high: never }));
        assert_eq!(median_interval(&[never; 9], 0.95), Some(Interval { low: never, high: never }));
        assert_eq!(median_interval(&[f64::NAN, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0], 0.95), None);
    }
}
