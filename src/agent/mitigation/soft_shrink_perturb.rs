//! Soft shrink-and-perturb: a little of it all the time (Juliani & Ash 2024, "A Study of Plasticity Loss in On-Policy Deep
//! Reinforcement Learning"; Dohare et al. 2024, "Loss of Plasticity in Deep Continual Learning").

use super::hooks::Mitigation;
use super::patient::Patient;
use crate::agent::engine::Units;
use crate::agent::shared::Shared;
use crate::config::{Settings, Visitor, fraction, integer, non_negative};

/// θ ← α·θ + β·θ′ for each gradient step, θ′ being parameters drawn as those of a new agent.
///
/// To draw parameters takes longer than the step itself. So the N steps of an interval are made at once, at its end: the
/// parameters are multiplied by αᴺ, and one θ′ is added with the weight that the noise of N has, √(β² + (αβ)² + …). The scales
/// of norms are no noise, but 1 in every θ′: they get β + αβ + … . N·(1 − α) may be 0.01 at most.
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

    fn check(&self, _shared: &Shared) -> Result<(), (&'static str, String)> {
        let shrinks_by = self.interval as f64 * (1.0 - self.shrink);
        if self.interval == 1 || shrinks_by <= 0.010_001 {
            return Ok(());
        }
        let most = (0.010_001 / (1.0 - self.shrink)).floor().max(1.0);
        let problem = format!(
            "with soft_shrink_perturb_alpha={} at most {most} gradient steps can be made at once, and not {}",
            self.shrink, self.interval
        );
        Err(("soft_shrink_perturb_interval", problem))
    }

    fn after_step(&self, patient: &mut Patient<'_>, _: &Units) {
        let Interval { kept, noise, mean } = self.of_interval();
        let new = patient.network.init(&mut patient.stream(self.number()));
        let parameters = &mut patient.agent.parameters;
        for (parameter, new) in parameters.iter_mut().zip(new) {
            *parameter = kept * *parameter + noise * new;
        }
        for norm in patient.network.hidden_blocks().filter_map(|block| block.norm.as_ref()) {
            parameters[norm.scale.clone()].iter_mut().for_each(|scale| *scale += mean - noise);
        }
    }

    fn boxed(&self) -> Box<dyn Mitigation> {
        Box::new(self.clone())
    }
}

/// What N steps at once are.
struct Interval {
    /// αᴺ.
    kept: f32,
    /// The weight of θ′ where it is noise.
    noise: f32,
    /// Its weight where it is always the same.
    mean: f32,
}

impl SoftShrinkPerturb {
    fn of_interval(&self) -> Interval {
        let (alpha, beta, steps) = (self.shrink, self.perturb, self.interval as f64);
        let kept = alpha.powf(steps);
        let (sum, squares) = if alpha < 1.0 {
            ((1.0 - kept) / (1.0 - alpha), (1.0 - kept * kept) / (1.0 - alpha * alpha))
        } else {
            (steps, steps)
        };
        Interval { kept: kept as f32, noise: (beta * squares.sqrt()) as f32, mean: (beta * sum) as f32 }
    }
}
