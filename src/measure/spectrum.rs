//! The singular values of a matrix, which the ranks are made of.

use nalgebra::{DMatrix, SVD};

/// The singular values σ of a matrix, the largest first.
///
/// Ranks lie between 1 and the number of singular values. Those of a zero matrix are 0, and those of one that is not
/// finite NaN.
#[derive(Clone, Debug)]
pub struct Spectrum(Vec<f64>);

impl Spectrum {
    /// That of a matrix `[N, K]`, row by row, K being `columns`.
    pub fn of(matrix: &[f64], columns: usize) -> Self {
        // What is not finite never converges.
        if !matrix.iter().all(|value| value.is_finite()) {
            return Self(vec![f64::NAN]);
        }
        let rows = matrix.len() / columns;
        let matrix = DMatrix::from_row_slice(rows, columns, matrix);
        // R of A = QR has the singular values of A, and is smaller where there are more states than units.
        let matrix = if rows > columns { matrix.qr().unpack_r() } else { matrix };
        let most = MAX_STEPS * rows.min(columns);
        let values = SVD::try_new(matrix, false, false, TOLERANCE, most).map(|svd| svd.singular_values);
        Self(values.map_or_else(|| vec![f64::NAN], |values| values.as_slice().to_vec()))
    }

    /// σ₁ ≥ σ₂ ≥ …
    pub fn values(&self) -> &[f64] {
        &self.0
    }

    /// Σσ.
    pub fn sum(&self) -> f64 {
        self.0.iter().sum()
    }
}

/// Below this share of its neighbours an off-diagonal element counts as 0: nalgebra's own choice.
const TOLERANCE: f64 = 5.0 * f64::EPSILON;
/// Steps for each singular value, at most; two or three are usual.
const MAX_STEPS: usize = 100;

#[cfg(test)]
pub(super) mod tests {
    use proptest::prelude::*;

    use super::*;

    /// One with these singular values.
    pub fn spectrum(values: &[f64]) -> Spectrum {
        Spectrum(values.to_vec())
    }

    #[test]
    fn singular_values_by_hand() {
        // Orthogonal columns of lengths 2, 4, 1 and 1.
        let rows = [
            [0.0, 4.0, 0.0, 0.0],
            [2.0, 0.0, 0.0, 0.0],
            [0.0, 0.0, 0.0, -1.0],
            [0.0, 0.0, 1.0, 0.0],
            [0.0, 0.0, 0.0, 0.0],
        ];
        let values = Spectrum::of(&rows.concat(), 4);
        assert_eq!(values.values().len(), 4);
        for (value, expected) in values.values().iter().zip([4.0, 2.0, 1.0, 1.0]) {
            assert!((value - expected).abs() < 1e-14, "{value} is not {expected}");
        }
        assert_eq!(Spectrum::of(&[0.0; 6], 2).values(), [0.0, 0.0]);
        let [largest, smallest] = Spectrum::of(&[3.0, 0.0, 4.0, 5.0], 2).values().try_into().unwrap();
        assert!((largest * largest - 45.0_f64).abs() < 1e-12 && (smallest * smallest - 5.0_f64).abs() < 1e-12);
    }

    #[test]
    fn what_is_not_finite_has_no_singular_values() {
        for value in [f64::NAN, f64::INFINITY] {
            assert!(Spectrum::of(&[value, 1.0, 1.0, 1.0], 2).values()[0].is_nan());
        }
    }

    proptest! {
        /// Σσ² is the sum of the squares of the elements. nalgebra's issue 1172 breaks this where vectors are wanted.
        #[test]
        fn squares_add_up(
            (rows, columns) in (1_usize..40, 1_usize..30),
            kind in 0_u8..4,
            seeds in prop::collection::vec(-1.0..1.0_f64, 1200),
        ) {
            let value = |i: usize| match kind {
                0 => 1.0,
                1 => seeds[i],
                // Units that are dead, or saturated: rank-deficient.
                2 => if (i % columns).is_multiple_of(3) { 0.0 } else { seeds[i].max(0.0) },
                _ => seeds[i].signum(),
            };
            let matrix: Vec<f64> = (0..rows * columns).map(value).collect();
            let squares = |values: &[f64]| values.iter().map(|value| value * value).sum::<f64>();
            let spectrum = Spectrum::of(&matrix, columns);
            prop_assert!(spectrum.values().is_sorted_by(|a, b| a >= b));
            prop_assert_eq!(spectrum.values().len(), rows.min(columns));
            let expected = squares(&matrix);
            prop_assert!((squares(spectrum.values()) - expected).abs() <= 1e-12 * expected);
        }
    }
}
