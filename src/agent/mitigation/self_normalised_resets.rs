//! Self-normalised resets (Farias & Jozefiak 2025, "Self-Normalized Resets for Plasticity in Continual Learning").

use bit_mlp::Activation;

use super::hooks::Mitigation;
use super::patient::{Patient, Place};
use crate::agent::engine::Units;
use crate::agent::shared::Shared;
use crate::config::{Choice, Settings, Visitor, fraction, integer};

/// The lists that an agent keeps: gradient steps since a unit fired, `[U]`; the silence after which it is reset, `[U]`; and
/// how often it was silent for 1, 2, … steps, `[U, longest]`.
const AGE: &str = "self-normalised-resets/age";
/// See [`AGE`].
const THRESHOLD: &str = "self-normalised-resets/threshold";
/// See [`AGE`].
const GAPS: &str = "self-normalised-resets/gaps";

/// A hidden unit that is silent for longer than it usually is gets new incoming weights, and outgoing weights of 0.
///
/// A unit fires in a gradient step if h > 0 on any sample of the minibatch. After the step the units are reset whose silence
/// has reached their own threshold τ: bias and moments become 0, too. Every so many steps τ becomes the
/// percentile of the unit's silences since the last time, or twice its value if that is not lower; it is at least 1.
/// These are the rules of the authors' code, which counts silence in samples and moves τ every 16 tasks; here both go by
/// gradient steps.
#[derive(Clone, Debug, PartialEq)]
pub struct SelfNormalisedResets {
    /// Of the silences.
    percentile: f64,
    /// τ at first, in gradient steps.
    threshold: u64,
    /// Gradient steps from one change of τ to the next.
    interval: u64,
    /// The longest silence that is counted, and the largest τ.
    longest: u64,
}

impl Default for SelfNormalisedResets {
    fn default() -> Self {
        Self { percentile: 0.99, threshold: 100, interval: 1000, longest: 100 }
    }
}

impl Settings for SelfNormalisedResets {
    fn visit(&mut self, v: &mut dyn Visitor) {
        let Self { percentile, threshold, interval, longest } = self;
        let doc = "percentile of a unit's own silences beyond which it is reset";
        v.field("self_normalised_resets_percentile", doc, &mut fraction(percentile));
        let doc = "silence, in gradient steps, after which a unit is reset at first";
        v.field("self_normalised_resets_threshold", doc, &mut integer(threshold, 1..=1000));
        let doc = "gradient steps between two changes of the thresholds";
        v.field("self_normalised_resets_interval", doc, &mut integer(interval, 1..=1_000_000_000));
        let doc = "longest silence that is counted, and largest threshold, in gradient steps";
        v.field("self_normalised_resets_longest", doc, &mut integer(longest, 1..=1000));
    }
}

impl Mitigation for SelfNormalisedResets {
    fn name(&self) -> &'static str {
        "self-normalised-resets"
    }

    fn summary(&self) -> &'static str {
        "units that are silent for longer than usual begin anew (Farias & Jozefiak 2025)"
    }

    fn number(&self) -> u16 {
        11
    }

    fn check(&self, shared: &Shared) -> Result<(), (&'static str, String)> {
        if shared.activation == Activation::Relu {
            if self.threshold <= self.longest {
                return Ok(());
            }
            let problem = format!("it is {}, above self_normalised_resets_longest={}", self.threshold, self.longest);
            return Err(("self_normalised_resets_threshold", problem));
        }
        let is = shared.activation.name();
        Err((
            "mitigations",
            format!("self-normalised-resets is for activation=relu, whose units can be silent; not {is}"),
        ))
    }

    fn acts_between_steps(&self) -> bool {
        true
    }

    fn reads_units(&self) -> bool {
        true
    }

    fn after_step(&self, patient: &mut Patient<'_>, units: &Units) {
        let fired = fired(units);
        let longest = self.longest as usize;
        let kept = &mut patient.agent.kept;
        let mut age = kept.take_list(AGE, fired.len(), 0.0);
        let mut threshold = kept.take_list(THRESHOLD, fired.len(), self.threshold as f32);
        let mut gaps = kept.take_list(GAPS, fired.len() * longest, 0.0);

        let mut reset = Vec::new();
        for (unit, (place, has_fired)) in fired.into_iter().enumerate() {
            let (age, gaps) = (&mut age[unit], &mut gaps[unit * longest..][..longest]);
            if !has_fired {
                *age += 1.0;
            }
            let is_reset = !has_fired && *age >= threshold[unit];
            if has_fired || is_reset {
                // Silence of no step is no silence.
                if let Some(gap) = (*age as usize).checked_sub(1).and_then(|gap| gaps.get_mut(gap)) {
                    *gap += 1.0;
                }
                *age = 0.0;
            }
            if is_reset {
                reset.push(place);
            }
        }
        if patient.step.is_multiple_of(self.interval) {
            for (threshold, gaps) in threshold.iter_mut().zip(gaps.chunks_exact_mut(longest)) {
                let usual = self.quantile(gaps);
                let moved = if usual < *threshold { usual } else { 2.0 * *threshold };
                *threshold = moved.clamp(1.0, longest as f32);
                gaps.fill(0.0);
            }
        }
        for (name, list) in [(AGE, age), (THRESHOLD, threshold), (GAPS, gaps)] {
            patient.agent.kept.lists.insert(name.to_owned(), list);
        }
        let mut stream = patient.stream(self.number());
        for place in reset {
            patient.renew_incoming(place, &mut stream);
            patient.silence_outgoing(place);
        }
    }

    fn boxed(&self) -> Box<dyn Mitigation> {
        Box::new(self.clone())
    }
}

impl SelfNormalisedResets {
    /// The silence that the percentile of these gaps does not exceed; 0 where there are none.
    fn quantile(&self, gaps: &[f32]) -> f32 {
        let all = gaps.iter().map(|&count| f64::from(count)).sum::<f64>();
        let mut below = 0.0;
        let reaches = |&count: &f32| {
            below += f64::from(count);
            below > 0.0 && below >= self.percentile * all
        };
        gaps.iter().position(reaches).map_or(0.0, |gap| gap as f32 + 1.0)
    }
}

/// Every hidden unit, and whether it fired on any sample.
fn fired(units: &Units) -> Vec<(Place, bool)> {
    let mut all = Vec::new();
    for (tower, layers) in units.towers.iter().enumerate() {
        for (layer, units) in layers.iter().enumerate() {
            let mut fired = vec![false; units.units];
            for row in units.activations.chunks_exact(units.units.max(1)) {
                fired.iter_mut().zip(row).for_each(|(fired, &h)| *fired |= h > 0.0);
            }
            all.extend(fired.into_iter().enumerate().map(|(unit, fired)| (Place { tower, layer, unit }, fired)));
        }
    }
    all
}
