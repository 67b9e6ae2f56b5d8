//! One HTML file for a report: sections, tables, warnings and figures, with nothing to load and no scripts.
//!
//! A [`Page`] is data; [`Page::to_html`] writes it as HTML5. All texts are escaped. The page follows the reader's
//! light or dark scheme, its figures with it; tables and wide figures scroll inside their own boxes on narrow
//! screens; printed, it is light.
//!
//! ```
//! use charts::html::{Block, Page, Section};
//!
//! let page = Page {
//!     title: "Results".to_owned(),
//!     sections: vec![Section::new("Returns", vec![Block::from("All seeds < 3 failed.")])],
//!     ..Page::default()
//! };
//! assert!(page.to_html().contains("All seeds &lt; 3 failed."));
//! ```

mod page;

use crate::drawing::Drawing;

/// A whole document.
#[derive(Clone, Debug, Default)]
pub struct Page {
    /// Its name, in the browser's tab and as its first heading.
    pub title: String,
    /// What stands before the table of contents.
    pub introduction: Vec<Block>,
    /// Its sections; they make the table of contents.
    pub sections: Vec<Section>,
}

/// A heading and what stands below it.
#[derive(Clone, Debug, Default)]
pub struct Section {
    /// The heading.
    pub heading: String,
    /// What stands directly below it.
    pub blocks: Vec<Block>,
}

impl Section {
    /// A section.
    pub fn new(heading: impl Into<String>, blocks: Vec<Block>) -> Self {
        Self { heading: heading.into(), blocks }
    }
}

/// A piece of a page.
#[derive(Clone, Debug)]
pub enum Block {
    /// Running text.
    Paragraph(Text),
    /// What a reader must not miss: missing runs, settings that differ.
    Warning(Text),
    /// Points, in no order.
    List(Vec<Text>),
    /// Numbers in rows and columns.
    Table(Table),
    /// A chart.
    Figure(Figure),
}

/// A paragraph of plain text.
impl From<&str> for Block {
    fn from(text: &str) -> Self {
        Self::Paragraph(text.into())
    }
}

/// Running text.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Text(pub Vec<Span>);

/// A part of a running text.
#[derive(Clone, Debug, PartialEq)]
pub enum Span {
    /// As it is.
    Plain(String),
    /// Emphasised.
    Strong(String),
    /// A name from a terminal or a file.
    Code(String),
    /// A link to a file beside the page, a place in it ("#…") or the web.
    Link {
        /// What is read.
        text: String,
        /// Where it leads.
        href: String,
    },
}

impl From<&str> for Text {
    fn from(text: &str) -> Self {
        text.to_owned().into()
    }
}

impl From<String> for Text {
    fn from(text: String) -> Self {
        Self(vec![Span::Plain(text)])
    }
}

/// A table whose first column names its rows.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Table {
    /// Stands above it; empty for none.
    pub caption: Text,
    /// The columns' headings, from the left.
    pub columns: Vec<Column>,
    /// The cells, row by row. Missing ones at a row's end are left empty.
    pub rows: Vec<Vec<String>>,
}

/// The heading of a column, and how its cells are set.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Column {
    /// The heading.
    pub heading: String,
    /// Whether its cells are numbers, set flush right.
    pub numeric: bool,
}

impl Column {
    /// A column of texts.
    pub fn text(heading: impl Into<String>) -> Self {
        Self { heading: heading.into(), numeric: false }
    }

    /// A column of numbers.
    pub fn numeric(heading: impl Into<String>) -> Self {
        Self { heading: heading.into(), numeric: true }
    }
}

/// A chart with its caption.
#[derive(Clone, Debug)]
pub struct Figure {
    /// The chart.
    pub drawing: Drawing,
    /// Stands below it, after "Figure 1." and so on.
    pub caption: Text,
    /// Files with the same figure or its data: what is read, and where it lies.
    pub files: Vec<(String, String)>,
}

impl Figure {
    /// A figure without files.
    pub fn new(drawing: Drawing, caption: impl Into<Text>) -> Self {
        Self { drawing, caption: caption.into(), files: Vec::new() }
    }
}
