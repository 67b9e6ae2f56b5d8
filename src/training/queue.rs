//! What is trained in which order.

use std::cmp::Reverse;
use std::collections::HashSet;
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};

use super::Experiment;
use super::saving::Stop;

/// Seeds of one experiment that one thread trains side by side.
#[derive(Clone, Copy, Debug)]
pub struct Work<'a> {
    /// The experiment, by its place among all.
    pub experiment: usize,
    /// Its seeds.
    pub seeds: &'a [u64],
}

/// The seeds of all experiments in the order in which `jobs` threads take them. The longest come first, so that all
/// threads end at about the same time.
pub fn queue(experiments: &[Experiment], jobs: usize) -> Vec<Work<'_>> {
    let mut queue = Vec::new();
    for (i, experiment) in experiments.iter().enumerate() {
        let cohorts = experiment.seeds.chunks(experiment.cohort_size(jobs));
        queue.extend(cohorts.map(|seeds| Work { experiment: i, seeds }));
    }
    queue.sort_by_key(|work: &Work<'_>| Reverse(experiments[work.experiment].curriculum.timesteps()));
    queue
}

/// What threads take their work from. A fork waits until its parents have ended.
pub(super) struct Queue<'a> {
    experiments: &'a [Experiment],
    state: Mutex<State<'a>>,
    /// Some work has ended.
    ended: Condvar,
}

struct State<'a> {
    /// In the order in which it is taken.
    waiting: Vec<Work<'a>>,
    /// Every experiment and seed that has not ended.
    left: HashSet<(usize, u64)>,
}

/// Work of one thread, which has ended when this is dropped.
pub(super) struct Taken<'q, 'a> {
    queue: &'q Queue<'a>,
    pub(super) work: Work<'a>,
}

impl<'a> Queue<'a> {
    pub(super) fn new(experiments: &'a [Experiment], waiting: Vec<Work<'a>>) -> Self {
        let left = waiting.iter().flat_map(Work::runs).collect();
        Self { experiments, state: Mutex::new(State { waiting, left }), ended: Condvar::new() }
    }

    /// The next work that can be done, as soon as there is some. None once everything is taken, or a stop is requested.
    pub(super) fn take(&self, stop: &Stop) -> Option<Taken<'_, 'a>> {
        let mut state = self.lock();
        loop {
            if stop.is_requested() || state.waiting.is_empty() {
                return None;
            }
            if let Some(next) = state.waiting.iter().position(|work| self.is_ready(work, &state.left)) {
                return Some(Taken { queue: self, work: state.waiting.remove(next) });
            }
            // Somebody is at work on its parents, and says so when they end.
            state = self.ended.wait(state).unwrap_or_else(PoisonError::into_inner);
        }
    }

    /// Whether no parent of it is still to come. One that failed has ended, too: then the fork says what it misses.
    fn is_ready(&self, work: &Work<'_>, left: &HashSet<(usize, u64)>) -> bool {
        let parents = self.experiments[work.experiment].parents.as_ref().and_then(|parents| parents.experiment);
        parents.is_none_or(|parents| !work.seeds.iter().any(|&seed| left.contains(&(parents, seed))))
    }

    fn lock(&self) -> MutexGuard<'_, State<'a>> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Drop for Taken<'_, '_> {
    fn drop(&mut self) {
        let mut state = self.queue.lock();
        self.work.runs().for_each(|run| _ = state.left.remove(&run));
        drop(state);
        self.queue.ended.notify_all();
    }
}

impl<'a> Work<'a> {
    /// Its runs: experiment and seed.
    fn runs(&self) -> impl Iterator<Item = (usize, u64)> + use<'a> {
        let Self { experiment, seeds } = *self;
        seeds.iter().map(move |&seed| (experiment, seed))
    }
}

/// When `jobs` threads that take work of these seconds, one after another, are done with all of it.
pub fn seconds_until_done(work: impl IntoIterator<Item = f64>, jobs: usize) -> f64 {
    let mut busy_until = vec![0.0_f64; jobs.max(1)];
    for seconds in work {
        if let Some(first_free) = busy_until.iter_mut().min_by(|a, b| a.total_cmp(b)) {
            *first_free += seconds;
        }
    }
    busy_until.into_iter().fold(0.0, f64::max)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::agent::engine::{Device, EngineKind};
    use crate::experiment::Curriculum;
    use coverage_env::Level;

    fn levels() -> Vec<Level> {
        ["0", "1"].into_iter().map(|id| Level::builtin(id).unwrap()).collect()
    }

    #[test]
    fn the_longest_comes_first_and_joined_seeds_stay_together() {
        let experiment = |curriculum, engine| Experiment::example(curriculum, &[3, 4, 5, 7, 9], engine);
        let joined = EngineKind::Libtorch(Device::Cpu);
        let experiments = [
            experiment(Curriculum::single(levels().remove(0), 1000), EngineKind::Fused),
            experiment(
                Curriculum::sequence("two", levels().into_iter().map(|level| (level.into(), 600)).collect()).unwrap(),
                joined,
            ),
            experiment(Curriculum::single(levels().remove(1), 1000), joined),
        ];
        let queue = queue(&experiments, 2);
        let taken: Vec<(usize, &[u64])> = queue.iter().map(|work| (work.experiment, work.seeds)).collect();
        let [one, other] = [&[3, 4, 5][..], &[7, 9]];
        let fused = [3, 4, 5, 7, 9].map(|seed| vec![seed]);
        let mut expected: Vec<(usize, &[u64])> = vec![(1, one), (1, other)];
        expected.extend(fused.iter().map(|seed| (0, &seed[..])));
        expected.extend([(2, one), (2, other)]);
        assert_eq!(taken, expected);
    }

    #[test]
    fn threads_take_what_is_next_as_soon_as_they_are_free() {
        assert_eq!(seconds_until_done([], 3), 0.0);
        assert_eq!(seconds_until_done([1.0, 2.0, 3.0], 1), 6.0);
        assert_eq!(seconds_until_done([5.0, 1.0, 1.0, 1.0], 2), 5.0);
        assert_eq!(seconds_until_done([4.0, 3.0, 3.0], 2), 6.0);
        // Two of ten threads have something to do.
        assert_eq!(seconds_until_done([2.0, 3.0], 10), 3.0);
    }
}
