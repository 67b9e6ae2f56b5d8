//! Measures of continual learning on the matrix of one run: what it earns on every task before the first stage and after
//! each. Tasks stand in the order of training, so that stage i trains on task i.

use crate::aggregate::mean_of;

/// R, the returns of one run. Entries may be NaN where nothing was evaluated; so then are the measures that need them.
#[derive(Clone, Debug, PartialEq)]
pub struct ReturnMatrix {
    before: Vec<f64>,
    after: Vec<Vec<f64>>,
}

impl ReturnMatrix {
    /// From `before[task]`, b of the untrained model, and `after[stage][task]`, R.
    ///
    /// # Panics
    /// If `after` is not square, or `before` of another length.
    pub fn new(before: Vec<f64>, after: Vec<Vec<f64>>) -> Self {
        let tasks = before.len();
        assert!(after.len() == tasks && after.iter().all(|row| row.len() == tasks), "R is square");
        Self { before, after }
    }

    /// T, the number of tasks.
    pub fn tasks(&self) -> usize {
        self.before.len()
    }

    /// Average performance: (1/T) Σⱼ R\[T, j\] (Lopez-Paz & Ranzato 2017, "ACC"). `None` without tasks.
    pub fn average_performance(&self) -> Option<f64> {
        Some(mean_of(self.after.last()?.iter().copied()))
    }

    /// Backward transfer: 1/(T − 1) Σ_{j<T} (R\[T, j\] − R\[j, j\]) (Lopez-Paz & Ranzato 2017, "BWT"). Negative where
    /// later stages destroy what earlier ones taught. `None` with fewer than two tasks.
    pub fn backward_transfer(&self) -> Option<f64> {
        let end = self.after.last()?;
        mean_or_none((0..self.tasks() - 1).map(|j| end[j] - self.after[j][j]))
    }

    /// Forward transfer: 1/(T − 1) Σ_{j>1} (R\[j − 1, j\] − bⱼ) (Lopez-Paz & Ranzato 2017, "FWT"): what is earned on a
    /// task before training on it, beyond the untrained model. `None` with fewer than two tasks.
    pub fn forward_transfer(&self) -> Option<f64> {
        mean_or_none((1..self.tasks()).map(|j| self.after[j - 1][j] - self.before[j]))
    }

    /// Forgetting of each task: R\[j, j\] − R\[T, j\], from the end of its own stage to the end of all (Wołczyk et al.
    /// 2021). The last task's is 0 by definition.
    pub fn forgetting(&self) -> Vec<f64> {
        let end = |j: usize| self.after[self.tasks() - 1][j];
        (0..self.tasks()).map(|j| self.after[j][j] - end(j)).collect()
    }

    /// The mean of [`forgetting`](Self::forgetting) over all T tasks, as Wołczyk et al. average it. `None` without tasks.
    pub fn mean_forgetting(&self) -> Option<f64> {
        mean_or_none(self.forgetting().into_iter())
    }

    /// Isolated forgetting of task i through stage j: (R\[j − 1, i\] − R\[j, i\]) / `scale[i]` for every j > i, else
    /// `None`; as `[i][j]` (Powers et al. 2022).
    ///
    /// Their scale is the largest return that the run ever has on the task; for returns that already are shares of an
    /// optimum, 1 is the natural one.
    pub fn isolated_forgetting(&self, scale: &[f64]) -> Vec<Vec<Option<f64>>> {
        let entry = |i: usize, j: usize| (j > i).then(|| (self.after[j - 1][i] - self.after[j][i]) / scale[i]);
        self.square(entry)
    }

    /// Zero-shot forward transfer from stage j to task i: (R\[j, i\] − R\[j − 1, i\]) / `scale[i]` for every j < i, else
    /// `None`; as `[i][j]`. Before stage 0 stands the untrained model (Powers et al. 2022).
    pub fn zero_shot_transfer(&self, scale: &[f64]) -> Vec<Vec<Option<f64>>> {
        let earlier = |i: usize, j: usize| if j == 0 { self.before[i] } else { self.after[j - 1][i] };
        self.square(|i, j| (j < i).then(|| (self.after[j][i] - earlier(i, j)) / scale[i]))
    }

    fn square(&self, entry: impl Fn(usize, usize) -> Option<f64>) -> Vec<Vec<Option<f64>>> {
        (0..self.tasks()).map(|i| (0..self.tasks()).map(|j| entry(i, j)).collect()).collect()
    }
}

/// The mean of the entries that there are; `None` if there are none.
pub fn mean_entry(entries: &[Vec<Option<f64>>]) -> Option<f64> {
    mean_or_none(entries.iter().flatten().flatten().copied())
}

fn mean_or_none(values: impl Iterator<Item = f64>) -> Option<f64> {
    let values: Vec<f64> = values.collect();
    (!values.is_empty()).then(|| mean_of(values.into_iter()))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn matrix() -> ReturnMatrix {
        let after = vec![vec![0.8, 0.3, 0.1], vec![0.5, 0.9, 0.2], vec![0.2, 0.6, 1.0]];
        ReturnMatrix::new(vec![0.0, 0.1, 0.2], after)
    }

    fn near(actual: Option<f64>, expected: f64) -> bool {
        actual.is_some_and(|actual| (actual - expected).abs() < 1e-15)
    }

    #[test]
    fn measures_are_as_computed_by_hand() {
        let r = matrix();
        assert!(near(r.average_performance(), (0.2 + 0.6 + 1.0) / 3.0));
        assert!(near(r.backward_transfer(), ((0.2 - 0.8) + (0.6 - 0.9)) / 2.0));
        assert!(near(r.forward_transfer(), ((0.3 - 0.1) + (0.2 - 0.2)) / 2.0));
        assert!(near(r.mean_forgetting(), (0.6 + 0.3 + 0.0) / 3.0));
        assert_eq!(r.forgetting()[2], 0.0);
    }

    #[test]
    fn isolated_measures_are_as_computed_by_hand() {
        let r = matrix();
        let forgetting = r.isolated_forgetting(&[0.8, 0.9, 1.0]);
        assert!(near(forgetting[0][1], (0.8 - 0.5) / 0.8) && near(forgetting[0][2], (0.5 - 0.2) / 0.8));
        assert!(near(forgetting[1][2], (0.9 - 0.6) / 0.9));
        assert_eq!(forgetting.iter().flatten().flatten().count(), 3);
        let transfer = r.zero_shot_transfer(&[1.0; 3]);
        assert!(near(transfer[1][0], 0.3 - 0.1) && near(transfer[2][0], 0.1 - 0.2) && near(transfer[2][1], 0.2 - 0.1));
        assert_eq!(transfer.iter().flatten().flatten().count(), 3);
        assert!(near(mean_entry(&transfer), (0.2 - 0.1 + 0.1) / 3.0));
    }

    #[test]
    fn one_task_transfers_nothing() {
        let r = ReturnMatrix::new(vec![0.0], vec![vec![0.7]]);
        assert_eq!((r.average_performance(), r.mean_forgetting()), (Some(0.7), Some(0.0)));
        assert_eq!((r.backward_transfer(), r.forward_transfer()), (None, None));
        assert_eq!(mean_entry(&r.isolated_forgetting(&[1.0])), None);
    }

    #[test]
    fn what_was_not_evaluated_is_not_measured() {
        let r = ReturnMatrix::new(vec![f64::NAN, 0.0], vec![vec![1.0, 0.0], vec![f64::NAN, 1.0]]);
        assert!(r.backward_transfer().is_some_and(f64::is_nan));
        assert!(near(r.forward_transfer(), 0.0));
    }
}
