//! How a report is written: one file per format.

mod csv;
mod html;
mod json;
mod latex;
mod markdown;
mod seeds;
mod terminal;

pub use html::page;
pub use json::{report as to_json, write_report as write_json};
pub use seeds::seeds;

use serde_json::Value;

use super::table::Table;

/// How results are printed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Format {
    /// Aligned columns, for reading.
    Table,
    /// GitHub's Markdown.
    Markdown,
    /// Comma-separated values, numbers in full.
    Csv,
    /// JSON, numbers in full.
    Json,
    /// LaTeX with booktabs.
    Latex,
}

/// Several tables as one text; in CSV each row says first which table it belongs to.
pub fn render(tables: &[Table], format: Format) -> String {
    match format {
        Format::Json => json::tables(tables),
        Format::Csv if tables.len() > 1 => csv::tables(tables),
        format => tables.iter().map(|table| table.render(format)).collect::<Vec<_>>().join("\n"),
    }
}

impl Table {
    /// This table alone. JSON is written of data, not of tables: as JSON it is aligned columns.
    pub fn render(&self, format: Format) -> String {
        match format {
            Format::Table | Format::Json => terminal::table(self),
            Format::Markdown => markdown::table(self),
            Format::Csv => csv::table(self),
            Format::Latex => latex::table(self),
        }
    }

    /// This table as JSON.
    pub fn to_json(&self) -> Value {
        json::table(self)
    }
}

#[cfg(test)]
mod tests {
    use rl_stats::Interval;
    use serde_json::json;

    use super::*;
    use crate::report::table::Cell;

    fn table() -> Table {
        Table {
            title: "Returns".to_owned(),
            columns: vec!["arm".to_owned(), "level 0".to_owned(), "share".to_owned()],
            rows: vec![
                vec!["ppo_l2".into(), Cell::MeanStd(-10.5, Some(3.0)), Cell::Number(0.125, 2)],
                vec!["a|b, c".into(), Cell::Missing, Cell::Number(1.0, 2)],
            ],
            notes: vec!["a note".to_owned()],
        }
    }

    #[test]
    fn columns_are_aligned() {
        let expected = "Returns\n\
                        arm           level 0  share\n\
                        ----------------------------\n\
                        ppo_l2  -10.50 ± 3.00   0.12\n\
                        a|b, c              –   1.00\n\
                        a note\n";
        assert_eq!(table().render(Format::Table), expected);
    }

    #[test]
    fn intervals_are_shown_where_there_are_any() {
        let interval = Some(Interval { low: 0.5, high: 1.0 });
        let cells = [Cell::Interval(0.75, interval, 2), Cell::Interval(0.5, None, 2), Cell::Missing];
        let rows = ["a", "b", "c"].into_iter().zip(cells).map(|(name, cell)| vec![name.into(), cell]).collect();
        let table = Table { title: String::new(), columns: vec!["arm".into(), "gap".into()], rows, notes: Vec::new() };
        assert_eq!(table.render(Format::Csv), "arm,gap,gap low,gap high\na,0.75,0.5,1\nb,0.5,,\nc,,,\n");
        let markdown = table.render(Format::Markdown);
        assert!(markdown.contains("| a | 0.75 [0.50, 1.00] |\n| b | 0.50 |\n| c | – |"), "{markdown}");
        assert!(table.render(Format::Latex).contains("a & $0.75 [0.50, 1.00]$ \\\\"));
    }

    #[test]
    fn cells_of_other_numbers_of_seeds_say_so() {
        let mean = |value: f64, std: Option<f64>, seeds| Cell::MeanStd(value, std).of_seeds(seeds, 5);
        let gap = |seeds| Cell::Interval(0.5, None, 1).of_seeds(seeds, 5);
        let rows = vec![
            vec!["a".into(), mean(1.0, Some(0.5), 5), gap(5)],
            vec!["b".into(), mean(2.0, None, 1), gap(3)],
            vec!["c".into(), Cell::Missing.of_seeds(0, 5), Cell::Missing],
        ];
        let columns = ["arm", "return", "gap"].map(str::to_owned).to_vec();
        let table = Table { title: String::new(), columns, rows, notes: Vec::new() };
        let markdown = table.render(Format::Markdown);
        assert!(markdown.contains("| a | 1.00 ± 0.50 | 0.5 |\n| b | 2.00 (n = 1) | 0.5 (n = 3) |\n| c | – | – |"));
        let csv = "arm,return mean,return std,return seeds,gap,gap low,gap high,gap seeds\n\
                   a,1,0.5,,0.5,,,\nb,2,,1,0.5,,,3\nc,,,,,,,\n";
        assert_eq!(table.render(Format::Csv), csv);
        assert_eq!(json::table(&table)["rows"][1]["return"], json!({ "of": { "mean": 2.0, "std": null }, "seeds": 1 }));
    }

    #[test]
    fn programs_get_full_numbers() {
        let expected = "arm,level 0 mean,level 0 std,share\nppo_l2,-10.5,3,0.125\n\"a|b, c\",,,1\n";
        assert_eq!(table().render(Format::Csv), expected);
    }

    #[test]
    fn markup_is_escaped() {
        let markdown = table().render(Format::Markdown);
        assert!(markdown.contains("| a\\|b, c | – | 1.00 |"), "{markdown}");
        let latex = table().render(Format::Latex);
        assert!(latex.contains("  ppo\\_l2 & $-10.50 \\pm 3.00$ & $0.12$ \\\\"), "{latex}");
        assert!(latex.contains("  a\\textbar{}b, c & -- & $1.00$"), "{latex}");
        assert_eq!(latex::text("P(X > Y) < \"1\""), "P(X \\textgreater{} Y) \\textless{} ''1''");
    }

    #[test]
    fn latex_shows_the_title_and_the_notes() {
        let latex = table().render(Format::Latex);
        let shown: Vec<&str> = latex.lines().filter(|line| !line.starts_with(' ')).collect();
        let expected = [
            "\\begin{table}",
            "\\centering",
            "\\caption{Returns}",
            "\\begin{tabular}{lrr}",
            "\\end{tabular}",
            "\\par{\\footnotesize a note\\par}",
            "\\end{table}",
        ];
        assert_eq!(shown, expected);
        let bare = Table { title: String::new(), notes: Vec::new(), ..table() }.render(Format::Latex);
        assert!(bare.starts_with("\\begin{tabular}") && bare.ends_with("\\end{tabular}\n"), "{bare}");
    }
}
