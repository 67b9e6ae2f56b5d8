//! What the scripts of `scripts/recompute…` make of a seeds.csv.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use crate::ROOT;

/// A row of a table, by column.
pub type Row = BTreeMap<String, String>;

/// Lets a script compute its tables into a folder; false, saying so, where there is no Python.
#[must_use]
pub fn compute(script: &str, arguments: &[&Path], out: &Path) -> bool {
    let mut command = Command::new("python3");
    command.arg(Path::new(ROOT).join("scripts").join(script)).args(arguments).arg("--out").arg(out);
    let Ok(output) = command.output() else {
        println!("skipped: no python3");
        return false;
    };
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    true
}

pub fn rows(file: &Path) -> Vec<Row> {
    let mut reader = csv::Reader::from_path(file).unwrap_or_else(|error| panic!("{}: {error}", file.display()));
    reader.deserialize().map(|row| row.expect("a row")).collect()
}

pub fn number(row: &Row, column: &str) -> f64 {
    row[column].parse().unwrap_or_else(|_| panic!("{column}: {:?}", row[column]))
}

/// The row that has these values in these columns.
#[track_caller]
pub fn find<'a>(rows: &'a [Row], keys: &[(&str, &str)]) -> &'a Row {
    let found = rows.iter().find(|row| keys.iter().all(|(column, value)| row[*column] == *value));
    found.unwrap_or_else(|| panic!("{keys:?} in {rows:?}"))
}

#[track_caller]
pub fn close(found: f64, expected: f64) {
    assert!((found - expected).abs() < 1e-9, "{found} is not {expected}");
}

/// Asserts that every figure that was computed again lies in this folder, byte for byte.
pub fn assert_same_figures(computed: &Path, published: &Path) {
    for entry in fs::read_dir(computed).expect("a folder") {
        let figure = entry.expect("an entry").path();
        if figure.extension().is_some_and(|end| end == "svg") {
            let beside = published.join(figure.file_name().expect("a name"));
            let text = |file: &Path| fs::read_to_string(file).unwrap_or_else(|e| panic!("{}: {e}", file.display()));
            assert!(text(&figure) == text(&beside), "{}", beside.display());
        }
    }
}

/// Asserts that every table of a folder of this repository was computed again, with the same rows.
pub fn assert_same_tables(computed: &Path, published: &Path) {
    let files = fs::read_dir(published).expect("a folder").map(|entry| entry.expect("an entry").path());
    let tables: Vec<PathBuf> = files.filter(|path| path.extension().is_some_and(|end| end == "csv")).collect();
    assert!(!tables.is_empty(), "{}", published.display());
    for table in tables {
        let (found, expected) = (rows(&computed.join(table.file_name().expect("a name"))), rows(&table));
        let place = table.display();
        assert!(!expected.is_empty() && found.len() == expected.len(), "{place}");
        for (found, expected) in found.iter().zip(&expected) {
            for (column, expected) in expected {
                let value = &found[column];
                let close = |a: f64, b: f64| (a - b).abs() <= 1e-9 * b.abs().max(1e-6);
                let alike = value.parse().ok().zip(expected.parse().ok()).is_some_and(|(a, b)| close(a, b));
                assert!(alike || value == expected, "{place}: {column}: {value} is not {expected}");
            }
        }
    }
}
