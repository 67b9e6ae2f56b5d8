//! `cpp-rl compare`.

use std::path::PathBuf;

use anyhow::Result;
use clap::Args;

use super::output::write_stdout;
use crate::messages::tell;
use crate::report::analysis::Analysis;
use crate::report::{Format, export, published_curves, render, tables};
use crate::shell;

/// Lay runs side by side.
#[derive(Debug, Args)]
pub struct CompareArgs {
    /// Runs' directories, or folders of runs at any depth up to four.
    #[arg(value_name = "RUN_DIR", required = true)]
    runs: Vec<PathBuf>,
    /// Also write the whole report into this folder: report.html with every figure and table, the figures as SVG and PNG,
    /// the tables as Markdown, LaTeX and CSV, and everything as JSON.
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Learning curves of the published study, to be drawn beside curricula on its levels: a CSV file with the columns run
    /// (`ppo-curriculum`), level, repeat, timesteps and ep_rew_mean.
    #[arg(long, value_name = "FILE")]
    published_curves: Option<PathBuf>,
    /// How the main tables are printed; json prints everything.
    #[arg(long, value_enum, default_value_t = Format::Table)]
    format: Format,
}

impl CompareArgs {
    /// Prints the comparison, and writes it if asked to.
    ///
    /// # Errors
    /// Directories without runs, and files that cannot be read or written.
    pub fn run(&self) -> Result<()> {
        let mut analysis = Analysis::read(&self.runs)?;
        if let Some(path) = &self.published_curves {
            analysis.published_curves = published_curves::read(path)?;
        }
        analysis.warnings.iter().for_each(|warning| tracing::warn!("{warning}"));
        if let Some(out) = &self.out {
            export::write(&analysis, out, &command_line())?;
            tell(format_args!("written to {}", out.display()));
        }
        match self.format {
            Format::Json => write_stdout(&(serde_json::to_string(&analysis)? + "\n")),
            format => write_stdout(&render(&tables::main(&analysis), format)),
        }
    }
}

/// The command as it was given, for a POSIX shell.
fn command_line() -> String {
    let arguments = std::env::args_os().skip(1).map(|argument| argument.to_string_lossy().into_owned());
    shell::join(&["cpp-rl".to_owned()].into_iter().chain(arguments).collect::<Vec<String>>())
}
