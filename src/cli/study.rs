//! `cpp-rl study`.

mod estimate;

use std::path::PathBuf;

use anyhow::Result;
use clap::Args;

use super::training::{LaunchArgs, carry_out, conclude};
use super::{Seeds, default_out};
use crate::error::UserError;
use crate::experiment::Study;
use crate::experiment::study::Planned;
use crate::messages::{Verbosity, tell};
use crate::report::Format;
use crate::run::Parents;
use crate::training::Experiment;
use estimate::Estimate;

/// More runs than this are trained only if someone says so.
const MANY_RUNS: usize = 10_000;

/// Train every arm of a study file, through its sequences of levels and on each level from scratch.
#[derive(Debug, Args)]
pub struct StudyArgs {
    /// The study file [default: configs/paper.yaml, which has the paper's arms and their controls].
    #[arg(value_name = "FILE")]
    file: Option<PathBuf>,
    /// How many seeds each arm has: 0 to N − 1.
    #[arg(long, value_name = "N", default_value_t = 10, value_parser = clap::value_parser!(u64).range(1..=10_000))]
    num_seeds: u64,
    /// The seeds instead: 4, or 0,2,5, or 0..10 for the ten from 0 to 9.
    #[arg(long, value_name = "SPEC", conflicts_with = "num_seeds")]
    seeds: Option<Seeds>,
    /// Timesteps per stage and seed, for all arms and stages [default: the file's, else those of each preset].
    #[arg(long, value_name = "N")]
    timesteps: Option<u64>,
    /// Only list what would be trained, and say how long it would take.
    #[arg(long)]
    estimate: bool,
    /// How the list of --estimate is printed.
    #[arg(long, value_enum, default_value_t = Format::Table, requires = "estimate")]
    format: Format,
    /// Train more than 10,000 runs.
    #[arg(long)]
    yes: bool,
    #[command(flatten)]
    launch: LaunchArgs,
}

impl StudyArgs {
    /// Says how long it will take, then trains all experiments from one queue; a seed that fails keeps no other from
    /// training.
    ///
    /// # Errors
    /// Wrong input, seeds that failed, and an interruption.
    pub fn run(&self, verbosity: Verbosity) -> Result<()> {
        let study = match &self.file {
            Some(file) => Study::read(file, self.timesteps)?,
            None => Study::paper(self.timesteps)?,
        };
        let seeds = self.seeds.as_ref().map_or_else(|| (0..self.num_seeds).collect(), |seeds| seeds.0.clone());
        let planned = study.experiments(&seeds)?;
        let runs: usize = planned.iter().map(|planned| planned.seeds.len()).sum();
        if runs > MANY_RUNS && !self.yes && !self.estimate {
            let remedy = "see them with --estimate, and train them with --yes";
            return Err(
                UserError::new(format!("{}: {runs} runs are more than {MANY_RUNS}: {remedy}", study.name)).into()
            );
        }
        let out = default_out(&study.name);
        let mut experiments: Vec<Experiment> = Vec::with_capacity(planned.len());
        for Planned { config, curriculum, seeds, fork } in planned {
            let mut experiment = self.launch.experiment(config.clone(), curriculum, &seeds, &out)?;
            experiment.parents = fork.map(|(fork, parent)| Parents {
                fork: fork.clone(),
                directories: seeds.iter().map(|&seed| (seed, experiments[parent].run_path(seed))).collect(),
                experiment: Some(parent),
            });
            experiments.push(experiment);
        }
        let engine = |config: &_| self.launch.engine(config);
        let estimate = Estimate::new(&study.name, &experiments, self.launch.jobs(), engine)?;
        if self.estimate {
            return estimate.print(self.format);
        }
        tell(estimate.summary());
        let outcomes = carry_out(&experiments, self.launch.jobs(), verbosity, |_| {})?;
        let out = self.launch.out(&out);
        if outcomes.iter().any(|outcome| !outcome.finished.is_empty()) {
            tell(format_args!("the report: cpp-rl compare {0} --out {0}/report", out.display()));
        }
        conclude(&experiments, &outcomes, Ok(()))
    }
}
