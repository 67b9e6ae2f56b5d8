//! Soft shrink-and-perturb: a little of it all the time (Juliani & Ash 2024, "A Study of Plasticity Loss in On-Policy Deep
//! Reinforcement Learning"; Dohare et al. 2024, "Loss of Plasticity in Deep Continual Learning").

use super::hooks::Mitigation;
use super::patient::Patient;
use crate::agent::engine::Units;
use crate::config::{Settings, Visitor, fraction, integer, non_negative};

/// θ ← α·θ + β·θ′ for each gradient step, θ′ being parameters drawn as those of a new agent.
///
/// To draw parameters takes longer than the step itself. So the N steps of an interval are made at once, at its end: the
/// parameters are multiplied by αᴺ, and one θ′ is added with the weight that the sum of N has, √(β² + (αβ)² + …).
#[derive(Clone, Debug, PartialEq)]
pub struct SoftShrinkPerturb {
    /// α.
    shrink: f64,
    /// β.
    perturb: f64,
    /// N.
    interval: u64,
}

impl Default for SoftShrinkPerturb {
    fn default() -> Self {
        Self { shrink: 1.0 - 1e-6, perturb: 1e-6, interval: 1000 }
    }
}

impl Settings for SoftShrinkPerturb {
    fn visit(&mut self, v: &mut dyn Visitor) {
        let Self { shrink, perturb, interval } = self;
        v.field("soft_shrink_perturb_alpha", "what each gradient step leaves of the parameters", &mut fraction(shrink));
        let doc = "share of new parameters added for each gradient step";
        v.field("soft_shrink_perturb_beta", doc, &mut non_negative(perturb));
        let doc = "gradient steps whose shrinking and noise are made at once";
        v.field("soft_shrink_perturb_interval", doc, &mut integer(interval, 1..=1_000_000_000));
    }
}

impl Mitigation for SoftShrinkPerturb {
    fn name(&self) -> &'static str {
        "soft-shrink-perturb"
    }

    fn summary(&self) -> &'static str {
        "in each step parameters shrink and new ones are added, a little (Juliani & Ash 2024)"
    }

    fn number(&self) -> u16 {
        8
    }

    fn acts_between_steps(&self) -> bool {
        true
    }

    fn acts_after(&self, step: u64) -> bool {
        step.is_multiple_of(self.interval)
    }

    fn after_step(&self, patient: &mut Patient<'_>, _: &Units) {
        let (shrink, perturb) = self.of_interval();
        let new = patient.network.init(&mut patient.stream(self.number()));
        for (parameter, new) in patient.agent.parameters.iter_mut().zip(new) {
            *parameter = shrink * *parameter + perturb * new;
        }
    }

    fn boxed(&self) -> Box<dyn Mitigation> {
        Box::new(self.clone())
    }
}

impl SoftShrinkPerturb {
    /// What an interval leaves of the parameters, and the weight of its θ′.
    fn of_interval(&self) -> (f32, f32) {
        let steps = self.interval as f64;
        let kept = self.shrink.powf(steps);
        // Σ α²ⁱ for i < N; where α is 1, N.
        let squares = if self.shrink < 1.0 { (1.0 - kept * kept) / (1.0 - self.shrink * self.shrink) } else { steps };
        (kept as f32, (self.perturb * squares.sqrt()) as f32)
    }
}
