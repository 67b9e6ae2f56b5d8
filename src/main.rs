//! The command-line tool.

use std::io::{self, Write};

use anyhow::Result;
use clap::Parser;
use cpp_rl::cli::{Cli, Command, exit_code};
use cpp_rl::messages;

fn main() {
    leave(match Cli::try_parse() {
        Ok(cli) => obey(&cli),
        // Also where `--help` and `--version` end. As when clap exits by itself: that help cannot be written is no error.
        Err(error) => {
            let _ = error.print();
            error.exit_code()
        }
    })
}

/// Runs the command and says what went wrong; the process's exit code.
fn obey(cli: &Cli) -> i32 {
    messages::show(cli.verbosity());
    match run(cli) {
        Ok(()) => 0,
        Err(error) => {
            tracing::error!("{error:#}");
            exit_code(&error)
        }
    }
}

/// Ends the process, with libtorch's tables of operators as they are: its static destructors would take them apart one
/// by one, a third of the time that a short command takes. Whatever is of worth has been dropped by now.
fn leave(code: i32) -> ! {
    // Nothing should be left in it: whoever prints flushes, and reports what could not be written.
    let _ = io::stdout().flush();
    signal_hook::low_level::exit(code)
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
