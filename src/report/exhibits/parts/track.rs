//! What was measured of one arm during one stage, as a piece of a drawn curve.

use std::collections::BTreeMap;

use crate::report::analysis::{Band, Curve, PlasticitySeries, SeriesPoint};

/// A learning curve or a plasticity measure of one stage.
#[derive(Clone, Copy)]
pub struct Track<'a> {
    points: &'a [SeriesPoint],
    mean: &'a [Option<Band>],
    seeds: &'a BTreeMap<u64, Vec<Option<f64>>>,
}

impl<'a> From<&'a Curve> for Track<'a> {
    fn from(curve: &'a Curve) -> Self {
        Self { points: &curve.points, mean: &curve.mean, seeds: &curve.seeds }
    }
}

impl<'a> From<&'a PlasticitySeries> for Track<'a> {
    fn from(series: &'a PlasticitySeries) -> Self {
        Self { points: &series.points, mean: &series.mean, seeds: &series.seeds }
    }
}

/// Whether each seed is drawn, thin, beside the mean.
#[derive(Clone, Copy, PartialEq)]
pub enum Seeds {
    Shown,
    Hidden,
}

impl Track<'_> {
    /// Puts the stage at the end of `curve`: `x` maps timesteps of the stage, `y` what was measured. Points without a
    /// value are stepped over. The line breaks before the stage, or it would join two levels.
    pub fn append(self, curve: &mut charts::Curve, seeds: Seeds, x: impl Fn(f64) -> f64, y: impl Fn(f64) -> f64) {
        let places: Vec<f64> = self.points.iter().map(|point| x(point.timesteps)).collect();
        let Some(&first) = places.first() else { return };
        if !curve.centre.is_empty() {
            curve.centre.push((first, f64::NAN));
            curve.band.push((first, f64::NAN, f64::NAN));
        }
        for (&place, band) in places.iter().zip(self.mean) {
            let Some(band) = band else { continue };
            curve.centre.push((place, y(band.value)));
            match band.low.zip(band.high) {
                Some((low, high)) => curve.band.push((place, y(low), y(high))),
                // Where a single seed is left the band ends.
                None => curve.band.push((place, f64::NAN, f64::NAN)),
            }
        }
        if seeds == Seeds::Shown && self.seeds.len() > 1 {
            let line = |values: &Vec<Option<f64>>| {
                let known = places.iter().zip(values).filter_map(|(&place, value)| Some((place, y((*value)?))));
                known.collect::<Vec<_>>()
            };
            curve.seeds.extend(self.seeds.values().map(line).filter(|line| !line.is_empty()));
        }
    }
}
