//! When a stage is measured, and the hold that a measurement takes of the training loop.

use bit_mlp::{BitBatch, Prepared};

use super::visited::visited_batch;
use super::{Change, Measurement, Probe, reference_batch};
use crate::agent::config::Config;
use crate::agent::state::AgentState;
use crate::agent::{Learner, Stage};
use crate::measure::States;
use crate::random::{Purpose, Stream};

/// Measures the agents of one stage at its beginning, and now and then.
///
/// It remembers nothing from one update to the next: which ones are due depends on the stage's timesteps alone, and so
/// do its random streams.
#[derive(Debug)]
pub struct Monitor {
    probe: Probe,
    /// The reference batch of the stage's level.
    reference: BitBatch,
    config: Config,
    stage: Stage,
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
    monitor: &'a Monitor,
    /// Of each seed before it.
    before: Vec<Before>,
}

/// What an update changes of a seed.
struct Before {
    /// θ, `[P]`.
    parameters: Vec<f32>,
    /// Adam's step count.
    steps: u64,
}

impl Monitor {
    /// One for a stage of `config`, with this many timesteps between measurements; none for 0.
    pub fn new(interval: u64, config: &Config, stage: &Stage) -> Option<Self> {
        (interval > 0).then(|| Self {
            probe: Probe::new(config.network(&stage.level), config.algorithm.outputs()),
            reference: reference_batch(config.shared.sensor, &stage.level, config.shared.max_steps),
            config: config.clone(),
            stage: stage.clone(),
            schedule: Schedule { interval, timesteps: stage.timesteps },
        })
    }

    /// Measures a seed as it begins the stage, before its first update.
    pub fn at_beginning(&self, learner: &dyn Learner, seed: usize) -> Measurement {
        self.measure(learner.agents()[seed], None, learner.timesteps())
    }

    /// To be called before a learner advances; nothing unless that update is due.
    pub fn before(&self, learner: &dyn Learner) -> Option<Pending<'_>> {
        let due = self.schedule.is_due(learner.timesteps(), learner.next_timesteps());
        let before = |agent: &AgentState| Before { parameters: agent.parameters.clone(), steps: agent.adam.step };
        due.then(|| Pending { monitor: self, before: learner.agents().into_iter().map(before).collect() })
    }

    /// Measures an agent after so many timesteps of the stage, on both kinds of states.
    fn measure(&self, agent: &AgentState, change: Option<Change<'_>>, timesteps: u64) -> Measurement {
        let sample = |states, batch| self.probe.sample(&agent.parameters, change, states, batch);
        let visited = self.visited(agent, timesteps);
        Measurement::new(&sample(States::Reference, &self.reference), &sample(States::Visited, &visited))
    }

    /// The states that an agent visits after so many timesteps of the stage.
    fn visited(&self, agent: &AgentState, timesteps: u64) -> BitBatch {
        let Config { shared, algorithm, .. } = &self.config;
        let behaviour = algorithm.behaviour(Some((&self.stage, timesteps)));
        let mut acting = Prepared::new(self.probe.network.acting(), &agent.parameters, self.reference.constant());
        let act = |active: &[u16]| {
            let outputs = acting.forward_one(&agent.parameters, active);
            std::array::from_fn(|action| outputs[action])
        };
        let purpose = Purpose::VisitedStates { timesteps: timesteps as u32 };
        let mut stream = Stream::new(agent.seed, self.stage.index, purpose);
        visited_batch(shared.sensor, &self.stage.level, shared.max_steps, behaviour, act, &mut stream)
    }
}

impl Pending<'_> {
    /// Measures a seed after the update, whose `train/grad_norm` was `grad_norm`.
    pub fn after(&self, learner: &dyn Learner, seed: usize, grad_norm: f64) -> Measurement {
        let (agent, Before { parameters, steps }) = (learner.agents()[seed], &self.before[seed]);
        let steps = agent.adam.step.saturating_sub(*steps);
        self.monitor.measure(agent, Some(Change { before: parameters, steps, grad_norm }), learner.timesteps())
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
