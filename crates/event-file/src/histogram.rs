//! Distributions as TensorFlow's `HistogramProto`.

use std::sync::LazyLock;

use crate::message::Message;

/// The smallest end above 0, and how many times larger the next one is.
const SMALLEST: f64 = 1e-12;
const GROWTH: f64 = 1.1;

/// The right ends of the buckets: ±1e-12 · 1.1ⁱ below 1e20, 0 between them, and one end for all that is larger.
///
/// A bucket holds the values from the end before it, inclusive, to its own, exclusive. The ends are those of
/// TensorFlow's `histogram.cc`, whose own first one, the lowest number of all, could hold no value.
static LIMITS: LazyLock<Vec<f64>> = LazyLock::new(|| {
    let positive: Vec<f64> =
        std::iter::successors(Some(SMALLEST), |limit| Some(limit * GROWTH)).take_while(|&limit| limit < 1e20).collect();
    let negative = positive.iter().rev().map(|limit| -limit);
    negative.chain([0.0]).chain(positive.iter().copied()).chain([f64::MAX]).collect()
});

/// The `HistogramProto` of the finite ones among `values`.
pub(crate) fn encode(values: &[f32]) -> Message {
    let finite = || values.iter().filter(|value| value.is_finite()).map(|&value| f64::from(value));
    let mut counts = vec![0_u64; LIMITS.len()];
    let (mut min, mut max) = (f64::MAX, f64::MIN);
    for value in finite() {
        counts[bucket(value)] += 1;
        (min, max) = (min.min(value), max.max(value));
    }
    let number: u64 = counts.iter().sum();
    if number == 0 {
        (min, max) = (0.0, 0.0);
    }
    let buckets = buckets(&counts);
    Message::new()
        .double(1, min)
        .double(2, max)
        .double(3, number as f64)
        .double(4, finite().sum())
        .double(5, finite().map(|value| value * value).sum())
        .doubles(6, buckets.iter().map(|(limit, _)| *limit))
        .doubles(7, buckets.iter().map(|(_, count)| *count as f64))
}

/// The buckets of the finite numbers whose first 16 bits are the index and the others 0: sign, exponent and 7 bits of the
/// mantissa. Numbers that begin alike differ by less than a hundredth, and a bucket's ends by a tenth.
static NEAR: LazyLock<Vec<u16>> = LazyLock::new(|| {
    let near = |first: u16| {
        let value = f32::from_bits(u32::from(first) << 16);
        if value.is_finite() { LIMITS.partition_point(|&limit| limit <= f64::from(value)) as u16 } else { 0 }
    };
    (0..=u16::MAX).map(near).collect()
});

/// The bucket of a finite value: the first whose end is larger.
fn bucket(value: f64) -> usize {
    let limits = &LIMITS[..];
    let mut at = usize::from(NEAR[((value as f32).to_bits() >> 16) as usize]);
    while limits[at] <= value {
        at += 1;
    }
    while at > 0 && limits[at - 1] > value {
        at -= 1;
    }
    at
}

/// The buckets from the first to the last that holds a value, as `(right end, count)`; empty ones in a row are one.
fn buckets(counts: &[u64]) -> Vec<(f64, u64)> {
    let Some(first) = counts.iter().position(|&count| count > 0) else {
        return Vec::new();
    };
    let last = counts.iter().rposition(|&count| count > 0).unwrap_or(first);
    (first..=last).filter(|&i| counts[i] > 0 || counts[i + 1] > 0).map(|i| (LIMITS[i], counts[i])).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(values: &[f64]) -> Vec<(f64, u64)> {
        let mut counts = vec![0; LIMITS.len()];
        values.iter().for_each(|&value| counts[bucket(value)] += 1);
        buckets(&counts)
    }

    #[test]
    fn limits_ascend_symmetrically() {
        assert!(LIMITS.is_sorted() && LIMITS.contains(&0.0));
        let inner = &LIMITS[..LIMITS.len() - 1];
        assert!(inner.iter().zip(inner.iter().rev()).all(|(low, high)| *low == -high));
        assert!(inner[0] < -9e19 && inner[0] > -1e20);
    }

    #[test]
    fn buckets_are_those_of_a_search() {
        let magnitudes = (-450..=400).map(|i| 10_f64.powf(f64::from(i) / 10.0));
        let ends = LIMITS[..LIMITS.len() - 1].iter().flat_map(|&end| [end, end.next_down(), end.next_up()]);
        for value in magnitudes.flat_map(|value| [value, -value]).chain(ends).chain([0.0, -0.0, f64::MIN_POSITIVE]) {
            assert_eq!(bucket(value), LIMITS.partition_point(|&limit| limit <= value), "{value:e}");
        }
    }

    #[test]
    fn values_fall_left_of_their_limit() {
        assert_eq!(of(&[]), []);
        assert_eq!(of(&[0.0, 0.0, 1e-13]), [(1e-12, 3)]);
        assert_eq!(of(&[1e-12]), [(1e-12 * 1.1, 1)]);
        assert_eq!(of(&[-1e-13, 0.0]), [(0.0, 1), (1e-12, 1)]);
        assert_eq!(of(&[f64::from(f32::MAX)]), [(f64::MAX, 1)]);
        assert_eq!(of(&[f64::from(f32::MIN)]), [(LIMITS[0], 1)]);
    }

    #[test]
    fn empty_buckets_between_are_one() {
        let [(low, 2), (gap, 0), (high, 1)] = of(&[-1.0, -1.0, 1.0])[..] else {
            panic!("three buckets: {:?}", of(&[-1.0, -1.0, 1.0]));
        };
        assert!(-1.0 < low && low < gap && gap <= 1.0 && 1.0 < high, "{low} {gap} {high}");
    }

    #[test]
    fn what_is_not_finite_is_left_out() {
        let all = encode(&[1.0, f32::NAN, f32::INFINITY, -2.0, f32::NEG_INFINITY]);
        assert_eq!(all.bytes(), encode(&[1.0, -2.0]).bytes());
        let none = encode(&[f32::NAN]);
        assert_eq!(none.bytes(), encode(&[]).bytes());
    }
}
