//! Sweeps: `grid:` of a study file, one arm for each combination of values.

use serde_json::Value;
use serde_saphyr::Location;

use super::node::{Content, Node, Source};
use crate::error::UserError;

/// The most arms of one grid.
const MAX_CELLS: usize = 10_000;

/// One combination of values.
pub(super) struct GridCell {
    /// `+key-value` of every setting: what is added to the arm's name.
    pub(super) suffix: String,
    /// The settings as `--set` takes them.
    pub(super) sets: Vec<String>,
    /// Where each of them stands in the file.
    pub(super) places: Vec<Location>,
}

/// Every combination of a grid's values; the last setting changes first.
pub(super) fn cells(node: &Node, source: &Source<'_>) -> Result<Vec<GridCell>, UserError> {
    let entries = node.map(source, "grid")?;
    if entries.is_empty() {
        return Err(source.refuse(node.at, "grid: it names no setting: add one, such as l2_coef: [1e-5, 1e-4]"));
    }
    let mut cells = vec![GridCell { suffix: String::new(), sets: Vec::new(), places: Vec::new() }];
    for (key, at, node) in entries {
        if key == "name" {
            return Err(source.refuse(*at, "grid: a name is not swept: say it with set: [name=…]"));
        }
        let values = node.list(source, "grid", "give the setting's values, such as [1e-5, 1e-4]")?;
        if cells.len().saturating_mul(values.len()) > MAX_CELLS {
            return Err(source.refuse(node.at, format_args!("grid: more than {MAX_CELLS} combinations: name fewer")));
        }
        for (place, value) in values.iter().enumerate() {
            if values[..place].iter().any(|other| other.value() == value.value()) {
                return Err(
                    source.refuse(value.at, format_args!("grid: {key}: {value} stands twice: drop one of them"))
                );
            }
        }
        let mut next = Vec::with_capacity(cells.len() * values.len());
        for cell in &cells {
            for value in values {
                let label = label(value).ok_or_else(|| {
                    let problem = "expected a number, a word, true, false or a list of numbers";
                    source.refuse(value.at, format_args!("grid: {key}: {problem}, got {value}"))
                })?;
                next.push(GridCell {
                    suffix: format!("{}+{key}-{label}", cell.suffix),
                    sets: cell.sets.iter().cloned().chain([format!("{key}={value}")]).collect(),
                    places: cell.places.iter().copied().chain([value.at]).collect(),
                });
            }
        }
        cells = next;
    }
    Ok(cells)
}

/// A value as part of a name: `1e-4`, `0.5`, `adamw`, `64x64`.
fn label(value: &Node) -> Option<String> {
    match &value.content {
        Content::Scalar(Value::Number(number)) => Some(match number.as_f64().filter(|_| number.is_f64()) {
            Some(float) => shortest(float),
            None => number.to_string(),
        }),
        Content::Scalar(Value::Bool(flag)) => Some(flag.to_string()),
        Content::Scalar(Value::String(text)) => {
            let keep = |c: char| if c.is_ascii_alphanumeric() || "-_.".contains(c) { c } else { '_' };
            Some(text.chars().map(keep).collect())
        }
        Content::List(entries) => {
            let entries: Option<Vec<String>> = entries.iter().map(label).collect();
            Some(entries?.join("x"))
        }
        Content::Scalar(_) | Content::Map(_) => None,
    }
}

/// The shorter of a number's two forms: `0.5` rather than `5e-1`, `1e-4` rather than `0.0001`.
pub(super) fn shortest(number: f64) -> String {
    let (plain, scientific) = (number.to_string(), format!("{number:e}"));
    if plain.len() <= scientific.len() { plain } else { scientific }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;

    fn grid(text: &str) -> Result<Vec<GridCell>, UserError> {
        let source = Source { path: Path::new("x.yaml") };
        cells(&source.parse(text).unwrap(), &source)
    }

    #[test]
    fn a_grid_has_a_cell_for_each_combination() {
        let cells = grid("l2_coef: [0, 1e-4, 0.5]\nl2: [adam, loss]\n").unwrap();
        let suffixes: Vec<&str> = cells.iter().map(|cell| cell.suffix.as_str()).collect();
        let expected = [
            "+l2_coef-0+l2-adam",
            "+l2_coef-0+l2-loss",
            "+l2_coef-1e-4+l2-adam",
            "+l2_coef-1e-4+l2-loss",
            "+l2_coef-0.5+l2-adam",
            "+l2_coef-0.5+l2-loss",
        ];
        assert_eq!(suffixes, expected);
        assert_eq!(cells[2].sets, ["l2_coef=0.0001", "l2=\"adam\""]);
        let [wide] = &grid("hidden: [[64, 32]]").unwrap()[..] else { panic!("one cell") };
        assert_eq!((wide.suffix.as_str(), &wide.sets[..]), ("+hidden-64x32", &["hidden=[64,32]".to_owned()][..]));
    }

    #[test]
    fn what_is_no_grid_is_refused_with_its_place() {
        let refused = |text: &str, says: &str| {
            let error = grid(text).map(drop).unwrap_err().to_string();
            assert!(error.contains(says), "{text}: {error}");
        };
        refused("{}", "x.yaml:1:1: grid: it names no setting");
        refused("l2_coef: []", "x.yaml:1:10: grid: the list is empty");
        refused("l2_coef: 1", "x.yaml:1:10: grid: expected a list");
        refused("l2_coef: [1, 2, 1]", "x.yaml:1:17: grid: l2_coef: 1 stands twice");
        refused("l2_coef: [{}]", "x.yaml:1:11: grid: l2_coef: expected a number");
        refused("name: [a, b]", "x.yaml:1:1: grid: a name is not swept");
        let many = (0..101).map(|i| i.to_string()).collect::<Vec<_>>().join(",");
        refused(&format!("a: [{many}]\nb: [{many}]"), "x.yaml:2:4: grid: more than 10000 combinations");
    }
}
