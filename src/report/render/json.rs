//! JSON, numbers in full.

use std::io::{self, Write};

use anyhow::Result;
use serde_json::{Map, Value, json};

use crate::report::analysis::Analysis;
use crate::report::exhibits::Exhibit;
use crate::report::table::{Cell, Table};

/// The table as JSON: an object per row, keyed by the columns; a mean with its deviation is an object of both.
pub(super) fn table(table: &Table) -> Value {
    fn value(cell: &Cell) -> Value {
        match cell {
            Cell::Text(text) => json!(text),
            Cell::Number(value, _) => json!(value),
            Cell::MeanStd(mean, std) => json!({ "mean": mean, "std": std }),
            Cell::Interval(value, interval, _) => json!({ "value": value, "interval": interval }),
            Cell::OfSeeds(cell, seeds) => json!({ "of": value(cell), "seeds": seeds }),
            Cell::Missing => Value::Null,
        }
    }
    let row =
        |row: &Vec<Cell>| -> Map<String, Value> { table.columns.iter().cloned().zip(row.iter().map(value)).collect() };
    let rows: Vec<Map<String, Value>> = table.rows.iter().map(row).collect();
    json!({ "title": table.title, "rows": rows, "notes": table.notes })
}

/// Several tables as one object.
pub(super) fn tables(tables: &[Table]) -> String {
    let tables: Vec<Value> = tables.iter().map(table).collect();
    json!({ "tables": tables }).to_string() + "\n"
}

/// `report.json`: the analysis, and below `exhibits` what each exhibit has computed beside it.
///
/// # Errors
/// None that a report can have.
pub fn report(analysis: &Analysis, exhibits: &[Box<dyn Exhibit>]) -> Result<String> {
    let mut text = Vec::new();
    write_report(analysis, exhibits, &mut text)?;
    Ok(String::from_utf8(text)?)
}

/// The same, written as it is made: of many runs it is large.
///
/// # Errors
/// Those of the writer.
pub fn write_report(analysis: &Analysis, exhibits: &[Box<dyn Exhibit>], mut to: impl Write) -> io::Result<()> {
    let mut all_but_last = AllButLast { to: &mut to, last: None };
    serde_json::to_writer(&mut all_but_last, analysis)?;
    // In place of the brace that closes the analysis.
    to.write_all(b",\"exhibits\":{")?;
    let mut numbers: Vec<(&str, &dyn Exhibit)> = exhibits.iter().map(|e| (e.key(), e.as_ref())).collect();
    numbers.sort_by_key(|(key, _)| *key);
    let mut between = "";
    for (key, exhibit) in numbers {
        if let Some(numbers) = exhibit.numbers()? {
            write!(to, "{between}\"{key}\":{numbers}")?;
            between = ",";
        }
    }
    to.write_all(b"}}\n")
}

/// A writer that holds the last byte back.
struct AllButLast<W> {
    to: W,
    last: Option<u8>,
}

impl<W: Write> Write for AllButLast<W> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        if let Some((&last, rest)) = bytes.split_last() {
            self.to.write_all(self.last.replace(last).as_slice())?;
            self.to.write_all(rest)?;
        }
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        self.to.flush()
    }
}
