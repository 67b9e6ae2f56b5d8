//! What is measured of one hidden layer. docs/metrics.md has the formulas and their sources.

use bit_mlp::Activation;
use tch::{Kind, Tensor};

/// Scores at or below which a unit counts as dormant, as they stand in the columns' names (Sokar et al. 2023).
pub const DORMANT: [(&str, f64); 2] = [("dormant_0.1", 0.1), ("dormant_0.025", 0.025)];
/// |h| beyond which a tanh unit is saturated; its slope there is below 0.02.
pub const SATURATED: f64 = 0.99;
/// The share of the sum of singular values that `rank_99` exceeds (Kumar et al. 2021, as srank; Dohare et al. 2024).
const RANK_SHARE: f64 = 0.99;

/// Every measure of a hidden layer with these activations, `[N, K]` of N samples and K units.
pub fn of_layer(activations: &Tensor, activation: Activation) -> Vec<(&'static str, f64)> {
    let activations = activations.to_kind(Kind::Double);
    let scores = dormancy_scores(&activations);
    let mut measures: Vec<_> = DORMANT.iter().map(|&(name, threshold)| (name, share(&scores, threshold))).collect();
    match activation {
        Activation::Relu => measures.push(("dead_units", dead_units(&activations))),
        Activation::Tanh => measures.extend([
            ("saturated_units", saturated_units(&activations)),
            ("saturated_activations", saturated_activations(&activations)),
        ]),
    }
    let spectrum = Spectrum::of(&activations);
    measures.extend([
        ("effective_rank", spectrum.effective_rank()),
        ("stable_rank", spectrum.stable_rank()),
        ("rank_99", spectrum.rank_99()),
    ]);
    measures
}

/// Each unit's mean |h| over that of the whole layer, `[K]`; 0 for all where the layer is silent.
pub fn dormancy_scores(activations: &Tensor) -> Vec<f64> {
    let magnitudes = floats(&activations.abs().mean_dim(0, false, Kind::Double));
    let mean = magnitudes.iter().sum::<f64>() / magnitudes.len() as f64;
    magnitudes.into_iter().map(|magnitude| if mean == 0.0 { 0.0 } else { magnitude / mean }).collect()
}

/// Share of scores at or below `threshold`.
fn share(scores: &[f64], threshold: f64) -> f64 {
    scores.iter().filter(|&&score| score <= threshold).count() as f64 / scores.len() as f64
}

/// Share of units that are 0 on every sample.
pub fn dead_units(activations: &Tensor) -> f64 {
    mean(&activations.eq(0.0).all_dim(0, false))
}

/// Share of units that are saturated on every sample.
pub fn saturated_units(activations: &Tensor) -> f64 {
    mean(&activations.abs().gt(SATURATED).all_dim(0, false))
}

/// Share of all N·K activations that are saturated.
pub fn saturated_activations(activations: &Tensor) -> f64 {
    mean(&activations.abs().gt(SATURATED))
}

/// The singular values σ of a matrix, the largest first.
///
/// All three ranks lie between 1 and the number of singular values; those of a zero matrix are 0, and those of one that
/// is not finite NaN.
#[derive(Clone, Debug)]
pub struct Spectrum(Vec<f64>);

impl Spectrum {
    /// That of a matrix `[N, K]`, as it is: no mean is taken away.
    pub fn of(matrix: &Tensor) -> Self {
        // Without vectors this is linalg_svdvals, which itself cannot be called on the CPU: the bindings pass a driver.
        // It refuses matrices that are not finite.
        let values = matrix.to_kind(Kind::Double).f_svd(true, false);
        Self(values.map_or_else(|_| vec![f64::NAN], |(_, values, _)| floats(&values)))
    }

    /// exp H(p) of pᵢ = σᵢ / Σσ, H being Shannon's entropy in nats (Roy & Vetterli 2007).
    pub fn effective_rank(&self) -> f64 {
        let sum = self.sum();
        if sum == 0.0 {
            return 0.0;
        }
        let term = |value: &f64| if *value == 0.0 { 0.0 } else { -(value / sum) * (value / sum).ln() };
        self.0.iter().map(term).sum::<f64>().exp()
    }

    /// ‖A‖²_F / ‖A‖²₂ = Σσ² / σ₁².
    pub fn stable_rank(&self) -> f64 {
        let largest = self.0[0];
        if largest == 0.0 {
            return 0.0;
        }
        self.0.iter().map(|value| (value / largest).powi(2)).sum()
    }

    /// The least k for which σ₁ + … + σₖ exceeds 99% of the sum: what Dohare et al. (2024) call stable rank.
    pub fn rank_99(&self) -> f64 {
        let sum = self.sum();
        if !sum.is_normal() {
            return sum;
        }
        let sums = self.0.iter().scan(0.0, |sum, value| {
            *sum += value;
            Some(*sum)
        });
        (1 + sums.take_while(|&first| first <= RANK_SHARE * sum).count()) as f64
    }

    fn sum(&self) -> f64 {
        self.0.iter().sum()
    }
}

/// The mean of all elements; of flags, the share that is set.
fn mean(tensor: &Tensor) -> f64 {
    tensor.to_kind(Kind::Double).mean(Kind::Double).double_value(&[])
}

/// The elements of a vector.
fn floats(vector: &Tensor) -> Vec<f64> {
    vector.try_into().expect("a vector of numbers")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn matrix<const N: usize, const K: usize>(rows: [[f64; K]; N]) -> Tensor {
        Tensor::from_slice(rows.as_flattened()).view([N as i64, K as i64])
    }

    fn measures<const N: usize, const K: usize>(
        rows: [[f64; K]; N],
        activation: Activation,
    ) -> Vec<(&'static str, f64)> {
        of_layer(&matrix(rows), activation)
    }

    fn value(measures: &[(&str, f64)], name: &str) -> f64 {
        measures.iter().find(|(other, _)| *other == name).unwrap_or_else(|| panic!("{name} is measured")).1
    }

    #[track_caller]
    fn assert_near(actual: f64, expected: f64) {
        assert!((actual - expected).abs() < 1e-12, "{actual} is not {expected}");
    }

    #[test]
    fn a_unit_at_the_threshold_is_dormant() {
        // Mean magnitudes 1, 16, 4 and 19 of a mean of 10: scores 0.1, 1.6, 0.4, 1.9.
        let rows = [[-1.0, 16.0, 0.0, 19.0], [1.0, 16.0, 8.0, -19.0]];
        assert_eq!(dormancy_scores(&matrix(rows)), [0.1, 1.6, 0.4, 1.9]);
        let of = |name| value(&measures(rows, Activation::Relu), name);
        assert_eq!((of("dormant_0.1"), of("dormant_0.025")), (0.25, 0.0));
    }

    #[test]
    fn a_saturated_unit_is_not_dormant() {
        let rows = [[-1.0, 0.001, 0.5], [-1.0, -0.001, 1.0], [-1.0, 0.001, 0.5], [-1.0, 0.001, -0.995]];
        let measures = measures(rows, Activation::Tanh);
        let of = |name| value(&measures, name);
        assert_eq!((of("dormant_0.1"), of("dormant_0.025")), (1.0 / 3.0, 1.0 / 3.0));
        assert_eq!((of("saturated_units"), of("saturated_activations")), (1.0 / 3.0, 0.5));
        assert!(!measures.iter().any(|(name, _)| *name == "dead_units"));
    }

    #[test]
    fn a_dead_unit_is_zero_everywhere() {
        // The second is active once, but too little not to be dormant.
        let measures = measures([[0.0, 0.0, 3.0], [0.0, 0.001, 2.0], [0.0, 0.0, 0.0]], Activation::Relu);
        let of = |name| value(&measures, name);
        assert_eq!((of("dead_units"), of("dormant_0.025")), (1.0 / 3.0, 2.0 / 3.0));
        assert!(!measures.iter().any(|(name, _)| name.starts_with("saturated")));
    }

    #[test]
    fn ranks_by_hand() {
        // Orthogonal columns of lengths 4, 2, 1 and 1: p = ½, ¼, ⅛, ⅛ and H = 7/4 ln 2.
        let spectrum = Spectrum::of(&matrix([
            [0.0, 2.0, 0.0, 0.0],
            [4.0, 0.0, 0.0, 0.0],
            [0.0, 0.0, 0.0, -1.0],
            [0.0, 0.0, 1.0, 0.0],
            [0.0, 0.0, 0.0, 0.0],
        ]));
        assert_near(spectrum.effective_rank(), 2_f64.powf(1.75));
        assert_near(spectrum.stable_rank(), 22.0 / 16.0);
        assert_eq!(spectrum.rank_99(), 4.0);
        // 99 of 100 is not yet more than 99%; 99.5 of 100 is.
        assert_eq!(Spectrum(vec![60.0, 39.0, 1.0]).rank_99(), 3.0);
        assert_eq!(Spectrum(vec![60.0, 39.5, 0.5]).rank_99(), 2.0);
    }

    #[test]
    fn constant_activations_have_rank_one() {
        let spectrum = Spectrum::of(&matrix([[0.5, -0.25, 1.0]; 5]));
        for rank in [spectrum.effective_rank(), spectrum.stable_rank(), spectrum.rank_99()] {
            // The singular values that should be 0 are of the order of 1e-17, each adding about 40 times that to the entropy.
            assert!((rank - 1.0).abs() < 1e-12, "{rank}");
        }
        assert_eq!(dormancy_scores(&matrix([[0.5, -0.5]; 3])), [1.0, 1.0]);
    }

    #[test]
    fn a_silent_layer_is_dormant_and_has_no_rank() {
        let measures = measures([[0.0; 3]; 4], Activation::Relu);
        let expected = [
            ("dormant_0.1", 1.0),
            ("dormant_0.025", 1.0),
            ("dead_units", 1.0),
            ("effective_rank", 0.0),
            ("stable_rank", 0.0),
            ("rank_99", 0.0),
        ];
        assert_eq!(measures, expected);
    }

    #[test]
    fn infinite_activations_have_no_number() {
        let spectrum = Spectrum::of(&matrix([[f64::INFINITY, 1.0], [1.0, 1.0]]));
        assert!(spectrum.effective_rank().is_nan() && spectrum.stable_rank().is_nan() && spectrum.rank_99().is_nan());
    }
}
