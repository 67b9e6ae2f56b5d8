//! How undecided a policy is.

use super::{Acting, Head, Loss, Measure, Of};

pub(super) const MEASURES: &[Measure] = &[Measure {
    name: "policy_entropy",
    title: "policy entropy",
    unit: "nats",
    range: (0.0, f64::INFINITY),
    formula: "mean over the states of −Σ π(a) ln π(a), π the softmax of the logits",
    source: "",
    loss: Loss::Unclear,
    of: Of::Acting(Head::Logits, mean_entropy),
}];

fn mean_entropy(acting: &Acting) -> f64 {
    acting.mean_over_states(|logits| {
        // Subtracting the largest keeps the exponentials finite.
        let largest = logits.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        let sum: f64 = logits.iter().map(|logit| (logit - largest).exp()).sum();
        let log_probabilities = logits.iter().map(|logit| logit - largest - sum.ln());
        log_probabilities.map(|log| -log.exp() * log).sum()
    })
}

#[cfg(test)]
mod tests {
    use super::super::sample::tests::acting;
    use super::*;

    #[test]
    fn by_hand() {
        // π = ½, ¼, ⅛, ⅛ has 7/4 ln 2, the uniform policy ln 4, and one that is sure 0.
        let halves = [3.0, 2.0, 1.0, 1.0].map(|power: f32| power * std::f32::consts::LN_2);
        let outputs = [halves, [100.0; 4], [1000.0, 0.0, 0.0, 0.0]].concat();
        let entropy = mean_entropy(&acting(Head::Logits, outputs));
        let expected = (1.75 + 2.0 + 0.0) / 3.0 * std::f64::consts::LN_2;
        assert!((entropy - expected).abs() < 1e-7, "{entropy} is not {expected}");
    }
}
