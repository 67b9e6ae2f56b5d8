//! The rank as a ratio of two norms.

use super::{Loss, Measure, Of, Spectrum};

pub(super) const MEASURES: &[Measure] = &[Measure {
    name: "stable_rank",
    title: "stable rank",
    unit: "",
    range: (0.0, f64::INFINITY),
    formula: "Σσ² / σ₁² = ‖h‖²_F / ‖h‖²₂",
    source: "",
    loss: Loss::Falls,
    of: Of::Hidden(|hidden| stable_rank(&hidden.spectra().plain)),
}];

fn stable_rank(spectrum: &Spectrum) -> f64 {
    let largest = spectrum.values()[0];
    if largest == 0.0 {
        return 0.0;
    }
    spectrum.values().iter().map(|value| (value / largest).powi(2)).sum()
}

#[cfg(test)]
mod tests {
    use super::super::sample::tests::{assert_rank_of_edges, hidden};
    use super::super::spectrum::tests::spectrum;
    use super::*;
    use crate::measure::Units;

    #[test]
    fn by_hand() {
        assert_eq!(stable_rank(&spectrum(&[4.0, 2.0, 1.0, 1.0])), 22.0 / 16.0);
    }

    #[test]
    fn constant_silent_and_infinite_layers() {
        assert_rank_of_edges(|rows| stable_rank(&hidden(rows, Units::Tanh).spectra().plain));
    }
}
