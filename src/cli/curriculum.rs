//! `cpp-rl curriculum`.

use anyhow::Result;
use clap::Args;

use super::parse_levels;
use super::training::{TrainingArgs, carry_out, conclude};
use crate::curriculum::Curriculum;
use crate::error::tell;
use crate::report::study::{Planned, after_stage, matrix};
use crate::report::{Format, Table};
use crate::run::evaluations::{self, Row};
use crate::training::progress::Verbosity;
use crate::training::{Event, Experiment};

/// The stage whose table the study prints: the one on this level.
const STUDY_LEVEL: &str = "3";

/// Train agents on one level after another and print the study's tables.
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
        let curriculum = Curriculum::sequence(parse_levels(&self.levels)?, config.timesteps)?;
        let experiment = self.training.experiment(config, curriculum, "curriculum")?;
        let max_steps = experiment.config.max_steps;
        let planned: Vec<Planned> =
            experiment.curriculum.levels.iter().map(|level| Planned::new(level, max_steps)).collect();

        let stages = &experiment.curriculum.stages;
        let study = stages.iter().find(|stage| stage.level.name() == STUDY_LEVEL).map(|stage| stage.index);
        let last = stages.len() as u16 - 1;
        let mut waiting = experiment.seeds.len();
        let outcome = carry_out(&experiment, verbosity, |event| match event {
            Event::StageDone { stage, .. } if Some(*stage) == study && *stage != last => {
                waiting -= 1;
                if waiting == 0 {
                    self.print_study_table(&experiment, *stage, &planned);
                }
            }
            _ => {}
        })?;

        let runs: Vec<Vec<Row>> = outcome.finished.iter().map(|run| run.evaluations.clone()).collect();
        if runs.is_empty() {
            return conclude(&experiment, verbosity, &outcome);
        }
        let tables = [
            after_stage(&experiment.curriculum, last, &runs, &planned),
            matrix(&experiment.curriculum, &runs, &planned),
        ];
        self.print(&tables)?;
        conclude(&experiment, verbosity, &outcome)
    }

    /// The study's Tables 2–4, from what the runs have written so far.
    fn print_study_table(&self, experiment: &Experiment, stage: u16, planned: &[Planned]) {
        let read = |&seed: &u64| evaluations::read(&experiment.run_path(seed)).unwrap_or_default();
        let runs: Vec<Vec<Row>> = experiment.seeds.iter().map(read).collect();
        let mut table = after_stage(&experiment.curriculum, stage, &runs, planned);
        table.title += " (the study's Tables 2-4)";
        if let Err(error) = self.print(&[table]) {
            tell(format_args!("cannot print the study's table: {error}"));
        }
    }

    fn print(&self, tables: &[Table]) -> Result<()> {
        for table in tables {
            let text = match self.format {
                Format::Json => serde_json::to_string(&table.to_json())? + "\n",
                format => table.render(format) + "\n",
            };
            super::eval::write_stdout(&text)?;
        }
        Ok(())
    }
}
