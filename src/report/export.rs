//! A report as files.

use std::fs;
use std::path::Path;

use anyhow::{Context, Result};

use super::analysis::Analysis;
use super::exhibits::{self, Exhibit, NamedFigure, NamedTable};
use super::parallel;
use super::render::{Format, page, render, seeds, write_json};
use super::table::Table;
use crate::run::{write_file, write_file_with};

/// Pixels of figures as PNG, in units of 96 per inch of the printed figure: 288 per inch.
pub const PNG_SCALE: f64 = 3.0;
/// What the measures are, to lie beside the report.
const METRICS: &str = include_str!("../../docs/metrics.md");

/// Writes `report.html`, `report.json`, `seeds.csv`, `tables.md`, `tables.tex`, `tables/*.csv`, `figures/*.svg`, `figures/*.png` and
/// the definitions of all measures, `metrics.md`, into `directory`, which is made if need be. `exhibits` are those of the
/// analysis, and `command` is what the report says it was made by.
///
/// # Errors
/// Those of the file system.
pub fn write(analysis: &Analysis, exhibits: &[Box<dyn Exhibit>], directory: &Path, command: &str) -> Result<()> {
    let [csv, drawn] = ["tables", "figures"].map(|folder| directory.join(folder));
    for folder in [&csv, &drawn] {
        fs::create_dir_all(folder).with_context(|| format!("cannot create {}", folder.display()))?;
    }
    let sections = exhibits::sections(analysis, exhibits);
    write_text(&directory.join("report.html"), &page(analysis, exhibits, &sections, command).to_html())?;
    let json = directory.join("report.json");
    write_file_with(&json, |file| write_json(analysis, exhibits, file))
        .with_context(|| format!("cannot write {}", json.display()))?;
    write_text(&directory.join("seeds.csv"), &seeds(analysis))?;
    let (tables, figures): (Vec<_>, Vec<_>) =
        sections.into_iter().map(|section| (section.tables, section.figures)).unzip();
    write_figures(&figures.concat(), &drawn)?;
    let written = parallel::map(&tables.concat(), |NamedTable { name, table, .. }| {
        write_text(&csv.join(format!("{name}.csv")), &table.render(Format::Csv))
    });
    written.into_iter().collect::<Result<()>>()?;
    let tables: Vec<Table> = tables.into_iter().flatten().map(|named| named.table).collect();
    write_text(&directory.join("tables.md"), &(render(&tables, Format::Markdown) + &warnings(analysis)))?;
    write_text(&directory.join("tables.tex"), &render(&tables, Format::Latex))?;
    write_text(&directory.join("metrics.md"), METRICS)
}

/// Writes every figure as SVG and PNG, on all cores: drawing pixels takes its time.
fn write_figures(figures: &[NamedFigure], directory: &Path) -> Result<()> {
    let write = |NamedFigure { name, drawing, .. }: &NamedFigure| {
        write_text(&directory.join(format!("{name}.svg")), &drawing.to_svg())?;
        let png = drawing.to_png(PNG_SCALE).with_context(|| format!("cannot draw the figure {name}"))?;
        write_bytes(&directory.join(format!("{name}.png")), &png)
    };
    parallel::map(figures, write).into_iter().collect()
}

/// What a reader must know, as a list in Markdown.
fn warnings(analysis: &Analysis) -> String {
    let lines: String = analysis.warnings.iter().map(|warning| format!("- {warning}\n")).collect();
    if lines.is_empty() { lines } else { format!("\n**Warnings**\n\n{lines}") }
}

fn write_text(path: &Path, text: &str) -> Result<()> {
    write_bytes(path, text.as_bytes())
}

fn write_bytes(path: &Path, bytes: &[u8]) -> Result<()> {
    write_file(path, bytes).with_context(|| format!("cannot write {}", path.display()))
}
