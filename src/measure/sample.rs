//! What measures see: an update, and the network after it, all on the same N states.

use std::cell::OnceCell;

use super::Spectra;

/// One agent at one measurement, on N states of one kind.
#[derive(Debug)]
pub struct Sample<'a> {
    /// Which states these are. No measure knows it: it says what a column is called.
    pub states: States,
    /// The update before the measurement; none before a stage's first.
    pub update: Option<Update<'a>>,
    /// How the agent chooses its actions.
    pub acting: Acting,
    /// Every layer, tower by tower.
    pub layers: Vec<Layer<'a>>,
}

/// The states on which an agent is measured.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum States {
    /// Those of a uniformly random policy, the same for all agents.
    Reference,
    /// Those that the agent itself meets.
    Visited,
}

impl States {
    /// What the names of their columns end with.
    pub fn suffix(self) -> &'static str {
        match self {
            Self::Reference => "",
            Self::Visited => "/visited",
        }
    }
}

/// What an update did to an agent.
#[derive(Debug)]
pub struct Update<'a> {
    /// θ before it, `[P]`.
    pub before: &'a [f32],
    /// θ after it, `[P]`.
    pub after: &'a [f32],
    /// The greedy action in each state before it, `[N]`, as an index.
    pub greedy_before: Vec<usize>,
    /// The same after it.
    pub greedy_after: Vec<usize>,
    /// Its gradient steps.
    pub steps: u64,
    /// `train/grad_norm` of the update, which the parameters do not tell.
    pub grad_norm: f64,
}

/// What leaves the tower that chooses actions.
#[derive(Debug)]
pub struct Acting {
    /// `[N, A]`, row by row.
    pub outputs: Vec<f32>,
    /// A, the number of actions.
    pub actions: usize,
    /// What the outputs mean.
    pub head: Head,
}

/// What the outputs mean by which an agent chooses its actions.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Head {
    /// They are the logits of a policy.
    Logits,
    /// They are the values of the actions.
    Values,
}

impl Acting {
    /// The mean over the states of `of` the outputs there, `[A]`.
    pub fn mean_over_states(&self, of: impl Fn(&[f64]) -> f64) -> f64 {
        let rows = self.outputs.chunks_exact(self.actions);
        let count = rows.len() as f64;
        let value = |row: &[f32]| of(&row.iter().copied().map(f64::from).collect::<Vec<f64>>());
        rows.map(value).sum::<f64>() / count
    }
}

/// One layer.
#[derive(Debug)]
pub struct Layer<'a> {
    /// Its tower and number, such as `policy.1`.
    pub name: String,
    /// Its weights, `[inputs · outputs]`, biases left out.
    pub weights: &'a [f32],
    /// Its units, if it is a hidden layer. The output layer has none that could wear out.
    pub hidden: Option<Hidden>,
}

/// The activations of a hidden layer of K units.
#[derive(Debug)]
pub struct Hidden {
    /// h, `[N, K]`, row by row.
    activations: Vec<f64>,
    /// K.
    width: usize,
    units: Units,
    spectra: OnceCell<Spectra>,
}

/// What the units of a hidden layer compute.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Units {
    /// The hyperbolic tangent of a sum.
    Tanh,
    /// The positive part of a sum.
    Relu,
    /// The sine and the cosine of a sum, each a value by itself. No measure is of them alone: they neither die nor
    /// saturate.
    Fourier,
}

impl Units {
    /// As reports write it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Tanh => "tanh",
            Self::Relu => "ReLU",
            Self::Fourier => "Fourier features",
        }
    }
}

impl Hidden {
    /// A layer with these activations `[N, K]`, row by row, K being `width`.
    ///
    /// # Panics
    /// If these are not whole rows, or none.
    pub fn new(activations: Vec<f64>, width: usize, units: Units) -> Self {
        let whole = width > 0 && !activations.is_empty() && activations.len().is_multiple_of(width);
        assert!(whole, "{} activations are no rows of {width}", activations.len());
        Self { activations, width, units, spectra: OnceCell::new() }
    }

    /// What its units compute.
    pub fn units(&self) -> Units {
        self.units
    }

    /// All N·K activations, row by row.
    pub fn activations(&self) -> &[f64] {
        &self.activations
    }

    /// The activations in each state, `[K]`.
    pub fn rows(&self) -> impl ExactSizeIterator<Item = &[f64]> {
        self.activations.chunks_exact(self.width)
    }

    /// The mean of `value` over the states, for each unit, `[K]`.
    pub fn means(&self, value: impl Fn(f64) -> f64) -> Vec<f64> {
        let mut sums = vec![0.0; self.width];
        for row in self.rows() {
            sums.iter_mut().zip(row).for_each(|(sum, &h)| *sum += value(h));
        }
        let count = self.rows().len() as f64;
        sums.into_iter().map(|sum| sum / count).collect()
    }

    /// The share of units of which `holds` is true in every state.
    pub fn share_always(&self, holds: impl Fn(f64) -> bool) -> f64 {
        let mut always = vec![true; self.width];
        for row in self.rows() {
            always.iter_mut().zip(row).for_each(|(always, &h)| *always &= holds(h));
        }
        share(&always, |&always| always)
    }

    /// The singular values of h, as it is and without each unit's mean. They are computed once for all measures.
    pub fn spectra(&self) -> &Spectra {
        self.spectra.get_or_init(|| Spectra::of(&self.activations, self.width))
    }
}

/// The share of values of which `holds` is true.
pub(super) fn share<T>(values: &[T], holds: impl Fn(&T) -> bool) -> f64 {
    values.iter().filter(|value| holds(value)).count() as f64 / values.len() as f64
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use crate::measure::{Measure, Of};

    /// A hidden layer whose rows are these.
    pub fn hidden<const N: usize, const K: usize>(rows: [[f64; K]; N], units: Units) -> Hidden {
        Hidden::new(rows.concat(), K, units)
    }

    /// An update of one step that changed nothing, in one state.
    pub fn update() -> Update<'static> {
        Update { before: &[], after: &[], greedy_before: vec![0], greedy_after: vec![0], steps: 1, grad_norm: 0.0 }
    }

    /// Four actions by these outputs.
    pub fn acting(head: Head, outputs: Vec<f32>) -> Acting {
        Acting { outputs, actions: 4, head }
    }

    /// What measures of any hidden layer say of this one.
    pub fn values(measures: &[Measure], hidden: &Hidden) -> Vec<f64> {
        let value = |measure: &Measure| match measure.of {
            Of::Hidden(compute) => compute(hidden),
            _ => panic!("{} is of something else", measure.name),
        };
        measures.iter().map(value).collect()
    }

    /// Asserts what every rank says of layers at the edges: 1 where all rows are the same, 0 where all are 0, and no
    /// number where one is infinite.
    pub fn assert_rank_of_edges(rank: impl Fn([[f64; 3]; 5]) -> f64) {
        // The singular values that should be 0 are of the order of 1e-17.
        let constant = rank([[0.5, -0.25, 1.0]; 5]);
        assert!((constant - 1.0).abs() < 1e-12, "{constant}");
        assert_eq!(rank([[0.0; 3]; 5]), 0.0);
        assert!(rank([[f64::INFINITY, 1.0, 1.0]; 5]).is_nan());
    }

    #[test]
    #[should_panic(expected = "5 activations are no rows of 2")]
    fn rows_are_whole() {
        Hidden::new(vec![0.0; 5], 2, Units::Tanh);
    }
}
