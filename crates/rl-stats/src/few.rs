//! Intervals for few runs: fewer than 30 or so, where percentile intervals promise too much.
//!
//! [`mean_interval`] is Student's: exact for the mean of normal values. [`studentised_interval`] keeps its promise for
//! skewed values, too, and is wider for it. [`interval_of_mean`] chooses by the number of values.
//! [`prediction_interval`] tells where one new run may fall. Ratios of means have an interval of their own, in
//! [`ratio`](crate::ratio). docs/metrics.md has the coverage of all of them, which
//! `cargo run --release --package rl-stats --example coverage` simulates.

use crate::bootstrap::{percentile_interval, quantiles};
use crate::{Bootstrap, Interval, Resamples};

/// With fewer values than this, percentile intervals promise too much.
pub const FEW: usize = 30;
/// With fewer values than this, studentised intervals have infinite bounds.
pub const LEAST_STUDENTISED: usize = 4;
/// A bound of [`interval_of_mean`] is at most so many times as far from the mean as Student's.
///
/// Where values tie, many resamples have next to no deviation of their own, and put a bound next to infinity.
pub const FARTHEST: f64 = 3.0;

/// The interval of the mean that keeps its promise for so many values.
///
/// Of 2 or 3 values it is Student's, below [`FEW`] the studentised bootstrap's, and from there on the percentile
/// bootstrap's. Studentised bounds end at [`FARTHEST`] times Student's distance.
///
/// None as for [`mean_interval`].
pub fn interval_of_mean(bootstrap: &Bootstrap, values: &[f64]) -> Option<Interval> {
    let drawn = if values.len() < LEAST_STUDENTISED { 0 } else { bootstrap.resamples };
    interval_of_mean_from(&Resamples::of_task(values.len(), drawn, bootstrap.seed), bootstrap.confidence, values)
}

/// [`interval_of_mean`] from draws for one task of so many runs.
///
/// # Panics
/// If the draws are for another number of values.
pub fn interval_of_mean_from(resamples: &Resamples, confidence: f64, values: &[f64]) -> Option<Interval> {
    let student = mean_interval(values, confidence)?;
    match values.len() {
        n if n < LEAST_STUDENTISED => Some(student),
        n if n < FEW => {
            let Interval { low, high } = studentised_from(resamples, confidence, values)?;
            let farther = (FARTHEST - 1.0) * (student.high - student.low) / 2.0;
            Some(Interval { low: low.max(student.low - farther), high: high.min(student.high + farther) })
        }
        _ => Some(percentile_interval(&mut resamples.means(values), confidence)),
    }
}

/// Mean and sample standard deviation (n − 1); none of fewer than two values, or where one is not finite.
fn moments(values: &[f64]) -> Option<(f64, f64)> {
    let n = values.len() as f64;
    let mean = values.iter().sum::<f64>() / n;
    let squares: f64 = values.iter().map(|value| (value - mean).powi(2)).sum();
    let deviation = (squares / (n - 1.0)).sqrt();
    (values.len() > 1 && deviation.is_finite()).then_some((mean, deviation))
}

/// The interval of the mean, `mean ± t s / √n` with Student's t of n − 1 degrees of freedom (Student 1908).
///
/// None of fewer than two values, or where one is not finite.
pub fn mean_interval(values: &[f64], confidence: f64) -> Option<Interval> {
    around(values, confidence, 1.0 / values.len() as f64)
}

/// Where one new value of the same kind falls with this confidence, `mean ± t s √(1 + 1/n)`, of normal values.
///
/// It is the interval to compare with where there is a single run of something else. None as for [`mean_interval`].
pub fn prediction_interval(values: &[f64], confidence: f64) -> Option<Interval> {
    around(values, confidence, 1.0 + 1.0 / values.len() as f64)
}

/// `mean ± t s √share`.
fn around(values: &[f64], confidence: f64, share: f64) -> Option<Interval> {
    let (mean, deviation) = moments(values)?;
    let reach = t_quantile((1.0 + confidence) / 2.0, values.len() - 1) * deviation * share.sqrt();
    Some(Interval { low: mean - reach, high: mean + reach })
}

/// The interval of the mean by the studentised bootstrap (Efron & Tibshirani 1993, section 12.5).
///
/// Each resample tells how many of its own standard errors its mean is away from the mean of the values. The quantiles
/// of these numbers take the place of Student's t, so that the interval follows a skew. A resample of one value many
/// times is infinitely many standard errors away: with three values or fewer the bounds are infinite.
///
/// None as for [`mean_interval`].
pub fn studentised_interval(bootstrap: &Bootstrap, values: &[f64]) -> Option<Interval> {
    let resamples = Resamples::of_task(values.len(), bootstrap.resamples, bootstrap.seed);
    studentised_from(&resamples, bootstrap.confidence, values)
}

fn studentised_from(resamples: &Resamples, confidence: f64, values: &[f64]) -> Option<Interval> {
    let (mean, deviation) = moments(values)?;
    if deviation == 0.0 {
        return Some(Interval { low: mean, high: mean });
    }
    let root = (values.len() as f64).sqrt();
    let errors_away = |resample: &[f64]| {
        // Rounding would give equal values some deviation.
        let is_constant = resample.iter().all(|value| *value == resample[0]);
        let (other, spread) = if is_constant { (resample[0], 0.0) } else { moments(resample).unwrap_or((mean, 0.0)) };
        if other == mean { 0.0 } else { (other - mean) / (spread / root) }
    };
    let mut away = resamples.of_one(values, errors_away);
    let tail = (1.0 - confidence) / 2.0;
    // What lies high above its own mean makes the lower bound, and the other way round.
    let [low, high] = quantiles(&mut away, [1.0 - tail, tail]).map(|quantile| mean - quantile * deviation / root);
    Some(Interval { low, high })
}

/// The two-sided p-value of Student's test that the mean is 0; of paired differences it is the paired test.
///
/// None of fewer than two values, where one is not finite, or where all are the same: then nothing tells what a
/// difference by chance would be.
pub fn mean_p_value(values: &[f64]) -> Option<f64> {
    let (mean, deviation) = moments(values)?;
    let t = mean.abs() / (deviation / (values.len() as f64).sqrt());
    let differs = values.iter().any(|value| *value != values[0]);
    (differs && t.is_finite()).then(|| 2.0 * (1.0 - t_below(t, values.len() - 1)))
}

/// The value below which Student's t with this many degrees of freedom is with this probability, between ½ and 1.
pub fn t_quantile(probability: f64, degrees: usize) -> f64 {
    let (mut low, mut high) = (0.0, 1.0);
    while t_below(high, degrees) < probability && high < f64::MAX / 2.0 {
        high *= 2.0;
    }
    // Bisection to the last bit.
    loop {
        let middle = (low + high) / 2.0;
        if middle <= low || middle >= high {
            return high;
        }
        if t_below(middle, degrees) < probability { low = middle } else { high = middle }
    }
}

/// The probability that Student's t with `degrees` degrees of freedom is below `t` ≥ 0: a finite sum in the angle
/// θ = arctan(t / √degrees) (Abramowitz & Stegun 1964, 26.7.3 and 26.7.4).
fn t_below(t: f64, degrees: usize) -> f64 {
    let angle = (t / (degrees as f64).sqrt()).atan();
    let (sine, cosine) = angle.sin_cos();
    let is_odd = degrees % 2 == 1;
    // cos θ + ⅔ cos³ θ + … of odd degrees, 1 + ½ cos² θ + … of even ones, up to the power degrees − 2.
    let mut term = if is_odd { cosine } else { 1.0 };
    let mut sum = 0.0;
    for power in (usize::from(is_odd)..degrees - 1).step_by(2) {
        sum += term;
        term *= (power + 1) as f64 / (power + 2) as f64 * cosine * cosine;
    }
    let two_sided = if is_odd { std::f64::consts::FRAC_2_PI * (angle + sine * sum) } else { sine * sum };
    0.5 + two_sided / 2.0
}

/// Holm's (1979) step-down: p-values of several contrasts, adjusted so that all of them can be read together.
///
/// The chance that any contrast without a difference has an adjusted p-value below α is at most α. The order stays; a
/// NaN makes all of them NaN.
pub fn holm(p_values: &[f64]) -> Vec<f64> {
    if p_values.iter().any(|p| p.is_nan()) {
        return vec![f64::NAN; p_values.len()];
    }
    let mut order: Vec<usize> = (0..p_values.len()).collect();
    order.sort_by(|&a, &b| p_values[a].total_cmp(&p_values[b]));
    let mut adjusted = vec![0.0; p_values.len()];
    let mut largest: f64 = 0.0;
    for (rank, &place) in order.iter().enumerate() {
        largest = largest.max((p_values.len() - rank) as f64 * p_values[place]).min(1.0);
        adjusted[place] = largest;
    }
    adjusted
}

#[cfg(test)]
mod tests {
    use super::*;

    #[track_caller]
    fn assert_near(actual: f64, expected: f64) {
        assert!((actual - expected).abs() <= 1e-9 * expected.abs(), "{actual} is not {expected}");
    }

    /// Tables of t (Fisher & Yates), and closed forms: tan of 1 degree of freedom, and (2p − 1) √(2 / (4p (1 − p))) of 2.
    #[test]
    fn quantiles_of_t_are_those_of_the_tables() {
        let tables = [(3, 3.1824), (4, 2.7764), (5, 2.5706), (9, 2.2622), (10, 2.2281), (19, 2.0930), (30, 2.0423)];
        for (degrees, expected) in tables {
            let t = t_quantile(0.975, degrees);
            assert!((t - expected).abs() < 5e-5, "{degrees}: {t}");
        }
        assert_near(t_quantile(0.975, 1), (std::f64::consts::PI * 0.475).tan());
        assert_near(t_quantile(0.975, 2), 0.95 * (2.0_f64 / (4.0 * 0.975 * 0.025)).sqrt());
        assert!((t_quantile(0.975, 100_000) - 1.96).abs() < 1e-4);
        assert!(t_quantile(0.5, 7).abs() < 1e-12);
    }

    #[test]
    fn intervals_by_hand() {
        // Mean 3, standard deviation √2.5.
        let values = [1.0, 2.0, 3.0, 4.0, 5.0];
        let t = t_quantile(0.975, 4);
        let mean = mean_interval(&values, 0.95).unwrap();
        assert_near(mean.high - 3.0, t * (2.5_f64 / 5.0).sqrt());
        assert_near(3.0 - mean.low, mean.high - 3.0);
        let new = prediction_interval(&values, 0.95).unwrap();
        assert_near(new.high - 3.0, t * (2.5_f64 * 1.2).sqrt());
        for values in [&[1.0][..], &[1.0, f64::NAN], &[1.0, f64::INFINITY], &[]] {
            assert_eq!((mean_interval(values, 0.95), prediction_interval(values, 0.95)), (None, None));
            assert_eq!(studentised_interval(&Bootstrap::default(), values), None);
        }
    }

    #[test]
    fn the_studentised_interval_follows_a_skew() {
        let values = [0.1, 0.2, 0.3, 0.5, 4.0, 0.2, 0.4, 0.1];
        let mean = values.iter().sum::<f64>() / 8.0;
        let Interval { low, high } = studentised_interval(&Bootstrap::default(), &values).unwrap();
        assert!(high - mean > 2.0 * (mean - low) && low < mean, "{low} {mean} {high}");
        let constant = studentised_interval(&Bootstrap::default(), &[0.3; 5]).unwrap();
        assert_eq!((constant.low, constant.high), (0.3, 0.3));
    }

    #[test]
    fn the_interval_of_a_mean_is_chosen_by_the_number_of_values() {
        let bootstrap = Bootstrap::default();
        let values: Vec<f64> = (0..40).map(|i| f64::from(i * i % 17)).collect();
        let interval = |n: usize| interval_of_mean(&bootstrap, &values[..n]);
        assert_eq!(interval(1), None);
        assert_eq!(interval(3), mean_interval(&values[..3], 0.95));
        assert_ne!(interval(4), mean_interval(&values[..4], 0.95));
        assert_eq!(interval(29), studentised_interval(&bootstrap, &values[..29]));
        let percentile = bootstrap.estimate(&[values[..30].to_vec()], crate::aggregate::mean).interval;
        assert_eq!(interval(30), percentile);
    }

    /// Four of five are the same: a third of the resamples has no deviation at all.
    #[test]
    fn ties_do_not_put_a_bound_at_infinity() {
        let values = [0.9, 0.9, 0.9, 0.9, 0.3];
        let bootstrap = Bootstrap::default();
        assert_eq!(studentised_interval(&bootstrap, &values).unwrap().low, f64::NEG_INFINITY);
        let Interval { low, high } = interval_of_mean(&bootstrap, &values).unwrap();
        let student = mean_interval(&values, 0.95).unwrap();
        assert_near(0.78 - low, FARTHEST * (0.78 - student.low));
        assert!(high > 0.78 && high < student.high, "{high}");
        assert_eq!(interval_of_mean(&bootstrap, &[0.9; 5]), Some(Interval { low: 0.9, high: 0.9 }));
    }

    /// Of 4 degrees of freedom by the incomplete beta function, of 2 in closed form: 1 − t / √(t² + 2).
    #[test]
    fn the_p_value_is_students() {
        assert!((mean_p_value(&[1.0, 2.0, 3.0, 4.0, 5.0]).unwrap() - 0.013235599563).abs() < 1e-11);
        assert!((mean_p_value(&[-1.0, 2.0, 0.5]).unwrap() - (1.0 - (1.0_f64 / 7.0).sqrt())).abs() < 1e-12);
        for values in [&[1.0][..], &[1.0, 1.0], &[0.0, 0.0], &[1.0, f64::NAN]] {
            assert_eq!(mean_p_value(values), None);
        }
    }

    #[test]
    fn two_values_have_infinite_studentised_bounds() {
        let interval = studentised_interval(&Bootstrap::default(), &[0.0, 1.0]).unwrap();
        assert_eq!((interval.low, interval.high), (f64::NEG_INFINITY, f64::INFINITY));
    }

    /// As statsmodels' `multipletests(p, method="holm")` says.
    #[test]
    fn holm_steps_down() {
        let adjusted = holm(&[0.01, 0.04, 0.03, 0.005]);
        for (actual, expected) in adjusted.iter().zip([0.03, 0.06, 0.06, 0.02]) {
            assert_near(*actual, expected);
        }
        assert_eq!(holm(&[0.6, 0.9]), [1.0, 1.0]);
        assert!(holm(&[]).is_empty() && holm(&[0.1, f64::NAN]).iter().all(|p| p.is_nan()));
    }
}
