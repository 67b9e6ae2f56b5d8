//! Learning curves of other programs, to lie beside those of runs. They are no part of cpp-rl: who has them names the
//! file.

use std::collections::BTreeMap;
use std::ffi::OsStr;
use std::path::Path;
use std::str::FromStr;

use anyhow::Result;
use csv::StringRecord;
use serde::Serialize;

use crate::error::UserError;

/// What the names of runs through a sequence end with, after the arm's.
const SEQUENCE: &str = "-curriculum";
/// What the names of runs on one level may end with.
const SINGLE: &str = "-single";
/// The columns, each with the names that it may have.
const COLUMNS: [(&str, &[&str]); 5] = [
    ("arm", &["arm", "algo", "run"]),
    ("level", &["level"]),
    ("seed", &["seed", "repeat"]),
    ("timesteps", &["timesteps"]),
    ("ep_rew_mean", &["ep_rew_mean"]),
];
/// The column that a file may have beside these: the stage's number from 0, of runs through a sequence.
const STAGE: &str = "stage";

/// Returns during one seed's training on one level.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ForeignCurve {
    /// Whose it is.
    pub source: String,
    /// The preset that trains alike.
    pub arm: String,
    /// Whether the level is one of a sequence; trained on from scratch if not.
    pub in_sequence: bool,
    /// The stage's number, where the file says it.
    pub stage: Option<usize>,
    /// The level's name.
    pub level: String,
    /// Tells seeds apart.
    pub seed: String,
    /// Timesteps on the level, and the mean return of the last 100 episodes; ascending.
    pub points: Vec<(f64, f64)>,
}

/// What rows of one curve have in common: arm, whether in a sequence, stage, level and seed.
type Key = (String, bool, Option<usize>, String, String);

/// Reads a CSV of long form; `argument` is the file, or `NAME=FILE` with a name for its curves. Without one they are
/// called as the file is. Rows without a return are passed over.
///
/// # Errors
/// A file that cannot be read, lacks a column, or has no number where there should be one.
pub fn read(argument: &str) -> Result<Vec<ForeignCurve>> {
    let (source, path) = match argument.split_once('=') {
        Some((name, path)) if !Path::new(argument).exists() => (name.to_owned(), Path::new(path)),
        _ => {
            let stem = Path::new(argument).file_stem().map(OsStr::to_string_lossy);
            (stem.unwrap_or_default().into_owned(), Path::new(argument))
        }
    };
    let problem = |what: String| UserError::new(format!("{}: {what}", path.display()));
    let mut reader = csv::Reader::from_path(path).map_err(|error| problem(error.to_string()))?;
    let head = reader.headers().map_err(|error| problem(error.to_string()))?.clone();
    let place = |names: &[&str]| head.iter().position(|column| names.contains(&column));
    let mut places = [0; COLUMNS.len()];
    for (found, (column, names)) in places.iter_mut().zip(COLUMNS) {
        let expected = "curves have the columns arm (or algo, run), level, seed (or repeat), timesteps and ep_rew_mean";
        *found = place(names).ok_or_else(|| problem(format!("no column {column}: {expected}")))?;
    }
    let stage = place(&[STAGE]);
    let mut curves: BTreeMap<Key, Vec<(f64, f64)>> = BTreeMap::new();
    for (number, row) in reader.records().enumerate() {
        let row = row.map_err(|error| problem(error.to_string()))?;
        let at = |what: String| problem(format!("row {}: {what}", number + 1));
        let [arm, level, seed, timesteps, value] = places.map(|place| row.get(place).unwrap_or(""));
        if value.is_empty() {
            continue;
        }
        let (arm, in_sequence) = match arm.strip_suffix(SEQUENCE) {
            Some(arm) => (arm, true),
            None => (arm.strip_suffix(SINGLE).unwrap_or(arm), false),
        };
        let stage = stage.map(|place| number_of(&row, place, STAGE)).transpose().map_err(at)?;
        let point = (parse(timesteps, "timesteps").map_err(at)?, parse::<f64>(value, "ep_rew_mean").map_err(at)?);
        if !point.1.is_nan() {
            let key = (arm.to_owned(), in_sequence, stage, level.to_owned(), seed.to_owned());
            curves.entry(key).or_default().push(point);
        }
    }
    let curve = |((arm, in_sequence, stage, level, seed), mut points): (Key, Vec<(f64, f64)>)| {
        points.sort_by(|a, b| a.0.total_cmp(&b.0));
        ForeignCurve { source: source.clone(), arm, in_sequence, stage, level, seed, points }
    };
    Ok(curves.into_iter().map(curve).collect())
}

fn number_of(row: &StringRecord, place: usize, column: &str) -> Result<usize, String> {
    parse(row.get(place).unwrap_or(""), column)
}

fn parse<T: FromStr>(text: &str, column: &str) -> Result<T, String> {
    text.parse().map_err(|_| format!("{column}: {text:?} is no such number"))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read_text(text: &str) -> Result<Vec<ForeignCurve>> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("curves.csv");
        std::fs::write(&path, text).unwrap();
        read(&format!("SB3={}", path.display()))
    }

    #[test]
    fn both_forms_are_read() {
        let curves =
            read_text("algo,level,seed,timesteps,ep_rew_mean\nppo,0,2,4096,-9\nppo,0,2,2048,-99\nppo,0,2,8192,\n");
        let [curve] = &curves.unwrap()[..] else { panic!("one curve") };
        assert_eq!((curve.source.as_str(), curve.arm.as_str(), curve.in_sequence), ("SB3", "ppo", false));
        assert_eq!(curve.points, [(2048.0, -99.0), (4096.0, -9.0)]);
        let text = "run,level,repeat,timesteps,ep_rew_mean\nppo-l2-curriculum,0,1,1,1\nppo-l2-single,0,1,1,1\n";
        let curves = read_text(text).unwrap();
        let kinds: Vec<(&str, bool)> = curves.iter().map(|curve| (curve.arm.as_str(), curve.in_sequence)).collect();
        assert_eq!(kinds, [("ppo-l2", false), ("ppo-l2", true)]);
    }

    #[test]
    fn mistakes_are_named() {
        for (text, says) in [
            ("run,level\nppo,0\n", "no column seed"),
            ("arm,level,seed,timesteps,ep_rew_mean\nppo,0,1,x,1\n", "row 1: timesteps: \"x\""),
            ("arm,level,seed,timesteps,ep_rew_mean,stage\nppo,0,1,1,1,-1\n", "row 1: stage: \"-1\""),
        ] {
            let error = format!("{:#}", read_text(text).unwrap_err());
            assert!(error.contains(says) && error.contains("curves.csv"), "{error}");
        }
    }
}
