//! How often intervals hold what they are of: the share of simulated studies, for several numbers of runs.
//!
//! `cargo run --release --package rl-stats --example coverage` prints the table of docs/metrics.md. `in reports` is
//! `interval_of_mean`; `width` is its median width, as a multiple of Student's.

use chacha20::ChaCha8Rng;
use rand::{Rng, SeedableRng};
use rl_stats::aggregate::mean;
use rl_stats::few::{interval_of_mean, mean_interval, prediction_interval, studentised_interval};
use rl_stats::{Bootstrap, Interval, quantile};

/// A kind of draws: its name, expectation and a draw.
type Kind = (&'static str, f64, fn(&mut Draws) -> f64);

/// Simulated studies per cell: the standard error of a share of 95% is 0.2%.
const STUDIES: u64 = 10_000;

fn main() {
    let kinds: [Kind; 4] = [
        ("normal", 0.0, Draws::normal),
        ("exponential", 1.0, |draws| -draws.uniform().ln()),
        ("log-normal, σ = 0.5", 0.125_f64.exp(), |draws| (0.5 * draws.normal()).exp()),
        ("log-normal, σ = 1", 0.5_f64.exp(), |draws| draws.normal().exp()),
    ];
    println!("| draws | n | percentile | Student's t | studentised | in reports | width | prediction of a new run |");
    println!("|---|---|---|---|---|---|---|---|");
    for (name, expectation, draw) in kinds {
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
