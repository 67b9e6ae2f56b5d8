//! Churn reduction, C-CHAIN (Tang et al. 2025, "Mitigating Plasticity Loss in Continual Reinforcement Learning by Reducing
//! Churn").

use bit_mlp::BitBatch;

use super::hooks::{Descent, Mitigation, Surroundings};
use super::patient::Patient;
use crate::agent::choice::log_softmax;
use crate::agent::engine::{Engine, Loss, Pass, Statement, Weights};
use crate::agent::network::Outputs;
use crate::agent::state::{AgentState, Kept};
use crate::config::{Settings, Visitor, fraction, integer, non_negative};
use crate::random::{Purpose, Stream};

/// The lists that an agent keeps: the mean loss and the mean churn of its last rows, the oldest first.
const LOSSES: &str = "churn/losses";
/// See [`LOSSES`].
const CHURNS: &str = "churn/churns";

/// How many actions there are: what a tower that acts gives for each sample.
const ACTIONS: usize = coverage_env::Action::COUNT;

/// The loss gets c·D, D being how far the last gradient step moved the policy on states that it was not made for.
///
/// The states are drawn from the rollout or the replay buffer. With π_old the network one step before, D is the mean of
/// −Σ π_old ln π for a policy, and the mean of (Q − Q_old)² over states and actions for values. After a few rows of the log
/// c = scale · mean|loss| / mean D over the last rows of the stage, and at least 1 for a policy; the loss is the policy's own, or
/// DQN's.
///
/// What differs from the authors' code: the states are half as many as a minibatch has, drawn with replacement; the first step
/// of each row of the log has no penalty; and DQN, too, renews c with each row.
#[derive(Clone, Debug, PartialEq)]
pub struct Churn {
    policy: Scaling,
    values: Scaling,
    /// Rows of the log before c is scaled.
    warm_up: usize,
    /// Rows of the log that scale it.
    window: usize,
    /// States, as a share of a minibatch.
    share: f64,
}

/// How large c is.
#[derive(Clone, Debug, PartialEq)]
struct Scaling {
    /// At first.
    coefficient: f64,
    /// The share of the loss that c·D is to have.
    scale: f64,
    least: f64,
}

impl Default for Churn {
    fn default() -> Self {
        Self {
            policy: Scaling { coefficient: 1.0, scale: 1e4, least: 1.0 },
            values: Scaling { coefficient: 50.0, scale: 0.01, least: 0.0 },
            warm_up: 10,
            window: 50,
            share: 0.5,
        }
    }
}

impl Settings for Churn {
    fn visit(&mut self, v: &mut dyn Visitor) {
        let Self { policy, values, warm_up, window, share } = self;
        let doc = "coefficient of a policy's churn before it is scaled";
        v.field("churn_policy_coef", doc, &mut non_negative(&mut policy.coefficient));
        v.field("churn_policy_scale", "its size against the policy's loss", &mut non_negative(&mut policy.scale));
        let doc = "coefficient of the churn of action values before it is scaled";
        v.field("churn_value_coef", doc, &mut non_negative(&mut values.coefficient));
        v.field("churn_value_scale", "its size against the loss", &mut non_negative(&mut values.scale));
        v.field(
            "churn_warm_up",
            "rows of the log before the coefficient is scaled",
            &mut integer(warm_up, 1..=1_000_000),
        );
        v.field("churn_window", "rows of the log that scale the coefficient", &mut integer(window, 1..=1_000_000));
        v.field("churn_share", "states, as a share of a minibatch", &mut fraction(share));
    }
}

impl Mitigation for Churn {
    fn name(&self) -> &'static str {
        "churn"
    }

    fn summary(&self) -> &'static str {
        "the loss holds the policy where a gradient step was not made to move it (Tang et al. 2025)"
    }

    fn number(&self) -> u16 {
        16
    }

    /// As the authors do for PPO, it measures anew in each stage.
    fn begin_stage(&self, patient: &mut Patient<'_>) {
        for name in [LOSSES, CHURNS] {
            patient.agent.kept.lists.remove(name);
        }
    }

    /// Its streams go by gradient steps.
    fn acts_between_steps(&self) -> bool {
        true
    }

    fn acts_after(&self, _: u64) -> bool {
        false
    }

    fn descent(&self, stage: u16, outputs: Outputs, agents: &[&AgentState]) -> Option<Box<dyn Descent>> {
        Some(Box::new(Churning::new(self, outputs, stage, agents)))
    }

    fn boxed(&self) -> Box<dyn Mitigation> {
        Box::new(self.clone())
    }
}

impl Churn {
    /// c, given what was measured.
    pub fn coefficient(&self, outputs: Outputs, records: &ChurnRecords) -> f64 {
        let Scaling { coefficient, scale, least } = match outputs {
            Outputs::Logits => &self.policy,
            Outputs::Values => &self.values,
        };
        let ChurnRecords { losses, churns } = records;
        if churns.len() < self.warm_up {
            return *coefficient;
        }
        let mean = |list: &[f32]| {
            let last = &list[list.len().saturating_sub(self.window)..];
            last.iter().map(|&v| f64::from(v.abs())).sum::<f64>() / last.len() as f64
        };
        (scale * mean(losses) / (mean(churns) + 1e-8)).max(*least)
    }

    /// Notes a row's mean loss and mean churn.
    pub fn note(&self, records: &mut ChurnRecords, loss: f64, churn: f64) {
        for (list, value) in [(&mut records.losses, loss), (&mut records.churns, churn)] {
            list.push(value as f32);
            list.drain(..list.len().saturating_sub(self.window.max(self.warm_up)));
        }
    }
}

/// The mean loss and the mean churn of the last rows of the log, the oldest first.
#[derive(Clone, Debug, Default)]
pub struct ChurnRecords {
    losses: Vec<f32>,
    churns: Vec<f32>,
}

impl ChurnRecords {
    /// Those that an agent keeps.
    fn of(kept: &Kept) -> Self {
        let list = |name| kept.lists.get(name).cloned().unwrap_or_default();
        Self { losses: list(LOSSES), churns: list(CHURNS) }
    }

    fn keep(&self, kept: &mut Kept) {
        for (name, list) in [(LOSSES, &self.losses), (CHURNS, &self.churns)] {
            kept.lists.insert(name.to_owned(), list.clone());
        }
    }
}

/// Churn reduction at work on S seeds.
#[derive(Debug)]
struct Churning {
    churn: Churn,
    outputs: Outputs,
    stage: u16,
    seeds: Vec<Seed>,
}

/// What a seed has of it within a row of the log.
#[derive(Debug)]
struct Seed {
    seed: u64,
    coefficient: f64,
    /// They are not read from the agent again: an engine's save writes those of the stage's beginning there.
    records: ChurnRecords,
    /// States for the next step, and what the network gives for them now, `[B, 4]`.
    next: Option<(BitBatch, Vec<f32>)>,
    loss: f64,
    distance: f64,
    steps: u32,
}

impl Churning {
    fn new(churn: &Churn, outputs: Outputs, stage: u16, agents: &[&AgentState]) -> Self {
        let seed = |agent: &&AgentState| {
            let records = ChurnRecords::of(&agent.kept);
            let coefficient = churn.coefficient(outputs, &records);
            Seed { seed: agent.seed, coefficient, records, next: None, loss: 0.0, distance: 0.0, steps: 0 }
        };
        Self { seeds: agents.iter().map(seed).collect(), churn: churn.clone(), outputs, stage }
    }

    /// States for the next step of each seed, half as many as its minibatch has by default.
    fn draw(&self, losses: &[&mut dyn Loss<'_>], surroundings: &Surroundings<'_>) -> Vec<BitBatch> {
        let of_seed = |(s, (loss, seed)): (usize, (&&mut dyn Loss<'_>, &Seed))| {
            let samples = loss.passes().first().map_or(0, |pass| pass.inputs.len());
            let count = (self.churn.share * samples as f64).ceil() as usize;
            let purpose = Purpose::Mitigation { number: self.churn.number(), step: surroundings.steps[s] as u32 };
            (surroundings.draw)(s, count, &mut Stream::new(seed.seed, self.stage, purpose))
        };
        losses.iter().zip(&self.seeds).enumerate().map(of_seed).collect()
    }

    /// One step down each loss and the churn on the states that were drawn for it.
    fn step<'a>(
        &mut self,
        engine: &mut dyn Engine,
        losses: &mut [&mut dyn Loss<'a>],
        held: &[(BitBatch, Vec<f32>)],
    ) -> Vec<f32> {
        let outputs = self.outputs;
        let each = losses.iter_mut().zip(held).zip(&self.seeds);
        let mut churned: Vec<WithChurn<'_, 'a>> = each
            .map(|((loss, (states, before)), seed)| {
                let coefficient = seed.coefficient as f32;
                WithChurn { inner: &mut **loss, states, before, outputs, coefficient, distance: 0.0 }
            })
            .collect();
        let norms = engine.descend(&mut churned.iter_mut().map(|l| l as _).collect::<Vec<&mut dyn Loss<'_>>>());
        for (seed, churned) in self.seeds.iter_mut().zip(churned) {
            seed.loss += f64::from(churned.inner.of_acting());
            seed.distance += f64::from(churned.distance);
            seed.steps += 1;
        }
        norms
    }
}

impl Descent for Churning {
    fn descend(&mut self, losses: &mut [&mut dyn Loss<'_>], surroundings: Surroundings<'_>) -> Vec<f32> {
        let states = self.draw(losses, &surroundings);
        let engine = surroundings.engine;
        let now = engine.forward(0, &states.iter().collect::<Vec<_>>());
        let held: Option<Vec<_>> = self.seeds.iter_mut().map(|seed| seed.next.take()).collect();
        let norms = match held {
            Some(held) => self.step(engine, losses, &held),
            None => engine.descend(losses),
        };
        for ((seed, states), now) in self.seeds.iter_mut().zip(states).zip(now) {
            seed.next = Some((states, now));
        }
        norms
    }

    fn save(&mut self, seed: usize, agent: &mut AgentState) {
        let Self { churn, outputs, seeds, .. } = self;
        let seed = &mut seeds[seed];
        seed.next = None;
        if seed.steps > 0 {
            let share = 1.0 / f64::from(seed.steps);
            churn.note(&mut seed.records, share * seed.loss, share * seed.distance);
        }
        (seed.loss, seed.distance, seed.steps) = (0.0, 0.0, 0);
        seed.coefficient = churn.coefficient(*outputs, &seed.records);
        seed.records.keep(&mut agent.kept);
    }
}

/// A loss and the churn of the acting tower.
pub struct WithChurn<'r, 'a> {
    /// The loss alone.
    pub inner: &'r mut dyn Loss<'a>,
    /// States that its step is not made for, B of them.
    pub states: &'r BitBatch,
    /// What the network gave for them one step before, `[B, 4]`.
    pub before: &'r [f32],
    /// What these are.
    pub outputs: Outputs,
    /// c.
    pub coefficient: f32,
    /// D, once it is derived.
    pub distance: f32,
}

impl<'r, 'a: 'r> Loss<'r> for WithChurn<'r, 'a> {
    fn passes(&self) -> Vec<Pass<'r>> {
        let own = Pass { weights: Weights::Own, tower: 0, inputs: self.states.all() };
        self.inner.passes().into_iter().chain([own]).collect()
    }

    fn derive(&mut self, outputs: &[&[f32]], gradients: &mut [Vec<f32>]) {
        let last = outputs.len() - 1;
        self.inner.derive(&outputs[..last], &mut gradients[..last]);
        let share = 1.0 / self.states.len() as f32;
        self.distance = 0.0;
        let samples = outputs[last].chunks_exact(ACTIONS).zip(self.before.chunks_exact(ACTIONS));
        for (now, before) in samples {
            let (distance, slope) = match self.outputs {
                Outputs::Logits => of_policies(now, before),
                Outputs::Values => of_values(now, before),
            };
            self.distance += share * distance;
            gradients[last].extend(slope.map(|d| self.coefficient * share * d));
        }
    }

    /// There is no second formula of it: an engine that looks for one takes the derivative above.
    fn statement(&self) -> Statement<'r> {
        Statement { name: "with churn", ..self.inner.statement() }
    }

    fn set_terms(&mut self, terms: &[f32]) {
        self.inner.set_terms(terms);
    }

    fn of_acting(&self) -> f32 {
        self.inner.of_acting()
    }
}

/// −Σ π_old ln(π + 10⁻⁸) and its slope with respect to the logits of π, where the 10⁻⁸ is left out.
fn of_policies(now: &[f32], before: &[f32]) -> (f32, [f32; ACTIONS]) {
    let [now, before] = [now, before].map(|logits| log_softmax(logits).map(f32::exp));
    let distance = -now.iter().zip(&before).map(|(p, old)| old * (p + 1e-8).ln()).sum::<f32>();
    (distance, std::array::from_fn(|a| now[a] - before[a]))
}

/// The mean of (Q − Q_old)² over the actions, and its slope with respect to Q.
fn of_values(now: &[f32], before: &[f32]) -> (f32, [f32; ACTIONS]) {
    let moved: [f32; ACTIONS] = std::array::from_fn(|a| now[a] - before[a]);
    let share = 1.0 / ACTIONS as f32;
    (share * moved.iter().map(|d| d * d).sum::<f32>(), moved.map(|d| 2.0 * share * d))
}
