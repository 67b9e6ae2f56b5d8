//! What goes to stdout, or to a file instead.

use std::fs;
use std::io::{self, Write};
use std::path::Path;

use anyhow::{Context, Result};
use clap::ValueEnum;
use clap::builder::PossibleValue;
use serde_json::json;

use crate::report::{self, Format};
use crate::results::Evaluation;
use crate::run::write_file;

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

/// Writes what the user wants in a file: whole or not at all where it is one, through a link to it, and straight into
/// what is no file.
///
/// # Errors
/// Those of the file system, naming the path.
pub(super) fn write_out(path: &Path, bytes: &[u8]) -> Result<()> {
    let written = match fs::metadata(path) {
        // A device or a pipe is not to be replaced by a file.
        Ok(there) if !there.is_file() => fs::write(path, bytes),
        Ok(_) => fs::canonicalize(path).and_then(|file| write_file(&file, bytes)),
        Err(_) => write_file(path, bytes),
    };
    written.with_context(|| format!("cannot write {}", path.display()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[cfg(unix)]
    #[test]
    fn only_files_are_replaced() {
        use std::os::unix::fs::{FileTypeExt, symlink};
        use std::process::Command;
        let directory = tempfile::tempdir().unwrap();
        let [file, link] = ["file", "link"].map(|name| directory.path().join(name));
        write_out(&file, b"old").unwrap();
        symlink(&file, &link).unwrap();
        write_out(&link, b"new").unwrap();
        assert_eq!(fs::read(&file).unwrap(), b"new");
        assert!(fs::symlink_metadata(&link).unwrap().is_symlink());
        let pipe = directory.path().join("pipe");
        assert!(Command::new("mkfifo").arg(&pipe).status().unwrap().success());
        let reader = std::thread::spawn({
            let pipe = pipe.clone();
            move || fs::read(pipe).unwrap()
        });
        write_out(&pipe, b"through").unwrap();
        assert!(fs::metadata(&pipe).unwrap().file_type().is_fifo());
        assert_eq!(reader.join().unwrap(), b"through");
        let error = write_out(directory.path(), b"").unwrap_err();
        assert!(format!("{error:#}").contains("cannot write"), "{error:#}");
    }
}
