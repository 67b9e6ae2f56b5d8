//! Reads forks and treatments from a study file, and a treatment from the command line.

use std::path::Path;

use coverage_env::Level;
use serde_json::Map;

use super::fork::{Fork, OF_COPY, config_of, name_of};
use super::node::{Content, Node, Source};
use super::timesteps::POSSIBLE;
use crate::agent::config::Config;
use crate::agent::network::Network;
use crate::agent::treatment::{NONE, Parts, Place, Treatment};
use crate::config::{check_name, nearest};
use crate::error::UserError;

const FORK_KEYS: [&str; 5] = ["after", "stages", "timesteps", "treatments", "grid"];
const TREATMENT_KEYS: [&str; 4] = ["weights", "optimizer", "scale", "set"];
/// The most treatments of one grid.
const MAX_CELLS: usize = 10_000;

/// What treatments are checked against.
pub(super) struct Parent<'a> {
    /// The settings of the agents that are treated.
    pub(super) config: &'a Config,
    /// A level of their curriculum.
    pub(super) level: &'a Level,
    /// Stages of their shortest curriculum.
    pub(super) stages: usize,
}

/// The forks of an arm: every treatment after every stage that is named.
///
/// # Errors
/// The first thing that cannot be taken, with its place.
pub(super) fn forks(node: &Node, source: &Source<'_>, parent: &Parent<'_>) -> Result<Vec<Fork>, UserError> {
    let fields = node.fields(source, "fork", &FORK_KEYS)?;
    let most = u64::try_from(parent.stages).unwrap_or(u64::MAX);
    let last = most.saturating_sub(2);
    let after = fields.need(source, "fork", "after")?;
    if most < 2 {
        let problem = "fork: the curriculum has one stage, and none after it: add a level, or drop the fork";
        return Err(source.refuse(after.at, problem));
    }
    let stage = |node: &Node| node.integer(source, "fork: after", 0..=last).map(|stage| stage as u16);
    let after: Vec<(u16, &Node)> = match &after.content {
        Content::List(_) => {
            let nodes = after.list(source, "fork: after", "name stages from 0, such as [0, 1]")?;
            nodes.iter().map(|node| Ok((stage(node)?, node))).collect::<Result<_, UserError>>()?
        }
        _ => vec![(stage(after)?, after)],
    };
    for (place, (number, node)) in after.iter().enumerate() {
        if after[..place].iter().any(|(other, _)| other == number) {
            return Err(source.refuse(node.at, format_args!("fork: after: {number} stands twice: drop one of them")));
        }
    }
    let stages = match fields.get("stages") {
        Some(node) => {
            // The latest fork has the fewest stages left.
            let left = most - 1 - after.iter().map(|(stage, _)| u64::from(*stage)).max().unwrap_or(0);
            node.integer(source, "fork: stages", 1..=left)? as u16
        }
        None => 1,
    };
    let timesteps = fields.get("timesteps");
    let timesteps = timesteps.map(|node| node.integer(source, "fork: timesteps", POSSIBLE)).transpose()?;
    let mut treatments: Vec<(Treatment, Config)> = Vec::new();
    let mut add = |treatment: Treatment, config, node: &Node| {
        if treatments.iter().any(|(known, _)| known.name == treatment.name) {
            let problem = format!("fork: the treatment {} stands twice: drop one of them", treatment.name);
            return Err(source.refuse(node.at, problem));
        }
        treatments.push((treatment, config));
        Ok(())
    };
    if let Some(node) = fields.get("treatments") {
        for (name, at, node) in node.map(source, "fork: treatments")? {
            check_name(name).map_err(|problem| source.refuse(*at, format_args!("fork: treatments: {problem}")))?;
            let (treatment, config) = read(node, source, parent)?;
            check_none(name, &treatment).map_err(|problem| source.refuse(*at, problem))?;
            add(Treatment { name: name.clone(), ..treatment }, config, node)?;
        }
    }
    if let Some(node) = fields.get("grid") {
        node.fields(source, "fork: grid", &known_keys(parent.config))?;
        for cell in cells(node, source)? {
            let (treatment, config) = read_parts(&cell, source, parent)?;
            // The curriculum itself is trained anyway.
            if treatment.is_none() {
                continue;
            }
            check_name(&treatment.name).map_err(|problem| {
                let remedy = "write it under treatments with a shorter name";
                source.refuse(node.at, format_args!("fork: grid: {problem}; {remedy}"))
            })?;
            add(treatment, config, node)?;
        }
    }
    if treatments.is_empty() {
        let problem = "fork: it has no treatment: add some, such as treatments: {fresh-adam: {optimizer: fresh}}";
        return Err(source.refuse(node.at, problem));
    }
    let forks = after.into_iter().flat_map(|(after, _)| {
        let fork = move |(treatment, config): &(Treatment, Config)| Fork {
            after,
            stages,
            timesteps,
            treatment: treatment.clone(),
            config: config.clone(),
        };
        treatments.iter().map(fork).collect::<Vec<_>>()
    });
    Ok(forks.collect())
}

/// A treatment as the command line says it, and the settings that follow from it. It may be written under a name, as in a
/// study file; else its name says what it does.
///
/// # Errors
/// The first thing that cannot be taken, with its place in the text.
pub fn parse_treatment(text: &str, config: &Config, level: &Level) -> Result<(Treatment, Config), UserError> {
    let source = Source { path: Path::new("--treatment") };
    let node = source.parse(text)?;
    let parent = Parent { config, level, stages: usize::MAX };
    let named = match &node.content {
        Content::Map(entries) => match &entries[..] {
            [(name, _, treatment @ Node { content: Content::Map(_), .. })] => {
                (!known_keys(config).contains(&name.as_str())).then_some((name, treatment))
            }
            _ => None,
        },
        _ => None,
    };
    let (mut treatment, config) = read(named.map_or(&node, |(_, treatment)| treatment), &source, &parent)?;
    if let Some((name, _)) = named {
        check_none(name, &treatment).map_err(|problem| source.refuse(node.at, problem))?;
        treatment.name.clone_from(name);
    }
    check_name(&treatment.name).map_err(|problem| source.refuse(node.at, problem))?;
    Ok((treatment, config))
}

/// Keeps the control's name for the control.
fn check_none(name: &str, treatment: &Treatment) -> Result<(), String> {
    if name == NONE && !treatment.is_none() {
        return Err(format!("{NONE} is the name of the control, which is {{}}: choose another"));
    }
    Ok(())
}

/// Reads a treatment; refuses one that says something, and yet changes nothing.
fn read(node: &Node, source: &Source<'_>, parent: &Parent<'_>) -> Result<(Treatment, Config), UserError> {
    let entries = node.map(source, "a treatment")?;
    let cell: Vec<(&str, &Node)> = entries.iter().map(|(key, _, node)| (key.as_str(), node)).collect();
    let known = known_keys(parent.config);
    node.fields(source, "a treatment", &known)?;
    let (treatment, config) = read_parts(&cell, source, parent)?;
    if treatment.is_none() && !entries.is_empty() {
        let problem = format!("this treatment changes nothing: write {{}} for the control {NONE}, or drop it");
        return Err(source.refuse(node.at, problem));
    }
    Ok((treatment, config))
}

/// The keys of a treatment: those that all have, and the algorithm's copies of its parameters.
fn known_keys(config: &Config) -> Vec<&'static str> {
    TREATMENT_KEYS.iter().chain(config.algorithm.copies()).copied().collect()
}

fn read_parts(
    entries: &[(&str, &Node)],
    source: &Source<'_>,
    parent: &Parent<'_>,
) -> Result<(Treatment, Config), UserError> {
    let network = parent.config.network(parent.level);
    let known = Place::known(&network);
    let place = |text: &str, node: &Node| {
        let place = Place(text.to_owned());
        if place.tensors(&network).next().is_some() {
            return Ok(place);
        }
        let names: Vec<&str> = known.iter().map(String::as_str).collect();
        let remedy = nearest(text, &names)
            .map_or_else(|| format!("known are {}", known.join(", ")), |near| format!("did you mean \"{near}\"?"));
        Err(source.refuse(node.at, format_args!("there is no tower or layer \"{text}\"; {remedy}")))
    };
    let parts = |key: &str, node: &Node| match &node.content {
        Content::List(_) => {
            let nodes = node.list(source, key, "name towers or layers, such as [policy.2]")?;
            let places = nodes.iter().map(|node| place(node.text(source, key)?, node));
            Ok(Parts::Places(places.collect::<Result<_, UserError>>()?))
        }
        _ => match node.word(source, key, &["warm", "fresh"])? {
            "warm" => Ok(Parts::Nothing),
            _ => Ok(Parts::All),
        },
    };
    let mut treatment = Treatment::default();
    let mut config = parent.config.clone();
    let mut written = Map::new();
    for &(key, node) in entries {
        written.insert(key.to_owned(), node.value());
        match key {
            "weights" => treatment.weights = parts(key, node)?,
            "optimizer" => treatment.optimizer = parts(key, node)?,
            "scale" => {
                for (name, at, factor) in node.map(source, key)? {
                    let place = place(name, factor)?;
                    check_scaled(&place, &network).map_err(|problem| source.refuse(*at, problem))?;
                    let by = factor.number(source, key)?;
                    if !(0.0..=1e6).contains(&by) {
                        return Err(source
                            .refuse(factor.at, format_args!("{key}: expected a number from 0 to 1e6, got {factor}")));
                    }
                    if by != 1.0 {
                        treatment.scales.push((place, by));
                    }
                }
            }
            "set" => {
                for set in node.list(source, key, "name settings as key=value, or drop it")? {
                    treatment.sets.push(set.text(source, key)?.to_owned());
                }
                config = config_of(&treatment, parent.config).map_err(|problem| source.refuse(node.at, problem))?;
            }
            copy => {
                let word = node.word(source, copy, &OF_COPY.map(|(word, _)| word))?;
                let of_copy = OF_COPY.iter().find(|(known, _)| *known == word).map(|(_, of_copy)| *of_copy);
                treatment.copies.extend(of_copy.filter(|of| *of != Default::default()).map(|of| (copy.to_owned(), of)));
            }
        }
    }
    if config == *parent.config {
        treatment.sets.clear();
    }
    treatment.name = name_of(&treatment);
    treatment.written = if treatment.is_none() { Map::new() } else { written };
    Ok((treatment, config))
}

/// Refuses to scale what is neither weight nor bias: the tensors of a norm.
fn check_scaled(place: &Place, network: &Network) -> Result<(), String> {
    if place.scaled(network).next().is_some() {
        return Ok(());
    }
    let Place(name) = place;
    let layer = name.rsplit_once('.').map_or(name.as_str(), |(layer, _)| layer);
    Err(format!("scale: {name} is neither weight nor bias: scale {layer}, {layer}.weight or {layer}.bias"))
}

/// Every combination of the values that a grid lists; the last key changes first.
fn cells<'a>(node: &'a Node, source: &Source<'_>) -> Result<Vec<Vec<(&'a str, &'a Node)>>, UserError> {
    let mut cells: Vec<Vec<(&str, &Node)>> = vec![Vec::new()];
    for (key, _, node) in node.map(source, "fork: grid")? {
        let values = node.list(source, key, "give its values, such as [warm, fresh]")?;
        if cells.len().saturating_mul(values.len()) > MAX_CELLS {
            return Err(
                source.refuse(node.at, format_args!("fork: grid: more than {MAX_CELLS} combinations: name fewer"))
            );
        }
        let with = |cell: &Vec<(&'a str, &'a Node)>| {
            let one = |value| cell.iter().copied().chain([(key.as_str(), value)]).collect();
            values.iter().map(one).collect::<Vec<_>>()
        };
        cells = cells.iter().flat_map(with).collect();
    }
    Ok(cells)
}
