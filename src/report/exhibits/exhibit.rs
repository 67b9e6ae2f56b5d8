//! What an exhibit is.

use charts::Drawing;

use crate::report::analysis::Analysis;
use crate::report::table::Table;

/// A section of a report.
pub trait Exhibit {
    /// The key of its numbers in `report.json`.
    fn key(&self) -> &'static str;

    /// Its heading.
    fn heading(&self) -> &'static str;

    /// What a reader should know before its figures and tables; empty for nothing.
    fn lead(&self) -> &'static str {
        ""
    }

    /// What is said where it has neither figure nor table.
    fn absence(&self) -> &'static str;

    /// The measures that it shows.
    fn definitions(&self) -> Vec<Definition> {
        Vec::new()
    }

    /// What it has computed beside the analysis, as JSON; none for nothing.
    ///
    /// # Errors
    /// None that numbers can have.
    fn numbers(&self) -> serde_json::Result<Option<String>> {
        Ok(None)
    }

    /// Its tables; those without rows are left out.
    fn tables(&self, analysis: &Analysis) -> Vec<NamedTable>;

    /// Whether its figures can be read with [`MOST_ARMS`](super::MOST_ARMS) arms and more.
    fn fits_many_arms(&self) -> bool {
        false
    }

    /// Its figures.
    fn figures(&self, analysis: &Analysis) -> Vec<NamedFigure> {
        let _ = analysis;
        Vec::new()
    }
}

/// A measure in short.
#[derive(Clone, Debug)]
pub struct Definition {
    /// What it is called.
    pub name: &'static str,
    /// What it is.
    pub meaning: String,
    /// The section of docs/metrics.md that defines it in full.
    pub place: &'static str,
}

/// A table and what its file is called.
#[derive(Clone, Debug)]
pub struct NamedTable {
    /// The file's name without extension.
    pub name: String,
    /// Whether a terminal gets it.
    pub is_main: bool,
    /// Whether it is of one arm alone: with [`MOST_ARMS`](super::MOST_ARMS) arms and more the page leaves it out.
    pub is_of_one_arm: bool,
    /// The table.
    pub table: Table,
}

impl NamedTable {
    pub(super) fn new(name: impl Into<String>, table: Table) -> Self {
        Self { name: name.into(), is_main: false, is_of_one_arm: false, table }
    }

    /// One that there is for every arm.
    pub(super) fn of_one_arm(name: impl Into<String>, table: Table) -> Self {
        Self { is_of_one_arm: true, ..Self::new(name, table) }
    }

    /// One that a terminal gets, too.
    pub(super) fn main(name: impl Into<String>, table: Table) -> Self {
        Self { is_main: true, ..Self::new(name, table) }
    }
}

/// A figure, what its files are called, and what is said of it.
#[derive(Clone, Debug)]
pub struct NamedFigure {
    /// The file's name without extension.
    pub name: String,
    /// What it shows: of how many seeds, what its bands are, what is missing.
    pub caption: String,
    /// The figure.
    pub drawing: Drawing,
    /// The tables that hold its numbers, by name.
    pub tables: Vec<String>,
}
