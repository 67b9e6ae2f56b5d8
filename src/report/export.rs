//! A report as files.

use std::fs;
use std::path::Path;

use anyhow::{Context, Result};

use super::analysis::Analysis;
use super::tables::{self, NamedTable};
use super::{Format, Table, render};
use crate::run::write_file;

/// Writes `report.json`, `tables.md`, `tables.tex` and `tables/*.csv` into `directory`, which is made if need be.
///
/// # Errors
/// Those of the file system.
pub fn write(analysis: &Analysis, directory: &Path) -> Result<()> {
    let csv = directory.join("tables");
    fs::create_dir_all(&csv).with_context(|| format!("cannot create {}", csv.display()))?;
    let named = tables::all(analysis);
    for NamedTable { name, table } in &named {
        write_text(&csv.join(format!("{name}.csv")), &table.render(Format::Csv))?;
    }
    let tables: Vec<Table> = named.into_iter().map(|named| named.table).collect();
    write_text(&directory.join("tables.md"), &(render(&tables, Format::Markdown) + &warnings(analysis)))?;
    write_text(&directory.join("tables.tex"), &render(&tables, Format::Latex))?;
    write_text(&directory.join("report.json"), &(serde_json::to_string(analysis)? + "\n"))
}

/// What a reader must know, as a list in Markdown.
fn warnings(analysis: &Analysis) -> String {
    let lines: String = analysis.warnings.iter().map(|warning| format!("- {warning}\n")).collect();
    if lines.is_empty() { lines } else { format!("\n**Warnings**\n\n{lines}") }
}

fn write_text(path: &Path, text: &str) -> Result<()> {
    write_file(path, text.as_bytes()).with_context(|| format!("cannot write {}", path.display()))
}
