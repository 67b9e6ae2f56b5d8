//! LaTeX with booktabs.

use crate::report::table::{Cell, Table};

/// A float with title and notes, or the bare tabular of a table that has no title.
pub(super) fn table(table: &Table) -> String {
    let line = |cells: Vec<String>| format!("  {} \\\\", cells.join(" & "));
    let cell = |cell: &Cell| match cell {
        Cell::Missing => "--".to_owned(),
        Cell::Text(words) => text(words),
        number => format!("${}$", number.shown(" \\pm ")),
    };
    let mut lines = vec![
        format!("\\begin{{tabular}}{{l{}}}", "r".repeat(table.columns.len() - 1)),
        "  \\toprule".to_owned(),
        line(table.columns.iter().map(|name| text(name)).collect()),
        "  \\midrule".to_owned(),
    ];
    lines.extend(table.rows.iter().map(|row| line(row.iter().map(cell).collect())));
    lines.extend(["  \\bottomrule", "\\end{tabular}"].map(str::to_owned));
    // A table that is included somewhere must not lose what a reader has to know of it.
    if !table.title.is_empty() {
        let head = ["\\begin{table}".to_owned(), "\\centering".to_owned()];
        let caption = format!("\\caption{{{}}}", text(&table.title));
        lines.splice(0..0, head.into_iter().chain([caption]));
    }
    lines.extend(table.notes.iter().map(|note| format!("\\par{{\\footnotesize {}\\par}}", text(note))));
    if !table.title.is_empty() {
        lines.push("\\end{table}".to_owned());
    }
    lines.join("\n") + "\n"
}

/// Text with LaTeX's special characters escaped.
pub(super) fn text(text: &str) -> String {
    let escape = |c: char| match c {
        '&' | '%' | '$' | '#' | '_' | '{' | '}' => format!("\\{c}"),
        '\\' => "\\textbackslash{}".to_owned(),
        '<' => "\\textless{}".to_owned(),
        '>' => "\\textgreater{}".to_owned(),
        '|' => "\\textbar{}".to_owned(),
        '"' => "''".to_owned(),
        '~' => "\\textasciitilde{}".to_owned(),
        '^' => "\\textasciicircum{}".to_owned(),
        '±' => "$\\pm$".to_owned(),
        '×' => "$\\times$".to_owned(),
        '−' => "$-$".to_owned(),
        '≤' => "$\\leq$".to_owned(),
        '–' => "--".to_owned(),
        c => c.to_string(),
    };
    text.chars().map(escape).collect()
}
