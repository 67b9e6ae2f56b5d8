//! `cpp-rl study`.

use std::collections::BTreeMap;
use std::iter::repeat;
use std::path::PathBuf;
use std::time::Duration;

use anyhow::Result;
use clap::Args;
use indicatif::HumanDuration;

use super::training::{LaunchArgs, carry_out, conclude};
use super::{Seeds, default_out};
use crate::agent::config::Config;
use crate::curriculum::Curriculum;
use crate::messages::{Verbosity, tell};
use crate::run::manifest::Manifest;
use crate::study::{Study, measure_rate};
use crate::training::progress::count_seeds;
use crate::training::{Experiment, Work, queue, seconds_until_done};

/// Train every arm of a study file, through its levels and on each of them from scratch.
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
    /// Timesteps per stage and seed, for all arms [default: those of each preset, as in the paper].
    #[arg(long, value_name = "N")]
    timesteps: Option<u64>,
    /// Only say what would be trained and how long it would take.
    #[arg(long)]
    estimate: bool,
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
        let out = default_out(&study.name);
        let make = |(config, curriculum): (&Config, Curriculum)| {
            self.launch.experiment(config.clone(), curriculum, &seeds, &out)
        };
        let experiments = study.experiments()?.into_iter().map(make).collect::<Result<Vec<_>>>()?;
        self.say_what_is_left(&study, &experiments)?;
        if self.estimate {
            return Ok(());
        }
        let outcomes = carry_out(&experiments, self.launch.jobs(), verbosity, |_| {})?;
        let out = self.launch.out(&out);
        if outcomes.iter().any(|outcome| !outcome.finished.is_empty()) {
            tell(format_args!("the report: cpp-rl compare {0} --out {0}/report", out.display()));
        }
        conclude(&experiments, &outcomes, Ok(()))
    }

    /// Tells what is to be trained, and for how long. A short trial measures each arm's speed.
    fn say_what_is_left(&self, study: &Study, experiments: &[Experiment]) -> Result<()> {
        let jobs = self.launch.jobs();
        let queue: Vec<(&Config, u64)> = queue(experiments, jobs)
            .into_iter()
            .map(|Work { experiment, seeds }| {
                let experiment = &experiments[experiment];
                (&experiment.config, seeds.iter().map(|&seed| timesteps_left(experiment, seed)).sum::<u64>())
            })
            .collect();
        let mut rates = BTreeMap::new();
        for arm in &study.arms {
            let name = arm.config.name.as_str();
            if queue.iter().any(|(config, left)| config.name == name && *left > 0) {
                let rate = measure_rate(&arm.config, &study.levels[0], self.launch.engine(&arm.config)?);
                rates.insert(name, rate);
            }
        }
        // Seeds that share a thread are counted one after another, which is more than they take.
        let seconds = queue.iter().map(|(config, left)| match rates.get(config.name.as_str()) {
            Some(rate) => *left as f64 / rate,
            None => 0.0,
        });
        let time = HumanDuration(Duration::from_secs_f64(seconds_until_done(seconds, jobs)));
        let timesteps: u64 = queue.iter().map(|(_, left)| left).sum();
        let rates: Vec<String> = rates.iter().map(|(name, rate)| format!("{name} {rate:.0}")).collect();
        tell(format_args!(
            "{}: {} experiments of {}, {timesteps} timesteps to go: about {time} on {jobs} threads (timesteps/s of \
             one: {})",
            study.name,
            experiments.len(),
            count_seeds(experiments.first().map_or(0, |experiment| experiment.seeds.len())),
            if rates.is_empty() { "nothing is left".to_owned() } else { rates.join(", ") }
        ));
        Ok(())
    }
}

/// Timesteps that a seed has still to do, of stages which it has not finished or which are to become longer.
fn timesteps_left(experiment: &Experiment, seed: u64) -> u64 {
    let manifest = Manifest::read(&experiment.run_path(seed)).ok().filter(|_| experiment.resume);
    let finished = manifest.map_or_else(Vec::new, |manifest| {
        let finished = manifest.stages.iter().take(manifest.stages_done.into());
        finished.map(|stage| stage.timesteps).collect()
    });
    let done = finished.into_iter().chain(repeat(0));
    experiment.curriculum.stages.iter().zip(done).map(|(stage, done)| stage.timesteps.saturating_sub(done)).sum()
}
