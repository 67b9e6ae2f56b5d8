//! ReLU units that nothing passes.

use super::{Hidden, Loss, Measure, Of, Units};

pub(super) const MEASURES: &[Measure] = &[Measure {
    name: "dead_units",
    title: "dead units",
    unit: "share",
    range: (0.0, 1.0),
    formula: "ReLU: share of units that are 0 on every state",
    source: "",
    loss: Loss::Rises,
    of: Of::HiddenOf(Units::Relu, share_dead),
}];

fn share_dead(hidden: &Hidden) -> f64 {
    hidden.share_always(|h| h == 0.0)
}

#[cfg(test)]
mod tests {
    use super::super::sample::tests::hidden;
    use super::*;

    #[test]
    fn a_dead_unit_is_zero_everywhere() {
        let rows = [[0.0, 0.0, 3.0], [0.0, 0.001, 2.0], [0.0, 0.0, 0.0]];
        assert_eq!(share_dead(&hidden(rows, Units::Relu)), 1.0 / 3.0);
    }
}
