//! The protocol as data: stages of training on one level after another, and the levels to evaluate on.

use std::sync::Arc;

use coverage_env::Level;

use crate::agent::Stage;
use crate::error::UserError;

/// What a run trains on and what it is evaluated on, before the first stage and after each.
#[derive(Clone, Debug)]
pub struct Curriculum {
    /// `curriculum` or `level-<L>`: the folder below the arm's.
    pub name: String,
    /// In the order of training.
    pub stages: Vec<Stage>,
    /// The levels to evaluate on.
    pub levels: Vec<Arc<Level>>,
    /// Whether a run may be extended to more timesteps. Only a single stage may: a later stage began where it ended.
    pub extensible: bool,
}

impl Curriculum {
    /// One level alone.
    pub fn single(level: Level, timesteps: u64) -> Self {
        let level = Arc::new(level);
        Self {
            name: format!("level-{}", folder_name(level.name())),
            stages: vec![Stage { index: 0, level: level.clone(), timesteps, horizon: timesteps }],
            levels: vec![level],
            extensible: true,
        }
    }

    /// One level after another, `timesteps` on each, evaluated on all of them.
    ///
    /// # Errors
    /// Levels of differing sizes or equal names, or none at all.
    pub fn sequence(levels: Vec<Level>, timesteps: u64) -> Result<Self, UserError> {
        let levels: Vec<Arc<Level>> = levels.into_iter().map(Arc::new).collect();
        let Some(first) = levels.first() else {
            return Err(UserError::new("a curriculum needs at least one level"));
        };
        for (i, level) in levels.iter().enumerate() {
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
            if levels[..i].iter().any(|other| other.name() == level.name()) {
                return Err(UserError::new(format!("level {} is listed twice: give each level once", level.name())));
            }
        }
        if levels.len() > usize::from(u16::MAX) {
            return Err(UserError::new(format!("{} levels are too many for one curriculum", levels.len())));
        }
        let stage = |(index, level): (usize, &Arc<Level>)| Stage {
            index: index as u16,
            level: level.clone(),
            timesteps,
            horizon: timesteps,
        };
        let stages = levels.iter().enumerate().map(stage).collect();
        Ok(Self { name: "curriculum".to_owned(), stages, levels, extensible: false })
    }

    /// Timesteps of all stages.
    pub fn timesteps(&self) -> u64 {
        self.stages.iter().map(|stage| stage.timesteps).sum()
    }
}

/// A level's name as part of a folder's name.
fn folder_name(name: &str) -> String {
    let keep = |c: char| if c.is_alphanumeric() || "-_.".contains(c) { c } else { '_' };
    name.chars().map(keep).collect()
}
