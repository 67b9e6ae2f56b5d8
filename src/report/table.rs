//! One table, printed in every format.

use rl_stats::{Estimate, Interval};
use serde_json::{Map, Value, json};

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

/// Text and numbers under named columns.
#[derive(Clone, Debug, Default)]
pub struct Table {
    /// What it shows.
    pub title: String,
    /// The heads of all columns, the row labels' included.
    pub columns: Vec<String>,
    /// As many cells as columns, each.
    pub rows: Vec<Vec<Cell>>,
    /// What a reader must know, below the table.
    pub notes: Vec<String>,
}

/// One entry.
#[derive(Clone, Debug, PartialEq)]
pub enum Cell {
    /// As it is.
    Text(String),
    /// A number, shown with this many decimals.
    Number(f64, usize),
    /// A mean and a standard deviation, which one value has not.
    MeanStd(f64, Option<f64>),
    /// A statistic with its interval, if it has one, shown with this many decimals.
    Interval(f64, Option<Interval>, usize),
    /// Such a number, of other than as many seeds as its row says.
    OfSeeds(Box<Cell>, usize),
    /// There is no such result.
    Missing,
}

/// Several tables as one text; in CSV each row says first which table it belongs to.
pub fn render(tables: &[Table], format: Format) -> String {
    match format {
        Format::Json => {
            let tables: Vec<Value> = tables.iter().map(Table::to_json).collect();
            json!({ "tables": tables }).to_string() + "\n"
        }
        Format::Csv if tables.len() > 1 => {
            let named = |table: &Table| {
                let quoted = format!("\"{}\"", table.title.replace('"', "\"\""));
                let mut lines = String::new();
                for (i, line) in table.csv().lines().enumerate() {
                    lines += &format!("{},{line}\n", if i == 0 { "table" } else { quoted.as_str() });
                }
                lines
            };
            tables.iter().map(named).collect::<Vec<_>>().join("\n")
        }
        format => tables.iter().map(|table| table.render(format)).collect::<Vec<_>>().join("\n"),
    }
}

impl From<&str> for Cell {
    fn from(text: &str) -> Self {
        Self::Text(text.to_owned())
    }
}

impl From<String> for Cell {
    fn from(text: String) -> Self {
        Self::Text(text)
    }
}

impl Cell {
    /// As people read it; `plus_minus` stands between mean and deviation.
    pub(super) fn shown(&self, plus_minus: &str) -> String {
        match self {
            Self::Text(text) => text.clone(),
            Self::Number(value, decimals) => format!("{value:.decimals$}"),
            Self::MeanStd(mean, None) => format!("{mean:.2}"),
            Self::MeanStd(mean, Some(std)) => format!("{mean:.2}{plus_minus}{std:.2}"),
            Self::Interval(value, None, decimals) => format!("{value:.decimals$}"),
            Self::Interval(value, Some(Interval { low, high }), decimals) => {
                format!("{value:.decimals$} [{low:.decimals$}, {high:.decimals$}]")
            }
            Self::OfSeeds(cell, seeds) => format!("{} (n = {seeds})", cell.shown(plus_minus)),
            Self::Missing => "–".to_owned(),
        }
    }

    /// An estimate as a table's entry; missing where there is none.
    pub(super) fn estimate<'a>(estimate: impl Into<Option<&'a Estimate>>, decimals: usize) -> Self {
        estimate.into().map_or(Self::Missing, |e| Self::Interval(e.value, e.interval, decimals))
    }

    /// This number, of so many seeds, in a row that says it is of `row`.
    pub(super) fn of_seeds(self, seeds: usize, row: usize) -> Self {
        if seeds == row || self == Self::Missing { self } else { Self::OfSeeds(Box::new(self), seeds) }
    }

    /// What the fields of a column of such cells are called after its name.
    fn suffixes(&self) -> &'static [&'static str] {
        match self {
            Self::MeanStd(..) => &[" mean", " std"],
            Self::Interval(..) => &["", " low", " high"],
            Self::OfSeeds(cell, _) => match cell.suffixes().len() {
                1 => &["", " seeds"],
                2 => &[" mean", " std", " seeds"],
                _ => &["", " low", " high", " seeds"],
            },
            _ => &[""],
        }
    }

    /// As programs read it; a mean with its deviation takes two fields, a statistic with its interval three, and one more
    /// says of how many seeds it is where that is not what the row says.
    fn fields(&self) -> Vec<String> {
        match self {
            Self::Text(text) => vec![text.clone()],
            Self::Number(value, _) => vec![value.to_string()],
            Self::MeanStd(mean, std) => vec![mean.to_string(), std.map_or(String::new(), |std| std.to_string())],
            Self::Interval(value, interval, _) => {
                let bound = |of: fn(&Interval) -> f64| interval.as_ref().map_or(String::new(), |i| of(i).to_string());
                vec![value.to_string(), bound(|i| i.low), bound(|i| i.high)]
            }
            Self::OfSeeds(cell, seeds) => [cell.fields(), vec![seeds.to_string()]].concat(),
            Self::Missing => vec![String::new()],
        }
    }
}

impl Table {
    /// Renders the table; JSON is not a table's business but its data's.
    pub fn render(&self, format: Format) -> String {
        match format {
            Format::Table | Format::Json => self.aligned(),
            Format::Markdown => self.markdown(),
            Format::Csv => self.csv(),
            Format::Latex => self.latex(),
        }
    }

    /// The table as JSON: an object per row, keyed by the columns; a mean with its deviation is an object of both.
    pub fn to_json(&self) -> Value {
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
        let row = |row: &Vec<Cell>| -> Map<String, Value> {
            self.columns.iter().cloned().zip(row.iter().map(value)).collect()
        };
        let rows: Vec<Map<String, Value>> = self.rows.iter().map(row).collect();
        json!({ "title": self.title, "rows": rows, "notes": self.notes })
    }

    fn aligned(&self) -> String {
        let mut rows = vec![self.columns.clone()];
        rows.extend(self.rows.iter().map(|row| row.iter().map(|cell| cell.shown(" ± ")).collect()));
        let width = |column: usize| rows.iter().map(|row| row[column].chars().count()).max().unwrap_or(0);
        let widths: Vec<usize> = (0..self.columns.len()).map(width).collect();
        let line = |row: &Vec<String>| {
            let pad = |(i, text): (usize, &String)| {
                let gap = " ".repeat(widths[i] - text.chars().count());
                if i == 0 { format!("{text}{gap}") } else { format!("{gap}{text}") }
            };
            row.iter().enumerate().map(pad).collect::<Vec<_>>().join("  ").trim_end().to_owned()
        };
        let rule = "-".repeat(widths.iter().sum::<usize>() + 2 * (widths.len().max(1) - 1));
        let mut lines = vec![self.title.clone(), line(&rows[0]), rule];
        lines.extend(rows[1..].iter().map(line));
        lines.extend(self.notes.iter().cloned());
        lines.retain(|line| !line.is_empty());
        lines.join("\n") + "\n"
    }

    fn markdown(&self) -> String {
        let escape = |text: String| text.replace('|', "\\|");
        let line = |cells: Vec<String>| format!("| {} |", cells.join(" | "));
        let mut lines = Vec::new();
        if !self.title.is_empty() {
            lines.extend([format!("**{}**", self.title), String::new()]);
        }
        lines.push(line(self.columns.iter().cloned().map(escape).collect()));
        let align = |i| if i == 0 { "---".to_owned() } else { "---:".to_owned() };
        lines.push(line((0..self.columns.len()).map(align).collect()));
        lines.extend(self.rows.iter().map(|row| line(row.iter().map(|cell| escape(cell.shown(" ± "))).collect())));
        if !self.notes.is_empty() {
            lines.push(String::new());
            lines.extend(self.notes.iter().cloned());
        }
        lines.join("\n") + "\n"
    }

    fn csv(&self) -> String {
        let widest = |column: usize| {
            let suffixes = self.rows.iter().map(|row| row[column].suffixes());
            suffixes.max_by_key(|suffixes| suffixes.len()).unwrap_or(&[""])
        };
        let suffixes: Vec<&[&str]> = (0..self.columns.len()).map(widest).collect();
        let named = |(name, suffixes): (&String, &&'static [&'static str])| {
            suffixes.iter().map(|suffix| format!("{name}{suffix}")).collect::<Vec<String>>()
        };
        let head = self.columns.iter().zip(&suffixes).flat_map(named);
        let mut csv = csv::Writer::from_writer(Vec::new());
        let mut write = |record: Vec<String>| csv.write_record(record).expect("memory takes every record");
        write(head.collect());
        for row in &self.rows {
            let fields = row.iter().zip(&suffixes).flat_map(|(cell, suffixes)| {
                let mut fields = cell.fields();
                fields.resize(suffixes.len(), String::new());
                fields
            });
            write(fields.collect());
        }
        String::from_utf8(csv.into_inner().expect("memory takes every record")).expect("built from text")
    }

    fn latex(&self) -> String {
        let line = |cells: Vec<String>| format!("  {} \\\\", cells.join(" & "));
        let cell = |cell: &Cell| match cell {
            Cell::Missing => "--".to_owned(),
            Cell::Text(text) => latex_text(text),
            number => format!("${}$", number.shown(" \\pm ")),
        };
        let mut lines = vec![
            format!("\\begin{{tabular}}{{l{}}}", "r".repeat(self.columns.len() - 1)),
            "  \\toprule".to_owned(),
            line(self.columns.iter().map(|name| latex_text(name)).collect()),
            "  \\midrule".to_owned(),
        ];
        lines.extend(self.rows.iter().map(|row| line(row.iter().map(cell).collect())));
        lines.extend(["  \\bottomrule", "\\end{tabular}"].map(str::to_owned));
        // A table that is included somewhere must not lose what a reader has to know of it.
        if !self.title.is_empty() {
            let head = ["\\begin{table}".to_owned(), "\\centering".to_owned()];
            let caption = format!("\\caption{{{}}}", latex_text(&self.title));
            lines.splice(0..0, head.into_iter().chain([caption]));
        }
        lines.extend(self.notes.iter().map(|note| format!("\\par{{\\footnotesize {}\\par}}", latex_text(note))));
        if !self.title.is_empty() {
            lines.push("\\end{table}".to_owned());
        }
        lines.join("\n") + "\n"
    }
}

/// Text with LaTeX's special characters escaped.
fn latex_text(text: &str) -> String {
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

#[cfg(test)]
mod tests {
    use super::*;

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
        assert_eq!(table.to_json()["rows"][1]["return"], json!({ "of": { "mean": 2.0, "std": null }, "seeds": 1 }));
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
        assert_eq!(latex_text("P(X > Y) < \"1\""), "P(X \\textgreater{} Y) \\textless{} ''1''");
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
