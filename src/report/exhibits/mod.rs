//! What a report shows: one file per topic, which holds its numbers, its tables, its figures and their words.
//!
//! To add one: write a file with an [`Exhibit`], and name it in [`all`].

pub mod aggregates;
pub mod continual;
pub mod doses;
mod exhibit;
pub mod from_scratch;
pub mod improvement;
mod learning;
mod levels;
mod matrix;
mod missing;
mod parts;
pub mod plasticity;
pub mod positions;
mod published_runs;
mod returns;
mod settings;
pub mod treatments;

pub use exhibit::{Definition, Exhibit, NamedFigure, NamedTable};
pub use levels::draw_levels;
pub use matrix::{after_stage_of_arm, of_arm as matrix_of_arm};
pub use missing::HEADING as MISSING;

use super::analysis::Analysis;
use super::names::make_unique;
use super::published::TITLE;
use super::table::{Cell, Table};

/// With more arms than this, figures with a line or a panel per arm are left out: nobody could read them.
pub const MOST_ARMS: usize = 30;

/// Every exhibit, in the order of a report.
pub fn all(analysis: &Analysis) -> Vec<Box<dyn Exhibit>> {
    let mut all: Vec<Box<dyn Exhibit>> = vec![
        Box::new(levels::Levels),
        Box::new(learning::Learning::new(analysis)),
        Box::new(returns::Returns),
        Box::new(aggregates::Aggregates::new(analysis)),
        Box::new(improvement::Improvements::new(analysis)),
        Box::new(matrix::Matrices),
        Box::new(continual::Continual::new(analysis)),
        Box::new(from_scratch::FromScratch::new(analysis)),
        Box::new(treatments::Treatments::new(analysis)),
        Box::new(plasticity::Plasticity::new(analysis)),
        Box::new(plasticity::layers::Layers),
        Box::new(settings::Settings),
        Box::new(missing::Missing),
    ];
    if positions::are_worth_it(analysis) {
        let place = all.iter().position(|exhibit| exhibit.key() == treatments::TREATMENTS).unwrap_or(all.len());
        all.insert(place, Box::new(positions::Positions::new(analysis)));
    }
    let doses = doses::Doses::new(analysis);
    if !doses.sweeps.is_empty() {
        let place = all.iter().position(|exhibit| exhibit.key() == treatments::TREATMENTS).unwrap_or(all.len());
        all.insert(place, Box::new(doses));
    }
    // A report of other levels does not speak of the paper.
    if analysis.published.is_some() {
        let place = all.iter().position(|exhibit| exhibit.key() == continual::KEY).unwrap_or(all.len());
        all.insert(place, Box::new(published_runs::PublishedRuns));
    }
    all
}

/// The tables and figures of one exhibit.
pub struct Section {
    /// Tables with rows.
    pub tables: Vec<NamedTable>,
    /// Figures.
    pub figures: Vec<NamedFigure>,
}

/// The sections of these exhibits, with names that no two tables, nor two figures, have in common.
pub fn sections(analysis: &Analysis, exhibits: &[Box<dyn Exhibit>]) -> Vec<Section> {
    let has_figures = |exhibit: &dyn Exhibit| analysis.arms.len() <= MOST_ARMS || exhibit.fits_many_arms();
    let section = |exhibit: &dyn Exhibit| Section {
        tables: shown(exhibit.tables(analysis)),
        figures: if has_figures(exhibit) { exhibit.figures(analysis) } else { Vec::new() },
    };
    let mut all: Vec<Section> = exhibits.iter().map(|exhibit| section(exhibit.as_ref())).collect();
    make_unique(all.iter_mut().flat_map(|section| &mut section.tables).map(|table| &mut table.name));
    make_unique(all.iter_mut().flat_map(|section| &mut section.figures).map(|figure| &mut figure.name));
    cite(all.iter_mut().flat_map(|section| &mut section.tables).map(|named| &mut named.table));
    all
}

/// The tables that a terminal gets: what each arm earns, what it forgets, whether it learns worse than from scratch,
/// and in what the arms differ.
pub fn main_tables(analysis: &Analysis, exhibits: &[Box<dyn Exhibit>]) -> Vec<Table> {
    let main = exhibits.iter().flat_map(|exhibit| shown(exhibit.tables(analysis))).filter(|named| named.is_main);
    let mut tables: Vec<Table> = main.map(|named| named.table).collect();
    cite(tables.iter_mut());
    tables
}

/// Those with rows, each with a note where cells are of other seeds than their row.
fn shown(mut tables: Vec<NamedTable>) -> Vec<NamedTable> {
    tables.retain(|named| !named.table.rows.is_empty());
    for NamedTable { table, .. } in &mut tables {
        let is_other = |cell: &Cell| matches!(cell, Cell::OfSeeds(..));
        if table.rows.iter().flatten().any(is_other) {
            let note = "(n = …): only so many seeds have a result there. One seed has no spread.";
            table.notes.push(note.to_owned());
        }
    }
    tables
}

/// Names the paper by its title below the first table that speaks of it.
pub fn cite<'a>(tables: impl IntoIterator<Item = &'a mut Table>) {
    let speaks = |table: &&mut Table| {
        let published = |cell: &Cell| matches!(cell, Cell::Text(text) if text.ends_with("(published)"));
        table.title.contains("the paper") || table.rows.iter().flatten().any(published)
    };
    if let Some(table) = tables.into_iter().find(speaks) {
        table.notes.push(format!("The paper: “{TITLE}”."));
    }
}
