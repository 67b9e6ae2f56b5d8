//! Axes: from values to places, ticks and their labels.

use crate::number::{number, superscript};

/// What an axis measures.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Axis {
    /// The quantity, such as "return".
    pub label: String,
    /// Its unit, such as "s"; `None` for numbers without one.
    pub unit: Option<String>,
    /// The values at its ends; `None` takes the data's. A wider range than the data's is kept, a narrower one cuts
    /// curves off.
    pub range: Option<(f64, f64)>,
    /// Whether the values are logarithms to base 10, which ticks call by the numbers they are of: "10⁻⁴" at −4. Of
    /// horizontal axes of curves.
    pub powers: bool,
}

impl Axis {
    /// An axis without unit over the range of the data.
    pub fn new(label: impl Into<String>) -> Self {
        Self { label: label.into(), ..Self::default() }
    }

    /// The label as printed, with unit and multiplier in parentheses.
    pub(crate) fn title(&self, multiplier: Multiplier) -> String {
        let note = match (multiplier.word(), self.unit.as_deref()) {
            (None, None) => return self.label.clone(),
            (None, Some(unit)) => unit.to_owned(),
            (Some(word), None) => word,
            (Some(word), Some(unit)) => format!("{word} {unit}"),
        };
        format!("{} ({note})", self.label).trim_start().to_owned()
    }
}

/// What tick labels leave out, so that they stay short.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Multiplier {
    One,
    Named(i32, &'static str),
    Power(i32),
}

impl Multiplier {
    fn of(largest: f64) -> Self {
        if largest == 0.0 || !largest.is_finite() {
            return Self::One;
        }
        match largest.log10().floor() as i32 {
            exponent @ (12.. | ..=-4) => Self::Power(exponent),
            9.. => Self::Named(9, "billions"),
            6.. => Self::Named(6, "millions"),
            5.. => Self::Named(3, "thousands"),
            _ => Self::One,
        }
    }

    fn exponent(self) -> i32 {
        match self {
            Self::One => 0,
            Self::Named(exponent, _) | Self::Power(exponent) => exponent,
        }
    }

    /// As it is written into the axis's title.
    pub fn word(self) -> Option<String> {
        match self {
            Self::One => None,
            Self::Named(_, word) => Some(word.to_owned()),
            Self::Power(exponent) => Some(format!("×10{}", superscript(exponent))),
        }
    }
}

/// The range of an axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Scale {
    pub low: f64,
    pub high: f64,
}

/// Where a tick stands and what it says.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Tick {
    pub value: f64,
    pub label: String,
}

impl Scale {
    /// The scale that shows `values` and `axis.range`, with `padding` times the data's range free at both ends;
    /// `None` without finite values.
    pub fn fit(values: impl Iterator<Item = f64>, axis: &Axis, padding: f64) -> Option<Self> {
        let (low, high) = values
            .filter(|value| drawable(*value))
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), value| (low.min(value), high.max(value)));
        if low > high {
            return None;
        }
        if let Some((low, high)) = axis.range.filter(|(low, high)| drawable(*low) && drawable(*high) && low < high) {
            return Some(Self { low, high });
        }
        let room = padding * (high - low);
        // Ticks of a range below the values' own precision would all be equal.
        if high - low <= 1e-9 * low.abs().max(high.abs()) {
            // What is 0 throughout, a share or a count, is no less.
            if low == 0.0 {
                return Some(Self { low: -padding, high: 1.0 + padding });
            }
            let room = 0.1 * low.abs();
            return Some(Self { low: low - room, high: high + room });
        }
        Some(Self { low: low - room, high: high + room })
    }

    /// Where `value` lies between `from` (the low end) and `to`; infinities lie at the ends.
    pub fn place(&self, value: f64, from: f64, to: f64) -> f64 {
        let share = ((value - self.low) / (self.high - self.low)).clamp(-CLAMP, 1.0 + CLAMP);
        let share = if value.is_infinite() { share.clamp(0.0, 1.0) } else { share };
        from + share * (to - from)
    }

    pub fn multiplier(&self) -> Multiplier {
        Multiplier::of(self.low.abs().max(self.high.abs()))
    }

    /// At most `max` ticks at multiples of 1, 2, 2.5 or 5 times a power of ten. There are fewer than two only if
    /// `max` is.
    pub fn ticks(&self, max: usize) -> Vec<Tick> {
        let exponent = self.multiplier().exponent();
        let unit = 10f64.powi(exponent);
        let (low, high) = (self.low / unit, self.high / unit);
        // A hair more than the range, or rounding loses the ticks at its ends.
        let slack = 1e-9 * (high - low);
        let first_power = ((high - low) / max.max(1) as f64).log10().floor() as i32 - 1;
        for power in first_power..first_power + 4 {
            for (digit, more_decimals) in [(1.0, 0), (2.0, 0), (2.5, 1), (5.0, 0)] {
                let step = digit * 10f64.powi(power);
                let (first, last) = (((low - slack) / step).ceil(), ((high + slack) / step).floor());
                if last - first + 1.0 > max as f64 {
                    continue;
                }
                let decimals = (more_decimals - power).max(0) as usize;
                return (0..=(last - first).max(0.0) as usize)
                    .map(|i| (first + i as f64) * step)
                    .filter(|_| last >= first)
                    .map(|value| Tick { value: value * unit, label: number(value, decimals) })
                    .collect();
            }
        }
        Vec::new()
    }
}

impl Scale {
    /// At most `max` ticks of a scale of logarithms to base 10: at whole powers, or, where it holds fewer than two of
    /// them, at 1, 2 and 5 times a power.
    pub fn power_ticks(&self, max: usize) -> Vec<Tick> {
        let (first, last) = ((self.low - 1e-9).ceil() as i32, (self.high + 1e-9).floor() as i32);
        let powers: Vec<i32> = (first..=last).collect();
        if powers.len() < 2 {
            let multiple = |power: i32| [1.0, 2.0, 5.0].map(|digit| digit * 10f64.powi(power));
            let within = |value: &f64| (self.low - 1e-9..=self.high + 1e-9).contains(&value.log10());
            let values = (first - 1..=last + 1).flat_map(multiple).filter(within);
            let tick = |value: f64| Tick { value: value.log10(), label: format!("{value}") };
            return values.map(tick).take(max).collect();
        }
        let tick = |&power: &i32| Tick { value: f64::from(power), label: format!("10{}", superscript(power)) };
        powers.iter().step_by(powers.len().div_ceil(max.max(1))).map(tick).collect()
    }
}

/// How far outside its panel a place may lie, in panels; more could overflow a renderer.
const CLAMP: f64 = 10.0;

/// Whether `value` can be shown. Beyond 10¹⁵⁰ the width of a range may overflow.
pub(crate) fn drawable(value: f64) -> bool {
    value.abs() < 1e150
}

#[cfg(test)]
mod tests {
    use super::*;

    fn labels(low: f64, high: f64, max: usize) -> Vec<String> {
        Scale { low, high }.ticks(max).into_iter().map(|tick| tick.label).collect()
    }

    #[test]
    fn ticks_are_round() {
        assert_eq!(labels(-200.0, 45.0, 6), ["−200", "−150", "−100", "−50", "0"]);
        assert_eq!(labels(0.0, 2_500_000.0, 6), ["0.0", "0.5", "1.0", "1.5", "2.0", "2.5"]);
        assert_eq!(labels(0.0, 1.0, 5), ["0.00", "0.25", "0.50", "0.75", "1.00"]);
        assert_eq!(labels(0.0, 9000.0, 4), ["0", "2,500", "5,000", "7,500"]);
        assert_eq!(labels(0.0, 3e-5, 4), ["0", "1", "2", "3"]);
        assert_eq!(labels(-4e20, 4e20, 3), ["−2.5", "0.0", "2.5"]);
    }

    #[test]
    fn never_more_ticks_than_asked_for_and_two_where_possible() {
        for max in 2..9 {
            for (low, high) in [(0.0, 1.0), (-3.3, 17.9), (1e9, 1e9 + 7.0), (-1e-7, 1e-9), (999.0, 1001.0)] {
                let ticks = Scale { low, high }.ticks(max);
                assert!(ticks.len() <= max, "{low}..{high} at most {max}: {ticks:?}");
                assert!(!ticks.is_empty() && (max < 4 || ticks.len() >= 2), "{low}..{high} at most {max}: {ticks:?}");
                assert!(ticks.windows(2).all(|pair| pair[0].label != pair[1].label), "{ticks:?}");
            }
        }
    }

    #[test]
    fn ticks_of_logarithms_are_powers() {
        let labels = |low: f64, high: f64, max: usize| {
            let ticks = Scale { low, high }.power_ticks(max);
            ticks.into_iter().map(|tick| tick.label).collect::<Vec<_>>()
        };
        assert_eq!(labels(-5.0, -2.0, 7), ["10⁻⁵", "10⁻⁴", "10⁻³", "10⁻²"]);
        assert_eq!(labels(-5.0, -2.0, 2), ["10⁻⁵", "10⁻³"]);
        assert_eq!(labels(0.2, 0.8, 7), ["2", "5"]);
        assert_eq!(labels(1.8, 2.5, 7), ["100", "200"]);
    }

    #[test]
    fn scales_hold_all_values() {
        let axis = Axis::new("return");
        assert_eq!(Scale::fit([f64::NAN, f64::INFINITY].into_iter(), &axis, 0.05), None);
        let constant = Scale::fit([45.0; 3].into_iter(), &axis, 0.05).unwrap();
        assert!(constant.low < 45.0 && constant.high > 45.0);
        let zero = Scale::fit([0.0].into_iter(), &axis, 0.05).unwrap();
        assert_eq!((zero.low, zero.high), (-0.05, 1.05));
        let fixed = Axis { range: Some((0.0, 1.0)), ..axis };
        assert_eq!(Scale::fit([0.4].into_iter(), &fixed, 0.05), Some(Scale { low: 0.0, high: 1.0 }));
    }

    #[test]
    fn titles_say_unit_and_multiplier() {
        let seconds = Axis { unit: Some("s".to_owned()), ..Axis::new("time") };
        assert_eq!(seconds.title(Multiplier::One), "time (s)");
        assert_eq!(seconds.title(Multiplier::of(3e6)), "time (millions s)");
        assert_eq!(Axis::new("timesteps").title(Multiplier::of(2.5e6)), "timesteps (millions)");
        assert_eq!(Axis::new("norm").title(Multiplier::of(3e-7)), "norm (×10⁻⁷)");
        assert_eq!(Axis::default().title(Multiplier::of(3e-7)), "(×10⁻⁷)");
    }
}
