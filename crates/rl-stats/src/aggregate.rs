//! One number for many runs on many tasks: `scores[task][run]` → a number.

/// The mean over tasks of each task's mean over runs.
pub fn mean(scores: &[Vec<f64>]) -> f64 {
    mean_of(scores.iter().map(|task| mean_of(task.iter().copied())))
}

/// The median over tasks of each task's mean over runs, as rliable aggregates. With one task it is that task's mean:
/// for a median over runs see [`median_run`].
pub fn median(scores: &[Vec<f64>]) -> f64 {
    sorted_median(scores.iter().map(|task| mean_of(task.iter().copied())).collect())
}

/// The median of all scores, whatever their tasks.
pub fn median_run(scores: &[Vec<f64>]) -> f64 {
    sorted_median(scores.iter().flatten().copied().collect())
}

/// The interquartile mean: the mean of all scores, whatever their tasks, without the lowest and the highest quarter.
///
/// Of n scores ⌊n/4⌋ go at either end (the 25% trimmed mean of SciPy's `trim_mean`, and so of rliable): with up to
/// three scores it is their mean.
pub fn interquartile_mean(scores: &[Vec<f64>]) -> f64 {
    let mut all: Vec<f64> = scores.iter().flatten().copied().collect();
    if all.iter().any(|score| score.is_nan()) {
        return f64::NAN; // sorted to an end, it would be trimmed away
    }
    all.sort_unstable_by(f64::total_cmp);
    let cut = all.len() / 4;
    mean_of(all[cut..all.len() - cut].iter().copied())
}

/// What is missing to `target` on average, a score beyond it missing nothing: the mean of `target − min(score, target)`.
pub fn optimality_gap(scores: &[Vec<f64>], target: f64) -> f64 {
    // `f64::min` would take the target for a NaN.
    let missing = |&score: &f64| if score > target { 0.0 } else { target - score };
    mean_of(scores.iter().flatten().map(missing))
}

/// The mean; NaN of nothing.
pub(crate) fn mean_of(values: impl Iterator<Item = f64>) -> f64 {
    let (sum, count) = values.fold((0.0, 0_u32), |(sum, count), value| (sum + value, count + 1));
    sum / f64::from(count)
}

fn sorted_median(mut values: Vec<f64>) -> f64 {
    if values.is_empty() || values.iter().any(|value| value.is_nan()) {
        return f64::NAN;
    }
    values.sort_unstable_by(f64::total_cmp);
    (values[(values.len() - 1) / 2] + values[values.len() / 2]) / 2.0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn small_cases_are_as_computed_by_hand() {
        let scores = [vec![1.0, 3.0], vec![5.0, 7.0], vec![0.0, 20.0]];
        // Task means 2, 6, 10; of the six sorted scores 0 1 3 5 7 20 one goes at either end.
        assert_eq!(mean(&scores), 6.0);
        assert_eq!(median(&scores), 6.0);
        assert_eq!(median_run(&scores), 4.0);
        assert_eq!(interquartile_mean(&scores), 4.0);
        // Missing to 4: 3, 1, 0, 0, 4, 0.
        assert_eq!(optimality_gap(&scores, 4.0), 8.0 / 6.0);
        assert_eq!(interquartile_mean(&[vec![1.0, 2.0, 9.0]]), 4.0);
    }

    #[test]
    fn nan_is_never_hidden() {
        let scores = [vec![f64::NAN, 1.0, 2.0, 3.0, 4.0]];
        assert!(mean(&scores).is_nan() && median(&scores).is_nan() && median_run(&scores).is_nan());
        assert!(interquartile_mean(&scores).is_nan() && optimality_gap(&scores, 1.0).is_nan());
        assert!(mean(&[]).is_nan() && interquartile_mean(&[vec![]]).is_nan());
    }
}
