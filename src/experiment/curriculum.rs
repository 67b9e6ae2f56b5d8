//! The protocol as data: stages of training on one level after another, and the levels to evaluate on.

use std::sync::Arc;

use coverage_env::Level;

use crate::agent::Stage;
use crate::error::UserError;

/// The name of the one sequence of a command or of an arm; also its folder below the arm's.
pub const ONLY: &str = "curriculum";
/// What the names of single levels begin with, and no sequence's.
pub const LEVEL: &str = "level-";

/// What a run trains on and what it is evaluated on, before the first stage and after each.
#[derive(Clone, Debug)]
pub struct Curriculum {
    /// `curriculum`, another sequence's own name, or `level-<L>`: the folder below the arm's.
    pub name: String,
    /// In the order of training.
    pub stages: Vec<Stage>,
    /// The number of the stage that training begins with: 0, or that after a fork. A parent trained those before it.
    pub begins: u16,
    /// The levels to evaluate on, each once, in the order of their first stages.
    pub levels: Vec<Arc<Level>>,
    /// Whether a run may be extended to more timesteps. Only a single level may: a later stage began where it ended.
    pub extensible: bool,
}

impl Curriculum {
    /// One level alone.
    pub fn single(level: impl Into<Arc<Level>>, timesteps: u64) -> Self {
        let level = level.into();
        Self {
            name: format!("{LEVEL}{}", folder_name(level.name())),
            stages: vec![Stage { index: 0, level: level.clone(), timesteps, horizon: timesteps }],
            begins: 0,
            levels: vec![level],
            extensible: true,
        }
    }

    /// One level after another, each with its timesteps; a level may come again.
    ///
    /// # Errors
    /// Levels of differing sizes, different levels of one name, no level, or too many.
    pub fn sequence(name: impl Into<String>, stages: Vec<(Arc<Level>, u64)>) -> Result<Self, UserError> {
        let mut levels: Vec<Arc<Level>> = Vec::new();
        for (level, _) in &stages {
            if !levels.iter().any(|known| Arc::ptr_eq(known, level)) {
                levels.push(level.clone());
            }
        }
        let levels = distinct(&levels)?;
        if levels.is_empty() {
            return Err(UserError::new("a curriculum needs at least one level"));
        }
        if stages.len() > usize::from(u16::MAX) {
            let (stages, most) = (stages.len(), u16::MAX);
            return Err(UserError::new(format!("{stages} stages are too many: at most {most} are possible")));
        }
        let stage = |(index, (level, timesteps))| Stage { index: index as u16, level, timesteps, horizon: timesteps };
        let stages = stages.into_iter().enumerate().map(stage).collect();
        Ok(Self { name: name.into(), stages, begins: 0, levels, extensible: false })
    }

    /// The stages that are trained here; a parent trained those before them.
    pub fn trained(&self) -> &[Stage] {
        &self.stages[usize::from(self.begins)..]
    }

    /// Timesteps of the stages that are trained here.
    pub fn timesteps(&self) -> u64 {
        total(self.trained())
    }

    /// Timesteps asked for of the stages that a parent trained.
    pub fn timesteps_of_parent(&self) -> u64 {
        total(&self.stages[..usize::from(self.begins)])
    }

    /// What a fork after a stage trains: as many of the stages that follow as are given. None where there are fewer.
    pub fn forked(&self, after: u16, stages: u16) -> Option<Self> {
        let begins = after.checked_add(1)?;
        let ends = usize::from(begins) + usize::from(stages);
        if stages == 0 || begins <= self.begins || ends > self.stages.len() {
            return None;
        }
        let stages = self.stages[..ends].to_vec();
        Some(Self { stages, begins, extensible: false, ..self.clone() })
    }
}

fn total(stages: &[Stage]) -> u64 {
    stages.iter().map(|stage| stage.timesteps).fold(0, u64::saturating_add)
}

/// Each level once, in the order of their first places.
///
/// # Errors
/// Levels of differing sizes, and different levels of one name.
pub fn distinct(levels: &[Arc<Level>]) -> Result<Vec<Arc<Level>>, UserError> {
    let mut distinct: Vec<Arc<Level>> = Vec::new();
    for level in levels {
        let first = distinct.first().unwrap_or(level);
        if (level.height(), level.width()) != (first.height(), first.width()) {
            return Err(UserError::new(format!(
                "all levels of a curriculum must have the same size, but level {} is {}×{} and level {} is {}×{}",
                first.name(),
                first.height(),
                first.width(),
                level.name(),
                level.height(),
                level.width()
            )));
        }
        match distinct.iter().find(|known| known.name() == level.name()) {
            None => distinct.push(level.clone()),
            Some(known) if known.cells() != level.cells() => {
                let name = level.name();
                return Err(UserError::new(format!(
                    "two levels with different maps are called {name}: give one of them another name"
                )));
            }
            Some(_) => {}
        }
    }
    Ok(distinct)
}

/// A level's name as part of a folder's name.
fn folder_name(name: &str) -> String {
    let keep = |c: char| if c.is_alphanumeric() || "-_.".contains(c) { c } else { '_' };
    name.chars().map(keep).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn level(name: &str, map: &str) -> Arc<Level> {
        Level::from_map(name, map).unwrap().into()
    }

    #[test]
    fn a_level_that_comes_again_is_evaluated_once() {
        let (a, b) = (level("a", "..T\n..."), level("b", "T..\n..."));
        // Levels that were read twice are the same level.
        let again = level("a", "..T\n...");
        let stages = vec![(a, 10), (b, 20), (again, 30)];
        let curriculum = Curriculum::sequence("a-b-a", stages).unwrap();
        let names: Vec<&str> = curriculum.levels.iter().map(|level| level.name()).collect();
        assert_eq!(names, ["a", "b"]);
        let stages: Vec<(u16, &str, u64)> =
            curriculum.stages.iter().map(|stage| (stage.index, stage.level.name(), stage.timesteps)).collect();
        assert_eq!(stages, [(0, "a", 10), (1, "b", 20), (2, "a", 30)]);
        assert_eq!(curriculum.timesteps(), 60);
    }

    #[test]
    fn levels_that_do_not_fit_together_are_refused() {
        let of = |levels: &[Arc<Level>]| {
            let stages = levels.iter().map(|level| (level.clone(), 1)).collect();
            Curriculum::sequence("x", stages).map(drop).map_err(|error| error.to_string())
        };
        let a = level("a", "..T\n...");
        assert!(of(&[a.clone(), level("a", "...\n..T")]).unwrap_err().contains("different maps are called a"));
        assert!(of(&[a.clone(), level("b", "..T")]).unwrap_err().contains("level a is 2×3 and level b is 1×3"));
        assert!(of(&[]).unwrap_err().contains("at least one level"));
        assert!(of(&vec![a.clone(); 65_536]).unwrap_err().contains("65536 stages are too many"));
        assert_eq!(of(&vec![a; 65_535]), Ok(()));
    }
}
