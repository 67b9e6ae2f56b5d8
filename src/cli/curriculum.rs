//! `cpp-rl curriculum`.

use anyhow::Result;
use clap::Args;
use tracing::warn;

use super::output::write_stdout;
use super::parse_levels;
use super::training::{TrainingArgs, carry_out, conclude};
use crate::agent::Stage;
use crate::curriculum::Curriculum;
use crate::error::UserError;
use crate::messages::{Verbosity, past_bars};
use crate::report::study::{Planned, after_stage, matrix};
use crate::report::{Format, Table, render};
use crate::run::evaluations::{self, Row};
use crate::training::{Event, Experiment};

/// The stage whose table the study prints: the one on this level.
const STUDY_LEVEL: &str = "3";

/// Train agents on one level after another and print the paper's tables.
#[derive(Debug, Args)]
pub struct CurriculumArgs {
    #[command(flatten)]
    training: TrainingArgs,
    /// The levels in the order of training: ids, ranges such as 0..5, or paths, separated by commas.
    #[arg(long, value_name = "SPEC", default_value = "0..5")]
    levels: String,
    /// How the tables are printed.
    #[arg(long, value_enum, default_value_t = Format::Table)]
    format: Format,
}

impl CurriculumArgs {
    /// Trains through all stages; prints the study's table when its stage ends, and the rest at the end.
    ///
    /// # Errors
    /// Wrong input, and seeds that failed.
    pub fn run(&self, verbosity: Verbosity) -> Result<()> {
        let config = self.training.config()?;
        let curriculum = Curriculum::sequence(parse_levels(&self.levels)?, config.timesteps)
            .map_err(|problem| UserError::new(format!("--levels: {problem}")))?;
        let experiments = [self.training.experiment(config, curriculum, "curriculum")?];
        let [experiment] = &experiments;
        let max_steps = experiment.config.max_steps;
        let planned: Vec<Planned> =
            experiment.curriculum.levels.iter().map(|level| Planned::new(level, max_steps)).collect();

        let stages = &experiment.curriculum.stages;
        let last = stages.len() as u16 - 1;
        let is_study = |stage: &&Stage| stage.level.name() == STUDY_LEVEL && stage.index != last;
        let study = stages.iter().find(is_study).map(|stage| stage.index);
        let study_table = |stage, runs: &[Vec<Row>]| {
            let mut table = after_stage(&experiment.curriculum, stage, runs, &planned);
            table.title += " (the study's Tables 2-4)";
            table
        };

        // People see the study's table as soon as its stage has ended for all seeds; programs get all tables at once.
        let mut waiting = if self.format == Format::Table { experiment.seeds.len() } else { usize::MAX };
        let outcomes = carry_out(&experiments, self.training.jobs(), verbosity, |event| {
            if let Event::StageDone { stage, .. } = event
                && Some(*stage) == study
            {
                waiting -= 1;
                if waiting == 0 {
                    print_now(&study_table(*stage, &written(experiment)));
                }
            }
        })?;

        let finished = outcomes.iter().flat_map(|outcome| &outcome.finished);
        let runs: Vec<Vec<Row>> = finished.map(|run| run.evaluations.clone()).collect();
        let mut printed = Ok(());
        if !runs.is_empty() {
            let late = study.filter(|_| waiting > 0).map(|stage| study_table(stage, &runs));
            let mut tables: Vec<Table> = late.into_iter().collect();
            tables.push(after_stage(&experiment.curriculum, last, &runs, &planned));
            tables.push(matrix(&experiment.curriculum, &runs, &planned));
            printed = write_stdout(&render(&tables, self.format));
        }
        conclude(&experiments, &outcomes, printed)
    }
}

/// What each seed's run has written so far; a file that cannot be read is told of and left out.
fn written(experiment: &Experiment) -> Vec<Vec<Row>> {
    let read = |&seed: &u64| match evaluations::read(&experiment.run_path(seed)) {
        Ok(rows) => Some(rows),
        Err(error) => {
            warn!("seed {seed} is missing from the table: {error:#}");
            None
        }
    };
    experiment.seeds.iter().filter_map(read).collect()
}

/// Prints a table while the training goes on, which it must not end.
fn print_now(table: &Table) {
    if let Err(error) = past_bars(|| write_stdout(&(table.render(Format::Table) + "\n"))) {
        warn!("cannot print the study's table: {error:#}");
    }
}
