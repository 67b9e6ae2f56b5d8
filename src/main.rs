//! The command-line tool.

use std::process::ExitCode;

use anyhow::Result;
use clap::Parser;
use cpp_rl::cli::{Cli, Command, exit_code};
use cpp_rl::messages;

fn main() -> ExitCode {
    let cli = Cli::parse();
    messages::show(cli.verbosity());
    match run(&cli) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            tracing::error!("{error:#}");
            ExitCode::from(exit_code(&error))
        }
    }
}

fn run(cli: &Cli) -> Result<()> {
    match &cli.command {
        Command::Train(args) => args.run(cli.verbosity()),
        Command::Curriculum(args) => args.run(cli.verbosity()),
        Command::Study(args) => args.run(cli.verbosity()),
        Command::Eval(args) => args.run(),
        Command::Baseline(args) => args.run(),
        Command::Runs(args) => args.run(),
        Command::Compare(args) => args.run(),
        Command::Levels(args) => args.run(),
    }
}
