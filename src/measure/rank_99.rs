//! The rank as the number of singular values that matter.

use super::{Loss, Measure, Of, Spectrum};

pub(super) const MEASURES: &[Measure] = &[Measure {
    name: "rank_99",
    title: "singular values for 99%",
    unit: "",
    range: (0.0, f64::INFINITY),
    formula: "the least k with σ₁ + … + σₖ > 0.99 Σσ",
    source: "Kumar et al. (2021)",
    loss: Loss::Falls,
    of: Of::Hidden(|hidden| rank_99(&hidden.spectra().plain)),
}];

fn rank_99(spectrum: &Spectrum) -> f64 {
    let sum = spectrum.sum();
    if !sum.is_normal() {
        return sum;
    }
    let sums = spectrum.values().iter().scan(0.0, |sum, value| {
        *sum += value;
        Some(*sum)
    });
    (1 + sums.take_while(|&first| first <= 0.99 * sum).count()) as f64
}

#[cfg(test)]
mod tests {
    use super::super::sample::tests::{assert_rank_of_edges, hidden};
    use super::super::spectrum::tests::spectrum;
    use super::*;
    use crate::measure::Units;

    #[test]
    fn by_hand() {
        assert_eq!(rank_99(&spectrum(&[4.0, 2.0, 1.0, 1.0])), 4.0);
        // 99 of 100 is not yet more than 99%; 99.5 of 100 is.
        assert_eq!(rank_99(&spectrum(&[60.0, 39.0, 1.0])), 3.0);
        assert_eq!(rank_99(&spectrum(&[60.0, 39.5, 0.5])), 2.0);
    }

    #[test]
    fn constant_silent_and_infinite_layers() {
        assert_rank_of_edges(|rows| rank_99(&hidden(rows, Units::Tanh).spectra().plain));
    }
}
