//! `cpp-rl compare`.

use std::fs;
use std::path::PathBuf;

use anyhow::{Context, Result};
use clap::Args;

use crate::error::tell;
use crate::report::compare::Comparison;
use crate::report::{Format, render};
use crate::run::write_file;

use super::output::write_stdout;

/// Lay runs side by side.
#[derive(Debug, Args)]
pub struct CompareArgs {
    /// Runs' directories, or folders of runs at any depth up to four.
    #[arg(value_name = "RUN_DIR", required = true)]
    runs: Vec<PathBuf>,
    /// Also write the table in every format into this folder.
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// How the table is printed.
    #[arg(long, value_enum, default_value_t = Format::Table)]
    format: Format,
}

impl CompareArgs {
    /// Prints the comparison, and writes it if asked to.
    ///
    /// # Errors
    /// Directories without runs, and files that cannot be read or written.
    pub fn run(&self) -> Result<()> {
        let comparison = Comparison::read(&self.runs)?;
        let mut tables = vec![comparison.table()];
        if !comparison.differences.is_empty() {
            tables.push(comparison.settings_table());
        }
        let json = serde_json::to_string_pretty(&comparison)? + "\n";
        let text = |format| if format == Format::Json { json.clone() } else { render(&tables, format) };
        comparison.warnings.iter().for_each(|warning| tell(format_args!("warning: {warning}")));
        if let Some(out) = &self.out {
            fs::create_dir_all(out).with_context(|| format!("cannot create {}", out.display()))?;
            let files = [
                ("tables.md", Format::Markdown),
                ("tables.csv", Format::Csv),
                ("tables.tex", Format::Latex),
                ("comparison.json", Format::Json),
            ];
            for (name, format) in files {
                let path = out.join(name);
                write_file(&path, text(format).as_bytes())
                    .with_context(|| format!("cannot write {}", path.display()))?;
            }
            tell(format_args!("written to {}", out.display()));
        }
        write_stdout(&text(self.format))
    }
}
