//! Tanh units that are stuck at one end.

use super::saturated_activations::is_saturated;
use super::{Hidden, Loss, Measure, Of, Units};

pub(super) const MEASURES: &[Measure] = &[Measure {
    name: "saturated_units",
    title: "saturated units",
    unit: "share",
    range: (0.0, 1.0),
    formula: "tanh: share of units with abs(h) > 0.99 on every state",
    source: "",
    loss: Loss::Rises,
    of: Of::HiddenOf(Units::Tanh, share_saturated),
}];

fn share_saturated(hidden: &Hidden) -> f64 {
    hidden.share_always(is_saturated)
}

#[cfg(test)]
mod tests {
    use super::super::sample::tests::hidden;
    use super::*;

    #[test]
    fn a_unit_that_is_saturated_in_one_state_only_is_not() {
        let rows = [[-1.0, 0.001, 0.5], [1.0, -0.001, 0.5], [-0.995, 0.001, -0.995]];
        assert_eq!(share_saturated(&hidden(rows, Units::Tanh)), 1.0 / 3.0);
    }
}
