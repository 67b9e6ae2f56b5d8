//! What has no result.

use super::exhibit::{Exhibit, NamedTable};
use crate::report::analysis::{Analysis, LeftOut, Missing as Gap};
use crate::report::table::{Cell, Table};

/// The section's heading, which others link to.
pub const HEADING: &str = "Missing results";

/// What should be there and is not.
pub struct Missing;

impl Exhibit for Missing {
    fn key(&self) -> &'static str {
        "missing"
    }

    fn heading(&self) -> &'static str {
        HEADING
    }

    fn lead(&self) -> &'static str {
        "What should be there and is not. It is left out of every number above."
    }

    fn absence(&self) -> &'static str {
        "Nothing is missing."
    }

    fn tables(&self, analysis: &Analysis) -> Vec<NamedTable> {
        vec![NamedTable::main("missing", table(analysis))]
    }
}

fn table(analysis: &Analysis) -> Table {
    let gap = |gap: &Gap| {
        vec![
            analysis.arms[gap.arm].name.as_str().into(),
            Cell::Text(gap.seed.to_string()),
            gap.levels.join(", ").into(),
            gap.why.as_str().into(),
        ]
    };
    let unread = |left_out: &LeftOut| {
        vec![left_out.path.display().to_string().into(), Cell::Missing, Cell::Missing, left_out.why.as_str().into()]
    };
    let rows = analysis.missing.iter().map(gap).chain(analysis.left_out.iter().map(unread)).collect();
    Table::new("Missing: stages and runs that have no result", ["arm", "seed", "levels", "why"], rows, Vec::new())
}
