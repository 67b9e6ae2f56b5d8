//! How often intervals hold what they are of: the share of simulated studies, for several numbers of runs.
//!
//! `cargo run --release --package rl-stats --example coverage` prints the tables of docs/metrics.md: of means, and of ratios
//! of means. In the first `in reports` is `interval_of_mean`, and `width` its median width, as a multiple of Student's.

use chacha20::ChaCha8Rng;
use rand::{Rng, SeedableRng};
use rl_stats::aggregate::mean;
use rl_stats::few::{interval_of_mean, mean_interval, prediction_interval, studentised_interval};
use rl_stats::ratio::fieller_interval;
use rl_stats::{Bootstrap, Interval, quantile};

/// A kind of draws: its name, expectation, standard deviation and a draw.
type Kind = (&'static str, f64, f64, fn(&mut Draws) -> f64);

/// Simulated studies per cell: the standard error of a share of 95% is 0.2%.
const STUDIES: u64 = 10_000;

/// The mean numerator of the ratios; the mean denominator is 1.
const RATIO: f64 = 0.5;

fn main() {
    // (e^σ² − 1) e^σ² is the variance of a log-normal draw.
    let log_normal = |variance: f64| (variance.exp_m1() * variance.exp()).sqrt();
    let kinds: [Kind; 4] = [
        ("normal", 0.0, 1.0, Draws::normal),
        ("exponential", 1.0, 1.0, |draws| -draws.uniform().ln()),
        ("log-normal, σ = 0.5", 0.125_f64.exp(), log_normal(0.25), |draws| (0.5 * draws.normal()).exp()),
        ("log-normal, σ = 1", 0.5_f64.exp(), log_normal(1.0), |draws| draws.normal().exp()),
    ];
    means(&kinds);
    println!();
    ratios(&kinds);
}

/// Intervals of means, and those of one draw more.
fn means(kinds: &[Kind]) {
    println!("| draws | n | percentile | Student's t | studentised | in reports | width | prediction of a new run |");
    println!("|---|---|---|---|---|---|---|---|");
    for &(name, expectation, _, draw) in kinds {
        for n in [3, 4, 5, 10, 20] {
            let mut draws = Draws(ChaCha8Rng::seed_from_u64(n as u64));
            let mut held = [0_u32; 5];
            let mut widths = Vec::new();
            for seed in 0..STUDIES {
                let values: Vec<f64> = (0..n).map(|_| draw(&mut draws)).collect();
                let new = draw(&mut draws);
                let bootstrap = Bootstrap { seed, resamples: 1000, ..Bootstrap::default() };
                let percentile = bootstrap.estimate(std::slice::from_ref(&values), mean).interval;
                let intervals = [
                    (percentile, expectation),
                    (mean_interval(&values, 0.95), expectation),
                    (studentised_interval(&bootstrap, &values), expectation),
                    (interval_of_mean(&bootstrap, &values), expectation),
                    (prediction_interval(&values, 0.95), new),
                ];
                let intervals = intervals.map(|(interval, value)| (interval.expect("several finite values"), value));
                for (count, (Interval { low, high }, value)) in held.iter_mut().zip(intervals) {
                    *count += u32::from((low..=high).contains(&value));
                }
                let [_, student, _, chosen, _] = intervals.map(|(Interval { low, high }, _)| high - low);
                widths.push(chosen / student);
            }
            widths.sort_unstable_by(f64::total_cmp);
            let width = quantile(&widths, 0.5);
            let [percentile, student, studentised, chosen, new] =
                held.map(|count| format!("{:.1}%", 100.0 * f64::from(count) / STUDIES as f64));
            println!("| {name} | {n} | {percentile} | {student} | {studentised} | {chosen} | {width:.2} | {new} |");
        }
    }
}

/// Intervals of ratios of means. Numerators and denominators are independent, both of the kind or the denominators normal,
/// and have the same standard deviation.
fn ratios(kinds: &[Kind]) {
    println!("| numerators | denominators | deviation | n | percentile | Fieller's | has an end |");
    println!("|---|---|---|---|---|---|---|");
    let normal = kinds[0];
    let both = kinds.iter().map(|&kind| (kind, kind, 0.3));
    let numerators = kinds[1..].iter().map(|&kind| (kind, normal, 0.3));
    for (numerator, denominator, deviation) in both.chain(numerators).chain([(normal, normal, 1.0)]) {
        let around = |draws: &mut Draws, middle: f64, (_, expectation, own, draw): Kind| {
            middle + deviation * (draw(draws) - expectation) / own
        };
        for n in [5_u32, 10, 20] {
            let mut draws = Draws(ChaCha8Rng::seed_from_u64(u64::from(n)));
            let (mut percentile, mut fieller, mut with_end) = (0_u32, 0_u32, 0_u32);
            for seed in 0..STUDIES {
                let mut pair = || (around(&mut draws, RATIO, numerator), around(&mut draws, 1.0, denominator));
                let pairs: Vec<(f64, f64)> = (0..n).map(|_| pair()).collect();
                let holds = |interval: Interval| u32::from((interval.low..=interval.high).contains(&RATIO));
                let places = [(0..n).map(f64::from).collect::<Vec<f64>>()];
                let bootstrap = Bootstrap { seed, resamples: 1000, ..Bootstrap::default() };
                let ratio = bootstrap.estimate(&places, |places| {
                    let drawn = places[0].iter().map(|&place| pairs[place as usize]);
                    let (x, y) = drawn.fold((0.0, 0.0), |sum, pair| (sum.0 + pair.0, sum.1 + pair.1));
                    x / y
                });
                percentile += ratio.interval.map_or(0, holds);
                if let Some(interval) = fieller_interval(&pairs, 0.95) {
                    with_end += 1;
                    fieller += holds(interval);
                }
            }
            let share = |count: u32, of: f64| format!("{:.1}%", 100.0 * f64::from(count) / of);
            let shares = [
                share(percentile, STUDIES as f64),
                share(fieller, f64::from(with_end)),
                share(with_end, STUDIES as f64),
            ];
            println!("| {} | {} | {deviation} | {n} | {} |", numerator.0, denominator.0, shares.join(" | "));
        }
    }
}

/// Independent draws.
struct Draws(ChaCha8Rng);

impl Draws {
    /// Uniform in (0, 1).
    fn uniform(&mut self) -> f64 {
        ((self.0.next_u64() >> 11) as f64 + 0.5) / (1_u64 << 53) as f64
    }

    /// Standard normal (Box & Muller 1958).
    fn normal(&mut self) -> f64 {
        (-2.0 * self.uniform().ln()).sqrt() * (std::f64::consts::TAU * self.uniform()).cos()
    }
}
