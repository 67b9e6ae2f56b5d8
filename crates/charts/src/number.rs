//! Numbers as readers of a paper expect them.

/// `value` with `decimals` decimals, commas between thousands and a true minus sign; "–" where it is not finite.
///
/// ```
/// assert_eq!(charts::number(-1234.56, 1), "−1,234.6");
/// assert_eq!(charts::number(-0.01, 1), "0.0");
/// assert_eq!(charts::number(f64::NAN, 1), "–");
/// ```
pub fn number(value: f64, decimals: usize) -> String {
    if !value.is_finite() {
        return "–".to_owned();
    }
    let digits = format!("{:.decimals$}", value.abs());
    let (whole, fraction) = digits.split_at(digits.find('.').unwrap_or(digits.len()));
    let mut text = String::new();
    if value < 0.0 && digits.bytes().any(|digit| (b'1'..=b'9').contains(&digit)) {
        text.push('−');
    }
    for (i, digit) in whole.chars().enumerate() {
        if i > 0 && (whole.len() - i).is_multiple_of(3) {
            text.push(',');
        }
        text.push(digit);
    }
    text + fraction
}

/// `exponent` in superscript digits.
pub(crate) fn superscript(exponent: i32) -> String {
    const DIGITS: [char; 10] = ['⁰', '¹', '²', '³', '⁴', '⁵', '⁶', '⁷', '⁸', '⁹'];
    let raise = |c: char| c.to_digit(10).map_or('⁻', |digit| DIGITS[digit as usize]);
    exponent.to_string().chars().map(raise).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn separates_thousands() {
        for (value, decimals, expected) in [
            (0.0, 0, "0"),
            (999.0, 0, "999"),
            (1000.0, 0, "1,000"),
            (-1234567.0, 0, "−1,234,567"),
            (12.345, 2, "12.35"),
        ] {
            assert_eq!(number(value, decimals), expected);
        }
    }

    #[test]
    fn raises_exponents() {
        assert_eq!(superscript(-12), "⁻¹²");
    }
}
