//! Levels of a study that a generator makes.

use std::sync::Arc;

use coverage_env::Level;
use coverage_env::generator::LevelSpec;

use super::node::{Node, Source};
use crate::error::UserError;

/// The keys of a specification, which are those of `cpp-rl levels generate`, and how many levels there are.
const KEYS: [&str; 6] = ["height", "width", "wall_density", "targets", "count", "seed"];
/// The most levels of one specification.
const MAX_LEVELS: u64 = 10_000;

/// The levels of a specification: `count` of them, by the seeds from `seed` on. What it does not say is as in
/// `cpp-rl levels generate`.
pub(super) fn levels(node: &Node, source: &Source<'_>) -> Result<Vec<Arc<Level>>, UserError> {
    let fields = node.fields(source, "generate", &KEYS)?;
    let integer = |key: &str, default: u64, most: u64| match fields.get(key) {
        Some(node) => node.integer(source, key, 0..=most),
        None => Ok(default),
    };
    let wall_density = fields.get("wall_density").map_or(Ok(0.2), |node| node.number(source, "wall_density"))?;
    let size = |key: &str| integer(key, 8, u64::from(u32::MAX)).map(|size| size as usize);
    let (height, width, num_targets) = (size("height")?, size("width")?, size("targets")?);
    let first = integer("seed", 0, u64::MAX - MAX_LEVELS)?;
    let count = match fields.get("count") {
        Some(node) => node.integer(source, "count", 1..=MAX_LEVELS)?,
        None => 1,
    };
    let level = |seed| {
        let spec = LevelSpec { height, width, wall_density, num_targets, seed };
        let level = spec.generate().map_err(|problem| source.refuse(node.at, format_args!("generate: {problem}")))?;
        Ok(Arc::new(level))
    };
    (first..first + count).map(level).collect()
}
