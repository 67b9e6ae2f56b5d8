//! A study: several arms, each through its sequences of levels, on each level from scratch, or both.
//!
//! docs/studies.md describes the file.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::Result;

use super::curriculum::Curriculum;
use super::fork::Fork;
use super::grid::{self, GridCell};
use super::node::{Content, Fields, Node, Source};
use super::sequence::Sequences;
use super::timesteps::Timesteps;
use super::{levels, sequence_file, treatment_file};
use crate::agent::config::{self, Config};
use crate::config::check_name;
use crate::error::UserError;
use crate::text_file;

/// The paper's arms and their controls, which need no file.
const PAPER: &str = include_str!("../../configs/paper.yaml");
/// A larger file is none of ours.
const MAX_FILE_BYTES: u64 = 1 << 20;
/// The most experiments of one study.
const MAX_EXPERIMENTS: usize = 100_000;

const KEYS: [&str; 4] = ["name", "levels", "sequence", "arms"];
const ARM_KEYS: [&str; 7] = ["algo", "config", "set", "grid", "sequence", "trains", "fork"];

/// What is trained, resolved and validated.
#[derive(Clone, Debug)]
pub struct Study {
    /// Its name; also that of its folder.
    pub name: String,
    /// What is trained; a grid is as many arms as it has cells.
    pub arms: Vec<StudyArm>,
}

/// One arm of a study.
#[derive(Clone, Debug)]
pub struct StudyArm {
    /// Its settings.
    pub config: Config,
    /// What it is trained through, and the levels that it is trained on from scratch.
    pub sequences: Arc<Sequences>,
    /// How it is trained, in this order.
    pub trains: Vec<Training>,
    /// What goes on otherwise from stages of its curricula.
    pub forks: Vec<Fork>,
}

/// How an arm is trained.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Training {
    /// One agent through all stages of a sequence.
    Curriculum,
    /// A new agent on each level alone.
    FromScratch,
}

/// One experiment of a study.
#[derive(Clone, Debug)]
pub struct Planned<'a> {
    /// Its settings.
    pub config: &'a Config,
    /// What it is trained on.
    pub curriculum: Curriculum,
    /// The seeds for which it is.
    pub seeds: Vec<u64>,
    /// If it is a fork: that, and the place of its parent among the experiments.
    pub fork: Option<(&'a Fork, usize)>,
}

impl Training {
    /// Each with its words; older files say "afresh".
    const WORDS: [(&'static str, Self); 3] =
        [("curriculum", Self::Curriculum), ("from scratch", Self::FromScratch), ("afresh", Self::FromScratch)];
}

impl Study {
    /// The paper's arms with their controls: `configs/paper.yaml`; `timesteps` replaces the arms' own.
    ///
    /// # Errors
    /// `timesteps` out of range.
    pub fn paper(timesteps: Option<u64>) -> Result<Self> {
        Self::parse(PAPER, Path::new("configs/paper.yaml"), timesteps)
    }

    /// Reads a study's file; paths in it are relative to it. `timesteps` replaces every stage's own.
    ///
    /// # Errors
    /// The first thing in it that cannot be taken, with its line and column where they are known.
    pub fn read(path: &Path, timesteps: Option<u64>) -> Result<Self> {
        let text = text_file::read(path, MAX_FILE_BYTES)
            .map_err(|error| UserError::new(format!("{}: cannot read the study: {error}", path.display())))?;
        Self::parse(&text, path, timesteps)
    }

    /// Takes a study's text as that of the file at `path`.
    ///
    /// # Errors
    /// Those of [`read`](Self::read).
    pub fn parse(text: &str, path: &Path, timesteps: Option<u64>) -> Result<Self> {
        let source = Source { path };
        let root = source.parse(text)?;
        let file = root.fields(&source, "the study", &KEYS)?;
        let name = file.need(&source, "the study", "name")?;
        let study = name.text(&source, "name")?;
        check_name(study).map_err(|problem| source.refuse(name.at, problem))?;
        let known = file.get("levels").map(|node| levels::read(node, &source, &[])).transpose()?.unwrap_or_default();
        // Without an order of its own, an arm goes through the study's levels as they stand.
        let shared = match (file.get("sequence"), file.get("levels")) {
            (Some(node), _) => Some(sequence_file::read(node, &source, &known)?),
            (None, Some(node)) => {
                let plain = sequence_file::plain(known.clone());
                Some(plain.map_err(|problem| source.refuse(node.at, format_args!("levels: {problem}")))?)
            }
            (None, None) => None,
        };
        let shared = shared.map(|sequences| Arc::new(replaced(sequences, timesteps)));

        let mut arms: Vec<StudyArm> = Vec::new();
        let mut experiments = 0;
        let nodes = file.need(&source, "the study", "arms")?;
        for node in nodes.list(&source, "arms", "name at least one arm, such as {algo: ppo, trains: [curriculum]}")? {
            let reader = ArmReader { source: &source, node, fields: node.fields(&source, "an arm", &ARM_KEYS)? };
            let sequences = match (reader.fields.get("sequence"), &shared) {
                (Some(node), _) => Arc::new(replaced(sequence_file::read(node, &source, &known)?, timesteps)),
                (None, Some(shared)) => shared.clone(),
                (None, None) => {
                    let problem = "this arm has no levels: add levels to the study, or a sequence to the arm";
                    return Err(source.refuse(node.at, problem).into());
                }
            };
            for arm in reader.arms(&sequences, timesteps)? {
                experiments += arm.num_experiments();
                if experiments > MAX_EXPERIMENTS {
                    let problem = format!("more than {MAX_EXPERIMENTS} experiments up to this arm: name fewer");
                    return Err(source.refuse(node.at, problem).into());
                }
                if arms.iter().any(|other| other.config.name == arm.config.name) {
                    let message = "stands twice: give one of them a name of its own with set: [name=…]";
                    return Err(source.refuse(node.at, format_args!("the arm {} {message}", arm.config.name)).into());
                }
                arms.push(arm);
            }
        }
        Ok(Self { name: study.to_owned(), arms })
    }

    /// Everything that is trained for these seeds, an experiment each: arm by arm, the curricula first, and after each
    /// of them its forks.
    ///
    /// # Errors
    /// None that [`parse`](Self::parse) does not have.
    pub fn experiments(&self, seeds: &[u64]) -> Result<Vec<Planned<'_>>> {
        let mut experiments: Vec<Planned<'_>> = Vec::new();
        for StudyArm { config, sequences, trains, forks } in &self.arms {
            for training in trains {
                match training {
                    Training::Curriculum => {
                        for (curriculum, seeds) in sequences.curricula(seeds, config.shared.timesteps)? {
                            let parent = experiments.len();
                            let of_fork = |fork: &'_ Fork| fork.curriculum(&curriculum);
                            let forks: Vec<_> = forks.iter().filter_map(|fork| Some((fork, of_fork(fork)?))).collect();
                            experiments.push(Planned { config, curriculum, seeds: seeds.clone(), fork: None });
                            experiments.extend(forks.into_iter().map(|(fork, curriculum)| Planned {
                                config: &fork.config,
                                curriculum,
                                seeds: seeds.clone(),
                                fork: Some((fork, parent)),
                            }));
                        }
                    }
                    Training::FromScratch => {
                        let levels = sequences.single_levels(config.shared.timesteps);
                        experiments.extend(levels.into_iter().map(|(level, timesteps)| Planned {
                            config,
                            curriculum: Curriculum::single(level, timesteps),
                            seeds: seeds.to_vec(),
                            fork: None,
                        }));
                    }
                }
            }
        }
        Ok(experiments)
    }
}

impl StudyArm {
    /// How many experiments it makes, shifts by seed aside.
    fn num_experiments(&self) -> usize {
        let of = |training: &Training| match training {
            Training::Curriculum => self.sequences.len() * (1 + self.forks.len()),
            Training::FromScratch => self.sequences.single_levels(1).len(),
        };
        self.trains.iter().map(of).sum()
    }
}

/// `--timesteps`, where it is given, in place of what a file says.
fn replaced(sequences: Sequences, timesteps: Option<u64>) -> Sequences {
    match timesteps {
        Some(timesteps) => sequences.with_timesteps(timesteps),
        None => sequences,
    }
}

/// One entry of `arms`.
struct ArmReader<'a> {
    source: &'a Source<'a>,
    node: &'a Node,
    fields: Fields<'a>,
}

impl ArmReader<'_> {
    /// The arm, or one for each cell of its grid.
    fn arms(&self, sequences: &Arc<Sequences>, timesteps: Option<u64>) -> Result<Vec<StudyArm>> {
        let Self { source, fields, .. } = self;
        let trains = self.trains()?;
        // A number for all stages is the setting of that name, so that the run's config.yaml says it too.
        let of_sequence = match sequences.timesteps() {
            Some(Timesteps::Each(timesteps)) => Some(*timesteps),
            _ => None,
        };
        let timesteps_for_all = timesteps;
        let timesteps = timesteps.or(of_sequence);
        let arm = |config: Config| -> Result<StudyArm> {
            let mut forks = self.forks(&config, sequences, &trains)?;
            if timesteps_for_all.is_some() {
                forks.iter_mut().for_each(|fork| fork.timesteps = None);
            }
            Ok(StudyArm { config, sequences: sequences.clone(), trains: trains.clone(), forks })
        };
        let Some(node) = fields.get("grid") else { return Ok(vec![arm(self.config(timesteps, None)?)?]) };
        if let (Some((_, at, _)), Some(_)) =
            (node.map(source, "grid")?.iter().find(|(key, ..)| key == "timesteps"), sequences.timesteps())
        {
            let problem = "grid: timesteps have no effect, since the sequence says its own: drop one of the two";
            return Err(source.refuse(*at, problem).into());
        }
        let cells = grid::cells(node, source)?;
        cells.iter().map(|cell| arm(self.config(timesteps, Some(cell))?)).collect()
    }

    /// What goes on otherwise from stages of the arm's curricula.
    fn forks(&self, config: &Config, sequences: &Sequences, trains: &[Training]) -> Result<Vec<Fork>> {
        let Self { source, fields, .. } = self;
        let Some(node) = fields.get("fork") else { return Ok(Vec::new()) };
        if !trains.contains(&Training::Curriculum) {
            let problem = "fork: the arm has no curriculum to go on from: add curriculum to trains";
            return Err(source.refuse(node.at, problem).into());
        }
        let parent =
            treatment_file::Parent { config, level: sequences.first_level(), stages: sequences.fewest_stages() };
        let nodes = match &node.content {
            Content::List(_) => node.list(source, "fork", "name a fork, or drop it")?.iter().collect(),
            _ => vec![node],
        };
        let mut forks: Vec<Fork> = Vec::new();
        for node in nodes {
            for fork in treatment_file::forks(node, source, &parent)? {
                if forks.iter().any(|known| known.suffix() == fork.suffix()) {
                    let (name, after) = (&fork.treatment.name, fork.after);
                    let problem = format!("fork: {name} after stage {after} stands twice: drop one of them");
                    return Err(source.refuse(node.at, problem).into());
                }
                forks.push(fork);
            }
        }
        Ok(forks)
    }

    /// The settings, with those of a grid's cell.
    fn config(&self, timesteps: Option<u64>, cell: Option<&GridCell>) -> Result<Config> {
        let Self { source, node, fields } = self;
        let algo = fields.get("algo").map(|node| node.text(source, "algo")).transpose()?;
        let file: Option<PathBuf> = fields
            .get("config")
            .map(|node| Ok::<_, UserError>(source.beside(node.text(source, "config")?)))
            .transpose()?;
        let mut sets = Vec::new();
        if let Some(node) = fields.get("set") {
            for set in node.list(source, "set", "name settings as key=value, or drop it")? {
                sets.push(set.text(source, "set")?.to_owned());
            }
        }
        sets.extend(cell.iter().flat_map(|cell| cell.sets.iter().cloned()));
        let mut config = config::resolve(algo, file.as_deref(), &sets, timesteps).map_err(|error| {
            // A setting of the grid is at fault where the message begins with it.
            let message = error.to_string();
            let of_grid = cell.and_then(|cell| {
                let mut settings = cell.sets.iter().zip(&cell.places);
                settings.find_map(|(set, at)| Some((*at, message.strip_prefix(&format!("--set {set}: "))?)))
            });
            match of_grid {
                Some((at, problem)) => source.refuse(at, format_args!("grid: {problem}")),
                None => source.refuse(node.at, format_args!("this arm: {message}")),
            }
        })?;
        if let Some(cell) = cell {
            config.name.push_str(&cell.suffix);
            check_name(&config.name).map_err(|problem| {
                let remedy = "give the arm a shorter name with set: [name=…]";
                source.refuse(node.at, format_args!("this arm's grid: {problem}; {remedy}"))
            })?;
        }
        Ok(config)
    }

    fn trains(&self) -> Result<Vec<Training>> {
        let Self { source, fields, .. } = self;
        let node = fields.need(source, "an arm", "trains")?;
        let words = Training::WORDS.map(|(word, _)| word);
        let mut trains = Vec::new();
        for entry in node.list(source, "trains", "name curriculum, from scratch or both")? {
            let word = entry
                .word(source, "trains", &words[..2])
                .or_else(|error| if entry.value() == words[2] { Ok(words[2]) } else { Err(error) })?;
            trains.extend(Training::WORDS.iter().filter(|(known, _)| *known == word).map(|(_, training)| *training));
        }
        trains.sort_unstable();
        trains.dedup();
        Ok(trains)
    }
}

#[cfg(test)]
mod tests;
