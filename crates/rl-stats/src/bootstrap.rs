//! Stratified bootstrap: percentile intervals of any statistic of `scores[task][run]`.

use std::cell::RefCell;
use std::rc::Rc;

use chacha20::ChaCha8Rng;
use rand::{Rng, SeedableRng};
use serde::{Deserialize, Serialize};

/// How intervals are made.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Bootstrap {
    /// How often the runs are resampled.
    pub resamples: usize,
    /// The share of the resampled statistics that an interval holds, such as 0.95.
    pub confidence: f64,
    /// Seed of the draws. The same seed and numbers of runs are the same draws, on every machine.
    pub seed: u64,
}

/// The bounds of an interval.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Interval {
    /// The lower bound.
    pub low: f64,
    /// The upper bound.
    pub high: f64,
}

/// A statistic and how far other runs might move it.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Estimate {
    /// The statistic of the runs as they are.
    pub value: f64,
    /// Its interval; none of one run, and where the function that made it says so, as where the value is no number.
    pub interval: Option<Interval>,
    /// The least number of runs that a task has.
    pub runs: usize,
}

/// Which runs each resample takes: `indices[resample][task][run]`.
#[derive(Clone, Debug, PartialEq)]
pub struct Resamples {
    /// Runs per task.
    sizes: Vec<usize>,
    /// Resample after resample, task after task.
    indices: Vec<u32>,
}

/// Indices that do not fit the runs they are to resample.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ShapeError;

impl std::fmt::Display for ShapeError {
    fn fmt(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
        write!(f, "resampling indices must name one run of its own task for every run of every task")
    }
}

impl std::error::Error for ShapeError {}

impl Default for Bootstrap {
    /// 95% intervals of 2,000 resamples.
    fn default() -> Self {
        Self { resamples: 2000, confidence: 0.95, seed: 0 }
    }
}

impl Bootstrap {
    /// The statistic with its interval.
    pub fn estimate(&self, scores: &[Vec<f64>], statistic: impl Fn(&[Vec<f64>]) -> f64) -> Estimate {
        let runs = scores.iter().map(Vec::len).min().unwrap_or(0);
        let value = statistic(scores);
        let interval = (runs > 1 && value.is_finite()).then(|| {
            let mut distribution = match scores {
                [one] => Resamples::of_task(one.len(), self.resamples, self.seed).distribution(scores, statistic),
                _ => self.resamples(scores).distribution(scores, statistic),
            };
            percentile_interval(&mut distribution, self.confidence)
        });
        Estimate { value, interval, runs }
    }

    /// The statistic with its interval, seeds being resampled whole: `scores[task][seed]`, and a seed that is drawn
    /// brings its scores on all tasks.
    ///
    /// # Panics
    /// If the tasks have not the same number of seeds.
    pub fn estimate_whole(&self, scores: &[Vec<f64>], statistic: impl Fn(&[Vec<f64>]) -> f64) -> Estimate {
        let runs = scores.first().map_or(0, Vec::len);
        assert!(scores.iter().all(|task| task.len() == runs), "every seed has a score on every task");
        let value = statistic(scores);
        let interval = (runs > 1 && value.is_finite()).then(|| {
            let mut resampled = scores.to_vec();
            let draws = Resamples::of_task(runs, self.resamples, self.seed);
            let of_draw = |drawn: &[u32]| {
                for (into, from) in resampled.iter_mut().zip(scores) {
                    into.iter_mut().zip(drawn).for_each(|(score, &seed)| *score = from[seed as usize]);
                }
                statistic(&resampled)
            };
            let mut distribution: Vec<f64> = draws.indices.chunks(runs).map(of_draw).collect();
            percentile_interval(&mut distribution, self.confidence)
        });
        Estimate { value, interval, runs }
    }

    /// The draws for scores of this shape.
    pub fn resamples(&self, scores: &[Vec<f64>]) -> Resamples {
        let sizes: Vec<usize> = scores.iter().map(Vec::len).collect();
        Resamples::draw(&sizes, self.resamples, self.seed)
    }
}

impl Resamples {
    /// Draws runs with replacement, each task by itself.
    pub fn draw(sizes: &[usize], resamples: usize, seed: u64) -> Self {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        // The upper half of a 64 × 64 bit product; for n runs its bias is below n / 2⁶⁴.
        let mut below = |n: usize| ((u128::from(rng.next_u64()) * n as u128) >> 64) as u32;
        let mut indices = Vec::with_capacity(resamples * sizes.iter().sum::<usize>());
        for _ in 0..resamples {
            indices.extend(sizes.iter().flat_map(|&size| std::iter::repeat_n(size, size)).map(&mut below));
        }
        Self { sizes: sizes.to_vec(), indices }
    }

    /// The draws for one task, which is what most statistics need: the last ones of a thread are kept, since a report
    /// asks for the same again and again.
    pub(crate) fn of_task(size: usize, resamples: usize, seed: u64) -> Rc<Self> {
        const KEPT: usize = 4;
        type Drawn = ((usize, usize, u64), Rc<Resamples>);
        thread_local!(static DRAWN: RefCell<Vec<Drawn>> = const { RefCell::new(Vec::new()) });
        DRAWN.with_borrow_mut(|kept| {
            let key = (size, resamples, seed);
            let known = kept.iter().find(|(own, _)| *own == key).map(|(_, draws)| Rc::clone(draws));
            known.unwrap_or_else(|| {
                let draws = Rc::new(Self::draw(&[size], resamples, seed));
                kept.truncate(KEPT - 1);
                kept.insert(0, (key, Rc::clone(&draws)));
                draws
            })
        })
    }

    /// Takes indices made elsewhere, `[resample][task][run]`.
    ///
    /// # Errors
    /// Indices that do not fit `sizes`, the numbers of runs of the tasks.
    pub fn given(sizes: &[usize], indices: &[Vec<Vec<usize>>]) -> Result<Self, ShapeError> {
        let mut flat = Vec::new();
        for resample in indices {
            let fits = |(task, &size): (&Vec<usize>, &usize)| task.len() == size && task.iter().all(|&run| run < size);
            if resample.len() != sizes.len() || !resample.iter().zip(sizes).all(fits) {
                return Err(ShapeError);
            }
            for &run in resample.iter().flatten() {
                flat.push(u32::try_from(run).map_err(|_| ShapeError)?);
            }
        }
        Ok(Self { sizes: sizes.to_vec(), indices: flat })
    }

    /// A statistic of every resample of one task's values, in order.
    ///
    /// # Panics
    /// If the draws are not for one task of so many runs.
    pub(crate) fn of_one(&self, values: &[f64], statistic: impl Fn(&[f64]) -> f64) -> Vec<f64> {
        assert_eq!(self.sizes, [values.len()], "indices of another shape");
        let mut resampled = values.to_vec();
        let of_resample = |indices: &[u32]| {
            resampled.iter_mut().zip(indices).for_each(|(value, &run)| *value = values[run as usize]);
            statistic(&resampled)
        };
        self.indices.chunks(values.len().max(1)).map(of_resample).collect()
    }

    /// The mean of every resample of one task's values.
    pub(crate) fn means(&self, values: &[f64]) -> Vec<f64> {
        self.of_one(values, |resample| crate::aggregate::mean_of(resample.iter().copied()))
    }

    /// The statistic of every resample, in order.
    ///
    /// # Panics
    /// If the scores have not the numbers of runs that the indices were made for.
    pub fn distribution(&self, scores: &[Vec<f64>], statistic: impl Fn(&[Vec<f64>]) -> f64) -> Vec<f64> {
        assert!(scores.iter().map(Vec::len).eq(self.sizes.iter().copied()), "indices of another shape");
        let runs: usize = self.sizes.iter().sum();
        let mut resampled = scores.to_vec();
        let of_resample = |indices: &[u32]| {
            let mut indices = indices.iter();
            for (into, from) in resampled.iter_mut().zip(scores) {
                into.iter_mut().zip(&mut indices).for_each(|(score, &run)| *score = from[run as usize]);
            }
            statistic(&resampled)
        };
        self.indices.chunks(runs.max(1)).map(of_resample).collect()
    }
}

/// The percentile interval of a bootstrap distribution, which is put into another order on the way.
pub fn percentile_interval(distribution: &mut [f64], confidence: f64) -> Interval {
    let tail = (1.0 - confidence) / 2.0;
    let [low, high] = quantiles(distribution, [tail, 1.0 - tail]);
    Interval { low, high }
}

/// [`quantile`] at each of these shares of values in any order, which are put into another one on the way. It takes a
/// fraction of a sort's time.
pub(crate) fn quantiles<const N: usize>(values: &mut [f64], shares: [f64; N]) -> [f64; N] {
    shares.map(|share| {
        let Some(last) = values.len().checked_sub(1) else { return f64::NAN };
        let place = share * last as f64;
        let (_, below, rest) = values.select_nth_unstable_by(place.floor() as usize, f64::total_cmp);
        let next = || rest.iter().copied().min_by(f64::total_cmp);
        let above = if place.fract() > 0.0 { next().unwrap_or(*below) } else { *below };
        between(*below, above, place.fract())
    })
}

/// The quantile at `share` of ascending values, interpolated linearly between neighbours (Hyndman & Fan's type 7,
/// NumPy's default); NaN of none.
pub fn quantile(sorted: &[f64], share: f64) -> f64 {
    let Some(last) = sorted.len().checked_sub(1) else { return f64::NAN };
    let place = share * last as f64;
    between(sorted[place.floor() as usize], sorted[place.ceil() as usize], place.fract())
}

/// The value at this part of the way between two neighbours.
fn between(below: f64, above: f64, part: f64) -> f64 {
    // Of two infinities there is no difference to interpolate.
    if part == 0.0 || below == above { below } else { below + part * (above - below) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::aggregate::mean;

    #[test]
    fn quantiles_are_interpolated() {
        let values = [1.0, 2.0, 4.0, 8.0];
        assert_eq!([0.0, 0.5, 1.0].map(|share| quantile(&values, share)), [1.0, 3.0, 8.0]);
        assert_eq!(quantile(&values, 0.25), 1.75);
        assert_eq!(quantile(&[1.0, f64::INFINITY, f64::INFINITY], 0.75), f64::INFINITY);
        assert!(quantile(&[], 0.5).is_nan());
        let shares = [0.0, 0.025, 0.25, 0.5, 0.975, 1.0];
        let mut shuffled = [8.0, 1.0, 4.0, 2.0];
        assert_eq!(quantiles(&mut shuffled, shares), shares.map(|share| quantile(&values, share)));
        assert!(quantiles(&mut [], [0.5])[0].is_nan());
    }

    #[test]
    fn a_task_is_resampled_from_its_own_runs() {
        let scores = [vec![1.0, 2.0, 3.0], vec![10.0, 20.0]];
        let resamples = Resamples::draw(&[3, 2], 500, 7);
        let sums = resamples.distribution(&scores, |s| {
            assert!(s[0].iter().all(|score| *score < 4.0) && s[1].iter().all(|score| *score > 4.0));
            mean(s)
        });
        assert_eq!(sums.len(), 500);
        assert_eq!(resamples, Resamples::draw(&[3, 2], 500, 7));
        assert_ne!(resamples, Resamples::draw(&[3, 2], 500, 8));
    }

    #[test]
    fn seeds_that_are_resampled_whole_keep_their_scores_together() {
        // Each seed earns 1 on one of the two tasks, so that its mean is always the same.
        let scores = [vec![1.0, 0.0, 1.0, 0.0], vec![0.0, 1.0, 0.0, 1.0]];
        let bootstrap = Bootstrap::default();
        let whole = bootstrap.estimate_whole(&scores, mean);
        assert_eq!((whole.value, whole.interval, whole.runs), (0.5, Some(Interval { low: 0.5, high: 0.5 }), 4));
        assert!(bootstrap.estimate(&scores, mean).interval.is_some_and(|interval| interval.low < 0.3));
        assert_eq!(bootstrap.estimate_whole(&[vec![1.0], vec![0.0]], mean).interval, None);
    }

    #[test]
    fn an_interval_needs_two_runs() {
        let bootstrap = Bootstrap::default();
        let one = bootstrap.estimate(&[vec![1.0, 2.0], vec![3.0]], mean);
        assert_eq!((one.value, one.interval, one.runs), (2.25, None, 1));
        assert_eq!(bootstrap.estimate(&[vec![f64::NAN, 1.0]], mean).interval, None);
        let two = bootstrap.estimate(&[vec![0.0, 1.0]], mean);
        // A quarter of the resamples is (0, 0), a quarter (1, 1).
        assert_eq!(two.interval, Some(Interval { low: 0.0, high: 1.0 }));
    }

    /// The mean of n normal scores has the standard error σ/√n; the percentile interval comes near 1.96 of them.
    #[test]
    fn the_interval_of_a_mean_has_the_expected_width() {
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        let mut uniform = || rng.next_u64() as f64 / u64::MAX as f64;
        let scores: Vec<f64> = (0..400).map(|_| (0..12).map(|_| uniform()).sum::<f64>() - 6.0).collect();
        let Estimate { interval, .. } = Bootstrap { resamples: 4000, ..Default::default() }.estimate(&[scores], mean);
        let width = interval.map_or(f64::NAN, |interval| interval.high - interval.low);
        assert!((width / (2.0 * 1.96 / 20.0) - 1.0).abs() < 0.15, "{width}");
    }

    #[test]
    fn given_indices_are_checked() {
        let fine = vec![vec![vec![0, 0], vec![2, 1, 0]]];
        assert!(Resamples::given(&[2, 3], &fine).is_ok());
        assert_eq!(Resamples::given(&[2, 2], &fine), Err(ShapeError));
        assert_eq!(Resamples::given(&[2, 3], &[vec![vec![0, 2], vec![0, 0, 0]]]), Err(ShapeError));
    }
}
