//! The command line. Each subcommand's file only turns arguments into a call of the library below.

pub mod baseline;
pub mod compare;
pub mod config;
pub mod curriculum;
pub mod eval;
pub mod fork;
pub mod levels;
mod midway;
mod output;
mod process;
pub mod runs;
mod signals;
pub mod study;
pub mod train;
mod training;

use std::collections::BTreeSet;
use std::path::PathBuf;

pub use process::main;

use anyhow::Result;
use clap::{Args, Parser, Subcommand};
use coverage_env::{Level, LevelError, PlanError};

use crate::config::ConfigError;
use crate::error::{Held, Interrupted, UserError};
use crate::evaluate::Starts;
use crate::messages::Verbosity;
use crate::run::checkpoint::CheckpointError;

/// The most seeds of one command.
const MAX_SEEDS: u64 = 10_000;

/// Research on loss of plasticity in reinforcement learning, on coverage path planning.
#[derive(Debug, Parser)]
#[command(name = "cpp-rl", version, propagate_version = true, max_term_width = 110)]
pub struct Cli {
    /// What to do.
    #[command(subcommand)]
    pub command: Command,
    #[command(flatten)]
    verbosity: VerbosityArgs,
}

#[derive(Clone, Copy, Debug, Args)]
struct VerbosityArgs {
    /// Show less: no progress, warnings and failures only.
    #[arg(short, long, global = true, conflicts_with = "verbose")]
    quiet: bool,
    /// Show more: all settings first, then each save and each stage's end.
    #[arg(short, long, global = true)]
    verbose: bool,
}

impl Cli {
    /// How much is to be shown on stderr.
    pub fn verbosity(&self) -> Verbosity {
        match self.verbosity {
            VerbosityArgs { quiet: true, .. } => Verbosity::Quiet,
            VerbosityArgs { verbose: true, .. } => Verbosity::Verbose,
            VerbosityArgs { .. } => Verbosity::Normal,
        }
    }
}

/// The process's exit code for an error: 2 for wrong input, 75 where another process writes the run, 130 after a signal, 1 for
/// anything else.
pub fn exit_code(error: &anyhow::Error) -> i32 {
    if error.chain().any(|e| e.is::<Interrupted>()) {
        return 130;
    }
    if error.chain().any(|e| e.is::<Held>()) {
        return 75;
    }
    if is_of_user(error) { 2 } else { 1 }
}

/// Whether the user's input is wrong.
fn is_of_user(error: &anyhow::Error) -> bool {
    error.chain().any(|e| {
        e.is::<UserError>()
            || e.is::<ConfigError>()
            || e.is::<LevelError>()
            || e.is::<PlanError>()
            || e.is::<CheckpointError>()
    })
}

/// The subcommands.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Train agents on one level.
    Train(train::TrainArgs),
    /// Train agents on one level after another and print the paper's tables.
    Curriculum(curriculum::CurriculumArgs),
    /// Train every arm of a study file: sequences of levels, levels from scratch, sweeps [default: the paper's arms].
    Study(study::StudyArgs),
    /// Let trained agents go on from the end of a stage under treatments.
    Fork(fork::ForkArgs),
    /// Evaluate checkpoints.
    Eval(eval::EvalArgs),
    /// Evaluate a planner: greedy A*, the proved optimum, or random moves.
    Baseline(baseline::BaselineArgs),
    /// List runs, live ones included: status, progress, return.
    Runs(runs::RunsArgs),
    /// Compare runs: tables (the paper's Table 5), statistics and figures.
    Compare(compare::CompareArgs),
    /// List, show, check, generate or draw levels.
    Levels(levels::LevelsArgs),
    /// List settings, show resolved ones, or compare presets, files and runs.
    Config(config::ConfigArgs),
}

/// Where the episodes of an evaluation start.
#[derive(Clone, Copy, Debug, Args)]
pub struct StartArgs {
    /// One episode from every start cell (the default).
    #[arg(long, conflicts_with = "episodes")]
    exhaustive: bool,
    /// This many episodes per level from drawn start cells instead.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=10_000_000))]
    episodes: Option<u32>,
    /// Seed of the drawn start cells and of random actions; training uses other random numbers.
    #[arg(long, value_name = "S", default_value_t = 0)]
    seed: u64,
}

impl StartArgs {
    /// What they mean.
    pub fn starts(self) -> Starts {
        match self.episodes {
            Some(episodes) => Starts::Drawn { episodes, seed: self.seed },
            None => Starts::Exhaustive,
        }
    }
}

/// Numbers from a SPEC: `4`, `0,2,5`, `0..10` (ten, from 0 to 9), or a mixture.
///
/// # Errors
/// Says what is wrong with which part.
pub fn parse_numbers(spec: &str) -> Result<Vec<u64>, String> {
    let mut numbers = BTreeSet::new();
    for part in spec.split(',').map(str::trim) {
        let number = |text: &str| {
            let number = text.trim().parse::<u64>();
            number.map_err(|_| format!("{part:?}: expected a number, or a range such as 0..10"))
        };
        let range = match part.split_once("..") {
            Some((from, to)) => match number(from)?..number(to)? {
                range if range.is_empty() => {
                    return Err(format!("{part:?} is an empty range; 0..10 means the ten numbers from 0 to 9"));
                }
                range => range.start..=range.end - 1,
            },
            None => number(part)?..=number(part)?,
        };
        // Before any of them is made, since a range may be as long as a number is large.
        let count = (range.end() - range.start()).saturating_add(1);
        if count > MAX_SEEDS {
            return Err(format!("{part:?} makes {count} numbers; at most {MAX_SEEDS} are possible"));
        }
        numbers.extend(range);
        if numbers.len() as u64 > MAX_SEEDS {
            return Err(format!("{spec:?} makes more than {MAX_SEEDS} numbers, which are the most possible"));
        }
    }
    Ok(numbers.into_iter().collect())
}

/// Seeds as clap takes them.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Seeds(pub Vec<u64>);

impl std::str::FromStr for Seeds {
    type Err = String;

    fn from_str(spec: &str) -> Result<Self, String> {
        parse_numbers(spec).map(Self)
    }
}

/// Levels from a SPEC: ids in levels/, ranges of them such as `0..5`, and paths, separated by commas.
///
/// # Errors
/// The first level that is not there or not valid.
pub fn parse_levels(spec: &str) -> Result<Vec<Level>> {
    parse_level_names(spec, "--levels")?.iter().map(|id| Ok(Level::resolve(id)?)).collect()
}

/// The ids and paths that `flag` names.
fn parse_level_names(spec: &str, flag: &str) -> Result<Vec<String>> {
    let mut names = Vec::new();
    for part in spec.split(',').map(str::trim) {
        // A path may hold two dots too ("../my.yaml"): only digits around them make a range.
        let is_range = part.split_once("..").is_some_and(|(from, to)| {
            let digits = |text: &str| !text.is_empty() && text.bytes().all(|b| b.is_ascii_digit());
            digits(from) && digits(to)
        });
        if part.is_empty() {
            return Err(UserError::new(format!("{flag}: {spec:?} names an empty level; drop a comma")).into());
        }
        if is_range {
            let numbers = parse_numbers(part).map_err(|e| UserError::new(format!("{flag}: {e}")))?;
            names.extend(numbers.iter().map(u64::to_string));
        } else {
            names.push(part.to_owned());
        }
    }
    Ok(names)
}

/// The default folder of a command's experiments.
fn default_out(command: &str) -> PathBuf {
    PathBuf::from("runs").join(command)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn specs_list_numbers() {
        assert_eq!(parse_numbers("4"), Ok(vec![4]));
        assert_eq!(parse_numbers("0,2,5"), Ok(vec![0, 2, 5]));
        assert_eq!(parse_numbers("0..3, 7,1"), Ok(vec![0, 1, 2, 7]));
        assert_eq!(parse_numbers("18446744073709551615"), Ok(vec![u64::MAX]));
        let most = |spec| parse_numbers(spec).map(|numbers| numbers.len());
        assert_eq!(most("0..10000"), Ok(10_000));
        assert_eq!(most("0..10000,0,5..9"), Ok(10_000), "a number that is listed twice counts once");
        assert_eq!(most("0..5000,18446744073709546615..18446744073709551615"), Ok(10_000));
        for wrong in ["", "a", "3..3", "5..2", "1,,2", "-1", "18446744073709551615..", "1..2..3"] {
            assert!(parse_numbers(wrong).is_err(), "{wrong}");
        }
        for many in ["0..10001", "0..10000,10000", "7,0..18446744073709551615", "0..6000,6000..12000,12000"] {
            assert!(parse_numbers(many).is_err_and(|error| error.contains("10000")), "{many}");
        }
    }

    #[test]
    fn levels_are_ids_ranges_and_paths() {
        let names = |spec| parse_levels(spec).map(|l| l.iter().map(|l| l.name().to_owned()).collect::<Vec<_>>());
        assert_eq!(names("0..5").unwrap(), ["0", "1", "2", "3", "4"]);
        assert_eq!(names("3,0").unwrap(), ["3", "0"]);
        assert!(names("../absent.yaml").unwrap_err().to_string().contains("absent.yaml"));
        assert!(names("0..9").is_err());
    }

    #[test]
    fn the_command_line_is_consistent() {
        use clap::CommandFactory;
        Cli::command().debug_assert();
    }
}
