//! Forks: agents that go on from the end of a stage under a treatment, beside the curriculum that they come from.

use serde_json::Value;

use super::curriculum::Curriculum;
use super::grid::shortest;
use crate::agent::config::Config;
use crate::agent::treatment::{NONE, OfCopy, Parts, Treatment};

/// Where agents go on otherwise, and how.
#[derive(Clone, Debug)]
pub struct Fork {
    /// The number of the finished stage.
    pub after: u16,
    /// How many of the stages that follow are trained.
    pub stages: u16,
    /// Timesteps of each of them; none for as many as the stage has that it replaces.
    pub timesteps: Option<u64>,
    /// What is done to the agents.
    pub treatment: Treatment,
    /// The settings that they go on with: their parent's with those of the treatment.
    pub config: Config,
}

impl Fork {
    /// What is added to the name of the sequence's folder.
    pub fn suffix(&self) -> String {
        suffix(self.after, &self.treatment.name)
    }

    /// The stages that are trained. None where the curriculum has too few.
    pub fn curriculum(&self, parent: &Curriculum) -> Option<Curriculum> {
        let mut curriculum = parent.forked(self.after, self.stages)?;
        if let Some(timesteps) = self.timesteps {
            let begins = curriculum.begins.into();
            for stage in curriculum.stages.iter_mut().skip(begins) {
                (stage.timesteps, stage.horizon) = (timesteps, timesteps);
            }
        }
        Some(curriculum)
    }
}

/// What the name of a fork's folder has after that of its sequence.
pub fn suffix(after: u16, treatment: &str) -> String {
    format!("+after-{after}+{treatment}")
}

/// A name that says a treatment: `weights-fresh+policy.2-0.02`.
pub(super) fn name_of(treatment: &Treatment) -> String {
    let Treatment { weights, optimizer, scales, copies, sets, .. } = treatment;
    let mut parts = Vec::new();
    for (what, of) in [("weights", weights), ("optimizer", optimizer)] {
        match of {
            Parts::Nothing => {}
            Parts::All => parts.push(format!("{what}-fresh")),
            Parts::Places(places) => {
                let names: Vec<&str> = places.iter().map(|place| place.0.as_str()).collect();
                parts.push(format!("{what}-{}", names.join("_")));
            }
        }
    }
    parts.extend(scales.iter().map(|(place, factor)| format!("{}-{}", place.0, shortest(*factor))));
    for (name, of_copy) in copies {
        let word = OF_COPY.iter().find(|(_, known)| known == of_copy).map_or("", |(word, _)| word);
        parts.push(format!("{name}-{word}"));
    }
    for set in sets {
        let keep = |c: char| if c.is_ascii_alphanumeric() || "-_.".contains(c) { c } else { '-' };
        let readable = set.replace(['[', ']', '"', ' '], "");
        parts.push(readable.chars().map(keep).collect());
    }
    if parts.is_empty() { NONE.to_owned() } else { parts.join("+") }
}

/// What becomes of a copy, each with its word.
pub(super) const OF_COPY: [(&str, OfCopy); 3] =
    [("follow", OfCopy::Follow), ("keep", OfCopy::Keep), ("renew", OfCopy::Renew)];

/// Settings that a treatment cannot change, since the agent, its stages or its place depend on them.
const FIXED: [&str; 3] = ["name", "algorithm", "extends"];

/// The settings of a fork: its parent's with those of the treatment.
pub(super) fn config_of(treatment: &Treatment, parent: &Config) -> Result<Config, String> {
    for set in &treatment.sets {
        let key = set.split('=').next().unwrap_or_default().trim();
        if key == "timesteps" {
            let remedy = "write timesteps in the fork, beside after (cpp-rl fork: --timesteps N)";
            return Err(format!("set: {key}: a treatment has no timesteps of its own: {remedy}"));
        }
        if FIXED.contains(&key) {
            return Err(format!("set: {key}: a fork keeps that of its parent: drop it"));
        }
    }
    let config = parent.with_sets(&treatment.sets).map_err(|error| error.to_string())?;
    let of_agent = |config: &Config| {
        let all = config.to_json();
        let keys = ["hidden", "activation", "layer_norm", "sensor"];
        keys.map(|key| (key, all.get(key).cloned().unwrap_or(Value::Null)))
    };
    let changed = of_agent(parent).into_iter().zip(of_agent(&config)).find(|(old, new)| old != new);
    if let Some(((key, old), (_, new))) = changed {
        return Err(format!("set: {key}: the agent comes with {old}, which cannot become {new}: drop it"));
    }
    config.algorithm.goes_on_from(&*parent.algorithm).map_err(|problem| format!("set: {problem}"))?;
    Ok(config)
}
