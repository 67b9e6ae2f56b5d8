//! Aligned columns, for reading.

use crate::report::table::Table;

/// The table with its title above and its notes below.
pub(super) fn table(table: &Table) -> String {
    let mut rows = vec![table.columns.clone()];
    rows.extend(table.rows.iter().map(|row| row.iter().map(|cell| cell.shown(" ± ")).collect()));
    let width = |column: usize| rows.iter().map(|row| row[column].chars().count()).max().unwrap_or(0);
    let widths: Vec<usize> = (0..table.columns.len()).map(width).collect();
    let line = |row: &Vec<String>| {
        let pad = |(i, text): (usize, &String)| {
            let gap = " ".repeat(widths[i] - text.chars().count());
            if i == 0 { format!("{text}{gap}") } else { format!("{gap}{text}") }
        };
        row.iter().enumerate().map(pad).collect::<Vec<_>>().join("  ").trim_end().to_owned()
    };
    let rule = "-".repeat(widths.iter().sum::<usize>() + 2 * (widths.len().max(1) - 1));
    let mut lines = vec![table.title.clone(), line(&rows[0]), rule];
    lines.extend(rows[1..].iter().map(line));
    lines.extend(table.notes.iter().cloned());
    lines.retain(|line| !line.is_empty());
    lines.join("\n") + "\n"
}
