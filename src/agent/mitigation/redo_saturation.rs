//! ReDo for units that are saturated: a variant of this project for tanh, whose units die in another way than ReLU's.

use super::hooks::Mitigation;
use super::patient::Patient;
use crate::agent::engine::{LayerUnits, Units};
use crate::agent::shared::Shared;
use crate::config::{Choice, Settings, Visitor, fraction, integer};
use bit_mlp::Activation;

/// Every so many gradient steps, units that are saturated on nearly all samples of the minibatch are recycled as
/// [`ReDo`](super::redo::ReDo) does it: new incoming weights, outgoing weights of 0, moments of 0.
///
/// A unit is saturated on a sample where |h| is above the level.
#[derive(Clone, Debug, PartialEq)]
pub struct ReDoSaturation {
    /// |h| above which a unit is saturated.
    level: f64,
    /// Share of the samples, at least, on which it is.
    share: f64,
    /// Gradient steps from one check to the next.
    interval: u64,
}

impl Default for ReDoSaturation {
    fn default() -> Self {
        Self { level: 0.99, share: 0.95, interval: 1000 }
    }
}

impl Settings for ReDoSaturation {
    fn visit(&mut self, v: &mut dyn Visitor) {
        let Self { level, share, interval } = self;
        v.field("redo_saturation_level", "|h| above which a unit is saturated", &mut fraction(level));
        let doc = "share of a minibatch's samples, at least, on which a recycled unit was saturated";
        v.field("redo_saturation_share", doc, &mut fraction(share));
        let doc = "gradient steps between two checks";
        v.field("redo_saturation_interval", doc, &mut integer(interval, 1..=1_000_000_000));
    }
}

impl Mitigation for ReDoSaturation {
    fn name(&self) -> &'static str {
        "redo-saturation"
    }

    fn summary(&self) -> &'static str {
        "now and then units that are saturated begin anew: a variant of this project for tanh"
    }

    fn number(&self) -> u16 {
        9
    }

    fn check(&self, shared: &Shared) -> Result<(), (&'static str, String)> {
        if shared.activation == Activation::Tanh {
            return Ok(());
        }
        let is = shared.activation.name();
        Err(("mitigations", format!("redo-saturation is for activation=tanh, and not for {is}: use redo there")))
    }

    fn acts_between_steps(&self) -> bool {
        true
    }

    fn reads_units(&self) -> bool {
        true
    }

    fn acts_after(&self, step: u64) -> bool {
        step.is_multiple_of(self.interval)
    }

    fn after_step(&self, patient: &mut Patient<'_>, units: &Units) {
        patient.recycle(&units.chosen(|layer| self.saturated(layer)), self.number());
    }

    fn boxed(&self) -> Box<dyn Mitigation> {
        Box::new(self.clone())
    }
}

impl ReDoSaturation {
    /// The units of a layer that were saturated often enough.
    fn saturated(&self, layer: &LayerUnits) -> Vec<usize> {
        let mut counts = vec![0_usize; layer.units];
        let rows = layer.activations.chunks_exact(layer.units.max(1));
        let samples = rows.len();
        for row in rows {
            let is_saturated = row.iter().map(|&h| usize::from(f64::from(h.abs()) > self.level));
            counts.iter_mut().zip(is_saturated).for_each(|(count, is)| *count += is);
        }
        let needed = self.share * samples as f64;
        (0..layer.units).filter(|&unit| counts[unit] as f64 >= needed).collect()
    }
}
