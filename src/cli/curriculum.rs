//! `cpp-rl curriculum`.

use std::path::PathBuf;
use std::sync::Arc;

use anyhow::Result;
use clap::Args;
use tracing::warn;

use super::output::write_stdout;
use super::parse_levels;
use super::training::{TrainingArgs, carry_out, conclude};
use crate::agent::Stage;
use crate::error::UserError;
use crate::experiment::curriculum::ONLY;
use crate::experiment::{Curriculum, Timesteps};
use crate::messages::{Verbosity, past_bars};
use crate::report::analysis::Analysis;
use crate::report::{Format, Table, exhibits, render};
use crate::training::Event;

/// The level after whose stage the returns are printed at once, as the paper printed them.
const PRINTED_LEVEL: &str = "3";

/// Train agents on one level after another and print what they earn on every level.
#[derive(Debug, Args)]
pub struct CurriculumArgs {
    #[command(flatten)]
    training: TrainingArgs,
    /// The levels in the order of training: ids, ranges such as 0..5, or paths, separated by commas. A level may come again.
    #[arg(long, value_name = "SPEC", default_value = "0..5")]
    levels: String,
    /// Timesteps per stage and seed, or a list with those of each stage [default: the preset's, as in the paper].
    #[arg(long, value_name = "N")]
    timesteps: Option<Timesteps>,
    /// How the tables are printed.
    #[arg(long, value_enum, default_value_t = Format::Table)]
    format: Format,
}

impl CurriculumArgs {
    /// Trains through all stages; prints the table of level 3 when its stage ends, and the rest at the end.
    ///
    /// # Errors
    /// Wrong input, and seeds that failed.
    pub fn run(&self, verbosity: Verbosity) -> Result<()> {
        let for_all = match self.timesteps {
            Some(Timesteps::Each(timesteps)) => Some(timesteps),
            _ => None,
        };
        let config = self.training.config(for_all)?;
        let levels = parse_levels(&self.levels)?;
        let timesteps = self.timesteps.clone().unwrap_or(Timesteps::Each(config.shared.timesteps));
        let timesteps = timesteps.of_stages(levels.len(), levels.len());
        let timesteps = timesteps.map_err(|problem| UserError::new(format!("--{problem}")))?;
        let stages = levels.into_iter().map(Arc::new).zip(timesteps).collect();
        let curriculum =
            Curriculum::sequence(ONLY, stages).map_err(|problem| UserError::new(format!("--levels: {problem}")))?;
        let experiments = [self.training.experiment(config, curriculum, "curriculum")?];
        let [experiment] = &experiments;
        let stages = &experiment.curriculum.stages;
        let last = stages.len() as u16 - 1;
        let is_printed = |stage: &&Stage| stage.level.name() == PRINTED_LEVEL && stage.index != last;
        let early = stages.iter().find(is_printed).map(|stage| stage.index);

        // People see the first table as soon as its stage has ended for all seeds; programs get all tables at once.
        let mut waiting = if self.format == Format::Table { experiment.seeds.len() } else { usize::MAX };
        let outcomes = carry_out(&experiments, self.training.jobs(), verbosity, |event| {
            if let Event::StageDone { stage, .. } = event
                && Some(*stage) == early
            {
                waiting -= 1;
                if waiting == 0 {
                    let runs: Vec<PathBuf> = experiment.seeds.iter().map(|&seed| experiment.run_path(seed)).collect();
                    print_now(&runs, *stage);
                }
            }
        })?;

        let runs: Vec<PathBuf> =
            outcomes.iter().flat_map(|outcome| &outcome.finished).map(|run| run.path.clone()).collect();
        let early = early.filter(|_| waiting > 0);
        let printed = if runs.is_empty() { Ok(()) } else { self.print(&runs, early, last) };
        conclude(&experiments, &outcomes, printed)
    }

    /// Prints what these runs earn after the last stage, and after every stage; after `early` first.
    fn print(&self, runs: &[PathBuf], early: Option<u16>, last: u16) -> Result<()> {
        let analysis = Analysis::read(runs)?;
        analysis.left_out.iter().for_each(|left_out| warn!("missing from the tables: {}", left_out.why));
        let mut tables: Vec<Table> = early.map_or_else(Vec::new, |stage| after_stage(&analysis, stage));
        tables.extend(after_stage(&analysis, last));
        tables.extend(analysis.arms.iter().filter_map(|arm| exhibits::matrix_of_arm(&analysis, arm)));
        exhibits::cite(&mut tables);
        write_stdout(&render(&tables, self.format))
    }
}

/// The returns on every level after a stage.
fn after_stage(analysis: &Analysis, stage: u16) -> Vec<Table> {
    analysis.arms.iter().filter_map(|arm| exhibits::after_stage_of_arm(analysis, arm, stage)).collect()
}

/// Prints a stage's table while the training goes on, which it must not end.
fn print_now(runs: &[PathBuf], stage: u16) {
    let print = || -> Result<()> {
        let analysis = Analysis::read(runs)?;
        analysis.left_out.iter().for_each(|left_out| warn!("missing from the table: {}", left_out.why));
        let mut tables = after_stage(&analysis, stage);
        exhibits::cite(&mut tables);
        past_bars(|| write_stdout(&(render(&tables, Format::Table) + "\n")))
    };
    if let Err(error) = print() {
        warn!("cannot print the table of level {PRINTED_LEVEL}: {error:#}");
    }
}
