//! The levels of a comparison, and what planners earn on them.

use std::cmp::Reverse;
use std::sync::Arc;

use coverage_env::planner::{self, AStar, Optimal, Random};
use coverage_env::{Level, worst_return};
use serde::Serialize;

use super::found::Found;
use crate::error::UserError;
use crate::evaluate::{self, Starts};
use crate::random::{Purpose, Stream};
use crate::results::{Episode, LevelResult, mean_std};

/// A level as its runs had it.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct LevelInfo {
    /// Its name.
    pub name: String,
    /// Its map, rows joined by newlines.
    pub map: String,
    /// The step limit.
    pub max_steps: u32,
    /// Uniform actions; none where the map cannot be read.
    pub random: Option<Planner>,
    /// The paper's greedy A*; likewise.
    pub astar: Option<Planner>,
    /// The proved optimum, where it is within reach.
    pub optimal: Option<Planner>,
}

/// What a planner earns, over every start cell.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Planner {
    /// Mean return.
    pub mean: f64,
    /// Population standard deviation over start cells.
    pub std: f64,
    /// Least return.
    pub min: i64,
    /// Largest return.
    pub max: i64,
    /// Mean length.
    pub length: f64,
    /// Every start cell, row-major.
    pub starts: Vec<PlannedStart>,
}

/// What a planner earns from one start cell.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct PlannedStart {
    /// `[row, column]`, from 0.
    pub start: [usize; 2],
    /// Sum of rewards.
    #[serde(rename = "return")]
    pub return_: i64,
    /// Timesteps.
    pub length: u32,
}

impl Planner {
    fn new(result: &LevelResult) -> Self {
        let lengths: Vec<f64> = result.episodes.iter().map(|episode| f64::from(episode.length)).collect();
        let start = |e: &Episode| PlannedStart { start: e.start, return_: e.return_, length: e.length };
        Self {
            mean: result.mean,
            std: result.std,
            min: result.min,
            max: result.max,
            length: mean_std(&lengths).0,
            starts: result.episodes.iter().map(start).collect(),
        }
    }
}

impl LevelInfo {
    fn planned(mut self) -> Self {
        if let Ok(level) = Level::from_map(self.name.clone(), &self.map).map(Arc::new) {
            let max_steps = self.max_steps;
            let plan = |planner: &mut dyn planner::Planner| {
                evaluate::planner(planner, &level, max_steps, Starts::Exhaustive).ok().map(|r| Planner::new(&r))
            };
            self.random = plan(&mut Random::new(Stream::new(0, 0, Purpose::EvaluationActions)));
            (self.astar, self.optimal) = (plan(&mut AStar), plan(&mut Optimal::new()));
        }
        self
    }

    /// (R − R_worst) / (R_opt − R_worst): 0 for the worst return, 1 for the mean optimum; none where that is unknown.
    pub fn normalised(&self, mean_return: f64) -> Option<f64> {
        let worst = worst_return(self.max_steps) as f64;
        self.optimal.as_ref().map(|optimal| (mean_return - worst) / (optimal.mean - worst))
    }
}

/// Every trained level, in the order of the longest curriculum that has it.
pub(super) fn of_runs(runs: &[Found]) -> Result<Vec<LevelInfo>, UserError> {
    let mut levels: Vec<LevelInfo> = Vec::new();
    let mut runs: Vec<&Found> = runs.iter().collect();
    runs.sort_by_key(|run| Reverse(run.manifest.stages.len()));
    for run in runs {
        for stage in &run.manifest.stages {
            let max_steps = run.manifest.max_steps();
            let (name, map) = (stage.level.clone(), stage.map.clone());
            let here = LevelInfo { name, map, max_steps, random: None, astar: None, optimal: None };
            match levels.iter().find(|known| known.name == here.name) {
                None => levels.push(here),
                Some(known) if *known != here => {
                    return Err(UserError::new(format!(
                        "{}: its level {} has another map or step limit than others': compare runs on the same levels",
                        run.path.display(),
                        stage.level
                    )));
                }
                Some(_) => {}
            }
        }
    }
    Ok(levels.into_iter().map(LevelInfo::planned).collect())
}
