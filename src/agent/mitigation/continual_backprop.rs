//! Continual backprop (Dohare et al. 2024, "Loss of Plasticity in Deep Continual Learning", Algorithm 1).

use std::ops::Range;

use super::hooks::Mitigation;
use super::patient::{Patient, Place};
use crate::agent::engine::{LayerUnits, Units};
use crate::agent::state::Kept;
use crate::config::{Settings, Visitor, below_one, fraction, integer};

/// The lists that an agent keeps, `[U]` over the hidden units of all towers, and `DUE`, `[L]` over their layers.
const UTILITY: &str = "continual-backprop/utility";
/// See [`UTILITY`]; for a unit that leaves several values, `[values]`.
const MEAN: &str = "continual-backprop/mean";
/// See [`UTILITY`].
const AGE: &str = "continual-backprop/age";
/// See [`UTILITY`].
const DUE: &str = "continual-backprop/due";

/// After each gradient step the mature unit of the lowest utility is now and then replaced in each hidden layer.
///
/// With h the activations of the minibatch, and running means of decay η: the utility u of mean|h|·mean|w_out|, and f of
/// mean h. Both are divided by 1 − ηᵃ, a being the unit's age in gradient steps. A layer's units older than m are mature;
/// each step adds ρ times their number to what is due. For each whole unit that is due, the mature unit with the least utility
/// gets new incoming weights as a new agent's, bias 0 and outgoing weights 0; its moments, u, f and a become 0.
/// What it gave on average, f·w_out, moves into the biases of the next layer.
///
/// The last follows the first version of the method (Dohare et al. 2021, "Continual Backprop: Stochastic Gradient Descent with
/// Persistent Randomness"). Algorithm 1 of 2024 does not have it; the authors' code means to, but clears f before it is used.
/// That code draws new weights uniformly, which here begin as the network's own.
#[derive(Clone, Debug, PartialEq)]
pub struct ContinualBackprop {
    /// ρ.
    rate: f64,
    /// m.
    maturity: u64,
    /// η.
    decay: f64,
}

impl Default for ContinualBackprop {
    fn default() -> Self {
        Self { rate: 1e-4, maturity: 10_000, decay: 0.99 }
    }
}

impl Settings for ContinualBackprop {
    fn visit(&mut self, v: &mut dyn Visitor) {
        let Self { rate, maturity, decay } = self;
        let doc = "share of the mature units that is replaced in each gradient step";
        v.field("continual_backprop_rate", doc, &mut fraction(rate));
        let doc = "gradient steps after which a unit can be replaced";
        // Ages are kept as f32, which counts exactly up to 2²⁴.
        v.field("continual_backprop_maturity", doc, &mut integer(maturity, 0..=10_000_000));
        v.field(
            "continual_backprop_decay",
            "decay of the running means of utility and activation",
            &mut below_one(decay),
        );
    }
}

impl Mitigation for ContinualBackprop {
    fn name(&self) -> &'static str {
        "continual-backprop"
    }

    fn summary(&self) -> &'static str {
        "now and then the least useful of the mature units begins anew (Dohare et al. 2024)"
    }

    fn number(&self) -> u16 {
        10
    }

    fn acts_between_steps(&self) -> bool {
        true
    }

    fn reads_units(&self) -> bool {
        true
    }

    fn after_step(&self, patient: &mut Patient<'_>, units: &Units) {
        let layers = layers(units);
        let mut records = Records::take(&mut patient.agent.kept, &layers);
        // All layers choose before any of them is changed.
        let chosen: Vec<(&Layer<'_>, usize)> =
            layers.iter().flat_map(|l| self.choose(l, &mut records, patient)).collect();
        let mut stream = patient.stream(self.number());
        for (layer, unit) in chosen {
            let place = Place { unit, ..layer.first };
            let Records { utility, mean, age, .. } = &mut records;
            let at = layer.units.start + unit;
            for value in patient.values_of(place) {
                let mean = &mut mean[layer.values.start + value];
                patient.move_into_next_bias(place, value, *mean / self.bias_correction(age[at]));
                *mean = 0.0;
            }
            patient.renew_incoming(place, &mut stream);
            patient.silence_outgoing(place);
            (utility[at], age[at]) = (0.0, 0.0);
        }
        records.give_back(&mut patient.agent.kept);
    }

    fn boxed(&self) -> Box<dyn Mitigation> {
        Box::new(self.clone())
    }
}

impl ContinualBackprop {
    /// Updates what is known of a layer's units, and says which of them are to be replaced.
    fn choose<'a>(
        &self,
        layer: &'a Layer<'a>,
        records: &mut Records,
        patient: &Patient<'_>,
    ) -> Vec<(&'a Layer<'a>, usize)> {
        let age = &mut records.age[layer.units.clone()];
        age.iter_mut().for_each(|age| *age = (*age + 1.0).min(MAX_AGE));
        let (magnitudes, means) = layer.activations.means();
        let (decay, new) = (self.decay as f32, (1.0 - self.decay) as f32);
        for (mean, now) in records.mean[layer.values.clone()].iter_mut().zip(means) {
            *mean = decay * *mean + new * now;
        }
        let utility = &mut records.utility[layer.units.clone()];
        for (unit, utility) in utility.iter_mut().enumerate() {
            let place = Place { unit, ..layer.first };
            let of_value = |value: usize| magnitudes[value] * patient.outgoing_magnitude(place, value);
            *utility = decay * *utility + new * patient.values_of(place).map(of_value).sum::<f32>();
        }
        let corrected = |&unit: &usize| utility[unit] / self.bias_correction(age[unit]);
        let mut mature: Vec<usize> = (0..age.len()).filter(|&unit| age[unit] > self.maturity as f32).collect();
        let due = &mut records.due[layer.index];
        *due += (self.rate * mature.len() as f64) as f32;
        let count = (*due as usize).min(mature.len());
        if count == 0 {
            return Vec::new();
        }
        *due -= count as f32;
        mature.sort_by(|a, b| corrected(a).total_cmp(&corrected(b)));
        mature.truncate(count);
        mature.sort_unstable();
        mature.into_iter().map(|unit| (layer, unit)).collect()
    }

    /// 1 − ηᵃ.
    fn bias_correction(&self, age: f32) -> f32 {
        (1.0 - self.decay.powf(f64::from(age))) as f32
    }
}

/// Beyond it an age would not grow as f32, and its bias correction is 1.
const MAX_AGE: f32 = 16_777_216.0;

/// A hidden layer, and where its units and their values stand in the lists.
struct Layer<'a> {
    /// Its number among all hidden layers.
    index: usize,
    /// Its first unit.
    first: Place,
    units: Range<usize>,
    values: Range<usize>,
    activations: &'a LayerUnits,
}

/// The hidden layers of all towers.
fn layers(units: &Units) -> Vec<Layer<'_>> {
    let towers = units.towers.iter().enumerate();
    let all =
        towers.flat_map(|(tower, layers)| layers.iter().enumerate().map(move |(layer, units)| (tower, layer, units)));
    let (mut unit, mut value) = (0, 0);
    let mut places = Vec::new();
    for (index, (tower, layer, activations)) in all.enumerate() {
        let first = Place { tower, layer, unit: 0 };
        let (units, values) = (unit..unit + activations.units, value..value + activations.values);
        (unit, value) = (units.end, values.end);
        places.push(Layer { index, first, units, values, activations });
    }
    places
}

/// What an agent keeps.
struct Records {
    /// u, `[U]`.
    utility: Vec<f32>,
    /// f, `[values]`.
    mean: Vec<f32>,
    /// a, `[U]`.
    age: Vec<f32>,
    /// Units due to be replaced, `[L]`.
    due: Vec<f32>,
}

impl Records {
    /// Takes them out of the agent; new ones where there are none.
    fn take(kept: &mut Kept, layers: &[Layer<'_>]) -> Self {
        let (units, values) = layers.last().map_or((0, 0), |last| (last.units.end, last.values.end));
        let mut list = |name, len| kept.take_list(name, len, 0.0);
        Self {
            utility: list(UTILITY, units),
            mean: list(MEAN, values),
            age: list(AGE, units),
            due: list(DUE, layers.len()),
        }
    }

    fn give_back(self, kept: &mut Kept) {
        for (name, list) in [(UTILITY, self.utility), (MEAN, self.mean), (AGE, self.age), (DUE, self.due)] {
            kept.lists.insert(name.to_owned(), list);
        }
    }
}
