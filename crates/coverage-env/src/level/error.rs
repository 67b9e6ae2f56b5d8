//! What can be wrong with a level, said so that its author can mend it.

use std::io;

use super::{BUILTIN_IDS, MAX_CELLS, MAX_FILE_BYTES, MAX_NAME_BYTES};

/// A level that cannot be used: where it came from and what is wrong with it.
#[derive(Debug, thiserror::Error)]
#[error("{origin}: {defect}")]
pub struct LevelError {
    origin: String,
    defect: Box<LevelDefect>,
}

impl LevelError {
    pub(super) fn new(origin: impl Into<String>, defect: LevelDefect) -> LevelError {
        LevelError { origin: origin.into(), defect: Box::new(defect) }
    }

    /// The file, or the name, of the level.
    pub fn origin(&self) -> &str {
        &self.origin
    }

    /// What is wrong.
    pub fn defect(&self) -> &LevelDefect {
        &self.defect
    }
}

/// What is wrong with a level.
///
/// Fields count rows, columns and lines from 0; the messages count from 1, as text editors do.
/// Every message ends in what to do about it.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum LevelDefect {
    /// Neither a built-in level nor a file.
    #[error(
        "neither a built-in level ({}) nor an existing file; give one of these ids or the path of a level's YAML file",
        BUILTIN_IDS.join(", ")
    )]
    Unknown,
    /// The file cannot be opened or read.
    #[error("cannot be read ({error}); give the path of a readable YAML file")]
    Unreadable {
        /// What the operating system answered.
        error: io::Error,
    },
    /// The file is larger than any level needs.
    #[error("larger than {MAX_FILE_BYTES} bytes, which no level needs; is it the right file?")]
    FileTooLarge,
    /// The file is not UTF-8 text.
    #[error("line {}: not UTF-8 text; save the file in the encoding UTF-8", .line + 1)]
    NotUtf8 {
        /// The line with the first offending byte.
        line: usize,
    },
    /// Not YAML, or not of a level's form: bad syntax, unknown or repeated keys, wrong types.
    #[error("{message}; a level is a `map: |` block of '.', '#' and 'T', and optionally a `name:`")]
    Yaml {
        /// The parser's message, with line and column.
        message: String,
    },
    /// There is no `map` key, or it has no value.
    #[error("no map; add a `map: |` block with indented rows of '.', '#' and 'T'")]
    NoMap,
    /// The name is a built-in level's, and the map is not.
    #[error(
        "the name {name:?} belongs to a built-in level with another map, so that results could not be told apart; \
         give this level a `name:` of its own"
    )]
    TakenName {
        /// The name, given or the file's stem.
        name: String,
    },
    /// The name is empty, too long, or not fit for a path.
    #[error(
        "the name {name:?} is empty, longer than {MAX_NAME_BYTES} bytes, or has control characters, '/' or '\\'; choose another"
    )]
    Name {
        /// The name as given.
        name: String,
    },
    /// The map has no rows.
    #[error("the map is empty; write rows of '.' (free), '#' (wall) and 'T' (target)")]
    EmptyMap,
    /// More cells than [`MAX_CELLS`].
    #[error("the map has more than {MAX_CELLS} cells (height times width); make it smaller")]
    TooManyCells,
    /// A character that means nothing.
    #[error(
        "row {}, column {}: unknown character {character:?}; use '.' (free), '#' (wall) or 'T' (target)",
        .row + 1, .column + 1
    )]
    UnknownCharacter {
        /// Its row.
        row: usize,
        /// Its column.
        column: usize,
        /// The character.
        character: char,
    },
    /// A row whose length differs from the first one's.
    #[error(
        "row {}, column {}: the row has {length} cells and the first row has {width}; make all rows equally long",
        .row + 1, .length.min(.width) + 1
    )]
    RaggedRow {
        /// The row.
        row: usize,
        /// How many cells it has.
        length: usize,
        /// How many the first row has.
        width: usize,
    },
    /// Nothing to visit.
    #[error("the map has no target; mark the cells to visit with 'T'")]
    NoTarget,
    /// Nowhere to start.
    #[error("the map has no start cell; leave at least one cell free ('.')")]
    NoStart,
    /// A target that no start can reach.
    #[error(
        "row {}, column {}: no start cell can reach this target; open a way to it, or make it a wall ('#')",
        .row + 1, .column + 1
    )]
    UnreachableTarget {
        /// The target's row.
        row: usize,
        /// The target's column.
        column: usize,
    },
    /// A start from which some target cannot be reached.
    #[error(
        "row {}, column {}: this free cell is a start that cannot reach the target at row {}, column {}; \
         make it a wall ('#'), or open a way",
        .row + 1, .column + 1, .target_row + 1, .target_column + 1
    )]
    TrappedStart {
        /// The start's row.
        row: usize,
        /// The start's column.
        column: usize,
        /// The row of the first target out of reach.
        target_row: usize,
        /// The column of the first target out of reach.
        target_column: usize,
    },
}
