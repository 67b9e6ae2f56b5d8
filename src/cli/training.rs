//! What `train`, `curriculum` and `study` share: their arguments, and carrying experiments out.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::time::Duration;

use anyhow::{Result, anyhow};
use clap::Args;
use tracing::warn;

use super::midway::MidwayArgs;
use super::{Seeds, is_of_user, signals};
use crate::agent::config::{self, Config};
use crate::agent::engine::{Device, EngineKind, NoEngine};
use crate::dose::Dose;
use crate::error::{Interrupted, UserError};
use crate::experiment::Curriculum;
use crate::messages::{Verbosity, tell};
use crate::run::manifest::Manifest;
use crate::shell;
use crate::training::progress::{Progress, count_seeds};
use crate::training::saving::Saving;
use crate::training::{self, Event, Experiment, Outcome, run_label};

/// Arguments of a training of one arm.
#[derive(Clone, Debug, Args)]
pub struct TrainingArgs {
    /// The preset: dqn, ppo, ppo-eps, ppo-l2, ppo-l2-dohare, …; not needed where --config names one.
    #[arg(long, value_name = "NAME")]
    algo: Option<String>,
    /// Seeds, one run each: 4, or 0,2,5, or 0..10 for the ten from 0 to 9.
    #[arg(long, value_name = "SPEC", default_value = "0")]
    seeds: Seeds,
    /// A YAML file of settings, which replace the preset's; a run's config.yaml is such a file.
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,
    /// One setting, which replaces the preset's and the file's; may be given many times.
    #[arg(long, value_name = "KEY=VALUE")]
    set: Vec<String>,
    /// Methods against loss of plasticity, such as redo,layer-norm: the same as --set 'mitigations=[redo, layer-norm]';
    /// `cpp-rl config mitigations` lists them.
    #[arg(long, value_name = "NAME,…", value_delimiter = ',')]
    mitigation: Vec<String>,
    #[command(flatten)]
    launch: LaunchArgs,
}

/// How a training is carried out. With the fused engine nothing here changes what a seed learns. With the libtorch engine
/// two things change it by rounding: the device, and the number of threads, which decides how many seeds are computed
/// together.
#[derive(Clone, Debug, Args)]
pub struct LaunchArgs {
    /// The experiment's folder [default: runs/<command>].
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Continue existing runs, each exactly where it was saved last; start the others.
    #[arg(long)]
    resume: bool,
    /// Save running stages after every N updates (rollouts of PPO, 2,048 timesteps of DQN).
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..))]
    checkpoint_updates: Option<u64>,
    /// Save running stages every T minutes; 0 for never [default: 2, or 0 with --checkpoint-updates].
    #[arg(long, value_name = "T", value_parser = parse_minutes)]
    checkpoint_minutes: Option<Minutes>,
    /// Where networks are computed: cpu, cuda or cuda:N.
    #[arg(long, value_name = "DEVICE", default_value = "cpu")]
    device: Device,
    /// Timesteps between two measurements of plasticity (plasticity.csv); 0 for none. It changes no other result.
    #[arg(long, value_name = "N", default_value_t = 65_536)]
    plasticity_interval: u64,
    #[command(flatten)]
    midway: MidwayArgs,
    /// Threads that train [default: one per core].
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    jobs: Option<u16>,
}

/// A duration; none if it is 0.
type Minutes = Option<Duration>;

fn parse_minutes(text: &str) -> Result<Minutes, String> {
    let minutes = text.parse::<f64>().ok().filter(|minutes| (0.0..=1e6).contains(minutes));
    let minutes = minutes.ok_or("expected a number of minutes, such as 2 or 0.5")?;
    Ok((minutes > 0.0).then(|| Duration::from_secs_f64(60.0 * minutes)))
}

impl TrainingArgs {
    /// The resolved settings; `timesteps` replaces those that all layers say.
    ///
    /// # Errors
    /// The first setting that cannot be taken.
    pub fn config(&self, timesteps: Option<u64>) -> Result<Config> {
        let mut sets = self.set.clone();
        if !self.mitigation.is_empty() {
            if let Some(listed) = sets.iter().find(|set| set.split('=').next().map(str::trim) == Some("mitigations")) {
                let problem = format!("--mitigation and --set {listed} both list mitigations: drop one of the two");
                return Err(UserError::new(problem).into());
            }
            sets.push(format!("mitigations=[{}]", self.mitigation.join(", ")));
        }
        Ok(config::resolve(self.algo.as_deref(), self.config.as_deref(), &sets, timesteps)?)
    }

    /// The experiment that these arguments describe.
    ///
    /// # Errors
    /// Those of [`LaunchArgs::experiment`].
    pub fn experiment(&self, config: Config, curriculum: Curriculum, command: &str) -> Result<Experiment> {
        self.launch.experiment(config, curriculum, &self.seeds.0, &super::default_out(command))
    }

    /// Threads that train.
    pub fn jobs(&self) -> usize {
        self.launch.jobs()
    }
}

impl LaunchArgs {
    fn saving(&self) -> Saving {
        let unsaid = self.checkpoint_updates.is_none().then_some(SAVING_INTERVAL);
        Saving { updates: self.checkpoint_updates, interval: self.checkpoint_minutes.unwrap_or(unsaid) }
    }

    /// The experiment's folder, `default` where none is given.
    pub fn out(&self, default: &Path) -> PathBuf {
        self.out.clone().unwrap_or_else(|| default.to_owned())
    }

    /// Threads that train.
    pub fn jobs(&self) -> usize {
        self.jobs.map_or_else(|| std::thread::available_parallelism().map_or(1, usize::from), usize::from)
    }

    /// How `config` is computed.
    ///
    /// # Errors
    /// A device that is not there or does not suit the engine.
    pub fn engine(&self, config: &Config) -> Result<EngineKind> {
        let kind = EngineKind::choose(config.shared.engine, self.device).inspect_err(|problem| {
            if let NoEngine::NotLinked(_) = problem {
                super::process::hand_over();
            }
        });
        Ok(kind.map_err(|problem| UserError::new(problem.to_string()))?)
    }

    /// An experiment.
    ///
    /// # Errors
    /// A device that is not there or does not suit the engine, a network too large for any machine, and levels that are not
    /// there or do not suit the curriculum.
    pub fn experiment(
        &self,
        config: Config,
        curriculum: Curriculum,
        seeds: &[u64],
        default_out: &Path,
    ) -> Result<Experiment> {
        curriculum.levels.iter().try_for_each(|level| config.check_size(level)).map_err(UserError::new)?;
        let engine = self.engine(&config)?;
        let midway = self.midway.of(&curriculum)?;
        Ok(Experiment {
            config,
            curriculum,
            seeds: seeds.to_vec(),
            parents: None,
            out: self.out(default_out),
            engine,
            resume: self.resume,
            plasticity_interval: self.plasticity_interval,
            midway,
            saving: self.saving(),
            command: std::env::args().collect(),
        })
    }
}

/// What `--checkpoint-minutes` is where nothing says how often to save.
const SAVING_INTERVAL: Duration = Duration::from_secs(120);

/// Trains, showing progress, and says how each experiment ended; `on_event` sees every event first. From here on signals
/// ask it to stop.
///
/// # Errors
/// What kept the experiments from starting.
pub fn carry_out(
    experiments: &[Experiment],
    jobs: usize,
    verbosity: Verbosity,
    mut on_event: impl FnMut(&Event),
) -> Result<Vec<Outcome>> {
    let stop = signals::stop()?;
    say_what_they_are(experiments, verbosity);
    let mut progress = Progress::new(experiments, verbosity);
    let on_event = |experiment, event| {
        on_event(&event);
        progress.show(experiment, event);
    };
    let on_end = |i: usize, outcome: &Outcome| say_how_it_ended(&experiments[i], outcome);
    let outcomes = training::train(experiments, jobs, &stop, on_event, on_end);
    progress.finish();
    outcomes
}

/// The settings, if more is to be shown, and what is known of the dose; once where experiments have them in common.
fn say_what_they_are(experiments: &[Experiment], verbosity: Verbosity) {
    let mut said = BTreeSet::new();
    for Experiment { config, curriculum, .. } in experiments {
        let settings = (verbosity == Verbosity::Verbose).then(|| config.to_yaml().trim_end().to_owned());
        let dose = Dose::planned(config, curriculum).line();
        let dose = dose.map(|line| if experiments.len() > 1 { format!("{}: {line}", config.name) } else { line });
        for text in settings.into_iter().chain(dose) {
            if !said.contains(&text) {
                tell(&text);
                said.insert(text);
            }
        }
    }
}

/// Says where the runs are, and what the L2 penalty of those that finished amounted to.
fn say_how_it_ended(experiment: &Experiment, outcome: &Outcome) {
    let (finished, seeds) = (outcome.finished.len(), experiment.seeds.len());
    tell(format_args!("{finished} of {seeds} seeds finished in {}", experiment.folder().display()));
    measured_dose(outcome).iter().for_each(tell);
}

/// Turns failed and interrupted seeds into an error; `printed` is what became of the results that were printed before.
///
/// # Errors
/// Names every seed that failed, and says how to go on with those that a signal stopped; that results could not be
/// printed comes first, and changes nothing of it.
pub fn conclude(experiments: &[Experiment], outcomes: &[Outcome], printed: Result<()>) -> Result<()> {
    match (printed, problems(experiments, outcomes)) {
        (Err(unprinted), Err(error)) => Err(error.context(format!("{unprinted:#}"))),
        (printed, concluded) => printed.and(concluded),
    }
}

fn problems(experiments: &[Experiment], outcomes: &[Outcome]) -> Result<()> {
    let mut problems = Vec::new();
    let mut failures = Vec::new();
    for (i, outcome) in outcomes.iter().enumerate() {
        for (seed, why) in &outcome.failed {
            failures.push(format!("  {}: {why:#}", run_label(experiments, i, *seed)));
        }
    }
    if !failures.is_empty() {
        problems.push(format!("{} failed:\n{}", count_seeds(failures.len()), failures.join("\n")));
    }
    let seeds: usize = experiments.iter().map(|experiment| experiment.seeds.len()).sum();
    let finished: usize = outcomes.iter().map(|outcome| outcome.finished.len()).sum();
    let waiting = seeds - finished - failures.len();
    if waiting > 0 {
        let saved: usize = outcomes.iter().map(|outcome| outcome.interrupted.len()).sum();
        let (place, command) = match experiments {
            [experiment] => (experiment.folder(), &experiment.command),
            several => (several[0].out.clone(), &several[0].command),
        };
        problems.push(format!(
            "interrupted: {} saved in {}, {} not begun; go on with\n  {}",
            count_seeds(saved),
            place.display(),
            waiting - saved,
            resuming(command)
        ));
        return Err(Interrupted(problems.join("\n")).into());
    }
    if problems.is_empty() {
        return Ok(());
    }
    let mut failed = outcomes.iter().flat_map(|outcome| &outcome.failed);
    let message = problems.join("\n");
    if failed.all(|(_, why)| is_of_user(why)) { Err(UserError::new(message).into()) } else { Err(anyhow!(message)) }
}

/// The command line that goes on with what this one began, for a POSIX shell.
fn resuming(command: &[String]) -> String {
    let resume = if command.iter().any(|word| word == "--resume") { "" } else { " --resume" };
    shell::join(command) + resume
}

/// What the L2 penalty of the finished runs amounted to, a line per seed; nothing where there is none.
fn measured_dose(outcome: &Outcome) -> Vec<String> {
    let mut lines = Vec::new();
    for run in &outcome.finished {
        // The run is done; that it can be read no more is no failure of this training.
        let Ok(Manifest { dose, .. }) = Manifest::read(&run.path).inspect_err(|error| warn!("{error:#}")) else {
            continue;
        };
        let list =
            |values: &[Option<f64>]| values.iter().flatten().map(|v| format!("{v:.4}")).collect::<Vec<_>>().join(", ");
        let Some(dose) = dose.filter(|dose| dose.l2_ratio.iter().any(Option::is_some)) else { continue };
        lines.push(format!(
            "L2 dose of seed {}, stage by stage: ratio to the loss's gradient {}; norm of the weights {}",
            run.seed,
            list(&dose.l2_ratio),
            list(&dose.weight_norm)
        ));
    }
    lines
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_command_that_goes_on_can_be_pasted() {
        let command = |words: &[&str]| resuming(&words.iter().map(|&word| word.to_owned()).collect::<Vec<_>>());
        assert_eq!(command(&["cpp-rl", "train", "--seeds", "0..3"]), "cpp-rl train --seeds 0..3 --resume");
        assert_eq!(command(&["cpp-rl", "--resume", "--out", "it's here"]), r"cpp-rl --resume --out 'it'\''s here'");
    }

    #[test]
    fn minutes_are_bounded() {
        assert_eq!(parse_minutes("0.5"), Ok(Some(Duration::from_secs(30))));
        assert_eq!(parse_minutes("0"), Ok(None));
        assert!(["-1", "x", "nan", "inf", "1e300"].iter().all(|text| parse_minutes(text).is_err()));
    }
}
