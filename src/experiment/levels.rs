//! The levels that a study file names.

use std::sync::Arc;

use coverage_env::Level;

use super::generate;
use super::node::{Content, Node, Source};
use crate::error::UserError;

/// What an empty list of levels is told.
const REMEDY: &str = "name at least one level";

/// Every entry of `levels`: a list of ids, paths and specifications, or one specification. A name stands for one of
/// `known` first.
pub(super) fn read(node: &Node, source: &Source<'_>, known: &[Arc<Level>]) -> Result<Vec<Arc<Level>>, UserError> {
    if let Content::Map(_) = node.content {
        return of_entry(node, source, known);
    }
    let mut levels = Vec::new();
    for entry in node.list(source, "levels", REMEDY)? {
        levels.extend(of_entry(entry, source, known)?);
    }
    Ok(levels)
}

/// The levels of one entry: several only of a specification.
fn of_entry(node: &Node, source: &Source<'_>, known: &[Arc<Level>]) -> Result<Vec<Arc<Level>>, UserError> {
    match &node.content {
        Content::Map(_) => {
            let fields = node.fields(source, "levels", &["generate"])?;
            generate::levels(fields.need(source, "levels", "generate")?, source)
        }
        Content::Scalar(_) => Ok(vec![named(node, source, known)?]),
        Content::List(_) => {
            Err(source.refuse(node.at, "levels: expected a level's id or path, or generate: {…}, got a list"))
        }
    }
}

/// One level by its name or path.
fn named(node: &Node, source: &Source<'_>, known: &[Arc<Level>]) -> Result<Arc<Level>, UserError> {
    let is_number = matches!(&node.content, Content::Scalar(value) if value.is_number());
    let id = if is_number { node.to_string() } else { node.text(source, "levels")?.to_owned() };
    if let Some(level) = known.iter().find(|level| level.name() == id) {
        return Ok(level.clone());
    }
    let level = match Level::builtin(&id) {
        Some(level) => Ok(level),
        None if is_number => Level::resolve(&id),
        None => Level::from_path(&source.beside(&id)),
    };
    level.map(Arc::new).map_err(|error| source.refuse(node.at, error))
}
