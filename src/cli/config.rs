//! `cpp-rl config`.

use std::path::{Path, PathBuf};

use anyhow::Result;
use clap::{Args, Subcommand};
use serde_json::{Map, Value, json};

use super::output::write_stdout;
use crate::agent::config::{Config, resolve};
use crate::agent::keys::{self, Key};
use crate::agent::registry;
use crate::config::{differing_keys, preset_names};
use crate::error::UserError;
use crate::report::{Cell, Format, Table};
use crate::run::manifest::{self, Manifest};

/// List settings, show resolved ones, or compare them.
#[derive(Debug, Args)]
pub struct ConfigArgs {
    #[command(subcommand)]
    action: Action,
}

#[derive(Debug, Subcommand)]
enum Action {
    /// List every setting: its default, what it can be, who declares it, what it is.
    Keys {
        /// Those of one preset, with its values as defaults [default: those of all algorithms].
        #[arg(long, value_name = "NAME")]
        algo: Option<String>,
        /// How the list is printed.
        #[arg(long, value_enum, default_value_t = Format::Table)]
        format: Format,
    },
    /// List every method against loss of plasticity: what it does, its settings and their defaults.
    Mitigations {
        /// How the list is printed.
        #[arg(long, value_enum, default_value_t = Format::Table)]
        format: Format,
    },
    /// Print the settings that these arguments make, as a file that --config takes.
    Show {
        /// The preset; not needed where --config names one.
        #[arg(long, value_name = "NAME")]
        algo: Option<String>,
        /// A YAML file of settings, which replace the preset's.
        #[arg(long, value_name = "FILE")]
        config: Option<PathBuf>,
        /// One setting, which replaces the preset's and the file's; may be given many times.
        #[arg(long, value_name = "KEY=VALUE")]
        set: Vec<String>,
    },
    /// Compare two sets of settings: each a preset, a file, or the directory of a run.
    Diff {
        /// A preset, a file, or a run's directory.
        #[arg(value_name = "A")]
        a: String,
        /// The other one.
        #[arg(value_name = "B")]
        b: String,
        /// How the list is printed.
        #[arg(long, value_enum, default_value_t = Format::Table)]
        format: Format,
    },
}

impl ConfigArgs {
    /// Does what the action says.
    ///
    /// # Errors
    /// Settings that cannot be taken or read, and a stdout that cannot be written.
    pub fn run(&self) -> Result<()> {
        write_stdout(&match &self.action {
            Action::Keys { algo, format } => list(algo.as_deref(), *format)?,
            Action::Mitigations { format } => mitigations(*format)?,
            Action::Show { algo, config, set } => resolve(algo.as_deref(), config.as_deref(), set, None)?.to_yaml(),
            Action::Diff { a, b, format } => compare([a, b], *format)?,
        })
    }
}

fn list(algo: Option<&str>, format: Format) -> Result<String> {
    let configs = match algo {
        Some(preset) => vec![resolve(Some(preset), None, &[], None)?],
        None => registry::names().into_iter().filter_map(Config::defaults).collect(),
    };
    let keys = keys::of(&configs);
    if format == Format::Json {
        return Ok(serde_json::to_string(&keys)? + "\n");
    }
    let row = |key: &Key| {
        let cells =
            [key.key.to_owned(), defaults(key), key.allowed.clone(), key.declared_by.clone(), key.doc.to_owned()];
        cells.map(Cell::from).to_vec()
    };
    let columns = ["setting", "default", "allowed", "declared by", "meaning"].map(str::to_owned).to_vec();
    Ok(Table { columns, rows: keys.iter().map(row).collect(), ..Table::default() }.render(format))
}

fn mitigations(format: Format) -> Result<String> {
    let described = keys::mitigations();
    if format == Format::Json {
        return Ok(serde_json::to_string(&described)? + "\n");
    }
    let settings = |settings: &Map<String, Value>| {
        settings.iter().map(|(key, value)| format!("{key}={}", shown(value))).collect::<Vec<_>>().join(", ")
    };
    let row = |m: &keys::Described| [m.name.into(), m.summary.into(), settings(&m.settings).into()].to_vec();
    let columns = ["mitigation", "what it does", "settings"].map(str::to_owned).to_vec();
    Ok(Table { columns, rows: described.iter().map(row).collect(), ..Table::default() }.render(format))
}

/// One value, or that of each config where they differ.
fn defaults(key: &Key) -> String {
    let mut values = key.defaults.values();
    match values.next() {
        Some(first) if values.all(|value| value == first) => shown(first),
        _ => {
            key.defaults.iter().map(|(name, value)| format!("{name}: {}", shown(value))).collect::<Vec<_>>().join(", ")
        }
    }
}

/// A value as it is typed.
fn shown(value: &Value) -> String {
    value.as_str().map_or_else(|| value.to_string(), str::to_owned)
}

fn compare(names: [&str; 2], format: Format) -> Result<String> {
    let [a, b] = [settings(names[0])?, settings(names[1])?];
    let differing = differing_keys(&a, &b);
    if format == Format::Json {
        let entry = |key: &&String| json!({ "key": key, "a": a.get(*key), "b": b.get(*key) });
        return Ok(
            json!({ "a": names[0], "b": names[1], "differences": differing.iter().map(entry).collect::<Vec<_>>() })
                .to_string()
                + "\n",
        );
    }
    let cell = |value: Option<&Value>| value.map_or(Cell::Missing, |value| shown(value).into());
    let table = Table {
        columns: ["setting", names[0], names[1]].map(str::to_owned).to_vec(),
        rows: differing.iter().map(|key| vec![key.as_str().into(), cell(a.get(*key)), cell(b.get(*key))]).collect(),
        ..Table::default()
    };
    Ok(if differing.is_empty() && format == Format::Table {
        "no setting differs\n".to_owned()
    } else {
        table.render(format)
    })
}

/// The settings of a preset, a file or a run.
fn settings(name: &str) -> Result<Map<String, Value>> {
    let path = Path::new(name);
    if preset_names().any(|preset| preset == name) {
        return Ok(resolve(Some(name), None, &[], None)?.to_json());
    }
    if path.join(manifest::FILE).is_file() {
        return Ok(Manifest::read(path)?.config);
    }
    if path.is_file() {
        return Ok(resolve(None, Some(path), &[], None)?.to_json());
    }
    let presets = preset_names().collect::<Vec<_>>().join(", ");
    let problem = format!("{name}: no preset, no file and no run's directory; presets are {presets}");
    Err(UserError::new(problem).into())
}
