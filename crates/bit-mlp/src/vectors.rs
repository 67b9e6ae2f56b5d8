//! Sums, norms and products of vectors, for penalties and projections of whole layers.

use pulp::{Arch, Simd, WithSimd};

use crate::adam::{Decayed, SumSquares};
use crate::pull::Pull;

/// `sum ← sum + values`.
///
/// # Panics
/// If the lengths differ.
pub fn add(sum: &mut [f32], values: &[f32]) {
    Pull { coefficient: 1.0, anchor: None, covered: Decayed::All }.add_to(sum, values);
}

/// `‖values‖₂`.
pub fn norm(values: &[f32]) -> f32 {
    Arch::new().dispatch(SumSquares { values, added: None }).sqrt()
}

/// `along = W u` and `product = Wᵀ W u`, in one pass over W, `[rows, columns]` row-major; u and `product` are `[columns]`,
/// and `along` is `[rows]`.
///
/// # Panics
/// If the lengths do not fit together.
pub fn there_and_back(weight: &[f32], u: &[f32], along: &mut [f32], product: &mut [f32]) {
    check(weight, along, u);
    assert_eq!(product.len(), u.len(), "the product is as long as u");
    product.fill(0.0);
    Arch::new().dispatch(ThereAndBack { weight, u, along, product });
}

/// `out ← out + factor · a bᵀ`; out is `[rows, columns]` row-major, a `[rows]`, b `[columns]`.
///
/// # Panics
/// If the lengths do not fit together.
pub fn add_outer(out: &mut [f32], factor: f32, a: &[f32], b: &[f32]) {
    check(out, a, b);
    Arch::new().dispatch(AddOuter { out, factor, a, b });
}

fn check(matrix: &[f32], rows: &[f32], columns: &[f32]) {
    assert!(!columns.is_empty(), "a matrix has columns");
    assert_eq!(matrix.len(), rows.len() * columns.len(), "a matrix has a value for each row and column");
}

struct ThereAndBack<'a> {
    weight: &'a [f32],
    u: &'a [f32],
    along: &'a mut [f32],
    product: &'a mut [f32],
}

impl WithSimd for ThereAndBack<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let (u, u_tail) = S::as_simd_f32s(self.u);
        let u_tail = simd.partial_load_f32s(u_tail);
        let (product, product_tail) = S::as_mut_simd_f32s(self.product);
        for (row, along) in self.weight.chunks_exact(self.u.len()).zip(self.along) {
            let (row, row_tail) = S::as_simd_f32s(row);
            let row_tail = simd.partial_load_f32s(row_tail);
            let mut sum = simd.mul_f32s(row_tail, u_tail);
            for (&w, &u) in row.iter().zip(u) {
                sum = simd.mul_add_e_f32s(w, u, sum);
            }
            *along = simd.reduce_sum_f32s(sum);
            let scale = simd.splat_f32s(*along);
            for (p, &w) in product.iter_mut().zip(row) {
                *p = simd.mul_add_e_f32s(scale, w, *p);
            }
            let last = simd.mul_add_e_f32s(scale, row_tail, simd.partial_load_f32s(product_tail));
            simd.partial_store_f32s(product_tail, last);
        }
    }
}

struct AddOuter<'a> {
    out: &'a mut [f32],
    factor: f32,
    a: &'a [f32],
    b: &'a [f32],
}

impl WithSimd for AddOuter<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let (b, b_tail) = S::as_simd_f32s(self.b);
        let b_tail = simd.partial_load_f32s(b_tail);
        for (row, &a) in self.out.chunks_exact_mut(self.b.len()).zip(self.a) {
            let scale = simd.splat_f32s(self.factor * a);
            let (row, tail) = S::as_mut_simd_f32s(row);
            for (out, &b) in row.iter_mut().zip(b) {
                *out = simd.mul_add_e_f32s(scale, b, *out);
            }
            let last = simd.mul_add_e_f32s(scale, b_tail, simd.partial_load_f32s(tail));
            simd.partial_store_f32s(tail, last);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn products_are_those_of_the_definition() {
        for (rows, columns) in [(1, 1), (5, 3), (4, 16), (7, 37), (24, 64)] {
            let value = |i: usize| ((i * 37 % 101) as f32 - 50.0) / 64.0;
            let weight: Vec<f32> = (0..rows * columns).map(value).collect();
            let u: Vec<f32> = (0..columns).map(|i| value(i + 7)).collect();
            let (mut along, mut product) = (vec![9.0; rows], vec![9.0; columns]);
            there_and_back(&weight, &u, &mut along, &mut product);
            let at = |r: usize, c: usize| f64::from(weight[r * columns + c]);
            let forth: Vec<f64> = (0..rows).map(|r| (0..columns).map(|c| at(r, c) * f64::from(u[c])).sum()).collect();
            assert!(forth.iter().zip(&along).all(|(a, &b)| (a - f64::from(b)).abs() < 1e-4));
            for (c, &is) in product.iter().enumerate() {
                let expected: f64 = (0..rows).map(|r| at(r, c) * forth[r]).sum();
                assert!((expected - f64::from(is)).abs() < 1e-4 * expected.abs().max(1.0), "{expected} {is}");
            }
            let mut out = weight.clone();
            add_outer(&mut out, 0.5, &along, &u);
            for (i, &is) in out.iter().enumerate() {
                let expected = at(i / columns, i % columns) + 0.5 * forth[i / columns] * f64::from(u[i % columns]);
                assert!((expected - f64::from(is)).abs() < 1e-4 * expected.abs().max(1.0));
            }
        }
    }
}
