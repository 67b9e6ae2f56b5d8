//! A report as files.

use std::fs;
use std::num::NonZero;
use std::path::Path;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::thread;

use anyhow::{Context, Result};

use super::analysis::Analysis;
use super::exhibits::{self, NamedFigure, NamedTable};
use super::render::{Format, page, render, seeds, to_json};
use super::table::Table;
use crate::run::write_file;

/// Pixels of figures as PNG, in units of 96 per inch of the printed figure: 288 per inch.
pub const PNG_SCALE: f64 = 3.0;
/// What the measures are, to lie beside the report.
const METRICS: &str = include_str!("../../docs/metrics.md");

/// Writes `report.html`, `report.json`, `seeds.csv`, `tables.md`, `tables.tex`, `tables/*.csv`, `figures/*.svg`, `figures/*.png` and
/// the definitions of all measures, `metrics.md`, into `directory`, which is made if need be. `command` is what the
/// report says it was made by.
///
/// # Errors
/// Those of the file system.
pub fn write(analysis: &Analysis, directory: &Path, command: &str) -> Result<()> {
    let [csv, drawn] = ["tables", "figures"].map(|folder| directory.join(folder));
    for folder in [&csv, &drawn] {
        fs::create_dir_all(folder).with_context(|| format!("cannot create {}", folder.display()))?;
    }
    let exhibits = exhibits::all(analysis);
    let sections = exhibits::sections(analysis, &exhibits);
    write_text(&directory.join("report.html"), &page(analysis, &exhibits, &sections, command).to_html())?;
    write_text(&directory.join("report.json"), &to_json(analysis, &exhibits)?)?;
    write_text(&directory.join("seeds.csv"), &seeds(analysis))?;
    let (tables, figures): (Vec<_>, Vec<_>) =
        sections.into_iter().map(|section| (section.tables, section.figures)).unzip();
    write_figures(&figures.concat(), &drawn)?;
    for NamedTable { name, table, .. } in tables.iter().flatten() {
        write_text(&csv.join(format!("{name}.csv")), &table.render(Format::Csv))?;
    }
    let tables: Vec<Table> = tables.into_iter().flatten().map(|named| named.table).collect();
    write_text(&directory.join("tables.md"), &(render(&tables, Format::Markdown) + &warnings(analysis)))?;
    write_text(&directory.join("tables.tex"), &render(&tables, Format::Latex))?;
    write_text(&directory.join("metrics.md"), METRICS)
}

/// Writes every figure as SVG and PNG, on all cores: drawing pixels takes most of a report's time.
fn write_figures(figures: &[NamedFigure], directory: &Path) -> Result<()> {
    let next = AtomicUsize::new(0);
    let work = || -> Result<()> {
        while let Some(NamedFigure { name, drawing, .. }) = figures.get(next.fetch_add(1, Ordering::Relaxed)) {
            write_text(&directory.join(format!("{name}.svg")), &drawing.to_svg())?;
            let png = drawing.to_png(PNG_SCALE).with_context(|| format!("cannot draw the figure {name}"))?;
            write_bytes(&directory.join(format!("{name}.png")), &png)?;
        }
        Ok(())
    };
    let threads = thread::available_parallelism().map_or(1, NonZero::get).min(figures.len());
    thread::scope(|scope| {
        let workers: Vec<_> = (0..threads).map(|_| scope.spawn(work)).collect();
        workers.into_iter().try_for_each(|worker| worker.join().expect("a figure can be drawn"))
    })
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
