//! JSON, numbers in full.

use std::collections::BTreeMap;

use anyhow::Result;
use serde::Serialize;
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
    #[derive(Serialize)]
    struct Report<'a> {
        #[serde(flatten)]
        analysis: &'a Analysis,
        exhibits: BTreeMap<&'a str, Value>,
    }
    let numbers = exhibits.iter().map(|exhibit| Ok((exhibit.key(), exhibit.numbers()?)));
    let mut exhibits = numbers.collect::<Result<BTreeMap<&str, Value>, serde_json::Error>>()?;
    exhibits.retain(|_, numbers| !numbers.is_null());
    Ok(serde_json::to_string(&Report { analysis, exhibits })? + "\n")
}
