//! Comma-separated values, numbers in full.

use rl_stats::Interval;

use crate::report::table::{Cell, Table};

/// The table without its title and notes.
pub(super) fn table(table: &Table) -> String {
    let widest = |column: usize| {
        let suffixes = table.rows.iter().map(|row| suffixes(&row[column]));
        suffixes.max_by_key(|suffixes| suffixes.len()).unwrap_or(&[""])
    };
    let suffixes: Vec<&[&str]> = (0..table.columns.len()).map(widest).collect();
    let named = |(name, suffixes): (&String, &&'static [&'static str])| {
        suffixes.iter().map(|suffix| format!("{name}{suffix}")).collect::<Vec<String>>()
    };
    let head = table.columns.iter().zip(&suffixes).flat_map(named);
    let mut csv = csv::Writer::from_writer(Vec::new());
    let mut write = |record: Vec<String>| csv.write_record(record).expect("memory takes every record");
    write(head.collect());
    for row in &table.rows {
        let fields = row.iter().zip(&suffixes).flat_map(|(cell, suffixes)| {
            let mut fields = fields(cell);
            fields.resize(suffixes.len(), String::new());
            fields
        });
        write(fields.collect());
    }
    String::from_utf8(csv.into_inner().expect("memory takes every record")).expect("built from text")
}

/// Several tables one after another; each row says first which table it belongs to.
pub(super) fn tables(tables: &[Table]) -> String {
    let named = |one: &Table| {
        let quoted = format!("\"{}\"", one.title.replace('"', "\"\""));
        let mut lines = String::new();
        for (i, line) in table(one).lines().enumerate() {
            lines += &format!("{},{line}\n", if i == 0 { "table" } else { quoted.as_str() });
        }
        lines
    };
    tables.iter().map(named).collect::<Vec<_>>().join("\n")
}

/// What the fields of a column of such cells are called after its name.
fn suffixes(cell: &Cell) -> &'static [&'static str] {
    match cell {
        Cell::MeanStd(..) => &[" mean", " std"],
        Cell::Interval(..) => &["", " low", " high"],
        Cell::OfSeeds(cell, _) => match suffixes(cell).len() {
            1 => &["", " seeds"],
            2 => &[" mean", " std", " seeds"],
            _ => &["", " low", " high", " seeds"],
        },
        _ => &[""],
    }
}

/// As programs read it; a mean with its deviation takes two fields, a statistic with its interval three, and one more
/// says of how many seeds it is where that is not what the row says.
fn fields(cell: &Cell) -> Vec<String> {
    match cell {
        Cell::Text(text) => vec![text.clone()],
        Cell::Number(value, _) => vec![value.to_string()],
        Cell::MeanStd(mean, std) => vec![mean.to_string(), std.map_or(String::new(), |std| std.to_string())],
        Cell::Interval(value, interval, _) => {
            let bound = |of: fn(&Interval) -> f64| interval.as_ref().map_or(String::new(), |i| of(i).to_string());
            vec![value.to_string(), bound(|i| i.low), bound(|i| i.high)]
        }
        Cell::OfSeeds(cell, seeds) => [fields(cell), vec![seeds.to_string()]].concat(),
        Cell::Missing => vec![String::new()],
    }
}
