//! The study's tables of one arm: what a model earns on every level after a stage.

use std::sync::Arc;

use coverage_env::Level;
use coverage_env::planner::{AStar, Optimal, Planner};
use serde::Serialize;

use super::{Cell, Table};
use crate::curriculum::Curriculum;
use crate::evaluate::{self, Starts};
use crate::results::mean_std;
use crate::run::evaluations::{Phase, Row, level_result};

/// What the planners earn on a level, on average over every start cell.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Planned {
    /// Greedy A*.
    pub astar: Option<f64>,
    /// The proved optimum, where it is within reach.
    pub optimal: Option<f64>,
}

impl Planned {
    /// Plans a level.
    pub fn new(level: &Arc<Level>, max_steps: u32) -> Self {
        let mean = |planner: &mut dyn Planner| {
            evaluate::planner(planner, level, max_steps, Starts::Exhaustive).ok().map(|result| result.mean)
        };
        Self { astar: mean(&mut AStar), optimal: mean(&mut Optimal::new()) }
    }
}

/// A planner's mean as a table's entry.
pub(super) fn planned_cell(mean: Option<f64>) -> Cell {
    mean.map_or(Cell::Missing, |mean| Cell::Number(mean, 2))
}

/// What was done with a level up to a stage.
fn trained(curriculum: &Curriculum, stage: u16, level: &str) -> &'static str {
    match curriculum.stages.iter().find(|s| s.level.name() == level).map(|s| s.index.cmp(&stage)) {
        Some(std::cmp::Ordering::Equal) => "last",
        Some(std::cmp::Ordering::Less) => "earlier",
        _ => "not yet",
    }
}

/// The returns on all levels after `stage`, a row per level; `runs` are the evaluations of each seed.
pub fn after_stage(curriculum: &Curriculum, stage: u16, runs: &[Vec<Row>], planned: &[Planned]) -> Table {
    let last = curriculum.stages[usize::from(stage)].level.name();
    let row = |(level, planned): (&Arc<Level>, &Planned)| {
        let of_run = |rows: &Vec<Row>| level_result(rows, Phase::After, stage, level.name());
        let results: Vec<_> = runs.iter().filter_map(of_run).collect();
        let shares: Vec<f64> = results.iter().map(|result| result.solved_share).collect();
        let means: Vec<f64> = results.iter().map(|result| result.mean).collect();
        let (returns, solved) = match &results[..] {
            [] => (Cell::Missing, Cell::Missing),
            [one] => (Cell::MeanStd(one.mean, Some(one.std)), Cell::Number(100.0 * one.solved_share, 1)),
            _ => {
                let (mean, std) = mean_std(&means);
                (Cell::MeanStd(mean, Some(std)), Cell::Number(100.0 * mean_std(&shares).0, 1))
            }
        };
        vec![
            level.name().into(),
            trained(curriculum, stage, level.name()).into(),
            returns,
            solved,
            planned_cell(planned.astar),
            planned_cell(planned.optimal),
        ]
    };
    let has_stage = |rows: &&Vec<Row>| rows.iter().any(|row| row.phase == Phase::After && row.stage == stage);
    let columns = ["level", "trained", "return", "solved %", "A*", "optimal"];
    Table {
        title: format!("Return on every level after the stage on level {last}"),
        columns: columns.map(str::to_owned).to_vec(),
        rows: curriculum.levels.iter().zip(planned).map(row).collect(),
        notes: vec![deviation_note(runs.iter().filter(has_stage).count())],
    }
}

/// The matrix of returns: a row per stage, a column per level.
pub fn matrix(curriculum: &Curriculum, runs: &[Vec<Row>], planned: &[Planned]) -> Table {
    let mean_of = |phase, stage, level: &Arc<Level>| {
        let result = |rows: &Vec<Row>| level_result(rows, phase, stage, level.name());
        match &runs.iter().filter_map(result).collect::<Vec<_>>()[..] {
            [] => Cell::Missing,
            [one] => Cell::MeanStd(one.mean, Some(one.std)),
            results => {
                let (mean, std) = mean_std(&results.iter().map(|result| result.mean).collect::<Vec<f64>>());
                Cell::MeanStd(mean, Some(std))
            }
        }
    };
    let row = |label: String, phase, stage| {
        let cells = curriculum.levels.iter().map(|level| mean_of(phase, stage, level));
        [label.into()].into_iter().chain(cells).collect::<Vec<Cell>>()
    };
    let mut rows = vec![row("before".to_owned(), Phase::Before, 0)];
    let stages = curriculum.stages.iter();
    rows.extend(stages.map(|stage| row(format!("level {}", stage.level.name()), Phase::After, stage.index)));
    let planner = |name: &str, of: fn(&Planned) -> Option<f64>| {
        let cells = planned.iter().map(|planned| planned_cell(of(planned)));
        [name.into()].into_iter().chain(cells).collect::<Vec<Cell>>()
    };
    rows.push(planner("A*", |planned| planned.astar));
    rows.push(planner("optimal", |planned| planned.optimal));
    let levels = curriculum.levels.iter().map(|level| format!("level {}", level.name()));
    Table {
        title: "Mean return on each level (columns) after each stage (rows: level last trained on)".to_owned(),
        columns: ["last trained on".to_owned()].into_iter().chain(levels).collect(),
        rows,
        notes: vec![deviation_note(runs.len())],
    }
}

/// What the number after ± is.
pub(super) fn deviation_note(seeds: usize) -> String {
    match seeds {
        1 => "Mean ± population standard deviation over every start cell of one seed: one seed tells nothing of the \
              spread between seeds."
            .to_owned(),
        seeds => {
            format!("Mean ± population standard deviation over {seeds} seeds, each the mean over every start cell.")
        }
    }
}
