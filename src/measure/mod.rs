//! What is measured of an agent while it trains: one file per measure.
//!
//! A file says what its measure is called, what it means and how it is computed. To add one, write a file that has
//! `MEASURES`, and name it in the list below; docs/metrics.md has a row for each.
//!
//! Nothing here knows an agent, an environment or a network: a measure sees a [`Sample`]. [`probe`] alone knows them,
//! and makes the samples.

use std::fmt;

pub mod probe;
mod sample;
mod spectrum;

pub use sample::{Acting, Head, Hidden, Layer, Sample, States, Units, Update};
pub use spectrum::{Spectra, Spectrum};

/// What the names of all columns of measures begin with.
pub const PREFIX: &str = "plasticity/";

/// Declares the files of measures, and lists them. (`cargo fmt` does not look into macros: `scripts/test` formats these
/// files by name.)
macro_rules! measures {
    ($($file:ident),* $(,)?) => {
        $(mod $file;)*
        static FILES: &[&[Measure]] = &[$($file::MEASURES),*];
    };
}

// The order is that of the columns of `plasticity.csv`: of the agent, then layer by layer.
measures! {
    grad_norm,
    update_norm,
    policy_churn,
    weight_magnitude,
    dormant,
    dead_units,
    saturated_units,
    saturated_activations,
    effective_rank,
    stable_rank,
    rank_99,
    constant_units,
    policy_entropy,
    logit_scale,
    action_gap,
    centred_rank,
}

/// One measure: how logs and reports name it, what it means, and how it is computed.
#[derive(Debug)]
pub struct Measure {
    /// The end of its columns' names in `plasticity.csv`. It never changes: logs have it.
    pub name: &'static str,
    /// What a report calls it.
    pub title: &'static str,
    /// What it counts, such as `share`; empty for numbers without a unit.
    pub unit: &'static str,
    /// The least and the greatest value that it can have.
    pub range: (f64, f64),
    /// How it is computed, in the words of docs/metrics.md.
    pub formula: &'static str,
    /// Where it comes from, as author and year; empty for what is common or ours.
    pub source: &'static str,
    /// How it moves where plasticity is lost.
    pub loss: Loss,
    /// What it is computed from.
    pub of: Of,
}

/// How a measure moves where plasticity is lost, as far as its source says.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Loss {
    /// More of it is a sign of lost plasticity.
    Rises,
    /// Less of it is.
    Falls,
    /// Neither is by itself.
    Unclear,
}

/// What a measure is computed from. It tells which agents and layers have the measure, and so which columns there are.
#[derive(Debug)]
pub enum Of {
    /// What an update made of the parameters, whatever the states.
    Update(fn(&Update) -> f64),
    /// What an update made of the greedy actions.
    Choices(fn(&Update) -> f64),
    /// The outputs by which an agent chooses, where they mean this.
    Acting(Head, fn(&Acting) -> f64),
    /// The weights `[inputs · outputs]` of each layer, the output layer included.
    Weights(fn(&[f32]) -> f64),
    /// The activations of each hidden layer.
    Hidden(fn(&Hidden) -> f64),
    /// The activations of each hidden layer of these units.
    HiddenOf(Units, fn(&Hidden) -> f64),
}

impl Measure {
    /// Title and unit, as on an axis or above a panel.
    pub fn label(&self) -> String {
        let only = match self.of {
            Of::HiddenOf(units, _) => units.name(),
            _ => "",
        };
        let notes: Vec<&str> = [self.unit, only].into_iter().filter(|note| !note.is_empty()).collect();
        if notes.is_empty() { self.title.to_owned() } else { format!("{} ({})", self.title, notes.join("; ")) }
    }

    /// Whether it is of one layer, and not of the whole agent.
    pub fn is_of_layer(&self) -> bool {
        !matches!(self.of, Of::Update(_) | Of::Choices(_) | Of::Acting(..))
    }

    /// Whether its value depends on the states on which the agent is measured.
    pub fn is_of_states(&self) -> bool {
        !matches!(self.of, Of::Update(_) | Of::Weights(_))
    }

    /// Its value of a whole agent, if such agents have it; NaN for one of an update where there was none.
    fn of_agent(&self, sample: &Sample) -> Option<f64> {
        match self.of {
            Of::Update(compute) | Of::Choices(compute) => Some(sample.update.as_ref().map_or(f64::NAN, compute)),
            Of::Acting(head, compute) => (sample.acting.head == head).then(|| compute(&sample.acting)),
            _ => None,
        }
    }

    /// Its value of a layer, if such layers have it.
    fn of_layer(&self, layer: &Layer) -> Option<f64> {
        match self.of {
            Of::Update(_) | Of::Choices(_) | Of::Acting(..) => None,
            Of::Weights(compute) => Some(compute(layer.weights)),
            Of::Hidden(compute) => layer.hidden.as_ref().map(compute),
            Of::HiddenOf(units, compute) => layer.hidden.as_ref().filter(|hidden| hidden.units() == units).map(compute),
        }
    }
}

/// Every measure, in the order of the columns of `plasticity.csv`.
pub fn catalogue() -> impl Iterator<Item = &'static Measure> + Clone {
    FILES.iter().copied().flatten()
}

/// What the name of a column of `plasticity.csv` says.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Column<'a> {
    /// The layer, such as `policy.1`; none for a measure of the whole agent.
    pub layer: Option<&'a str>,
    /// The name of the measure.
    pub name: &'a str,
    /// The states on which it is measured.
    pub states: States,
}

impl<'a> Column<'a> {
    /// Reads a name, of whatever version it is.
    pub fn parse(column: &'a str) -> Self {
        let column = column.strip_prefix(PREFIX).unwrap_or(column);
        let visited = column.strip_suffix(States::Visited.suffix());
        let states = if visited.is_some() { States::Visited } else { States::Reference };
        let column = visited.unwrap_or(column);
        let (layer, name) = column.rsplit_once('/').map_or((None, column), |(layer, name)| (Some(layer), name));
        Self { layer, name, states }
    }

    /// The measure; none that this version does not know.
    pub fn measure(self) -> Option<&'static Measure> {
        let is_of = |measure: &&Measure| measure.name == self.name && measure.is_of_layer() == self.layer.is_some();
        catalogue().find(is_of).filter(|measure| self.states == States::Reference || measure.is_of_states())
    }
}

impl fmt::Display for Column<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let layer = self.layer.map(|layer| format!("{layer}/")).unwrap_or_default();
        write!(f, "{PREFIX}{layer}{}{}", self.name, self.states.suffix())
    }
}

/// The columns of `plasticity.csv` for this sample, and their values: NaN where a measure has none.
///
/// Which columns there are depends on the network alone, so that all rows of a log have the same. What does not depend on
/// the states stands with the reference states only.
pub fn columns(sample: &Sample) -> Vec<(String, f64)> {
    let states = sample.states;
    let measures = catalogue().filter(|measure| states == States::Reference || measure.is_of_states());
    let name = |layer, measure: &Measure| Column { layer, name: measure.name, states }.to_string();
    let of_agent = |measure: &Measure| Some((name(None, measure), measure.of_agent(sample)?));
    let mut columns: Vec<_> = measures.clone().filter_map(of_agent).collect();
    for layer in &sample.layers {
        let of_layer = |measure: &Measure| Some((name(Some(layer.name.as_str()), measure), measure.of_layer(layer)?));
        columns.extend(measures.clone().filter_map(of_layer));
    }
    columns
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;

    #[test]
    fn names_are_unique_and_can_stand_in_a_column() {
        let names: BTreeSet<&str> = catalogue().map(|measure| measure.name).collect();
        assert_eq!(names.len(), catalogue().count());
        for measure in catalogue() {
            let is_plain = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit() || "_.".contains(c);
            assert!(measure.name.chars().all(is_plain), "{}", measure.name);
            assert!(measure.range.0 < measure.range.1, "{}", measure.name);
        }
    }

    #[test]
    fn a_column_leads_to_its_measure() {
        let found = |name| {
            let column = Column::parse(name);
            let measure = column.measure()?;
            assert_eq!(column.to_string(), name);
            Some((column.layer, measure.name, column.states))
        };
        let (reference, visited) = (States::Reference, States::Visited);
        assert_eq!(found("plasticity/update_norm"), Some((None, "update_norm", reference)));
        assert_eq!(found("plasticity/policy.1/dormant_0.1"), Some((Some("policy.1"), "dormant_0.1", reference)));
        assert_eq!(found("plasticity/policy.1/dormant_0.1/visited"), Some((Some("policy.1"), "dormant_0.1", visited)));
        assert_eq!(found("plasticity/policy_churn/visited"), Some((None, "policy_churn", visited)));
        assert_eq!(found("plasticity/policy.1/update_norm"), None);
        assert_eq!(found("plasticity/dormant_0.1"), None);
        // What the states do not change has one column.
        assert_eq!(found("plasticity/update_norm/visited"), None);
        assert_eq!(found("plasticity/q.0/weight_magnitude/visited"), None);
        assert_eq!(found("timesteps"), None);
    }

    #[test]
    fn labels_say_unit_and_units() {
        let label = |name: &str| catalogue().find(|measure| measure.name == name).map(Measure::label);
        assert_eq!(label("dormant_0.1").as_deref(), Some("dormant units, τ = 0.1 (share)"));
        assert_eq!(label("dead_units").as_deref(), Some("dead units (share; ReLU)"));
        assert_eq!(label("effective_rank").as_deref(), Some("effective rank"));
    }

    #[test]
    fn the_documentation_defines_every_measure_in_the_same_words() {
        let text = include_str!("../../docs/metrics.md");
        for measure in catalogue() {
            let table = match measure.of {
                Of::Update(_) | Of::Choices(_) | Of::Acting(..) => PREFIX,
                Of::Weights(_) => "plasticity/<tower>.<i>/",
                Of::Hidden(_) | Of::HiddenOf(..) => "",
            };
            let beginning = format!("| `{table}{}` |", measure.name);
            let row = text.lines().find(|line| line.starts_with(&beginning));
            let row = row.unwrap_or_else(|| panic!("docs/metrics.md has no row that begins {beginning}"));
            assert!(row.contains(measure.formula), "{}: {}", measure.name, measure.formula);
            assert!(row.contains(measure.source), "{}: {}", measure.name, measure.source);
        }
    }

    #[test]
    fn measures_know_no_agent() {
        let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/src/measure");
        let files = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
        let files: Vec<_> = files.filter(|path| path.is_file()).collect();
        assert!(files.len() > FILES.len());
        for file in files {
            let text = std::fs::read_to_string(&file).unwrap();
            for import in text.lines().map(str::trim).filter(|line| line.starts_with("use ")) {
                let of_measures = import.contains("crate::measure") || !import.contains("crate::");
                let foreign = ["bit_mlp", "coverage_env", "tch"].iter().any(|room| import.contains(room));
                assert!(of_measures && !foreign, "{}: {import}", file.display());
            }
        }
    }
}
