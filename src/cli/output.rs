//! What goes to stdout.

use std::io::{self, Write};

use anyhow::{Context, Result};
use clap::ValueEnum;
use clap::builder::PossibleValue;
use serde_json::json;

use crate::report::{self, Format};
use crate::results::Evaluation;

/// `--format`.
impl ValueEnum for Format {
    fn value_variants<'a>() -> &'a [Self] {
        &[Self::Table, Self::Markdown, Self::Csv, Self::Json, Self::Latex]
    }

    fn to_possible_value(&self) -> Option<PossibleValue> {
        let (name, help) = match self {
            Self::Table => ("table", "Aligned columns, for reading"),
            Self::Markdown => ("markdown", "GitHub's Markdown"),
            Self::Csv => ("csv", "Comma-separated values, numbers in full"),
            Self::Json => ("json", "JSON, numbers in full"),
            Self::Latex => ("latex", "LaTeX with booktabs"),
        };
        Some(PossibleValue::new(name).help(help))
    }
}

/// Prints evaluations to stdout; as JSON one object for one of them, a list within an object for several.
///
/// # Errors
/// A stdout that cannot be written.
pub(super) fn print_evaluations(evaluations: &[Evaluation], format: Format) -> Result<()> {
    let text = match (format, evaluations) {
        (Format::Json, [one]) => serde_json::to_string(one)? + "\n",
        (Format::Json, all) => json!({ "evaluations": all }).to_string() + "\n",
        (format, _) => report::evaluations(evaluations).render(format),
    };
    write_stdout(&text)
}

/// Whether somebody still reads stdout.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Reader {
    /// As far as can be told.
    There,
    /// A pipe's other end was closed (`| head`).
    Gone,
}

/// Writes to stdout; a reader that has gone is no error.
///
/// # Errors
/// Any other that stdout has.
pub(super) fn write_stdout(text: &str) -> Result<()> {
    offer_stdout(text).map(drop)
}

/// Writes to stdout, and tells whether there is any use in writing more.
///
/// # Errors
/// Any that stdout has, but for a reader that has gone.
pub(super) fn offer_stdout(text: &str) -> Result<Reader> {
    let mut stdout = io::stdout().lock();
    match stdout.write_all(text.as_bytes()).and_then(|()| stdout.flush()) {
        Ok(()) => Ok(Reader::There),
        Err(error) if error.kind() == io::ErrorKind::BrokenPipe => Ok(Reader::Gone),
        Err(error) => Err(error).context("cannot write to stdout"),
    }
}
