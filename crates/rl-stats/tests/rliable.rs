//! rliable's own numbers, from `scripts/rliable-oracle`: aggregates to 1e-12, and intervals on the very resamples that
//! it drew.

use rl_stats::aggregate::{interquartile_mean, mean, median, optimality_gap};
use rl_stats::pairs::probability_of_improvement;
use rl_stats::{Interval, Resamples, percentile_interval};
use serde_json::Value;

const TOLERANCE: f64 = 1e-12;

fn fixture() -> Value {
    serde_json::from_str(include_str!("fixtures/rliable.json")).expect("the fixture is JSON")
}

fn read<T: serde::de::DeserializeOwned>(value: &Value) -> T {
    serde_json::from_value(value.clone()).expect("the fixture has this form")
}

/// Compares a statistic of `scores`, and its interval on the recorded resamples, with what rliable computed.
fn check(name: &str, scores: &[Vec<f64>], indices: &Value, expected: &Value, statistic: impl Fn(&[Vec<f64>]) -> f64) {
    let near = |actual: f64, expected: &Value| (actual - read::<f64>(expected)).abs() <= TOLERANCE;
    let value = statistic(scores);
    assert!(near(value, &expected["value"]), "{name}: {value}, not {}", expected["value"]);
    let sizes: Vec<usize> = scores.iter().map(Vec::len).collect();
    let resamples = Resamples::given(&sizes, &read::<Vec<Vec<Vec<usize>>>>(indices)).expect("indices fit the scores");
    let mut distribution = resamples.distribution(scores, statistic);
    assert_eq!(distribution.len(), 200);
    let Interval { low, high } = percentile_interval(&mut distribution, 0.95);
    let bounds = &expected["interval"];
    assert!(near(low, &bounds[0]) && near(high, &bounds[1]), "{name}: [{low}, {high}], not {bounds}");
    assert!(low <= high);
}

#[test]
fn aggregates_are_those_of_rliable() {
    type Aggregate = fn(&[Vec<f64>]) -> f64;
    let aggregates: [(&str, Aggregate); 4] = [
        ("mean", mean),
        ("median", median),
        ("interquartile_mean", interquartile_mean),
        ("optimality_gap", |scores| optimality_gap(scores, 1.0)),
    ];
    let fixture = fixture();
    let cases = fixture["cases"].as_array().expect("cases");
    assert_eq!(cases.len(), 4);
    for case in cases {
        let scores: Vec<Vec<f64>> = read(&case["scores"]);
        for (name, aggregate) in aggregates {
            let label = format!("{} of {}", name, case["name"]);
            check(&label, &scores, &case["indices"], &case["expected"][name], aggregate);
        }
    }
}

#[test]
fn improvement_is_that_of_rliable() {
    let fixture = fixture();
    let comparisons = fixture["comparisons"].as_array().expect("comparisons");
    assert_eq!(comparisons.len(), 3);
    for case in comparisons {
        let (x, y): (Vec<Vec<f64>>, Vec<Vec<f64>>) = (read(&case["x"]), read(&case["y"]));
        let statistic = |both: &[Vec<f64>]| {
            let (x, y) = both.split_at(x.len());
            probability_of_improvement(x, y)
        };
        check(&case["name"].to_string(), &[&x[..], &y[..]].concat(), &case["indices"], &case["expected"], statistic);
    }
}
