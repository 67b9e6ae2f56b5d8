//! The settings in which arms differ.

use serde_json::Value;

use super::exhibit::{Exhibit, NamedTable};
use crate::report::analysis::{Analysis, Difference};
use crate::report::table::{Cell, Table};

/// The settings that are not the same in all arms.
pub struct Settings;

impl Exhibit for Settings {
    fn key(&self) -> &'static str {
        "settings"
    }

    fn heading(&self) -> &'static str {
        "Settings"
    }

    fn absence(&self) -> &'static str {
        "The arms differ in their names alone."
    }

    fn tables(&self, analysis: &Analysis) -> Vec<NamedTable> {
        vec![NamedTable::main("settings", table(analysis))]
    }
}

/// More arms than this have no column each on a page.
const MAX_COLUMNS: usize = 12;

/// A row per setting and a column per arm; of many arms a row per arm and a column per setting.
fn table(analysis: &Analysis) -> Table {
    let show = |value: &Value| match value {
        Value::Null => Cell::Missing,
        Value::String(text) => text.clone().into(),
        value => value.to_string().into(),
    };
    let row = |difference: &Difference| {
        [difference.key.as_str().into()].into_iter().chain(difference.values.iter().map(show)).collect()
    };
    let arms = analysis.arms.iter().map(|arm| arm.name.as_str());
    let title = "Settings in which the arms differ";
    if analysis.arms.len() > MAX_COLUMNS {
        let of_arm = |(place, name): (usize, &str)| {
            let values = analysis.differences.iter().map(|difference| show(&difference.values[place]));
            [name.into()].into_iter().chain(values).collect()
        };
        let rows = arms.enumerate().map(of_arm).collect();
        let settings = analysis.differences.iter().map(|difference| difference.key.as_str());
        return Table::new(title, ["arm"].into_iter().chain(settings), rows, Vec::new());
    }
    let rows = analysis.differences.iter().map(row).collect();
    Table::new(title, ["setting"].into_iter().chain(arms), rows, Vec::new())
}
