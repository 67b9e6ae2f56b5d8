//! How closely floating-point results agree.

/// Asserts that `actual` is `expected` within `tolerance` times the largest magnitude expected.
///
/// Measured by the largest entry, and not entry by entry: an entry that is the small difference of large terms carries
/// the rounding of those terms, about 6e-8 of their size each, however small it is itself.
#[track_caller]
pub fn assert_close(what: &str, actual: &[f32], expected: &[f32], tolerance: f32) {
    let largest = expected.iter().fold(0.0_f32, |m, e| m.max(e.abs()));
    assert_within(what, actual, expected, tolerance * largest);
}

/// Asserts that every entry of `actual` is that of `expected` within `margin`.
#[track_caller]
pub fn assert_within(what: &str, actual: &[f32], expected: &[f32], margin: f32) {
    assert_eq!(actual.len(), expected.len(), "{what}: lengths");
    for (i, (a, e)) in actual.iter().zip(expected).enumerate() {
        // A comparison that NaN fails.
        assert!((a - e).abs() <= margin, "{what}[{i}]: {a} is not {e} within {margin:e}");
    }
}

/// Asserts that one number is `expected` within `margin`.
#[track_caller]
pub fn assert_near(actual: f64, expected: f64, margin: f64) {
    assert!((actual - expected).abs() <= margin, "{actual} is not {expected} within {margin:e}");
}
