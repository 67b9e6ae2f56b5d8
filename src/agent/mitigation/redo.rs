//! ReDo: dormant units are recycled (Sokar et al. 2023, "The Dormant Neuron Phenomenon in Deep Reinforcement Learning").

use super::hooks::Mitigation;
use super::patient::Patient;
use crate::agent::engine::{LayerUnits, Units};
use crate::config::{Settings, Visitor, integer, non_negative};

/// Every so many gradient steps, units whose score is at most τ get new incoming weights, and outgoing weights of 0.
///
/// A unit's score is its mean |h| over the minibatch, divided by the mean of that over its layer (equation 1). As in the
/// authors' code the bias becomes 0, the moments of all these weights become 0, and outgoing weights are written last.
/// Two things differ: the moments of the bias become 0 too, which that code leaves as they are, and scores are of the
/// minibatch just trained on.
#[derive(Clone, Debug, PartialEq)]
pub struct ReDo {
    /// τ.
    threshold: f64,
    /// Gradient steps from one check to the next.
    interval: u64,
}

impl Default for ReDo {
    fn default() -> Self {
        Self { threshold: 0.1, interval: 1000 }
    }
}

impl Settings for ReDo {
    fn visit(&mut self, v: &mut dyn Visitor) {
        let (threshold, interval) = (&mut self.threshold, &mut self.interval);
        v.field("redo_threshold", "score at or below which a unit is dormant", &mut non_negative(threshold));
        v.field("redo_interval", "gradient steps between two checks", &mut integer(interval, 1..=1_000_000_000));
    }
}

impl Mitigation for ReDo {
    fn name(&self) -> &'static str {
        "redo"
    }

    fn summary(&self) -> &'static str {
        "now and then dormant units begin anew (Sokar et al. 2023)"
    }

    fn number(&self) -> u16 {
        3
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
        patient.recycle(&units.chosen(|layer| self.dormant(layer)), self.number());
    }

    fn boxed(&self) -> Box<dyn Mitigation> {
        Box::new(self.clone())
    }
}

impl ReDo {
    /// The units of a layer whose score is at most τ.
    fn dormant(&self, layer: &LayerUnits) -> Vec<usize> {
        let magnitudes = layer.mean_magnitudes();
        let mean = magnitudes.iter().sum::<f64>() / magnitudes.len() as f64;
        let is_dormant = |magnitude: f64| magnitude / (mean + 1e-9) <= self.threshold;
        (0..magnitudes.len()).filter(|&unit| is_dormant(magnitudes[unit])).collect()
    }
}
