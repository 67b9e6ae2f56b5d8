//! The report as one page.

use std::collections::BTreeMap;

use charts::html::{Block, Column, Figure, Page, Section, Span, Table as HtmlTable, Text};

use crate::report::analysis::{Analysis, Arm, Protocol};
use crate::report::exhibits::{Definition, Exhibit, MISSING, MOST_ARMS, NamedFigure, NamedTable, Section as Shown};
use crate::report::table::{Cell, Table};
use crate::run::manifest::{Status, Versions};

/// Warnings that stand at the top; more of them stand with what is missing.
const MOST_AT_THE_TOP: usize = 10;

/// The whole report.
pub fn page(analysis: &Analysis, exhibits: &[Box<dyn Exhibit>], shown: &[Shown], command: &str) -> Page {
    let mut sections: Vec<Section> =
        exhibits.iter().zip(shown).map(|(exhibit, shown)| section(analysis, exhibit.as_ref(), shown)).collect();
    let all: Vec<Definition> = exhibits.iter().flat_map(|exhibit| exhibit.definitions()).collect();
    sections.push(definitions(&all));
    Page { title: "Comparison of runs".to_owned(), introduction: introduction(analysis, command), sections }
}

fn plain(text: impl Into<String>) -> Span {
    Span::Plain(text.into())
}

fn code(text: impl Into<String>) -> Span {
    Span::Code(text.into())
}

fn link(text: impl Into<String>, href: impl Into<String>) -> Span {
    Span::Link { text: text.into(), href: href.into() }
}

fn count(number: usize, one: &str, several: &str) -> String {
    if number == 1 { format!("1 {one}") } else { format!("{number} {several}") }
}

fn introduction(analysis: &Analysis, command: &str) -> Vec<Block> {
    let levels: Vec<&str> = analysis.levels.iter().map(|level| level.name.as_str()).collect();
    let summary = format!(
        "{} in {} on {}: {}.",
        count(analysis.runs.len(), "run", "runs"),
        count(analysis.arms.len(), "arm", "arms"),
        count(levels.len(), "level", "levels"),
        levels.join(", ")
    );
    let Versions { cpp_rl, git, libtorch } = Versions::here();
    let made = Text(vec![
        plain("Made by "),
        code(command),
        plain(format!(
            " with cpp-rl {cpp_rl} (commit {git}, libtorch {libtorch}). {} All numbers are in ",
            versions(analysis)
        )),
        link("report.json", "report.json"),
        plain(", those of single seeds in "),
        link("seeds.csv", "seeds.csv"),
        plain(", all tables in "),
        link("tables.md", "tables.md"),
        plain(" and, for LaTeX, "),
        link("tables.tex", "tables.tex"),
        plain("; every measure is defined in "),
        link("metrics.md", "metrics.md"),
        plain("."),
    ]);
    let mut blocks = vec![Block::from(summary.as_str()), Block::Table(arms(analysis)), Block::Paragraph(made)];
    if analysis.arms.len() > MOST_ARMS {
        let text = format!(
            "There are more than {MOST_ARMS} arms. Figures and tables for each of them are left out here; the folder \
             tables has the numbers. Orders of the levels and long sequences stand under Over positions."
        );
        blocks.push(Block::from(text.as_str()));
    }
    let (warnings, missing) = (&analysis.warnings, analysis.missing.len() + analysis.left_out.len());
    if warnings.len() <= MOST_AT_THE_TOP {
        blocks.extend(warnings.iter().map(|warning| Block::Warning(warning.as_str().into())));
    }
    if missing > 0 || warnings.len() > MOST_AT_THE_TOP {
        let mut text = count(missing, "run lacks results", "runs lack results");
        if warnings.len() > MOST_AT_THE_TOP {
            text += &format!(", and there are {} warnings", warnings.len());
        }
        text += ": see ";
        blocks.push(Block::Warning(Text(vec![plain(text), link(MISSING, anchor(MISSING)), plain(".")])));
    }
    blocks
}

/// What made the runs: a run that was resumed by another version counts for each.
fn versions(analysis: &Analysis) -> String {
    let mut runs: BTreeMap<&str, usize> = BTreeMap::new();
    for version in analysis.runs.iter().flat_map(|run| &run.versions) {
        *runs.entry(version).or_default() += 1;
    }
    let each = |(version, &number): (&&str, &usize)| format!("{version}: {}", count(number, "run", "runs"));
    format!("The runs were made by {}.", runs.iter().map(each).collect::<Vec<_>>().join("; "))
}

/// The link to a section.
fn anchor(heading: &str) -> String {
    format!("#{}", heading.to_lowercase().replace(' ', "-"))
}

/// The arms and how far their runs are.
fn arms(analysis: &Analysis) -> HtmlTable {
    let row = |(index, arm): (usize, &Arm)| {
        let runs = || analysis.runs.iter().filter(|run| run.arm == index);
        let with = |is: fn(&Status) -> bool| runs().filter(|run| is(&run.status)).count().to_string();
        let levels = arm.stages.iter().map(|stage| analysis.levels[stage.level].name.as_str()).collect::<Vec<_>>();
        let how = match arm.protocol {
            Protocol::Curriculum => "one after another",
            Protocol::FromScratch => "each from scratch",
            Protocol::Fork => "on from a checkpoint",
        };
        vec![
            arm.name.clone(),
            how.to_owned(),
            levels.join(", "),
            seeds(&arm.seeds),
            runs().count().to_string(),
            with(|status| *status == Status::Finished),
            with(|status| matches!(status, Status::Running | Status::Interrupted)),
            with(|status| matches!(status, Status::Failed(_))),
        ]
    };
    let texts = ["arm", "trained", "levels", "seeds"].map(Column::text);
    let numbers = ["runs", "finished", "unfinished", "failed"].map(Column::numeric);
    HtmlTable {
        caption: Text::default(),
        columns: texts.into_iter().chain(numbers).collect(),
        rows: analysis.arms.iter().enumerate().map(row).collect(),
    }
}

/// Seeds in short: "0–4, 7".
fn seeds(seeds: &[u64]) -> String {
    let run = |run: &[u64]| match run {
        [first, .., last] => format!("{first}–{last}"),
        _ => run.iter().map(u64::to_string).collect(),
    };
    seeds.chunk_by(|a, b| a + 1 == *b).map(run).collect::<Vec<_>>().join(", ")
}

fn section(analysis: &Analysis, exhibit: &dyn Exhibit, shown: &Shown) -> Section {
    let figures = shown.figures.iter().map(|named| Block::Figure(figure(named, &shown.tables)));
    let is_left_out = |named: &&NamedTable| named.is_of_one_arm && analysis.arms.len() > MOST_ARMS;
    let (elsewhere, here): (Vec<&NamedTable>, Vec<&NamedTable>) = shown.tables.iter().partition(is_left_out);
    let mut blocks: Vec<Block> = figures.chain(here.iter().flat_map(|named| table(&named.table))).collect();
    if let Some(first) = elsewhere.first() {
        let each = count(elsewhere.len(), "table of one arm", "tables of one arm each");
        let text = vec![
            plain(format!("{each} can be found in the folder tables, such as ")),
            link(format!("{}.csv", first.name), format!("tables/{}.csv", first.name)),
            plain("."),
        ];
        blocks.push(Block::Paragraph(Text(text)));
    }
    if blocks.is_empty() {
        blocks.push(exhibit.absence().into());
    } else if !exhibit.lead().is_empty() {
        blocks.insert(0, exhibit.lead().into());
    }
    if exhibit.heading() == MISSING && analysis.warnings.len() > MOST_AT_THE_TOP {
        blocks.push(Block::List(analysis.warnings.iter().map(|warning| warning.as_str().into()).collect()));
    }
    Section::new(exhibit.heading(), blocks)
}

fn figure(named: &NamedFigure, tables: &[NamedTable]) -> Figure {
    let NamedFigure { name, caption, drawing, .. } = named;
    let drawn = ["SVG", "PNG"].map(|kind| (kind.to_owned(), format!("figures/{name}.{}", kind.to_lowercase())));
    let exists = |name: &&String| tables.iter().any(|table| table.name == **name);
    let numbers = named.tables.iter().filter(exists).map(|name| (format!("{name}.csv"), format!("tables/{name}.csv")));
    Figure { files: drawn.into_iter().chain(numbers).collect(), ..Figure::new(drawing.clone(), caption.as_str()) }
}

/// A table and the notes below it.
fn table(table: &Table) -> Vec<Block> {
    let is_numeric = |column: usize| table.rows.iter().any(|row| !matches!(row[column], Cell::Text(_) | Cell::Missing));
    let column = |(place, heading): (usize, &String)| Column { heading: heading.clone(), numeric: is_numeric(place) };
    let shown = |cell: &Cell| cell.shown(" ± ").replace('-', "−");
    let cell = |cell: &Cell| if let Cell::Text(text) = cell { text.clone() } else { shown(cell) };
    let content = HtmlTable {
        caption: table.title.as_str().into(),
        columns: table.columns.iter().enumerate().map(column).collect(),
        rows: table.rows.iter().map(|row| row.iter().map(cell).collect()).collect(),
    };
    let notes = table.notes.join(" ");
    let mut blocks = vec![Block::Table(content)];
    if !notes.is_empty() {
        blocks.push(notes.as_str().into());
    }
    blocks
}

fn definitions(all: &[Definition]) -> Section {
    let definition = |Definition { name, meaning, place }: &Definition| {
        let href = format!("metrics.md#{place}");
        Text(vec![
            Span::Strong((*name).to_owned()),
            plain(format!(": {meaning} (")),
            link("in full", href),
            plain(")."),
        ])
    };
    Section::new("Definitions", vec![Block::List(all.iter().map(definition).collect())])
}
