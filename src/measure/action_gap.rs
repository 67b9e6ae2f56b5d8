//! How much better the best action looks than the second best.

use super::{Acting, Head, Loss, Measure, Of};

pub(super) const MEASURES: &[Measure] = &[Measure {
    name: "action_gap",
    title: "action gap",
    unit: "return",
    range: (0.0, f64::INFINITY),
    formula: "mean over the states of the difference between the largest and the second largest action value",
    source: "Farahmand 2011",
    loss: Loss::Unclear,
    of: Of::Acting(Head::Values, mean_gap),
}];

fn mean_gap(acting: &Acting) -> f64 {
    acting.mean_over_states(|values| {
        let mut sorted = values.to_vec();
        sorted.sort_by(|a, b| b.total_cmp(a));
        sorted[0] - sorted[1]
    })
}

#[cfg(test)]
mod tests {
    use super::super::sample::tests::acting;
    use super::*;

    #[test]
    fn by_hand() {
        // Gaps 3 and, where two are best, 0.
        let outputs = [[-1.0, 2.0, 5.0, 0.0], [4.0, 1.0, 4.0, 2.0]].concat();
        assert_eq!(mean_gap(&acting(Head::Values, outputs)), 1.5);
    }
}
