//! The rank of what varies over the states.

use super::effective_rank::effective_rank;
use super::{Hidden, Loss, Measure, Of, Spectrum};

pub(super) const MEASURES: &[Measure] = &[Measure {
    name: "centred_rank",
    title: "effective rank, centred",
    unit: "",
    range: (0.0, f64::INFINITY),
    formula: "`effective_rank` of h without each unit's mean over the states",
    source: "",
    loss: Loss::Falls,
    of: Of::Hidden(centred_rank),
}];

fn centred_rank(hidden: &Hidden) -> f64 {
    // Taken from the first state's, the activations of a constant unit are exactly 0, and so is their mean.
    let Some(first) = hidden.rows().next() else { return f64::NAN };
    let mut centred: Vec<f64> =
        hidden.rows().flat_map(|row| row.iter().zip(first).map(|(h, first)| h - first)).collect();
    let shifted = Hidden::new(centred.clone(), first.len(), hidden.units());
    let means = shifted.means(|h| h);
    for row in centred.chunks_exact_mut(first.len()) {
        row.iter_mut().zip(&means).for_each(|(h, mean)| *h -= mean);
    }
    effective_rank(&Spectrum::of(&centred, first.len()))
}

#[cfg(test)]
mod tests {
    use super::super::sample::tests::hidden;
    use super::*;
    use crate::measure::Units;

    #[test]
    fn means_are_taken_away() {
        // Around means of 0.3, 7 and -2 only two units vary, by orthogonal patterns of lengths 6 and 2: p = ¾, ¼.
        let rows = [[0.3, 10.0, -1.0], [0.3, 4.0, -3.0], [0.3, 10.0, -3.0], [0.3, 4.0, -1.0]];
        let rank = centred_rank(&hidden(rows, Units::Tanh));
        let expected = (2.0 * 2_f64.ln() - 0.75 * 3_f64.ln()).exp();
        assert!((rank - expected).abs() < 1e-12, "{rank} is not {expected}");
    }

    #[test]
    fn constant_and_infinite_layers() {
        assert_eq!(centred_rank(&hidden([[0.3, -0.7, 0.1]; 7], Units::Tanh)), 0.0);
        assert!(centred_rank(&hidden([[f64::INFINITY, 1.0], [0.0, 1.0]], Units::Tanh)).is_nan());
    }
}
