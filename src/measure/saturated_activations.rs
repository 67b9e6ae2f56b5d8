//! Activations of tanh units that pass next to no gradient.

use super::sample::share;
use super::{Hidden, Loss, Measure, Of, Units};

pub(super) const MEASURES: &[Measure] = &[Measure {
    name: "saturated_activations",
    title: "saturated activations",
    unit: "share",
    range: (0.0, 1.0),
    formula: "tanh: share of all N·K activations with abs(h) > 0.99",
    source: "",
    loss: Loss::Rises,
    of: Of::HiddenOf(Units::Tanh, share_saturated),
}];

/// Whether tanh is so near its end that its slope is below 0.02.
pub(super) fn is_saturated(h: f64) -> bool {
    h.abs() > 0.99
}

fn share_saturated(hidden: &Hidden) -> f64 {
    share(hidden.activations(), |&h| is_saturated(h))
}

#[cfg(test)]
mod tests {
    use super::super::sample::tests::hidden;
    use super::*;

    #[test]
    fn by_hand() {
        let rows = [[-1.0, 0.001, 0.5], [-1.0, -0.001, 1.0], [-1.0, 0.001, 0.5], [-1.0, 0.99, -0.995]];
        assert_eq!(share_saturated(&hidden(rows, Units::Tanh)), 0.5);
    }
}
