//! Intervals for few runs: fewer than 30 or so, where percentile intervals promise too much.
//!
//! [`mean_interval`] is Student's: exact for the mean of normal values. [`studentised_interval`] keeps its promise for
//! skewed values, too, and is wider for it. [`prediction_interval`] tells where one new run may fall. docs/metrics.md has
//! the coverage of all of them, which `cargo run --release --package rl-stats --example coverage` simulates.

use crate::{Bootstrap, Interval, Resamples, quantile};

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
    let (mean, deviation) = moments(values)?;
    if deviation == 0.0 {
        return Some(Interval { low: mean, high: mean });
    }
    let root = (values.len() as f64).sqrt();
    let errors_away = |resample: &[Vec<f64>]| {
        let resample = &resample[0];
        // Rounding would give equal values some deviation.
        let is_constant = resample.iter().all(|value| *value == resample[0]);
        let (other, spread) = if is_constant { (resample[0], 0.0) } else { moments(resample).unwrap_or((mean, 0.0)) };
        if other == mean { 0.0 } else { (other - mean) / (spread / root) }
    };
    let scores = [values.to_vec()];
    let resamples = Resamples::draw(&[values.len()], bootstrap.resamples, bootstrap.seed);
    let mut away = resamples.distribution(&scores, errors_away);
    away.sort_unstable_by(f64::total_cmp);
    let tail = (1.0 - bootstrap.confidence) / 2.0;
    // What lies high above its own mean makes the lower bound, and the other way round.
    let bound = |share: f64| mean - quantile(&away, share) * deviation / root;
    Some(Interval { low: bound(1.0 - tail), high: bound(tail) })
}

/// The value below which Student's t with this many degrees of freedom is with this probability, between ½ and 1.
pub fn t_quantile(probability: f64, degrees: usize) -> f64 {
    let (mut low, mut high) = (0.0, 1.0);
    while t_below(high, degrees) < probability && high < f64::MAX / 2.0 {
        high *= 2.0;
    }
    // Bisection to the last bit.
    for _ in 0..2 * f64::MANTISSA_DIGITS {
        let middle = (low + high) / 2.0;
        if t_below(middle, degrees) < probability { low = middle } else { high = middle }
    }
    high
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
