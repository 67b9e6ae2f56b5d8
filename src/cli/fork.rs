//! `cpp-rl fork`.

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::Arc;

use anyhow::{Context, Result};
use clap::Args;
use coverage_env::Level;

use super::default_out;
use super::output::print_evaluations;
use super::training::{LaunchArgs, carry_out, conclude};
use crate::agent::config::Config;
use crate::error::UserError;
use crate::experiment::curriculum::LEVEL;
use crate::experiment::timesteps::POSSIBLE;
use crate::experiment::{Curriculum, Fork, parse_treatment};
use crate::messages::Verbosity;
use crate::report::Format;
use crate::report::find::find_runs;
use crate::results::{Evaluation, Policy};
use crate::run::evaluations::{Phase, level_result};
use crate::run::manifest::Manifest;
use crate::run::{Parents, stage_checkpoint};
use crate::training::Experiment;

/// Let agents go on from the end of a stage under treatments, beside the curriculum that they come from.
///
/// A fork has the random numbers of the stage that it replaces. So with the treatment {} it does again what its parent did.
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  cpp-rl fork runs/curriculum/ppo/curriculum/seed-0 --after 0 --treatment '{optimizer: fresh}'
  cpp-rl fork runs/curriculum --after 0 --stages 2 --treatment '{}' --treatment '{scale: {policy.2: 0.02}}'
  cpp-rl compare runs/curriculum runs/fork

A treatment is any combination of
  weights: fresh              new weights; or a list of towers and layers, such as [value, policy.2]
  optimizer: fresh            Adam's state from zero; or such a list
  scale: {policy.2: 0.02}     weights and biases of a layer or tower, multiplied
  target: keep                DQN's target network: follow (it is treated too), keep, or renew (a copy of the network)
  set: [ent_coef=0.1]         settings
It may have a name: 'unsure: {scale: {policy.2: 0.02}}'")]
pub struct ForkArgs {
    /// The parents: directories of runs through a curriculum, or folders of such runs.
    #[arg(value_name = "RUN", required = true)]
    runs: Vec<PathBuf>,
    /// The number of the finished stage that they go on from, from 0.
    #[arg(long, value_name = "K")]
    after: u16,
    /// How many of the stages that follow are trained.
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u16).range(1..))]
    stages: u16,
    /// Timesteps of each of them [default: those of the stages that they replace].
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(POSSIBLE))]
    timesteps: Option<u64>,
    /// What is done to the agents, as a YAML mapping; may be given many times.
    #[arg(long, value_name = "TREATMENT", required = true)]
    treatment: Vec<String>,
    /// How the evaluations after the last stage are printed.
    #[arg(long, value_enum, default_value_t = Format::Table)]
    format: Format,
    #[command(flatten)]
    launch: LaunchArgs,
}

/// A run that others go on from.
struct Parent {
    path: PathBuf,
    manifest: Manifest,
    config: Config,
    curriculum: Curriculum,
}

impl ForkArgs {
    /// Trains the forks, then prints what each earns from every start cell.
    ///
    /// # Errors
    /// Wrong input, and seeds that failed.
    pub fn run(&self, verbosity: Verbosity) -> Result<()> {
        let parents = self.parents()?;
        let mut experiments: Vec<Experiment> = Vec::new();
        for parent in &parents {
            for text in &self.treatment {
                self.add(&mut experiments, parent, text)?;
            }
        }
        let outcomes = carry_out(&experiments, self.launch.jobs(), verbosity, |_| {})?;
        let mut evaluations = Vec::new();
        for (experiment, outcome) in experiments.iter().zip(&outcomes) {
            let last = experiment.curriculum.stages.len() as u16 - 1;
            let of_level = |rows: &[_]| {
                let levels = experiment.curriculum.levels.iter();
                levels
                    .filter_map(|level| level_result(rows, Phase::After, last, level.name(), Policy::Greedy))
                    .collect()
            };
            evaluations.extend(outcome.finished.iter().map(|run| Evaluation {
                policy: experiment.label(),
                run: Some(run.path.display().to_string()),
                stage: Some(last),
                seed: Some(run.seed),
                levels: of_level(&run.evaluations),
            }));
        }
        let printed = print_evaluations(&evaluations, self.format);
        conclude(&experiments, &outcomes, printed)
    }

    /// The runs to go on from, each of which has what is needed.
    fn parents(&self) -> Result<Vec<Parent>> {
        let mut paths = Vec::new();
        for path in &self.runs {
            let found =
                find_runs(path).map_err(|error| UserError::new(format!("cannot list {}: {error}", path.display())))?;
            if found.runs.is_empty() {
                let problem = "holds no run: name a run's directory, or a folder of runs";
                return Err(UserError::new(format!("{} {problem}", path.display())).into());
            }
            let is_one = found.runs.len() == 1;
            for run in found.runs {
                let manifest = Manifest::read(&run)?;
                // A folder may hold runs on single levels and other forks, too; a run that was named must be fit.
                if is_one || (!manifest.curriculum.starts_with(LEVEL) && manifest.fork.is_none()) {
                    paths.push((run, manifest));
                }
            }
        }
        if paths.is_empty() {
            let problem = "none of these runs goes through a curriculum without being a fork: name one that does";
            return Err(UserError::new(problem).into());
        }
        paths.sort_by(|(one, _), (other, _)| one.cmp(other));
        paths.dedup_by(|(one, _), (other, _)| one == other);
        paths.into_iter().map(|(path, manifest)| self.parent(path, manifest)).collect()
    }

    fn parent(&self, path: PathBuf, manifest: Manifest) -> Result<Parent> {
        let refuse = |problem: String| Err(UserError::new(format!("{}: {problem}", path.display())).into());
        if manifest.fork.is_some() {
            return refuse("a fork of a fork is not possible: fork its parent".to_owned());
        }
        let stages = manifest.stages.len();
        let ends = usize::from(self.after) + 1 + usize::from(self.stages);
        if ends > stages {
            let problem = match stages {
                0 | 1 => "the run has one stage, and none after it: fork a run through a curriculum".to_owned(),
                _ => format!(
                    "--after {} --stages {} needs {ends} stages, and the run has {stages}: the two together can be at most {}",
                    self.after,
                    self.stages,
                    stages - 1
                ),
            };
            return refuse(problem);
        }
        if manifest.stages_done <= self.after || !stage_checkpoint(&path, self.after).is_file() {
            let done = manifest.stages_done;
            return refuse(format!("stage {} is not done ({done} of {stages} are): train it first", self.after));
        }
        let config = Config::recorded(&manifest.config).with_context(|| path.display().to_string())?;
        let mut levels: BTreeMap<&str, Arc<Level>> = BTreeMap::new();
        for stage in &manifest.stages {
            if !levels.contains_key(stage.level.as_str()) {
                levels.insert(&stage.level, Level::from_map(stage.level.clone(), &stage.map)?.into());
            }
        }
        let stages = manifest.stages.iter().map(|stage| (levels[stage.level.as_str()].clone(), stage.timesteps));
        let curriculum = Curriculum::sequence(manifest.curriculum.clone(), stages.collect())?;
        Ok(Parent { path, config, curriculum, manifest })
    }

    /// Adds a parent under a treatment: a seed more of an experiment that is there, or an experiment of its own.
    fn add(&self, experiments: &mut Vec<Experiment>, parent: &Parent, text: &str) -> Result<()> {
        let (treatment, config) = parse_treatment(text, &parent.config, &parent.curriculum.levels[0])?;
        let fork = Fork { after: self.after, stages: self.stages, timesteps: self.timesteps, treatment, config };
        let Some(curriculum) = fork.curriculum(&parent.curriculum) else {
            return Err(UserError::new(format!("{}: too few stages", parent.path.display())).into());
        };
        let (seed, out) = (parent.manifest.seed, default_out("fork"));
        let config = fork.config.clone();
        let mut experiment = self.launch.experiment(config, curriculum, &[seed], &out)?;
        let directories = BTreeMap::from([(seed, parent.path.clone())]);
        experiment.parents = Some(Parents { fork, directories, experiment: None });
        let folder = experiment.folder();
        let Some(other) = experiments.iter_mut().find(|other| other.folder() == folder) else {
            experiments.push(experiment);
            return Ok(());
        };
        if other.config != experiment.config || !alike(other, &experiment) || other.seeds.contains(&seed) {
            let problem =
                "two of these forks would lie there: give runs of one study at a time, and each treatment once";
            return Err(UserError::new(format!("{}: {problem}", folder.display())).into());
        }
        other.seeds.push(seed);
        other.seeds.sort_unstable();
        if let Some(parents) = &mut other.parents {
            parents.directories.insert(seed, parent.path.clone());
        }
        Ok(())
    }
}

/// Whether two experiments have the same stages.
fn alike(one: &Experiment, other: &Experiment) -> bool {
    let stages = |experiment: &Experiment| {
        let stages = experiment.curriculum.stages.iter();
        stages.map(|stage| (stage.level.name().to_owned(), stage.level.to_map(), stage.timesteps)).collect::<Vec<_>>()
    };
    stages(one) == stages(other)
}
