//! How far apart the logits of a policy are.

use super::{Acting, Head, Loss, Measure, Of};

pub(super) const MEASURES: &[Measure] = &[Measure {
    name: "logit_scale",
    title: "scale of the logits",
    unit: "",
    range: (0.0, f64::INFINITY),
    formula: "mean over the states of the standard deviation of the logits over the actions",
    source: "",
    loss: Loss::Unclear,
    of: Of::Acting(Head::Logits, mean_deviation),
}];

fn mean_deviation(acting: &Acting) -> f64 {
    acting.mean_over_states(|logits| {
        let count = logits.len() as f64;
        let mean = logits.iter().sum::<f64>() / count;
        (logits.iter().map(|logit| (logit - mean).powi(2)).sum::<f64>() / count).sqrt()
    })
}

#[cfg(test)]
mod tests {
    use super::super::sample::tests::acting;
    use super::*;

    #[test]
    fn by_hand() {
        // Deviations 2 and, since a shift changes no policy, 0.
        let outputs = [[1.0, 5.0, 1.0, 5.0], [7.0; 4]].concat();
        assert_eq!(mean_deviation(&acting(Head::Logits, outputs)), 1.0);
    }
}
