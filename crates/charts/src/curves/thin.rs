//! Fewer points for the same picture.
//!
//! A run of half a million timesteps is logged thousands of times, on a panel some hundred points wide. Of the
//! points that share a narrow column, a line needs only the first, the lowest, the highest and the last
//! (Jugel et al. 2014, "M4").

use crate::drawing::Point;

/// Width of a column, in points: finer than any line here is drawn.
const COLUMN: f64 = 0.25;

fn column(x: f64) -> f64 {
    (x / COLUMN).floor()
}

/// `points` without those that do not change the line. Points that are not in order of x are all kept.
pub(super) fn line(points: &[Point]) -> Vec<Point> {
    if !points.is_sorted_by(|a, b| a.0 <= b.0) {
        return points.to_vec();
    }
    let mut kept = Vec::new();
    for group in points.chunk_by(|a, b| column(a.0) == column(b.0)) {
        let by_y = |a: &usize, b: &usize| group[*a].1.total_cmp(&group[*b].1);
        let lowest = (0..group.len()).min_by(by_y).expect("chunks are never empty");
        let highest = (0..group.len()).max_by(by_y).expect("chunks are never empty");
        let mut indices = [0, lowest.min(highest), lowest.max(highest), group.len() - 1].to_vec();
        indices.dedup();
        kept.extend(indices.into_iter().map(|index| group[index]));
    }
    kept
}

/// The outline of a band of `((x, lower), upper)`: one lower and one upper end for each column. Empty for fewer than
/// two points.
pub(super) fn band(points: &[(Point, f64)]) -> Vec<Point> {
    if points.len() < 2 {
        return Vec::new();
    }
    let mut lower = Vec::new();
    let mut upper = Vec::new();
    for group in points.chunk_by(|a, b| column(a.0.0) == column(b.0.0)) {
        // Downwards on the page is towards greater y.
        let x = if lower.is_empty() { group[0].0.0 } else { group[group.len() - 1].0.0 };
        lower.push((x, group.iter().map(|point| point.0.1).fold(f64::NEG_INFINITY, f64::max)));
        upper.push((x, group.iter().map(|point| point.1).fold(f64::INFINITY, f64::min)));
    }
    upper.extend(lower.into_iter().rev());
    upper
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn extremes_survive() {
        let points: Vec<Point> =
            (0..100_000).map(|i| (f64::from(i) * 1e-3, if i == 54_321 { 90.0 } else { f64::from(i % 7) })).collect();
        let thinned = line(&points);
        assert!(thinned.len() <= 4 * 401, "{}", thinned.len());
        assert!(thinned.contains(&points[54_321]));
        assert_eq!((thinned[0], thinned[thinned.len() - 1]), (points[0], points[99_999]));
        assert!(thinned.is_sorted_by(|a, b| a.0 <= b.0));
    }

    #[test]
    fn sparse_points_are_all_kept() {
        let points = [(0.0, 1.0), (1.0, 2.0), (2.0, 0.0)];
        assert_eq!(line(&points), points);
    }

    #[test]
    fn a_band_goes_there_and_back() {
        let outline = band(&[((0.0, 5.0), 1.0), ((1.0, 6.0), 2.0)]);
        assert_eq!(outline, [(0.0, 1.0), (1.0, 2.0), (1.0, 6.0), (0.0, 5.0)]);
        assert!(band(&[((0.0, 5.0), 1.0)]).is_empty());
    }
}
