//! The rank of what varies over the states.

use super::effective_rank::effective_rank;
use super::{Loss, Measure, Of};

pub(super) const MEASURES: &[Measure] = &[Measure {
    name: "centred_rank",
    title: "effective rank, centred",
    unit: "",
    range: (0.0, f64::INFINITY),
    formula: "`effective_rank` of h without each unit's mean over the states",
    source: "",
    loss: Loss::Falls,
    of: Of::Hidden(|hidden| effective_rank(&hidden.spectra().centred)),
}];

#[cfg(test)]
mod tests {
    use super::super::sample::tests::{hidden, values};
    use super::*;
    use crate::measure::Units;

    fn centred_rank<const N: usize, const K: usize>(rows: [[f64; K]; N]) -> f64 {
        values(MEASURES, &hidden(rows, Units::Tanh))[0]
    }

    #[test]
    fn means_are_taken_away() {
        // Around means of 0.3, 7 and -2 only two units vary, by orthogonal patterns of lengths 6 and 2: p = ¾, ¼.
        let rows = [[0.3, 10.0, -1.0], [0.3, 4.0, -3.0], [0.3, 10.0, -3.0], [0.3, 4.0, -1.0]];
        let rank = centred_rank(rows);
        let expected = (2.0 * 2_f64.ln() - 0.75 * 3_f64.ln()).exp();
        assert!((rank - expected).abs() < 1e-12, "{rank} is not {expected}");
    }

    #[test]
    fn constant_and_infinite_layers() {
        assert_eq!(centred_rank([[0.3, -0.7, 0.1]; 7]), 0.0);
        assert!(centred_rank([[f64::INFINITY, 1.0], [0.0, 1.0]]).is_nan());
    }
}
