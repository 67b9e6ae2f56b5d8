//! A table before it is written in any format.

use rl_stats::{Estimate, Interval};

/// Text and numbers under named columns.
#[derive(Clone, Debug, Default)]
pub struct Table {
    /// What it shows.
    pub title: String,
    /// The heads of all columns, the row labels' included.
    pub columns: Vec<String>,
    /// As many cells as columns, each.
    pub rows: Vec<Vec<Cell>>,
    /// What a reader must know, below the table.
    pub notes: Vec<String>,
}

/// One entry.
#[derive(Clone, Debug, PartialEq)]
pub enum Cell {
    /// As it is.
    Text(String),
    /// A number, shown with this many decimals.
    Number(f64, usize),
    /// A mean and a standard deviation, which one value has not.
    MeanStd(f64, Option<f64>),
    /// A statistic with its interval, if it has one, shown with this many decimals.
    Interval(f64, Option<Interval>, usize),
    /// Such a number, of other than as many seeds as its row says.
    OfSeeds(Box<Cell>, usize),
    /// There is no such result.
    Missing,
}

impl From<&str> for Cell {
    fn from(text: &str) -> Self {
        Self::Text(text.to_owned())
    }
}

impl From<String> for Cell {
    fn from(text: String) -> Self {
        Self::Text(text)
    }
}

impl Cell {
    /// As people read it; `plus_minus` stands between mean and deviation.
    pub(super) fn shown(&self, plus_minus: &str) -> String {
        match self {
            Self::Text(text) => text.clone(),
            Self::Number(value, decimals) => format!("{value:.decimals$}"),
            Self::MeanStd(mean, None) => format!("{mean:.2}"),
            Self::MeanStd(mean, Some(std)) => format!("{mean:.2}{plus_minus}{std:.2}"),
            Self::Interval(value, None, decimals) => format!("{value:.decimals$}"),
            Self::Interval(value, Some(Interval { low, high }), decimals) => {
                format!("{value:.decimals$} [{low:.decimals$}, {high:.decimals$}]")
            }
            Self::OfSeeds(cell, seeds) => format!("{} (n = {seeds})", cell.shown(plus_minus)),
            Self::Missing => "–".to_owned(),
        }
    }

    /// An estimate as a table's entry; missing where there is none.
    pub(super) fn estimate<'a>(estimate: impl Into<Option<&'a Estimate>>, decimals: usize) -> Self {
        estimate.into().map_or(Self::Missing, |e| Self::Interval(e.value, e.interval, decimals))
    }

    /// This number, of so many seeds, in a row that says it is of `row`.
    pub(super) fn of_seeds(self, seeds: usize, row: usize) -> Self {
        if seeds == row || self == Self::Missing { self } else { Self::OfSeeds(Box::new(self), seeds) }
    }

    /// A count.
    pub(super) fn count(number: usize) -> Self {
        Self::Number(number as f64, 0)
    }
}

impl Table {
    /// A table with these columns; empty notes are left out.
    pub(super) fn new(
        title: impl Into<String>,
        columns: impl IntoIterator<Item = impl Into<String>>,
        rows: Vec<Vec<Cell>>,
        mut notes: Vec<String>,
    ) -> Self {
        notes.retain(|note| !note.is_empty());
        Self { title: title.into(), columns: columns.into_iter().map(Into::into).collect(), rows, notes }
    }
}
