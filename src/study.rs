//! A study: several arms, each through a curriculum, on each of its levels from scratch, or both.

use std::collections::BTreeSet;
use std::fmt::Display;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use anyhow::Result;
use coverage_env::Level;
use serde::Deserialize;
use serde_saphyr::{Location, Spanned};

use crate::agent::config::{self, Config};
use crate::agent::engine::EngineKind;
use crate::agent::{self, Stage};
use crate::curriculum::Curriculum;
use crate::error::UserError;
use crate::text_file;

/// The paper's arms and their controls, which need no file.
const PAPER: &str = include_str!("../configs/paper.yaml");
/// A larger file is none of ours.
const MAX_FILE_BYTES: u64 = 1 << 20;
/// How long a trial of an arm's speed runs at least.
const TRIAL: Duration = Duration::from_millis(250);

/// What is trained, resolved and validated.
#[derive(Clone, Debug)]
pub struct Study {
    /// Its name; also that of its folder.
    pub name: String,
    /// The levels, in the order of the curriculum.
    pub levels: Vec<Level>,
    /// What is trained on them.
    pub arms: Vec<StudyArm>,
}

/// One arm of a study.
#[derive(Clone, Debug)]
pub struct StudyArm {
    /// Its settings.
    pub config: Config,
    /// How it is trained, in this order.
    pub trains: Vec<Training>,
}

/// How an arm is trained.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Training {
    /// One agent through all levels.
    Curriculum,
    /// A new agent on each level alone.
    #[serde(rename = "from scratch", alias = "afresh")]
    FromScratch,
}

/// The file, key by key.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    name: Spanned<String>,
    levels: Spanned<Vec<Spanned<LevelId>>>,
    arms: Vec<Spanned<Arm>>,
}

/// A level's id or path; `0` need not be quoted.
#[derive(Deserialize)]
#[serde(untagged)]
enum LevelId {
    Number(u64),
    Text(String),
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Arm {
    algo: Option<String>,
    config: Option<PathBuf>,
    #[serde(default)]
    set: Vec<String>,
    trains: BTreeSet<Training>,
}

impl Study {
    /// The paper's arms with their controls: `configs/paper.yaml`; `timesteps` replaces the arms' own.
    ///
    /// # Errors
    /// `timesteps` out of range.
    pub fn paper(timesteps: Option<u64>) -> Result<Self> {
        Self::parse(PAPER, Path::new("configs/paper.yaml"), timesteps)
    }

    /// Reads a study's file; paths in it are relative to it.
    ///
    /// # Errors
    /// The first thing in it that cannot be taken, with its line and column where they are known.
    pub fn read(path: &Path, timesteps: Option<u64>) -> Result<Self> {
        let text = text_file::read(path, MAX_FILE_BYTES)
            .map_err(|error| UserError::new(format!("{}: cannot read the study: {error}", path.display())))?;
        Self::parse(&text, path, timesteps)
    }

    fn parse(text: &str, path: &Path, timesteps: Option<u64>) -> Result<Self> {
        let file: File = serde_saphyr::from_str(text).map_err(|e| {
            let at = e.location().map(|l| format!(":{}:{}", l.line(), l.column())).unwrap_or_default();
            UserError::new(format!("{}{at}: not a study: {}", path.display(), e.without_snippet()))
        })?;
        let refuse = |at: Location, problem: &dyn Display| {
            UserError::new(format!("{}:{}:{}: {problem}", path.display(), at.line(), at.column()))
        };
        crate::config::check_name(&file.name.value).map_err(|problem| refuse(file.name.referenced, &problem))?;
        let beside = |other: &Path| path.parent().unwrap_or(Path::new("")).join(other);
        let level = |id: &Spanned<LevelId>| {
            let level = match &id.value {
                LevelId::Number(number) => Level::resolve(&number.to_string()),
                LevelId::Text(text) => match Level::builtin(text) {
                    Some(level) => Ok(level),
                    None => Level::from_path(&beside(Path::new(text))),
                },
            };
            level.map_err(|error| refuse(id.referenced, &error))
        };
        let levels = file.levels.value.iter().map(level).collect::<Result<Vec<_>, _>>()?;
        // What a sequence refuses, equal names say, is refused before anything is trained.
        Curriculum::sequence(levels.clone(), 1)
            .map_err(|problem| refuse(file.levels.referenced, &format_args!("levels: {problem}")))?;

        let mut arms: Vec<StudyArm> = Vec::new();
        for arm in &file.arms {
            let refuse = |problem: &dyn Display| refuse(arm.referenced, problem);
            let Arm { algo, config, set, trains } = &arm.value;
            let config = config::resolve(algo.as_deref(), config.as_deref().map(beside).as_deref(), set, timesteps)
                .map_err(|error| refuse(&format_args!("this arm: {error}")))?;
            if trains.is_empty() {
                return Err(refuse(&"trains: name curriculum, from scratch or both").into());
            }
            if arms.iter().any(|other| other.config.name == config.name) {
                let message = "stands twice: give one of them a name of its own with set: [name=…]";
                return Err(refuse(&format_args!("the arm {} {message}", config.name)).into());
            }
            arms.push(StudyArm { config, trains: trains.iter().copied().collect() });
        }
        if arms.is_empty() {
            return Err(UserError::new(format!("{}: arms: name at least one", path.display())).into());
        }
        Ok(Self { name: file.name.value, levels, arms })
    }

    /// Everything that is trained, an experiment each: arm by arm, the curriculum first.
    ///
    /// # Errors
    /// Those of [`Curriculum::sequence`].
    pub fn experiments(&self) -> Result<Vec<(&Config, Curriculum)>> {
        let mut experiments = Vec::new();
        for StudyArm { config, trains } in &self.arms {
            for training in trains {
                match training {
                    Training::Curriculum => {
                        experiments.push((config, Curriculum::sequence(self.levels.clone(), config.shared.timesteps)?));
                    }
                    Training::FromScratch => {
                        let single =
                            |level: &Level| (config, Curriculum::single(level.clone(), config.shared.timesteps));
                        experiments.extend(self.levels.iter().map(single));
                    }
                }
            }
        }
        Ok(experiments)
    }
}

/// Timesteps per second of one seed of `config` on one thread of this machine, by a trial of a fraction of a second.
pub fn measure_rate(config: &Config, level: &Level, engine: EngineKind) -> f64 {
    // Nothing of the trial is kept, so that any seed will do.
    let agent = config.agent(level, 0);
    let stage = Stage { index: 0, level: level.clone().into(), timesteps: u64::MAX, horizon: u64::MAX };
    let mut learner = agent::learner(config, &stage, vec![agent], engine);
    learner.advance();
    let (start, before) = (Instant::now(), learner.timesteps());
    while start.elapsed() < TRIAL {
        learner.advance();
    }
    (learner.timesteps() - before) as f64 / start.elapsed().as_secs_f64()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parse(text: &str) -> Result<Study> {
        Study::parse(text, Path::new("study.yaml"), None)
    }

    #[test]
    fn the_paper_has_its_arms_and_levels() {
        let study = Study::paper(None).unwrap();
        let names: Vec<&str> = study.arms.iter().map(|arm| arm.config.name.as_str()).collect();
        assert_eq!(names, ["dqn", "ppo", "ppo-l2", "dqn-constant-eps", "ppo-eps", "ppo-l2-dohare"]);
        let experiments = study.experiments().unwrap();
        // Six curricula, and five arms on five levels from scratch.
        assert_eq!(experiments.len(), 6 + 5 * 5);
        let timesteps: u64 = experiments.iter().map(|(_, curriculum)| curriculum.timesteps()).sum();
        assert_eq!(timesteps, 4 * 5_000_000 + 7 * 2_500_000);
        let short = Study::paper(Some(1000)).unwrap();
        assert!(short.arms.iter().all(|arm| arm.config.shared.timesteps == 1000));
    }

    #[test]
    fn an_arm_may_have_settings_and_a_name_of_its_own() {
        let text = "name: mine\nlevels: [\"0\", 3]\narms:\n  - {algo: ppo, trains: [curriculum]}\n  \
                    - {algo: ppo, set: [name=fast, learning_rate=3e-4], trains: [from scratch]}\n";
        let study = parse(text).unwrap();
        assert_eq!(study.levels.iter().map(Level::name).collect::<Vec<_>>(), ["0", "3"]);
        assert_eq!(study.arms[1].config.name, "fast");
        assert_eq!(study.arms[1].config.shared.optimizer.learning_rate, 3e-4);
        assert_eq!(study.arms[1].trains, [Training::FromScratch]);
    }

    #[test]
    fn files_that_say_afresh_are_still_read() {
        let study = parse("name: old\nlevels: [0]\narms: [{algo: ppo, trains: [curriculum, afresh]}]\n").unwrap();
        assert_eq!(study.arms[0].trains, [Training::Curriculum, Training::FromScratch]);
    }

    #[test]
    fn mistakes_are_named_with_their_place() {
        let with = |levels: &str, arms: &str| format!("name: x\nlevels: {levels}\narms:\n{arms}");
        let one = "  - {algo: ppo, trains: [curriculum]}\n";
        for (text, says) in [
            (
                with("[0]", "  - {algo: pop, trains: [from scratch]}\n"),
                "study.yaml:4:5: this arm: --algo: unknown preset",
            ),
            (with("[0]", "  - {algo: ppo, trains: []}\n"), "study.yaml:4:5: trains"),
            (with("[0]", "  - {algo: ppo, trains: [twice]}\n"), "study.yaml:4"),
            (with("[0]", &one.repeat(2)), "study.yaml:5:5: the arm ppo stands twice"),
            (with("[0, 0]", one), "study.yaml:2:9: levels: level 0 is listed twice"),
            (with("[]", one), "study.yaml:2:9: levels: a curriculum needs at least one level"),
            (with("[0, 9]", one), "study.yaml:2:13: 9: neither a built-in level"),
            (with("[0, absent.yaml]", one), "study.yaml:2:13: absent.yaml: cannot be read"),
            (with("[0]", one).replace("name: x", "name: ../x"), "study.yaml:1:7: name: expected 1 to 64 letters"),
            ("name: x\nlevels: [0]\narms: []\n".to_owned(), "at least one"),
            ("name: x\nlevels: [0]\n".to_owned(), "missing field"),
            ("nmae: x".to_owned(), "nmae"),
        ] {
            let error = format!("{:#}", parse(&text).unwrap_err());
            assert!(error.contains(says), "{text:?}: {error}");
        }
    }
}
