//! Tanh units that say the same in every state, wherever they are stuck.

use super::sample::share;
use super::{Hidden, Loss, Measure, Of, Units};

pub(super) const MEASURES: &[Measure] = &[Measure {
    name: "constant_units",
    title: "constant units",
    unit: "share",
    range: (0.0, 1.0),
    formula: "tanh: share of units with standard deviation of h below 0.001 over the states",
    source: "",
    loss: Loss::Rises,
    of: Of::HiddenOf(Units::Tanh, share_constant),
}];

fn share_constant(hidden: &Hidden) -> f64 {
    let means = hidden.means(|h| h);
    let mut squares = vec![0.0; means.len()];
    for row in hidden.rows() {
        let each = squares.iter_mut().zip(row).zip(&means);
        each.for_each(|((square, h), mean)| *square += (h - mean).powi(2));
    }
    let count = hidden.rows().len() as f64;
    share(&squares, |square| (square / count).sqrt() < 0.001)
}

#[cfg(test)]
mod tests {
    use super::super::sample::tests::hidden;
    use super::*;

    #[test]
    fn units_are_constant_at_any_level() {
        // Standard deviations 0, 0.0005, 0.002 and 0.5.
        let rows = [[0.25, 0.9995, 0.002, 1.0], [0.25, 0.9985, -0.002, 0.0]];
        assert_eq!(share_constant(&hidden(rows, Units::Tanh)), 0.5);
    }

    #[test]
    fn a_unit_without_numbers_is_not_constant() {
        assert_eq!(share_constant(&hidden([[f64::NAN], [0.0]], Units::Tanh)), 0.0);
    }
}
