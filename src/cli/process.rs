//! The process: from the command line to an exit code, and handing over to the program that links libtorch.

use std::env;
use std::io::{self, Write};
use std::path::PathBuf;
use std::process::Command as Process;

use anyhow::Result;
use clap::Parser;

use super::{Cli, Command, exit_code};
use crate::messages;
use crate::run::manifest::Versions;

/// The program beside this one that has libtorch linked in.
const WITH_LIBTORCH: &str = "cpp-rl-libtorch";
/// The variable that tells that program which code this one was built from.
const HANDED_OVER_BY: &str = "CPP_RL_HANDED_OVER_BY";

/// Reads the command line, obeys it, and ends the process.
pub fn main() -> ! {
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
    if let Ok(other) = env::var(HANDED_OVER_BY)
        && other != built_from()
    {
        // Cargo builds each when it is asked to, so that one can be older.
        let this = built_from();
        tracing::warn!("{WITH_LIBTORCH} is {this} but cpp-rl is {other}: build both again (docs/install.md)");
    }
    match run(cli) {
        Ok(()) => 0,
        Err(error) => {
            tracing::error!("{error:#}");
            exit_code(&error)
        }
    }
}

fn run(cli: &Cli) -> Result<()> {
    match &cli.command {
        Command::Train(args) => args.run(cli.verbosity()),
        Command::Curriculum(args) => args.run(cli.verbosity()),
        Command::Study(args) => args.run(cli.verbosity()),
        Command::Fork(args) => args.run(cli.verbosity()),
        Command::Eval(args) => args.run(),
        Command::Baseline(args) => args.run(),
        Command::Runs(args) => args.run(),
        Command::Compare(args) => args.run(),
        Command::Levels(args) => args.run(),
        Command::Config(args) => args.run(),
    }
}

/// Ends the process without static destructors: libtorch's, where it is linked, take a third of the time that a short
/// command takes. All files are closed by now.
fn leave(code: i32) -> ! {
    // Nothing should be left in it: whoever prints flushes, and reports what could not be written.
    let _ = io::stdout().flush();
    signal_hook::low_level::exit(code)
}

/// Goes on as the program beside this one that links libtorch, with the same arguments; comes back where there is none.
pub(super) fn hand_over() {
    let Some(program) = with_libtorch().filter(|program| program.is_file()) else { return };
    let mut process = Process::new(&program);
    process.args(env::args_os().skip(1)).env(HANDED_OVER_BY, built_from());
    replace(process, &program);
}

#[cfg(unix)]
fn replace(mut process: Process, program: &std::path::Path) {
    use std::os::unix::process::CommandExt;
    // The manifest records the command as it was typed.
    if let Some(name) = env::args_os().next() {
        process.arg0(name);
    }
    // It only comes back where the program cannot be started.
    let error = process.exec();
    tracing::warn!("cannot start {}: {error}", program.display());
}

#[cfg(not(unix))]
fn replace(mut process: Process, program: &std::path::Path) {
    match process.status() {
        Ok(status) => leave(status.code().unwrap_or(1)),
        Err(error) => tracing::warn!("cannot start {}: {error}", program.display()),
    }
}

/// The version and the commit of this program's code.
fn built_from() -> String {
    let Versions { cpp_rl, git, .. } = Versions::here();
    format!("version {cpp_rl}, commit {git}")
}

fn with_libtorch() -> Option<PathBuf> {
    let this = env::current_exe().ok()?;
    Some(this.parent()?.join(format!("{WITH_LIBTORCH}{}", env::consts::EXE_SUFFIX)))
}
