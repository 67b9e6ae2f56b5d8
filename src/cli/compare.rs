//! `cpp-rl compare`.

use std::path::PathBuf;

use anyhow::Result;
use clap::Args;

use super::output::write_stdout;
use crate::messages::tell;
use crate::report::analysis::Analysis;
use crate::report::render::to_json;
use crate::report::{Format, exhibits, export, foreign, render};
use crate::shell;

/// Lay runs side by side.
#[derive(Debug, Args)]
pub struct CompareArgs {
    /// Runs' directories, or folders of runs at any depth up to four.
    #[arg(value_name = "RUN_DIR", required = true)]
    runs: Vec<PathBuf>,
    /// Also write the whole report into this folder: report.html with every figure and table, the figures as SVG and
    /// PNG, the tables as Markdown, LaTeX and CSV, and everything as JSON.
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Learning curves of other programs or of the paper, to be drawn and tabled beside runs that are trained alike;
    /// may be given many times. A CSV with the columns arm (or algo, run), level, seed (or repeat), timesteps and
    /// ep_rew_mean.
    #[arg(long, value_name = "[NAME=]FILE", alias = "published-curves")]
    curves: Vec<String>,
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
        for file in &self.curves {
            analysis.foreign_curves.extend(foreign::read(file)?);
        }
        analysis.warnings.iter().for_each(|warning| tracing::warn!("{warning}"));
        let exhibits = exhibits::all(&analysis);
        if let Some(out) = &self.out {
            export::write(&analysis, &exhibits, out, &command_line())?;
            tell(format_args!("written to {}", out.display()));
        }
        match self.format {
            Format::Json => write_stdout(&to_json(&analysis, &exhibits)?),
            format => write_stdout(&render(&exhibits::main_tables(&analysis, &exhibits), format)),
        }
    }
}

/// The command as it was given, for a POSIX shell.
fn command_line() -> String {
    let arguments = std::env::args_os().skip(1).map(|argument| argument.to_string_lossy().into_owned());
    shell::join(&["cpp-rl".to_owned()].into_iter().chain(arguments).collect::<Vec<String>>())
}
