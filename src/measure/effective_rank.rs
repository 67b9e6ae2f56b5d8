//! The rank as an entropy of the singular values.

use super::{Loss, Measure, Of, Spectrum};

pub(super) const MEASURES: &[Measure] = &[Measure {
    name: "effective_rank",
    title: "effective rank",
    unit: "",
    range: (0.0, f64::INFINITY),
    formula: "exp(−Σ pᵢ ln pᵢ), pᵢ = σᵢ / Σσ",
    source: "Roy & Vetterli 2007",
    loss: Loss::Falls,
    of: Of::Hidden(|hidden| effective_rank(&hidden.spectra().plain)),
}];

pub(super) fn effective_rank(spectrum: &Spectrum) -> f64 {
    let sum = spectrum.sum();
    if sum == 0.0 {
        return 0.0;
    }
    let term = |value: &f64| if *value == 0.0 { 0.0 } else { -(value / sum) * (value / sum).ln() };
    spectrum.values().iter().map(term).sum::<f64>().exp()
}

#[cfg(test)]
mod tests {
    use super::super::sample::tests::{assert_rank_of_edges, hidden};
    use super::super::spectrum::tests::spectrum;
    use super::*;
    use crate::measure::Units;

    #[test]
    fn by_hand() {
        // p = ½, ¼, ⅛, ⅛ and so an entropy of 7/4 ln 2.
        let rank = effective_rank(&spectrum(&[4.0, 2.0, 1.0, 1.0]));
        assert!((rank - 2_f64.powf(1.75)).abs() < 1e-12, "{rank}");
    }

    #[test]
    fn constant_silent_and_infinite_layers() {
        assert_rank_of_edges(|rows| effective_rank(&hidden(rows, Units::Tanh).spectra().plain));
    }
}
