//! What a learning curve amounts to: its area, the time to a threshold, the final return.

use std::fmt;

use serde::{Deserialize, Serialize};

/// When something happened, in timesteps, if it did: `Never` is later than any time (a censored observation).
#[derive(Clone, Copy, Debug, PartialEq, PartialOrd, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Time {
    /// At this timestep.
    At(f64),
    /// Not within the time it was given.
    Never,
}

impl Time {
    /// A number to compare and resample: infinity for `Never`.
    pub fn to_f64(self) -> f64 {
        match self {
            Self::At(time) => time,
            Self::Never => f64::INFINITY,
        }
    }

    /// The reverse of [`to_f64`](Time::to_f64).
    pub fn from_f64(time: f64) -> Self {
        if time == f64::INFINITY { Self::Never } else { Self::At(time) }
    }

    /// The median of times, `Never` being larger than any: with half of them or more censored it is `Never` itself.
    /// `None` of no times.
    pub fn median(times: &[Self]) -> Option<Self> {
        let all: Vec<f64> = times.iter().map(|time| time.to_f64()).collect();
        (!all.is_empty()).then(|| Self::from_f64(crate::aggregate::median_run(&[all])))
    }
}

impl fmt::Display for Time {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        match self {
            Self::At(time) => write!(f, "{time:.0}"),
            Self::Never => write!(f, "never"),
        }
    }
}

/// One curve, read row by row; no row is kept.
///
/// Rows without a value (NaN) are skipped: between two values the curve is taken as straight, and it begins with the first
/// value and ends with the last, so that time before and after them does not count.
#[derive(Clone, Debug, PartialEq)]
pub struct Curve {
    thresholds: Vec<f64>,
    reached: Vec<Time>,
    first: Option<f64>,
    last: Option<(f64, f64)>,
    area: f64,
}

impl Curve {
    /// A curve without rows yet, that watches for these thresholds.
    pub fn new(thresholds: &[f64]) -> Self {
        let reached = vec![Time::Never; thresholds.len()];
        Self { thresholds: thresholds.to_vec(), reached, first: None, last: None, area: 0.0 }
    }

    /// Takes in the value at a timestep; timesteps ascend.
    pub fn push(&mut self, timestep: f64, value: f64) {
        if value.is_nan() {
            return;
        }
        match self.last {
            None => self.first = Some(timestep),
            Some((before, earlier)) => self.area += (timestep - before) * (value + earlier) / 2.0,
        }
        self.last = Some((timestep, value));
        for (threshold, reached) in self.thresholds.iter().zip(&mut self.reached) {
            if *reached == Time::Never && value >= *threshold {
                *reached = Time::At(timestep);
            }
        }
    }

    /// The area under the curve by the trapezoidal rule, divided by the timesteps between its first and its last value: a
    /// mean over training. One value is its own mean; `None` of none.
    pub fn area(&self) -> Option<f64> {
        let (first, (last, value)) = (self.first?, self.last?);
        Some(if last > first { self.area / (last - first) } else { value })
    }

    /// When each threshold was first reached, in the order given.
    pub fn times(&self) -> &[Time] {
        &self.reached
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_curve_is_as_computed_by_hand() {
        let mut curve = Curve::new(&[0.5, 0.9, 2.0]);
        assert_eq!(curve.area(), None);
        let gaps = [0.0_f64, 30.0, 70.0].map(|timestep| (timestep, f64::NAN));
        let mut rows = [&gaps[..], &[(10.0, 0.0), (20.0, 0.6), (50.0, 1.0), (60.0, 0.8)]].concat();
        rows.sort_by(|a, b| a.0.total_cmp(&b.0));
        rows.into_iter().for_each(|(timestep, value)| curve.push(timestep, value));
        // 10 · 0.3 + 30 · 0.8 + 10 · 0.9 over the 50 timesteps from the first value to the last.
        assert!((curve.area().unwrap() - 36.0 / 50.0).abs() < 1e-15);
        assert_eq!(curve.times(), [Time::At(20.0), Time::At(50.0), Time::Never]);
    }

    #[test]
    fn a_median_can_be_never() {
        let (early, late, never) = (Time::At(10.0), Time::At(30.0), Time::Never);
        assert_eq!(Time::median(&[late, never, early]), Some(late));
        assert_eq!(Time::median(&[late, early]), Some(Time::At(20.0)));
        assert_eq!(Time::median(&[late, never]), Some(never));
        assert_eq!(Time::median(&[never, never]), Some(never));
        assert_eq!(Time::median(&[]), None);
        assert!(late < never && early < late);
    }
}
