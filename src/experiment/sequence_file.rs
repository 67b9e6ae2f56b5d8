//! `sequence:` of a study file.

use std::fmt::Display;
use std::sync::Arc;

use coverage_env::Level;
use serde_saphyr::Location;

use super::curriculum;
use super::levels;
use super::node::{Content, Node, Source};
use super::orders::{num_permutations, permutations, williams};
use super::sequence::{Order, Sequences, Through};
use super::timesteps::{POSSIBLE, Timesteps};
use crate::config::nearest;
use crate::error::UserError;

const KEYS: [&str; 6] = ["levels", "timesteps", "repeat", "order", "shift", "seeds"];
/// The words that `order` can be.
const ORDERS: [&str; 2] = ["all", "williams"];
/// The most levels of which every order is made: 8! = 40,320 orders.
const MAX_PERMUTED: usize = 8;
/// The most levels of a Williams design, which is as many orders or twice as many.
const MAX_BALANCED: usize = 1000;

/// Levels one after another, each once.
pub(super) fn plain(levels: Vec<Arc<Level>>) -> Result<Sequences, UserError> {
    Sequences::new(vec![Order { name: None, levels }], 1, None, Through::All)
}

/// Reads a sequence: a list of levels, or a mapping. `known` are the study's levels, and those that it orders where it
/// names none.
pub(super) fn read(node: &Node, source: &Source<'_>, known: &[Arc<Level>]) -> Result<Sequences, UserError> {
    let at_node = |problem: UserError| source.refuse(node.at, format_args!("sequence: {problem}"));
    if let Content::List(_) = node.content {
        return plain(levels::read(node, source, known)?).map_err(at_node);
    }
    let fields = node.fields(source, "sequence", &KEYS)?;
    let own = fields.get("levels").map(|node| levels::read(node, source, known)).transpose()?;
    let levels = own.unwrap_or_else(|| known.to_vec());
    let repeat = fields.get("repeat").map_or(Ok(1), |node| node.integer(source, "repeat", 1..=u64::from(u16::MAX)))?;
    let timesteps = fields.get("timesteps").map(|node| timesteps(node, source)).transpose()?;
    let shift = fields.get("shift").map(|node| node.word(source, "shift", &["by-seed"])).transpose()?;
    let seeds = fields.get("seeds").map(|node| node.word(source, "seeds", &["in-turn"])).transpose()?;
    let through = match (shift, seeds) {
        (None, None) => Through::All,
        (Some(_), None) => Through::Shifted,
        (None, Some(_)) => Through::InTurn,
        (Some(_), Some(_)) => {
            let at = fields.get("seeds").map_or(node.at, |node| node.at);
            return Err(source.refuse(at, "seeds: in-turn and shift: by-seed cannot both be: drop one of the two"));
        }
    };
    let orders = match fields.get("order") {
        Some(node) => orders(node, source, &levels)?,
        None if levels.is_empty() => {
            return Err(source.refuse(node.at, "sequence: it has no levels: add levels, here or to the study"));
        }
        None => vec![Order { name: None, levels }],
    };
    let at = |problem: &UserError| {
        // The part of the sequence that the message is about.
        let part = KEYS.iter().find(|key| problem.to_string().starts_with(&format!("{key}: ")));
        part.and_then(|key| fields.get(key)).map_or(node.at, |node| node.at)
    };
    Sequences::new(orders, repeat as usize, timesteps, through)
        .map_err(|problem| source.refuse(at(&problem), format_args!("sequence: {problem}")))
}

fn timesteps(node: &Node, source: &Source<'_>) -> Result<Timesteps, UserError> {
    match &node.content {
        Content::List(_) => {
            let list = node.list(source, "timesteps", "name those of each stage")?;
            let each = list.iter().map(|node| node.integer(source, "timesteps", POSSIBLE));
            Ok(Timesteps::List(each.collect::<Result<_, _>>()?))
        }
        _ => Ok(Timesteps::Each(node.integer(source, "timesteps", POSSIBLE)?)),
    }
}

/// The orders that `order` says, of these levels.
fn orders(node: &Node, source: &Source<'_>, levels: &[Arc<Level>]) -> Result<Vec<Order>, UserError> {
    match &node.content {
        Content::Scalar(_) => {
            let word = word(node, source)?;
            if levels.is_empty() {
                return Err(source.refuse(node.at, format_args!("order: {word} has no levels: add levels")));
            }
            by_word(word, levels, node.at, source)
        }
        Content::List(_) => {
            let remedy = "name each order as a list of levels, such as [[0, 1], [1, 0]]";
            let lists = node.list(source, "order", remedy)?;
            let order = |node: &Node| {
                let Content::List(_) = node.content else {
                    return Err(source.refuse(node.at, format_args!("order: {node} is no list: {remedy}")));
                };
                Ok(Order { name: None, levels: levels::read(node, source, levels)? })
            };
            lists.iter().map(order).collect()
        }
        Content::Map(entries) if entries.is_empty() => {
            Err(source.refuse(node.at, "order: it names no order: add one, such as forward: [0, 1]"))
        }
        Content::Map(entries) => {
            let order = |(name, _, node): &(String, Location, Node)| {
                Ok(Order { name: Some(name.clone()), levels: levels::read(node, source, levels)? })
            };
            entries.iter().map(order).collect()
        }
    }
}

fn word(node: &Node, source: &Source<'_>) -> Result<&'static str, UserError> {
    let text = node.value().as_str().map_or_else(|| node.to_string(), str::to_owned);
    ORDERS.into_iter().find(|word| *word == text).ok_or_else(|| {
        let meant = nearest(&text, &ORDERS).map_or_else(String::new, |word| format!("; did you mean \"{word}\"?"));
        let expected = "all, williams, or a list of orders such as [[0, 1], [1, 0]]";
        source.refuse(node.at, format_args!("order: expected {expected}, got {node}{meant}"))
    })
}

fn by_word(word: &str, levels: &[Arc<Level>], at: Location, source: &Source<'_>) -> Result<Vec<Order>, UserError> {
    let refuse = |problem: &dyn Display| Err(source.refuse(at, format_args!("order: {problem}")));
    let distinct = curriculum::distinct(levels).map_err(|problem| source.refuse(at, problem))?;
    if distinct.len() < levels.len() {
        return refuse(&format_args!("{word} orders different levels, but one stands twice: name each level once"));
    }
    let n = levels.len();
    let places = match word {
        "all" if n > MAX_PERMUTED => {
            let orders = num_permutations(n);
            let orders = if orders == u64::MAX { format!("more than {orders}") } else { orders.to_string() };
            let remedy = format!("at most {MAX_PERMUTED} levels are possible; williams makes a balanced choice");
            return refuse(&format_args!("all orders of {n} levels are {orders}: {remedy}"));
        }
        "williams" if n > MAX_BALANCED => {
            return refuse(&format_args!("williams: at most {MAX_BALANCED} levels are possible, got {n}"));
        }
        "all" => permutations(n),
        _ => williams(n),
    };
    let order = |places: Vec<usize>| Order { name: None, levels: places.iter().map(|&i| levels[i].clone()).collect() };
    Ok(places.into_iter().map(order).collect())
}
