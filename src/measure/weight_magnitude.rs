//! The size of the weights.

use super::{Loss, Measure, Of};

pub(super) const MEASURES: &[Measure] = &[Measure {
    name: "weight_magnitude",
    title: "mean weight magnitude",
    unit: "",
    range: (0.0, f64::INFINITY),
    formula: "mean abs(w) over the layer's weights, biases left out",
    source: "after Dohare et al. 2024",
    loss: Loss::Rises,
    of: Of::Weights(mean_magnitude),
}];

fn mean_magnitude(weights: &[f32]) -> f64 {
    weights.iter().map(|w| f64::from(w.abs())).sum::<f64>() / weights.len() as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn by_hand() {
        assert_eq!(mean_magnitude(&[1.0, -2.0, 0.0, -3.0]), 1.5);
    }
}
