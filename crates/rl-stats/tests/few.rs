//! Intervals of few values keep their promise in simulated studies; the example `coverage` has the whole table.

use chacha20::ChaCha8Rng;
use rand::{Rng, SeedableRng};
use rl_stats::few::{mean_interval, prediction_interval, studentised_interval};
use rl_stats::ratio::fieller_interval;
use rl_stats::{Bootstrap, Interval};

const STUDIES: u64 = 2000;

/// The share of studies whose interval of `n` standard exponential draws holds their expectation, 1, or one draw more.
fn coverage(n: usize, of_new: bool, interval: impl Fn(u64, &[f64]) -> Option<Interval>) -> f64 {
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let mut draw = || -(((rng.next_u64() >> 11) as f64 + 0.5) / (1_u64 << 53) as f64).ln();
    let held = (0..STUDIES).filter(|&study| {
        let values: Vec<f64> = (0..n).map(|_| draw()).collect();
        let expected = if of_new { draw() } else { 1.0 };
        interval(study, &values).is_some_and(|Interval { low, high }| (low..=high).contains(&expected))
    });
    held.count() as f64 / STUDIES as f64
}

/// The standard error of a share of 93.5% among 2,000 is 0.6%.
#[test]
fn the_studentised_interval_covers_skewed_means() {
    let studentised = |seed, values: &[f64]| {
        studentised_interval(&Bootstrap { seed, resamples: 500, ..Bootstrap::default() }, values)
    };
    for n in [5, 20] {
        let held = coverage(n, false, studentised);
        assert!((0.925..0.965).contains(&held), "{n}: {held}");
    }
    // Student's does not.
    assert!(coverage(5, false, |_, values| mean_interval(values, 0.95)) < 0.90);
}

#[test]
fn the_prediction_interval_covers_new_values_and_not_only_means() {
    let held = coverage(10, true, |_, values| prediction_interval(values, 0.95));
    assert!((0.92..0.95).contains(&held), "{held}");
    assert!(coverage(10, true, |_, values| mean_interval(values, 0.95)) < 0.6);
}

/// Numerators are uniform around ½, denominators around 1. The standard error of a share of 95% among 2,000 is 0.5%.
#[test]
fn fiellers_interval_holds_ratios() {
    let mut rng = ChaCha8Rng::seed_from_u64(2);
    let mut around = |middle: f64| middle + (rng.next_u64() >> 11) as f64 / (1_u64 << 53) as f64 - 0.5;
    for n in [5, 20] {
        let held = (0..STUDIES).filter(|_| {
            let pairs: Vec<(f64, f64)> = (0..n).map(|_| (around(0.5), around(1.0))).collect();
            fieller_interval(&pairs, 0.95).is_some_and(|Interval { low, high }| (low..=high).contains(&0.5))
        });
        let held = held.count() as f64 / STUDIES as f64;
        assert!((0.93..0.97).contains(&held), "{n}: {held}");
    }
}
