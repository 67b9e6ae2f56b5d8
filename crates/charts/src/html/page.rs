//! A page as HTML.

use base64::Engine;
use base64::prelude::BASE64_STANDARD;
use maud::{DOCTYPE, Markup, PreEscaped, html};

use super::{Block, Figure, Page, Section, Span, Table, Text};
use crate::{color, font};

const STYLE: &str = include_str!("style.css");

/// CSS pixels per point of a figure: its 7 pt ticks read like 11 px.
const PIXELS: f64 = 1.6;
/// The least, on narrow screens; a wider figure scrolls.
const LEAST_PIXELS: f64 = 1.15;

impl Page {
    /// The page as one HTML5 document.
    pub fn to_html(&self) -> String {
        let mut ids = Vec::new();
        let sections: Vec<Numbered> = self.sections.iter().map(|section| Numbered::new(section, &mut ids)).collect();
        let mut figures = 0;
        let font = BASE64_STANDARD.encode(font::ARIMO);
        let style = format!(
            "{}\n@font-face{{font-family:Arimo;src:url(data:font/ttf;base64,{font})}}\n{STYLE}",
            color::stylesheet()
        );
        let page = html! {
            (DOCTYPE)
            html lang="en" {
                head {
                    meta charset="utf-8";
                    meta name="viewport" content="width=device-width, initial-scale=1";
                    title { (self.title) }
                    style { (PreEscaped(style)) }
                }
                body {
                    main {
                        h1 { (self.title) }
                        (blocks(&self.introduction, &mut figures))
                        @if !sections.is_empty() {
                            nav aria-label="Contents" { (contents(&sections)) }
                        }
                        @for section in &sections { (section.markup(&mut figures)) }
                    }
                }
            }
        };
        page.into_string() + "\n"
    }
}

/// A section with the name by which links find it.
struct Numbered<'a> {
    section: &'a Section,
    id: String,
}

impl<'a> Numbered<'a> {
    fn new(section: &'a Section, ids: &mut Vec<String>) -> Self {
        let id = unused_id(&section.heading, ids);
        ids.push(id.clone());
        Self { section, id }
    }

    fn markup(&self, figures: &mut usize) -> Markup {
        html! {
            section id=(self.id) {
                h2 { (self.section.heading) }
                (blocks(&self.section.blocks, figures))
            }
        }
    }
}

/// `heading` in lower-case words joined by hyphens, numbered if another heading has that id.
fn unused_id(heading: &str, ids: &[String]) -> String {
    let words: Vec<String> =
        heading.split(|c: char| !c.is_alphanumeric()).filter(|word| !word.is_empty()).map(str::to_lowercase).collect();
    let id = if words.is_empty() { "section".to_owned() } else { words.join("-") };
    let numbered = (2..).map(|number| format!("{id}-{number}"));
    std::iter::once(id.clone()).chain(numbered).find(|id| !ids.contains(id)).expect("there is always a next number")
}

fn contents(sections: &[Numbered]) -> Markup {
    html! {
        ul {
            @for section in sections {
                li { a href={ "#" (section.id) } { (section.section.heading) } }
            }
        }
    }
}

fn blocks(blocks: &[Block], figures: &mut usize) -> Markup {
    html! {
        @for block in blocks {
            @match block {
                Block::Paragraph(text) => p { (spans(text)) },
                Block::Warning(text) => p.warning role="note" { strong { "Warning: " } (spans(text)) },
                Block::List(points) => ul { @for point in points { li { (spans(point)) } } },
                Block::Table(content) => (table(content)),
                Block::Figure(content) => {
                    @let number = next(figures);
                    (figure(content, number))
                },
            }
        }
    }
}

fn next(count: &mut usize) -> usize {
    *count += 1;
    *count
}

fn spans(text: &Text) -> Markup {
    html! {
        @for span in &text.0 {
            @match span {
                Span::Plain(text) => (text),
                Span::Strong(text) => strong { (text) },
                Span::Code(text) => code { (text) },
                Span::Link { text, href } => a href=(href) { (text) },
            }
        }
    }
}

/// The box is in the order of the Tab key, so that a keyboard can scroll it.
fn table(table: &Table) -> Markup {
    let class = |column: usize| table.columns.get(column).filter(|column| column.numeric).map(|_| "numeric");
    html! {
        div.scroll tabindex="0" {
            table {
                @if !table.caption.0.is_empty() { caption { span { (spans(&table.caption)) } } }
                thead { tr {
                    @for (i, column) in table.columns.iter().enumerate() {
                        th scope="col" class=[class(i)] { (column.heading) }
                    }
                } }
                tbody {
                    @for row in &table.rows {
                        tr {
                            @for i in 0..row.len().max(table.columns.len()) {
                                @let cell = row.get(i).map_or("", String::as_str);
                                @if i == 0 { th scope="row" class=[class(i)] { (cell) } }
                                @else { td class=[class(i)] { (cell) } }
                            }
                        }
                    }
                }
            }
        }
    }
}

fn figure(figure: &Figure, number: usize) -> Markup {
    let width = figure.drawing.width();
    let size =
        format!("width:{:.0}px;min-width:min({:.0}px,{:.0}px)", PIXELS * width, PIXELS * width, LEAST_PIXELS * width);
    html! {
        figure id={ "figure-" (number) } {
            div.scroll tabindex="0" {
                div.drawing style=(size) { (PreEscaped(figure.drawing.to_svg())) }
            }
            figcaption {
                strong { "Figure " (number) ". " } (spans(&figure.caption))
                @for (i, (text, href)) in figure.files.iter().enumerate() {
                    @if i == 0 { " " } @else { " · " }
                    a href=(href) { (text) }
                }
            }
        }
    }
}
