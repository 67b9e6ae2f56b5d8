//! `cpp-rl eval`.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::{Context, Result};
use clap::Args;
use coverage_env::Level;

use super::output::print_evaluations;
use super::{StartArgs, parse_levels};
use crate::agent::Behaviour;
use crate::agent::config::Config;
use crate::error::UserError;
use crate::evaluate::{self, Choose};
use crate::random::{Purpose, Stream};
use crate::report::Format;
use crate::results::Evaluation;
use crate::run::checkpoint::Checkpoint;
use crate::run::manifest::{self, Manifest};
use crate::run::stage_checkpoint;

/// Evaluate checkpoints.
#[derive(Debug, Args)]
pub struct EvalArgs {
    /// Checkpoint files or runs' directories.
    #[arg(value_name = "CHECKPOINT|RUN", required = true)]
    models: Vec<PathBuf>,
    /// The stage of a run [default: its last].
    #[arg(long, value_name = "K")]
    stage: Option<u16>,
    /// Levels: ids, ranges such as 0..5, or paths, separated by commas [default: those of the run, or of the checkpoint].
    #[arg(long, value_name = "SPEC")]
    levels: Option<String>,
    #[command(flatten)]
    starts: StartArgs,
    /// Sample PPO's policy; for DQN, act randomly with the final probability of its exploration: the run's, or 0.05.
    #[arg(long)]
    stochastic: bool,
    /// Step limit of an episode [default: the run's, or 200].
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1_000_000))]
    max_steps: Option<u32>,
    /// How results are printed.
    #[arg(long, value_enum, default_value_t = Format::Table)]
    format: Format,
}

/// A model to evaluate.
struct Model {
    checkpoint: Checkpoint,
    behaviour: Behaviour,
    policy: String,
    run: Option<String>,
    max_steps: u32,
    levels: Vec<Level>,
}

impl EvalArgs {
    /// Evaluates every model on every level.
    ///
    /// # Errors
    /// Models and levels that cannot be read or do not fit together.
    pub fn run(&self) -> Result<()> {
        let levels = self.levels.as_deref().map(parse_levels).transpose()?;
        let evaluations = self.models.iter().map(|path| self.evaluate(path, levels.as_deref()));
        let evaluations: Vec<Evaluation> = evaluations.collect::<Result<_>>()?;
        print_evaluations(&evaluations, self.format)
    }

    fn evaluate(&self, path: &Path, levels: Option<&[Level]>) -> Result<Evaluation> {
        let model = self.load(path, levels)?;
        let max_steps = self.max_steps.unwrap_or(model.max_steps);
        let Checkpoint { sensor, network, agent, origin, .. } = &model.checkpoint;
        let mut results = Vec::new();
        for level in model.levels {
            if sensor.shape(level.height(), level.width()) != sensor.shape(origin.height, origin.width) {
                return Err(UserError::new(format!(
                    "{} was trained on {}×{} maps, but level {} is {}×{}: choose levels with --levels",
                    path.display(),
                    origin.height,
                    origin.width,
                    level.name(),
                    level.height(),
                    level.width()
                ))
                .into());
            }
            let starts = self.starts.starts();
            let mut choose = if self.stochastic {
                Choose::Sampled(model.behaviour, Box::new(Stream::new(self.starts.seed, 0, Purpose::EvaluationActions)))
            } else {
                Choose::Greedy
            };
            let level = Arc::new(level);
            let parameters = &agent.parameters;
            results.push(evaluate::network(network, *sensor, parameters, &level, max_steps, starts, &mut choose));
        }
        let (stage, seed) = (origin.stage, origin.seed);
        Ok(Evaluation { policy: model.policy, run: model.run, stage, seed, levels: results })
    }

    fn load(&self, path: &Path, levels: Option<&[Level]>) -> Result<Model> {
        if !path.is_dir() {
            if self.stage.is_some() {
                let message = "is a checkpoint, which has one stage: drop --stage or give the run's directory";
                return Err(UserError::new(format!("{} {message}", path.display())).into());
            }
            let checkpoint = Checkpoint::read(path)?;
            let levels = match (levels, &checkpoint.origin.level) {
                (Some(levels), _) => levels.to_vec(),
                (None, Some(level)) => vec![Level::resolve(level).with_context(|| {
                    format!("{} was trained on level {level}: say with --levels where it is", path.display())
                })?],
                (None, None) => {
                    let message = "does not say what level it was trained on: name levels with --levels";
                    return Err(UserError::new(format!("{} {message}", path.display())).into());
                }
            };
            let policy = path.file_stem().map_or_else(String::new, |stem| stem.to_string_lossy().into_owned());
            let behaviour = checkpoint.algorithm.behaviour(None);
            return Ok(Model { checkpoint, behaviour, policy, run: None, max_steps: coverage_env::MAX_STEPS, levels });
        }
        if !path.join(manifest::FILE).is_file() {
            let message = "holds no run: give a run's directory (with a manifest.json) or a checkpoint file";
            return Err(UserError::new(format!("{} {message}", path.display())).into());
        }
        let manifest = Manifest::read(path)?;
        let done = manifest.stages_done;
        let stage = self.stage.or(done.checked_sub(1)).filter(|stage| *stage < done).ok_or_else(|| {
            UserError::new(match done {
                0 => format!("{}: no stage of this run is done yet", path.display()),
                _ => format!(
                    "{}: stages 0 to {} of this run are done; choose one with --stage",
                    path.display(),
                    done - 1
                ),
            })
        })?;
        let of_run = || -> Result<Vec<Level>> {
            let trained = |name: &String| {
                let stage = manifest.stages.iter().find(|stage| stage.level == *name);
                stage.map_or_else(|| Level::resolve(name), |stage| Level::from_map(name.clone(), &stage.map))
            };
            manifest.levels.iter().map(|name| Ok(trained(name)?)).collect()
        };
        let checkpoint = Checkpoint::read(&stage_checkpoint(path, stage))?;
        // Settings of a version that had others do not keep its agents from being evaluated.
        let algorithm = Config::recorded(&manifest.config).map_or(checkpoint.algorithm.clone(), |own| own.algorithm);
        Ok(Model {
            checkpoint,
            behaviour: algorithm.behaviour(None),
            policy: manifest.arm.clone(),
            run: Some(path.display().to_string()),
            max_steps: manifest.max_steps(),
            levels: levels.map_or_else(of_run, |levels| Ok(levels.to_vec()))?,
        })
    }
}
