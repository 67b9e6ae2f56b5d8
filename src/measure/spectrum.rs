//! The singular values of a matrix, which the ranks are made of.

use nalgebra::{DMatrix, SVD};

/// The singular values σ of a matrix, the largest first.
///
/// Ranks lie between 1 and the number of singular values. Those of a zero matrix are 0, and those of one that is not
/// finite NaN.
#[derive(Clone, Debug)]
pub struct Spectrum(Vec<f64>);

/// The spectra of one matrix.
#[derive(Clone, Debug)]
pub struct Spectra {
    /// As it is.
    pub plain: Spectrum,
    /// Without the mean of each column.
    pub centred: Spectrum,
}

impl Spectra {
    /// Those of a matrix A `[N, K]`, row by row, K being `columns`.
    ///
    /// One decomposition gives both. With f the first row of A, QR of `[1 | A − 1fᵀ]` leaves a first row `[s, r]` and below
    /// it `[0, C]`. 1 is s times the first column of Q, so that C has the singular values of A without its means, and
    /// `r + sf` above C those of A. Taken from the first row's, the values of a constant column are exactly 0, and so
    /// they are in C.
    pub fn of(matrix: &[f64], columns: usize) -> Self {
        // What is not finite never converges.
        if !matrix.iter().all(|value| value.is_finite()) {
            let none = Spectrum(vec![f64::NAN]);
            return Self { plain: none.clone(), centred: none };
        }
        let (rows, first) = (matrix.len() / columns, &matrix[..columns]);
        // Column by column, as the decomposition wants it; a few at once, as memory does.
        let mut shifted = vec![1.0; rows * (columns + 1)];
        for (block, start) in shifted[rows..].chunks_mut(8 * rows).zip((0..).step_by(8)) {
            for (row, values) in matrix.chunks_exact(columns).enumerate() {
                let each = block.chunks_exact_mut(rows).zip(values[start..].iter().zip(&first[start..]));
                each.for_each(|(column, (value, first))| column[row] = value - first);
            }
        }
        let r = DMatrix::from_vec(rows, columns + 1, shifted).qr().unpack_r();
        let mut plain = r.columns(1, columns).into_owned();
        let centred = plain.rows(1, r.nrows() - 1).into_owned();
        plain.row_mut(0).iter_mut().zip(first).for_each(|(value, first)| *value += r[(0, 0)] * first);
        Self { plain: Spectrum::of(plain), centred: Spectrum::of(centred) }
    }
}

impl Spectrum {
    /// That of a finite matrix; one without rows has a single value of 0.
    fn of(matrix: DMatrix<f64>) -> Self {
        if matrix.is_empty() {
            return Self(vec![0.0]);
        }
        let most = MAX_STEPS * matrix.nrows().min(matrix.ncols());
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
        let values = Spectra::of(&rows.concat(), 4).plain;
        assert_eq!(values.values().len(), 4);
        for (value, expected) in values.values().iter().zip([4.0, 2.0, 1.0, 1.0]) {
            assert!((value - expected).abs() < 1e-14, "{value} is not {expected}");
        }
        assert_eq!(Spectra::of(&[0.0; 6], 2).plain.values(), [0.0, 0.0]);
        // Without means of 2 and 1: ±[1, 1].
        let centred = Spectra::of(&[1.0, 0.0, 3.0, 2.0], 2).centred;
        assert!((centred.values()[0] - 2.0).abs() < 1e-15 && centred.values()[1..].iter().all(|value| *value == 0.0));
        assert_eq!(Spectra::of(&[3.0, 4.0], 2).centred.values(), [0.0]);
        let [largest, smallest] = Spectra::of(&[3.0, 0.0, 4.0, 5.0], 2).plain.values().try_into().unwrap();
        assert!((largest * largest - 45.0_f64).abs() < 1e-12 && (smallest * smallest - 5.0_f64).abs() < 1e-12);
    }

    #[test]
    fn what_is_not_finite_has_no_singular_values() {
        for value in [f64::NAN, f64::INFINITY] {
            let Spectra { plain, centred } = Spectra::of(&[value, 1.0, 1.0, 1.0], 2);
            assert!(plain.values()[0].is_nan() && centred.values()[0].is_nan());
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
            let Spectra { plain, centred } = Spectra::of(&matrix, columns);
            prop_assert_eq!(plain.values().len(), rows.min(columns));
            let mean = |column: usize| matrix.iter().skip(column).step_by(columns).sum::<f64>() / rows as f64;
            let means: Vec<f64> = (0..columns).map(mean).collect();
            let without_means: Vec<f64> = matrix.iter().zip(means.iter().cycle()).map(|(value, mean)| value - mean).collect();
            let all = squares(&matrix);
            for (spectrum, expected) in [(plain, all), (centred, squares(&without_means))] {
                prop_assert!(spectrum.values().is_sorted_by(|a, b| a >= b));
                prop_assert!((squares(spectrum.values()) - expected).abs() <= 1e-12 * all);
            }
        }
    }
}
