//! Measures of continual learning on the matrix of one run: what it earns on every task before the first stage and after
//! each. Tasks stand in the order of training, so that stage i trains on task i.
//!
//! A task may be the same as an earlier one ([`ReturnMatrix::of_tasks`]). Then the task of stage j is forgotten until it is
//! trained again, at most until the end: what the next stage on it teaches is no loss. Transfer to a task is measured up to
//! its first stage. At the end each task counts once. Where no task comes again, all measures are those of their sources.

use crate::aggregate::mean_of;

/// R, the returns of one run. Entries may be NaN where nothing was evaluated; so then are the measures that need them.
#[derive(Clone, Debug, PartialEq)]
pub struct ReturnMatrix {
    before: Vec<f64>,
    after: Vec<Vec<f64>>,
    /// Which task each stage trains on; equal numbers are the same one.
    tasks: Vec<usize>,
}

impl ReturnMatrix {
    /// From `before[task]`, b of the untrained model, and `after[stage][task]`, R.
    ///
    /// # Panics
    /// If `after` is not square, or `before` of another length.
    pub fn new(before: Vec<f64>, after: Vec<Vec<f64>>) -> Self {
        let tasks = before.len();
        assert!(after.len() == tasks && after.iter().all(|row| row.len() == tasks), "R is square");
        Self { before, after, tasks: (0..tasks).collect() }
    }

    /// The same of stages that train on these tasks, of which some may be the same.
    ///
    /// # Panics
    /// If there is not one task per stage.
    pub fn of_tasks(self, tasks: &[usize]) -> Self {
        assert!(tasks.len() == self.before.len(), "a task per stage");
        Self { tasks: tasks.to_vec(), ..self }
    }

    /// Whether stage j is the first on its task.
    fn is_first(&self, j: usize) -> bool {
        !self.tasks[..j].contains(&self.tasks[j])
    }

    /// What is earned on the task of stage j at the end of all, or before it is trained again.
    fn kept(&self, j: usize) -> f64 {
        self.after[self.next(j) - 1][j]
    }

    /// The next stage on the task of stage j, or T where it does not come again.
    fn next(&self, j: usize) -> usize {
        let again = self.tasks[j + 1..].iter().position(|task| *task == self.tasks[j]);
        again.map_or(self.tasks(), |after| j + 1 + after)
    }

    /// T, the number of tasks.
    pub fn tasks(&self) -> usize {
        self.before.len()
    }

    /// Average performance: (1/T) Σⱼ R\[T, j\] (Lopez-Paz & Ranzato 2017, "ACC"). `None` without tasks.
    pub fn average_performance(&self) -> Option<f64> {
        let end = self.after.last()?;
        Some(mean_of((0..self.tasks()).filter(|&j| self.is_first(j)).map(|j| end[j])))
    }

    /// Backward transfer: 1/(T − 1) Σ_{j<T} (R\[T, j\] − R\[j, j\]) (Lopez-Paz & Ranzato 2017, "BWT"). Negative where
    /// later stages destroy what earlier ones taught. `None` with fewer than two tasks.
    pub fn backward_transfer(&self) -> Option<f64> {
        let last = self.tasks().checked_sub(1)?;
        mean_or_none((0..last).map(|j| self.kept(j) - self.after[j][j]))
    }

    /// Forward transfer: 1/(T − 1) Σ_{j>1} (R\[j − 1, j\] − bⱼ) (Lopez-Paz & Ranzato 2017, "FWT"): what is earned on a
    /// task before training on it, beyond the untrained model. `None` with fewer than two tasks.
    pub fn forward_transfer(&self) -> Option<f64> {
        let first = (1..self.tasks()).filter(|&j| self.is_first(j));
        mean_or_none(first.map(|j| self.after[j - 1][j] - self.before[j]))
    }

    /// Forgetting of each task: R\[j, j\] − R\[T, j\], from the end of its own stage to the end of all (Wołczyk et al.
    /// 2021). The last task's is 0 by definition.
    pub fn forgetting(&self) -> Vec<f64> {
        (0..self.tasks()).map(|j| self.after[j][j] - self.kept(j)).collect()
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
        let lost = |i: usize, j: usize| (self.after[j - 1][i] - self.after[j][i]) / scale[i];
        self.square(|i, j| (j > i && j < self.next(i)).then(|| lost(i, j)))
    }

    /// Zero-shot forward transfer from stage j to task i: (R\[j, i\] − R\[j − 1, i\]) / `scale[i]` for every j < i, else
    /// `None`; as `[i][j]`. Before stage 0 stands the untrained model (Powers et al. 2022).
    pub fn zero_shot_transfer(&self, scale: &[f64]) -> Vec<Vec<Option<f64>>> {
        let earlier = |i: usize, j: usize| if j == 0 { self.before[i] } else { self.after[j - 1][i] };
        self.square(|i, j| (j < i && self.is_first(i)).then(|| (self.after[j][i] - earlier(i, j)) / scale[i]))
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
    fn a_task_that_comes_again_is_forgotten_until_then() {
        // A, B, A: the third column is the first one's task.
        let after = vec![vec![0.8, 0.3, 0.8], vec![0.5, 0.9, 0.5], vec![0.7, 0.6, 0.7]];
        let r = ReturnMatrix::new(vec![0.0, 0.1, 0.0], after).of_tasks(&[0, 1, 0]);
        assert!(near(r.average_performance(), (0.7 + 0.6) / 2.0));
        let forgetting = r.forgetting();
        assert!(near(Some(forgetting[0]), 0.8 - 0.5) && near(Some(forgetting[1]), 0.9 - 0.6) && forgetting[2] == 0.0);
        assert!(near(r.backward_transfer(), ((0.5 - 0.8) + (0.6 - 0.9)) / 2.0));
        assert!(near(r.forward_transfer(), 0.3 - 0.1));
        let isolated = r.isolated_forgetting(&[1.0; 3]);
        assert!(near(isolated[0][1], 0.8 - 0.5) && near(isolated[1][2], 0.9 - 0.6));
        assert_eq!(isolated.iter().flatten().flatten().count(), 2, "the third stage does not destroy its own task");
        let transfer = r.zero_shot_transfer(&[1.0; 3]);
        assert!(near(transfer[1][0], 0.3 - 0.1));
        assert_eq!(transfer.iter().flatten().flatten().count(), 1, "what is trained on already is no zero shot");
        // The same task twice at once: nothing lies between.
        let twice = ReturnMatrix::new(vec![0.0; 2], vec![vec![0.5; 2], vec![0.9; 2]]).of_tasks(&[4, 4]);
        assert_eq!(twice.forgetting(), [0.0, 0.0]);
        assert_eq!((twice.forward_transfer(), twice.average_performance()), (None, Some(0.9)));
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
