//! `cpp-rl study`.

use std::path::PathBuf;
use std::time::Duration;

use anyhow::{Result, anyhow};
use clap::Args;

use super::training::{LaunchArgs, carry_out, conclude};
use super::{Seeds, default_out};
use crate::config::Config;
use crate::curriculum::Curriculum;
use crate::error::Interrupted;
use crate::messages::{Verbosity, tell};
use crate::run::manifest::Manifest;
use crate::study::{Study, measure_rate};
use crate::training::Experiment;

/// Train every arm of a study, through its levels and on each of them afresh.
#[derive(Debug, Args)]
pub struct StudyArgs {
    /// The study's file; configs/paper.yaml is one [default: that one, the published study with its controls].
    #[arg(value_name = "FILE")]
    file: Option<PathBuf>,
    /// How many seeds each arm has: 0 to N − 1.
    #[arg(long, value_name = "N", default_value_t = 10, value_parser = clap::value_parser!(u64).range(1..=10_000))]
    num_seeds: u64,
    /// The seeds by number instead: 4, or 0,2,5, or 0..10 for the ten from 0 to 9.
    #[arg(long, value_name = "SPEC", conflicts_with = "num_seeds")]
    seeds: Option<Seeds>,
    /// Timesteps per stage and seed, for all arms [default: those of each preset, as in the study].
    #[arg(long, value_name = "N")]
    timesteps: Option<u64>,
    /// Say what would be trained and how long it would take, and train nothing.
    #[arg(long)]
    estimate: bool,
    #[command(flatten)]
    launch: LaunchArgs,
}

impl StudyArgs {
    /// Says how long it will take, then trains one experiment after another; a seed that fails keeps no other from
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
        let mut failures = Vec::new();
        for (i, experiment) in experiments.iter().enumerate() {
            let (arm, curriculum) = (&experiment.config.name, &experiment.curriculum.name);
            tell(format_args!("{} of {}: {arm}, {curriculum}", i + 1, experiments.len()));
            let outcome = carry_out(experiment, verbosity, |_| {})?;
            match conclude(experiment, verbosity, &outcome, Ok(())) {
                Err(error) if error.is::<Interrupted>() => return Err(error),
                Err(error) => failures.push(format!("{arm}, {curriculum}: {error:#}")),
                Ok(()) => {}
            }
        }
        let out = self.launch.out(&out);
        tell(format_args!("the report: cpp-rl compare {0} --out {0}/report", out.display()));
        if failures.is_empty() { Ok(()) } else { Err(anyhow!(failures.join("\n"))) }
    }

    /// Tells what is to be trained, and for how long, by a short trial of each arm's speed.
    fn say_what_is_left(&self, study: &Study, experiments: &[Experiment]) -> Result<()> {
        let (mut timesteps, mut seconds, mut rates) = (0, 0.0, Vec::new());
        for arm in &study.arms {
            let of_arm = experiments.iter().filter(|experiment| experiment.config.name == arm.config.name);
            let left: u64 = of_arm.map(timesteps_left).sum();
            if left == 0 {
                continue;
            }
            let rate = measure_rate(&arm.config, &study.levels[0], self.launch.backend(&arm.config)?);
            timesteps += left;
            seconds += left as f64 / rate;
            rates.push(format!("{} {rate:.0}", arm.config.name));
        }
        let jobs = self.launch.jobs();
        let time = indicatif::HumanDuration(Duration::from_secs_f64(seconds / jobs as f64));
        tell(format_args!(
            "{}: {} experiments of {} seeds, {timesteps} timesteps to go: about {time} on {jobs} threads (timesteps/s of \
             one: {})",
            study.name,
            experiments.len(),
            experiments.first().map_or(0, |experiment| experiment.seeds.len()),
            if rates.is_empty() { "nothing is left".to_owned() } else { rates.join(", ") }
        ));
        Ok(())
    }
}

/// Timesteps of an experiment's stages that no run has finished yet.
fn timesteps_left(experiment: &Experiment) -> u64 {
    let of_seed = |&seed: &u64| {
        let manifest = Manifest::read(&experiment.run_path(seed)).ok().filter(|_| experiment.resume);
        let done = manifest.map_or(0, |manifest| usize::from(manifest.stages_done));
        experiment.curriculum.stages.iter().skip(done).map(|stage| stage.timesteps).sum::<u64>()
    };
    experiment.seeds.iter().map(of_seed).sum()
}
