//! GitHub's Markdown.

use crate::report::table::Table;

/// The table with its title above and its notes below.
pub(super) fn table(table: &Table) -> String {
    let escape = |text: String| text.replace('|', "\\|");
    let line = |cells: Vec<String>| format!("| {} |", cells.join(" | "));
    let mut lines = Vec::new();
    if !table.title.is_empty() {
        lines.extend([format!("**{}**", table.title), String::new()]);
    }
    lines.push(line(table.columns.iter().cloned().map(escape).collect()));
    let align = |i| if i == 0 { "---".to_owned() } else { "---:".to_owned() };
    lines.push(line((0..table.columns.len()).map(align).collect()));
    lines.extend(table.rows.iter().map(|row| line(row.iter().map(|cell| escape(cell.shown(" ± "))).collect())));
    if !table.notes.is_empty() {
        lines.push(String::new());
        lines.extend(table.notes.iter().cloned());
    }
    lines.join("\n") + "\n"
}
