//! What `train` and `curriculum` share: their arguments, and carrying an experiment out.

use std::path::PathBuf;

use anyhow::{Result, anyhow};
use clap::Args;
use serde_json::Value;
use tch::Device;

use super::Seeds;
use crate::agent::Backend;
use crate::config::{self, Config};
use crate::curriculum::Curriculum;
use crate::dose::Dose;
use crate::error::{UserError, tell};
use crate::run::manifest::Manifest;
use crate::training::progress::{Progress, Verbosity};
use crate::training::{Event, Experiment, Outcome};

/// Arguments of every training.
#[derive(Clone, Debug, Args)]
pub struct TrainingArgs {
    /// The preset: dqn, ppo, ppo-eps, ppo-l2, ppo-l2-dohare, …; may be left out where --config says it.
    #[arg(long, value_name = "NAME")]
    algo: Option<String>,
    /// Timesteps per stage and seed [default: the preset's, as in the study].
    #[arg(long, value_name = "N")]
    timesteps: Option<u64>,
    /// Seeds, one run each: 4, or 0,2,5, or 0..10 for the ten from 0 to 9.
    #[arg(long, value_name = "SPEC", default_value = "0")]
    seeds: Seeds,
    /// A YAML file of settings on top of the preset; a run's config.yaml is one.
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,
    /// One setting on top of preset and file; may be given many times.
    #[arg(long, value_name = "KEY=VALUE")]
    set: Vec<String>,
    /// The experiment's folder [default: runs/<command>].
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Go on with runs that are there already, each from its last finished stage; start those that are not.
    #[arg(long)]
    resume: bool,
    /// Where networks are computed: cpu, cuda or cuda:N.
    #[arg(long, value_name = "DEVICE", default_value = "cpu", value_parser = parse_device)]
    device: Device,
    /// Timesteps between two measurements of plasticity (plasticity.csv); 0 for none. It changes no other result.
    #[arg(long, value_name = "N", default_value_t = 65_536)]
    plasticity_interval: u64,
    /// Threads that train [default: one per core].
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    jobs: Option<u16>,
}

fn parse_device(text: &str) -> Result<Device, String> {
    let index = match text.split_once(':') {
        None if text == "cpu" => return Ok(Device::Cpu),
        None if text == "cuda" => Some(0),
        Some(("cuda", index)) => index.parse().ok(),
        _ => None,
    };
    index.map(Device::Cuda).ok_or_else(|| format!("expected cpu, cuda or cuda:N, got {text:?}"))
}

impl TrainingArgs {
    /// The resolved settings.
    ///
    /// # Errors
    /// The first setting that cannot be taken.
    pub fn config(&self) -> Result<Config> {
        Ok(config::resolve(self.algo.as_deref(), self.config.as_deref(), &self.set, self.timesteps)?)
    }

    /// The experiment that these arguments describe.
    ///
    /// # Errors
    /// A device that is not there or does not suit the kernel.
    pub fn experiment(&self, config: Config, curriculum: Curriculum, command: &str) -> Result<Experiment> {
        if let Device::Cuda(index) = self.device
            && tch::Cuda::device_count() <= index as i64
        {
            return Err(UserError::new(format!(
                "--device cuda:{index}: libtorch sees {} CUDA devices; build against a CUDA libtorch by setting \
                 LIBTORCH to it (see docs/install.md)",
                tch::Cuda::device_count()
            ))
            .into());
        }
        let backend = Backend::choose(config.kernel, self.device).map_err(UserError::new)?;
        let cores = std::thread::available_parallelism().map_or(1, usize::from);
        Ok(Experiment {
            config,
            curriculum,
            seeds: self.seeds.0.clone(),
            out: self.out.clone().unwrap_or_else(|| super::default_out(command)),
            jobs: self.jobs.map_or(cores, usize::from),
            backend,
            resume: self.resume,
            plasticity_interval: self.plasticity_interval,
            command: std::env::args().collect(),
        })
    }
}

/// Trains, showing progress; `on_event` sees every event first and may print to stdout.
///
/// # Errors
/// What kept the experiment from starting.
pub fn carry_out(experiment: &Experiment, verbosity: Verbosity, mut on_event: impl FnMut(&Event)) -> Result<Outcome> {
    let mut progress = Progress::new(experiment, verbosity);
    if verbosity == Verbosity::Verbose {
        tell(experiment.config.to_yaml().trim_end());
    }
    let dose = Dose::new(&experiment.config, &experiment.curriculum, &Value::Null);
    if let Some(line) = dose.line().filter(|_| verbosity != Verbosity::Quiet) {
        tell(line);
    }
    let outcome = experiment.run(|event| {
        progress.suspend(|| on_event(&event));
        progress.show(event);
    });
    progress.finish();
    outcome
}

/// Says where the runs are, and turns failed seeds into an error.
///
/// # Errors
/// Names every seed that failed.
pub fn conclude(experiment: &Experiment, verbosity: Verbosity, outcome: &Outcome) -> Result<()> {
    let place = experiment.out.join(&experiment.config.name).join(&experiment.curriculum.name);
    if verbosity != Verbosity::Quiet {
        measured_dose(outcome)?.iter().for_each(tell);
        let (finished, seeds) = (outcome.finished.len(), experiment.seeds.len());
        tell(format_args!("{finished} of {seeds} seeds finished in {}", place.display()));
    }
    if outcome.failed.is_empty() {
        return Ok(());
    }
    let each = outcome.failed.iter().map(|(seed, why)| format!("  seed {seed}: {why}"));
    Err(anyhow!("{} seeds failed:\n{}", outcome.failed.len(), each.collect::<Vec<_>>().join("\n")))
}

/// What the L2 penalty of the finished runs amounted to, a line per seed; nothing where there is none.
fn measured_dose(outcome: &Outcome) -> Result<Vec<String>> {
    let mut lines = Vec::new();
    for run in &outcome.finished {
        let dose = Manifest::read(&run.path)?.dose;
        let list = |key: &str| {
            let numbers = dose.get(key).and_then(Value::as_array).map_or(&[][..], Vec::as_slice);
            numbers.iter().filter_map(Value::as_f64).map(|v| format!("{v:.4}")).collect::<Vec<_>>().join(", ")
        };
        if !list("l2_ratio").is_empty() {
            lines.push(format!(
                "L2 dose of seed {}, stage by stage: ratio to the loss's gradient {}; norm of the weights {}",
                run.seed,
                list("l2_ratio"),
                list("weight_norm")
            ));
        }
    }
    Ok(lines)
}
