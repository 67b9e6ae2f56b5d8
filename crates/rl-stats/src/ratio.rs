//! Ratios of means of paired values: the mean numerator over the mean denominator.

use crate::few::{FEW, t_quantile};
use crate::{Bootstrap, Estimate, Interval};

/// The mean numerator over the mean denominator of pairs `(numerator, denominator)`, one per seed, with its interval over
/// pairs. Both are averaged before they are divided, so that one small denominator does not rule the result.
///
/// With fewer than [`FEW`] pairs the interval is [`fieller_interval`], from there on the percentile bootstrap's, of pairs.
/// There is none in either case where Fieller's has no end: the denominator may then be 0, and the ratio anything.
pub fn estimate_ratio_of_means(bootstrap: &Bootstrap, pairs: &[(f64, f64)]) -> Estimate {
    // The pairs' numbers are resampled, that a numerator stays with its denominator.
    let places = [(0..pairs.len()).map(|place| place as f64).collect::<Vec<f64>>()];
    let ratio = |places: &[Vec<f64>]| {
        let sum = |of: fn(&(f64, f64)) -> f64| places[0].iter().map(|&place| of(&pairs[place as usize])).sum::<f64>();
        sum(|pair| pair.0) / sum(|pair| pair.1)
    };
    let fieller = fieller_interval(pairs, bootstrap.confidence);
    if pairs.len() >= FEW && fieller.is_some() {
        return bootstrap.estimate(&places, ratio);
    }
    Estimate { value: ratio(&places), interval: fieller, runs: pairs.len() }
}

/// Fieller's (1954) interval of the mean x over the mean y of n pairs `(x, y)`: every r for which Student's test with
/// n − 1 degrees of freedom does not tell the mean of d(r) = x − r y from 0.
///
/// With the means x̄ and ȳ and the variances and the covariance of these means, s_xx, s_yy and s_xy, it lies between the
/// roots of (ȳ² − t² s_yy) r² − 2 (x̄ȳ − t² s_xy) r + (x̄² − t² s_xx). Where ȳ is not told from 0 it has no end, and there
/// is none. It is exact for values that are normally distributed together; skewed ones hold it as often as Student's
/// interval of the mean of d(r).
///
/// None of fewer than two pairs, too, or where a value is not finite.
pub fn fieller_interval(pairs: &[(f64, f64)], confidence: f64) -> Option<Interval> {
    let n = pairs.len() as f64;
    if pairs.len() < 2 {
        return None;
    }
    let mean = |of: &dyn Fn(&(f64, f64)) -> f64| pairs.iter().map(of).sum::<f64>() / n;
    let (x, y) = (mean(&|pair| pair.0), mean(&|pair| pair.1));
    let ratio = x / y;
    // Around the ratio, where the mean of d is 0, no term is a difference of nearly equal numbers: with the residuals
    // e = d(ratio) and r = ratio + δ the condition is (ȳ² − t² s_yy) δ² + 2 t² s_ey δ − t² s_ee ≤ 0.
    let residual = |pair: &(f64, f64)| (pair.0 - x) - ratio * (pair.1 - y);
    let of_means = |sum: f64| sum / (n - 1.0) / n;
    let s_yy = of_means(pairs.iter().map(|pair| (pair.1 - y).powi(2)).sum());
    let s_ey = of_means(pairs.iter().map(|pair| residual(pair) * (pair.1 - y)).sum());
    let s_ee = of_means(pairs.iter().map(|pair| residual(pair).powi(2)).sum());
    let t2 = t_quantile((1.0 + confidence) / 2.0, pairs.len() - 1).powi(2);
    let square = y * y - t2 * s_yy;
    let (linear, root) = (t2 * s_ey, (t2 * t2 * s_ey * s_ey + square * t2 * s_ee).sqrt());
    let [low, high] = [-root, root].map(|root| ratio + (root - linear) / square);
    (square > 0.0 && low.is_finite() && high.is_finite()).then_some(Interval { low, high })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::few::mean_interval;

    #[track_caller]
    fn assert_near(actual: f64, expected: f64) {
        assert!((actual - expected).abs() <= 1e-9 * expected.abs().max(1.0), "{actual} is not {expected}");
    }

    const PAIRS: [(f64, f64); 4] = [(1.0, 3.0), (2.0, 4.0), (3.0, 5.0), (2.0, 8.0)];

    /// Means 2 and 5; sums of squares 2 and 14, of products 2, and each is divided by 3 · 4. t of 3 degrees of freedom is
    /// 3.182446 in printed tables, t² 10.127964.
    #[test]
    fn fiellers_bounds_are_the_roots_computed_by_hand() {
        let t2 = 10.127964;
        let (a, b, c) = (25.0 - t2 * 14.0 / 12.0, 10.0 - t2 * 2.0 / 12.0, 4.0 - t2 * 2.0 / 12.0);
        let root = f64::sqrt(b * b - a * c);
        let Interval { low, high } = fieller_interval(&PAIRS, 0.95).unwrap();
        assert!((low - (b - root) / a).abs() < 1e-6 && (high - (b + root) / a).abs() < 1e-6, "{low} {high}");
        // As numbers: 13.184042 r² − 2 · 8.312006 r + 2.312006 = 0.
        assert!((low - 0.159168).abs() < 1e-5 && (high - 1.101751).abs() < 1e-5, "{low} {high}");
    }

    /// At its bounds the mean of d(r) is just significant, whatever the confidence.
    #[test]
    fn at_the_bounds_students_interval_of_the_difference_ends_at_zero() {
        for confidence in [0.8, 0.95] {
            let Interval { low, high } = fieller_interval(&PAIRS, confidence).unwrap();
            let d = |r: f64| mean_interval(&PAIRS.map(|(x, y)| x - r * y), confidence).unwrap();
            assert!(d(low).low.abs() < 1e-9 && d(high).high.abs() < 1e-9, "{:?} {:?}", d(low), d(high));
        }
    }

    #[test]
    fn a_denominator_that_may_be_zero_leaves_no_interval() {
        // ȳ = 1, and its Student's interval is 1 ± 4.30 · 0.577: it holds 0.
        let pairs = [(1.0, 0.0), (1.0, 1.0), (1.0, 2.0)];
        assert_eq!(fieller_interval(&pairs, 0.95), None);
        let estimate = estimate_ratio_of_means(&Bootstrap::default(), &pairs);
        assert_eq!((estimate.value, estimate.interval, estimate.runs), (1.0, None, 3));
        // With less confidence it does not: t of 2 degrees of freedom and 60% is 1.06.
        assert!(fieller_interval(&pairs, 0.6).is_some());
        // Neither is there one of thirty and more.
        let many: Vec<(f64, f64)> = (0..40).map(|i| (1.0, if i % 2 == 0 { 1.1 } else { -1.0 })).collect();
        assert_eq!(estimate_ratio_of_means(&Bootstrap::default(), &many).interval, None);
        let zero = [(0.0, 0.0), (1.0, 0.0)];
        assert_eq!(fieller_interval(&zero, 0.95), None);
    }

    #[test]
    fn a_denominator_that_does_not_vary_leaves_students_interval() {
        let pairs = PAIRS.map(|(x, _)| (x, 4.0));
        let (fieller, student) =
            (fieller_interval(&pairs, 0.95).unwrap(), mean_interval(&PAIRS.map(|pair| pair.0), 0.95).unwrap());
        assert_near(fieller.low, student.low / 4.0);
        assert_near(fieller.high, student.high / 4.0);
        // Of negative denominators the bounds still stand in their order.
        let turned = fieller_interval(&PAIRS.map(|(x, y)| (x, -y)), 0.95).unwrap();
        let same = fieller_interval(&PAIRS, 0.95).unwrap();
        assert_eq!((turned.low, turned.high), (-same.high, -same.low));
    }

    #[test]
    fn a_ratio_is_of_means_and_not_a_mean_of_ratios() {
        // The mean of the ratios is (100 + 1/3) / 2; a seed with next to no denominator must not rule it.
        let ratio = estimate_ratio_of_means(&Bootstrap::default(), &[(1.0, 0.01), (1.0, 3.0)]);
        assert_eq!((ratio.value, ratio.interval), (2.0 / (0.01 + 3.0), None));
        let constant = [(1.0, 2.0), (2.0, 4.0), (4.0, 8.0), (2.0, 4.0), (2.0, 4.0)];
        let constant = estimate_ratio_of_means(&Bootstrap::default(), &constant);
        assert_eq!(constant.interval, Some(Interval { low: 0.5, high: 0.5 }));
        for pairs in [&[(1.0, 2.0)][..], &[], &[(1.0, f64::NAN), (1.0, 2.0)], &[(f64::INFINITY, 1.0), (1.0, 1.0)]] {
            assert_eq!(estimate_ratio_of_means(&Bootstrap::default(), pairs).interval, None);
        }
    }

    #[test]
    fn the_interval_of_a_ratio_is_chosen_by_the_number_of_pairs() {
        let bootstrap = Bootstrap::default();
        let pairs: Vec<(f64, f64)> = (0..40).map(|i| (f64::from(i * i % 17), 5.0 + f64::from(i * 7 % 11))).collect();
        let interval = |n: usize| estimate_ratio_of_means(&bootstrap, &pairs[..n]).interval.unwrap();
        assert_eq!(Some(interval(29)), fieller_interval(&pairs[..29], 0.95));
        assert_ne!(Some(interval(30)), fieller_interval(&pairs[..30], 0.95));
        // The two hardly differ there.
        let fieller = fieller_interval(&pairs[..30], 0.95).unwrap();
        let ratio = (interval(30).high - interval(30).low) / (fieller.high - fieller.low);
        assert!((0.85..1.05).contains(&ratio), "{ratio}");
    }
}
