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

/// A row per setting, a column per arm.
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
    let rows = analysis.differences.iter().map(row).collect();
    Table::new("Settings in which the arms differ", ["setting"].into_iter().chain(arms), rows, Vec::new())
}
