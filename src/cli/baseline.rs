//! `cpp-rl baseline`.

use std::sync::Arc;

use anyhow::{Context, Result};
use clap::{Args, ValueEnum};
use coverage_env::planner::{AStar, Optimal, Planner, Random};

use super::output::print_evaluations;
use super::{StartArgs, parse_levels};
use crate::evaluate;
use crate::random::{Purpose, Stream};
use crate::report::Format;
use crate::results::Evaluation;

/// Evaluate a planner.
#[derive(Debug, Args)]
pub struct BaselineArgs {
    /// The planner.
    #[arg(value_enum)]
    policy: Policy,
    /// Levels: ids, ranges such as 0..5, or paths, separated by commas.
    #[arg(long, value_name = "SPEC", default_value = "0..5")]
    levels: String,
    #[command(flatten)]
    starts: StartArgs,
    /// Step limit of an episode.
    #[arg(long, value_name = "N", default_value_t = coverage_env::MAX_STEPS,
          value_parser = clap::value_parser!(u32).range(1..=1_000_000))]
    max_steps: u32,
    /// How results are printed.
    #[arg(long, value_enum, default_value_t = Format::Table)]
    format: Format,
}

/// The planners.
#[derive(Clone, Copy, Debug, ValueEnum)]
enum Policy {
    /// Greedy A*: to the nearest target left, again and again (the paper's "gold standard").
    Astar,
    /// The best return possible, proved.
    Optimal,
    /// Uniform actions.
    Random,
}

impl BaselineArgs {
    /// Plans every level from the chosen starts.
    ///
    /// # Errors
    /// Levels that cannot be read, or are beyond the planner's reach.
    pub fn run(&self) -> Result<()> {
        let mut planner: Box<dyn Planner> = match self.policy {
            Policy::Astar => Box::new(AStar),
            Policy::Optimal => Box::new(Optimal::new()),
            Policy::Random => Box::new(Random::new(Stream::new(self.starts.seed, 0, Purpose::EvaluationActions))),
        };
        let mut levels = Vec::new();
        for level in parse_levels(&self.levels)? {
            let level = Arc::new(level);
            let result = evaluate::planner(planner.as_mut(), &level, self.max_steps, self.starts.starts());
            levels.push(result.with_context(|| format!("level {}", level.name()))?);
        }
        let policy = planner.name().to_owned();
        let evaluation = [Evaluation { policy, run: None, stage: None, seed: None, levels }];
        print_evaluations(&evaluation, self.format)
    }
}
