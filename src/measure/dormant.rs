//! Units that hardly act, compared with the others of their layer.

use super::sample::share;
use super::{Hidden, Loss, Measure, Of};

pub(super) const MEASURES: &[Measure] = &[
    dormant(
        "dormant_0.1",
        "dormant units, τ = 0.1",
        "share of units with score sᵢ ≤ 0.1, sᵢ = E abs(hᵢ) / ((1/K) Σₖ E abs(hₖ)), E over the states",
        |hidden| share(&scores(hidden), |&score| score <= 0.1),
    ),
    dormant(
        "dormant_0.025",
        "dormant units, τ = 0.025",
        "share of units with score sᵢ ≤ 0.025, the score as for `dormant_0.1`",
        |hidden| share(&scores(hidden), |&score| score <= 0.025),
    ),
];

/// One of the measures, which differ in their threshold τ.
const fn dormant(
    name: &'static str,
    title: &'static str,
    formula: &'static str,
    compute: fn(&Hidden) -> f64,
) -> Measure {
    Measure {
        name,
        title,
        unit: "share",
        range: (0.0, 1.0),
        formula,
        source: "Sokar et al. 2023",
        loss: Loss::Rises,
        of: Of::Hidden(compute),
    }
}

/// Each unit's mean |h| over that of the whole layer, `[K]`; 0 for all where the layer is silent.
fn scores(hidden: &Hidden) -> Vec<f64> {
    let magnitudes = hidden.means(f64::abs);
    let mean = magnitudes.iter().sum::<f64>() / magnitudes.len() as f64;
    magnitudes.into_iter().map(|magnitude| if mean == 0.0 { 0.0 } else { magnitude / mean }).collect()
}

#[cfg(test)]
mod tests {
    use super::super::sample::tests::{hidden, values};
    use super::*;
    use crate::measure::Units;

    #[test]
    fn a_unit_at_the_threshold_is_dormant() {
        // Mean magnitudes 1, 16, 4 and 19 of a mean of 10: scores 0.1, 1.6, 0.4, 1.9.
        let layer = hidden([[-1.0, 16.0, 0.0, 19.0], [1.0, 16.0, 8.0, -19.0]], Units::Relu);
        assert_eq!(scores(&layer), [0.1, 1.6, 0.4, 1.9]);
        assert_eq!(values(MEASURES, &layer), [0.25, 0.0]);
    }

    #[test]
    fn constant_units_are_compared_by_size_alone() {
        assert_eq!(scores(&hidden([[0.5, -0.5]; 3], Units::Tanh)), [1.0, 1.0]);
    }

    #[test]
    fn a_silent_layer_is_dormant_throughout() {
        assert_eq!(values(MEASURES, &hidden([[0.0; 3]; 4], Units::Relu)), [1.0, 1.0]);
    }
}
