//! When a stage is measured, and the hold that a measurement takes of the training loop.

use crate::agent::config::Config;
use crate::agent::{Learner, Stage};

use super::{Measurement, Probe, reference_batch};

/// Measures the agents of one stage now and then.
///
/// It remembers nothing from one update to the next: which ones are due depends on the stage's timesteps alone.
#[derive(Debug)]
pub struct Monitor {
    probe: Probe,
    schedule: Schedule,
}

/// The updates of a stage that are measured: the first, the last, and those that fill another interval of timesteps.
#[derive(Clone, Copy, Debug)]
struct Schedule {
    /// More than 0.
    interval: u64,
    /// Of the whole stage.
    timesteps: u64,
}

/// An update about to be measured.
pub struct Pending<'a> {
    probe: &'a Probe,
    /// θ of each seed before it, `[P]` each.
    before: Vec<Vec<f32>>,
}

impl Monitor {
    /// One for a stage of `config`, with this many timesteps between measurements; none for 0.
    pub fn new(interval: u64, config: &Config, stage: &Stage) -> Option<Self> {
        let probe = || {
            let states = reference_batch(config.shared.sensor, &stage.level, config.shared.max_steps);
            Probe::new(config.network(&stage.level), config.algorithm.outputs(), states)
        };
        let schedule = Schedule { interval, timesteps: stage.timesteps };
        (interval > 0).then(|| Self { probe: probe(), schedule })
    }

    /// To be called before a learner advances; nothing unless that update is due.
    pub fn before(&self, learner: &dyn Learner) -> Option<Pending<'_>> {
        let due = self.schedule.is_due(learner.timesteps(), learner.next_timesteps());
        let before = || learner.agents().into_iter().map(|agent| agent.parameters.clone()).collect();
        due.then(|| Pending { probe: &self.probe, before: before() })
    }
}

impl Pending<'_> {
    /// Measures a seed after the update, whose `train/grad_norm` was `grad_norm`.
    pub fn after(&self, learner: &dyn Learner, seed: usize, grad_norm: f64) -> Measurement {
        self.probe.measure(&self.before[seed], &learner.agents()[seed].parameters, grad_norm)
    }
}

impl Schedule {
    /// Whether the update that takes the stage from `before` timesteps to `after` is measured.
    fn is_due(self, before: u64, after: u64) -> bool {
        before == 0 || after >= self.timesteps || before / self.interval < after / self.interval
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn first_last_and_every_full_interval_are_measured() {
        let measured = |interval, rows: &[u64], timesteps| {
            let schedule = Schedule { interval, timesteps };
            let updates = [0].iter().chain(rows).zip(rows);
            let due = updates.filter(|(before, after)| schedule.is_due(**before, **after));
            due.map(|(_, after)| *after).collect::<Vec<u64>>()
        };
        let rows = [64, 128, 192, 256, 320];
        assert_eq!(measured(1, &rows, 300), rows);
        assert_eq!(measured(128, &rows, 300), [64, 128, 256, 320]);
        assert_eq!(measured(100, &rows, 320), [64, 128, 256, 320]);
        assert_eq!(measured(1000, &rows, 300), [64, 320]);
        // One update may fill several intervals, and be the first and the last at once.
        assert_eq!(measured(10, &[64], 50), [64]);
    }
}
