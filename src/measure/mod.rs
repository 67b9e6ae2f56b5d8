//! What is measured of an agent while it trains: one file per measure.
//!
//! A file says what its measure is called, what it means and how it is computed. To add one, write a file that has
//! `MEASURES`, and name it in the list below; docs/metrics.md has a row for each.
//!
//! Nothing here knows an agent, an environment or a network: a measure sees a [`Sample`]. [`probe`] alone knows them,
//! and makes the samples.

pub mod probe;
mod sample;
mod spectrum;

pub use sample::{Head, Hidden, Layer, Sample, Units, Update};
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
    /// An update of any agent: one number.
    Update(fn(&Update) -> f64),
    /// An update of an agent whose outputs mean this.
    UpdateOf(Head, fn(&Update) -> f64),
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
        !matches!(self.of, Of::Update(_) | Of::UpdateOf(..))
    }

    /// Its value of an update, if it is of one.
    fn of_update(&self, update: &Update) -> Option<f64> {
        match self.of {
            Of::Update(compute) => Some(compute(update)),
            Of::UpdateOf(head, compute) => (update.head == head).then(|| compute(update)),
            _ => None,
        }
    }

    /// Its value of a layer, if such layers have it.
    fn of_layer(&self, layer: &Layer) -> Option<f64> {
        match self.of {
            Of::Update(_) | Of::UpdateOf(..) => None,
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

/// The layer, such as `policy.1`, and the measure of a column of `plasticity.csv`.
///
/// The layer is `None` for a measure of the whole agent. Returns `None` for a column that is of no measure known here,
/// such as one that a later version logged.
pub fn find(column: &str) -> Option<(Option<&str>, &'static Measure)> {
    let column = column.strip_prefix(PREFIX)?;
    let (layer, name) = column.rsplit_once('/').map_or((None, column), |(layer, name)| (Some(layer), name));
    let measure = catalogue().find(|measure| measure.name == name && measure.is_of_layer() == layer.is_some())?;
    Some((layer, measure))
}

/// The columns of `plasticity.csv` for this sample, and their values: NaN where a measure has none.
///
/// Which columns there are depends on the network alone, so that all rows of a log have the same.
pub fn columns(sample: &Sample) -> Vec<(String, f64)> {
    let of_update = |measure: &Measure| Some((format!("{PREFIX}{}", measure.name), measure.of_update(&sample.update)?));
    let mut columns: Vec<_> = catalogue().filter_map(of_update).collect();
    for layer in &sample.layers {
        let of_layer =
            |measure: &Measure| Some((format!("{PREFIX}{}/{}", layer.name, measure.name), measure.of_layer(layer)?));
        columns.extend(catalogue().filter_map(of_layer));
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
        let found = |column| find(column).map(|(layer, measure)| (layer, measure.name));
        assert_eq!(found("plasticity/update_norm"), Some((None, "update_norm")));
        assert_eq!(found("plasticity/policy.1/dormant_0.1"), Some((Some("policy.1"), "dormant_0.1")));
        assert_eq!(found("plasticity/policy.1/update_norm"), None);
        assert_eq!(found("plasticity/dormant_0.1"), None);
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
                Of::Update(_) | Of::UpdateOf(..) => PREFIX,
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
