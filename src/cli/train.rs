//! `cpp-rl train`.

use anyhow::Result;
use clap::Args;
use coverage_env::Level;

use super::output::print_evaluations;
use super::training::{TrainingArgs, carry_out, conclude};
use crate::experiment::Curriculum;
use crate::messages::Verbosity;
use crate::report::Format;
use crate::results::{Evaluation, Policy};
use crate::run::evaluations::{Phase, level_result};

/// Train agents on one level.
#[derive(Debug, Args)]
pub struct TrainArgs {
    #[command(flatten)]
    training: TrainingArgs,
    /// The level: an id in levels/ or a path to a file.
    #[arg(long, value_name = "LEVEL")]
    level: String,
    /// Timesteps per seed [default: the preset's, as in the paper].
    #[arg(long, value_name = "N")]
    timesteps: Option<u64>,
    /// How the final evaluation is printed.
    #[arg(long, value_enum, default_value_t = Format::Table)]
    format: Format,
}

impl TrainArgs {
    /// Trains, then prints what each seed earns from every start cell.
    ///
    /// # Errors
    /// Wrong input, and seeds that failed.
    pub fn run(&self, verbosity: Verbosity) -> Result<()> {
        let config = self.training.config(self.timesteps)?;
        let curriculum = Curriculum::single(Level::resolve(&self.level)?, config.shared.timesteps);
        let experiments = [self.training.experiment(config, curriculum, "train")?];
        let outcomes = carry_out(&experiments, self.training.jobs(), verbosity, |_| {})?;
        let [experiment] = &experiments;
        let level = experiment.curriculum.levels[0].name();
        let evaluations: Vec<Evaluation> = outcomes
            .iter()
            .flat_map(|outcome| &outcome.finished)
            .map(|run| Evaluation {
                policy: experiment.config.name.clone(),
                run: Some(run.path.display().to_string()),
                stage: Some(0),
                seed: Some(run.seed),
                levels: level_result(&run.evaluations, Phase::After, 0, level, Policy::Greedy).into_iter().collect(),
            })
            .collect();
        let printed = print_evaluations(&evaluations, self.format);
        conclude(&experiments, &outcomes, printed)
    }
}
