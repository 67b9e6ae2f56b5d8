//! `cpp-rl levels`.

use std::path::{Path, PathBuf};

use anyhow::Result;
use clap::{Args, Subcommand};
use coverage_env::generator::LevelSpec;
use coverage_env::{BUILTIN_IDS, Level};

use super::output::{write_out, write_stdout};
use crate::error::UserError;
use crate::report::{Cell, Format, Table, exhibits, export};

/// List, show, check, generate or draw levels.
#[derive(Debug, Args)]
pub struct LevelsArgs {
    #[command(subcommand)]
    action: Action,
}

#[derive(Debug, Subcommand)]
enum Action {
    /// List the built-in levels, which are the paper's.
    List {
        /// How the list is printed.
        #[arg(long, value_enum, default_value_t = Format::Table)]
        format: Format,
    },
    /// Print levels as files: `.` free, `#` wall, `T` target.
    Show {
        /// Ids or paths.
        #[arg(required = true)]
        levels: Vec<String>,
    },
    /// Check level files; prints what each holds, or what is wrong with it.
    Check {
        /// Paths or ids.
        #[arg(required = true)]
        levels: Vec<String>,
    },
    /// Make a random level that can be solved from every start cell, and print its file.
    Generate {
        /// Rows.
        #[arg(long, default_value_t = 8)]
        height: usize,
        /// Columns.
        #[arg(long, default_value_t = 8)]
        width: usize,
        /// Share of the cells that are walls, from 0 to below 1.
        #[arg(long, default_value_t = 0.2)]
        wall_density: f64,
        /// Number of targets.
        #[arg(long, default_value_t = 8)]
        targets: usize,
        /// The same seed makes the same level.
        #[arg(long, default_value_t = 0)]
        seed: u64,
        /// Write the file here instead of to stdout.
        #[arg(long, value_name = "FILE")]
        out: Option<PathBuf>,
    },
    /// Draw levels side by side (the paper's Figure 1): targets green, walls black.
    Draw {
        /// Levels: ids, ranges such as 0..5, or paths, separated by commas.
        #[arg(long, value_name = "SPEC", default_value = "0..5")]
        levels: String,
        /// Write the drawing here, as PNG if the name ends in .png, instead of as SVG to stdout.
        #[arg(long, value_name = "FILE")]
        out: Option<PathBuf>,
    },
}

impl LevelsArgs {
    /// Does what the action says.
    ///
    /// # Errors
    /// Levels that cannot be read, specifications that no level meets, and files that cannot be written.
    pub fn run(&self) -> Result<()> {
        match &self.action {
            Action::List { format } => list(*format),
            Action::Show { levels } => {
                levels.iter().try_for_each(|level| write_stdout(&Level::resolve(level)?.to_yaml()))
            }
            Action::Check { levels } => check(levels),
            Action::Generate { height, width, wall_density, targets, seed, out } => {
                let (height, width, wall_density) = (*height, *width, *wall_density);
                let spec = LevelSpec { height, width, wall_density, num_targets: *targets, seed: *seed };
                let level = spec.generate().map_err(|e| UserError::new(format!("no such level is possible: {e}")))?;
                deliver(&level.to_yaml(), out.as_ref())
            }
            Action::Draw { levels, out } => draw(&super::parse_levels(levels)?, out.as_ref()),
        }
    }
}

fn list(format: Format) -> Result<()> {
    let row = |level: Level| {
        let count = |n: usize| Cell::Number(n as f64, 0);
        vec![
            level.name().into(),
            count(level.height()),
            count(level.width()),
            count(level.targets().len()),
            count(level.starts().len()),
        ]
    };
    let table = Table {
        columns: ["level", "height", "width", "targets", "start cells"].map(str::to_owned).to_vec(),
        rows: BUILTIN_IDS.iter().filter_map(|id| Level::builtin(id)).map(row).collect(),
        ..Table::default()
    };
    let text = if format == Format::Json { table.to_json().to_string() + "\n" } else { table.render(format) };
    write_stdout(&text)
}

fn check(levels: &[String]) -> Result<()> {
    let mut wrong = 0;
    for level in levels {
        match Level::resolve(level) {
            Ok(found) => write_stdout(&format!(
                "{level}: {}×{}, {} targets, {} start cells\n",
                found.height(),
                found.width(),
                found.targets().len(),
                found.starts().len()
            ))?,
            Err(error) => {
                wrong += 1;
                tracing::error!("{error}");
            }
        }
    }
    if wrong == 0 {
        return Ok(());
    }
    Err(UserError::new(format!("{wrong} of {} levels are not valid", levels.len())).into())
}

fn draw(levels: &[Level], out: Option<&PathBuf>) -> Result<()> {
    let drawing = exhibits::draw_levels(levels);
    let is_png = |path: &Path| path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("png"));
    match out {
        Some(path) if is_png(path) => write_out(path, &drawing.to_png(export::PNG_SCALE)?),
        out => deliver(&drawing.to_svg(), out),
    }
}

fn deliver(text: &str, out: Option<&PathBuf>) -> Result<()> {
    match out {
        Some(path) => write_out(path, text.as_bytes()),
        None => write_stdout(text),
    }
}
