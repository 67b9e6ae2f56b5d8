//! The paper's single runs beside ours: inside or outside of where one more run of ours would fall.

use rl_stats::few::prediction_interval;

use super::exhibit::{Exhibit, NamedTable};
use super::parts::returns::published_note;
use crate::report::analysis::{Analysis, Arm};
use crate::report::published::{Published, PublishedArm};
use crate::report::table::{Cell, Table};

/// The table's name.
const TABLE: &str = "published-runs";

/// Every number of the paper that stands beside ours.
pub struct PublishedRuns;

/// One number of the paper, and the seeds of the arm beside it.
struct Beside<'a> {
    arm: &'a Arm,
    when: String,
    level: usize,
    seeds: Vec<f64>,
    published: f64,
}

impl Exhibit for PublishedRuns {
    fn key(&self) -> &'static str {
        "published_runs"
    }

    fn heading(&self) -> &'static str {
        "Published runs"
    }

    fn lead(&self) -> &'static str {
        "A published run is one seed. It is compared with where one more seed of ours would fall."
    }

    fn absence(&self) -> &'static str {
        "No published number stands beside these runs."
    }

    fn tables(&self, analysis: &Analysis) -> Vec<NamedTable> {
        let Some(paper) = &analysis.published else { return Vec::new() };
        vec![NamedTable::new(TABLE, table(analysis, paper))]
    }
}

fn table(analysis: &Analysis, paper: &Published) -> Table {
    let confidence = analysis.conventions.bootstrap.confidence;
    let all: Vec<Beside> = analysis.arms.iter().flat_map(|arm| beside(analysis, paper, arm)).collect();
    let row = |beside: &Beside| {
        let interval = prediction_interval(&beside.seeds, confidence);
        let verdict = interval.map_or(Cell::Missing, |interval| {
            let is_inside = (interval.low..=interval.high).contains(&beside.published);
            Cell::from(if is_inside { "inside" } else { "outside" })
        });
        let mean = beside.seeds.iter().sum::<f64>() / beside.seeds.len() as f64;
        vec![
            beside.arm.name.as_str().into(),
            beside.when.as_str().into(),
            analysis.levels[beside.level].name.as_str().into(),
            Cell::count(beside.seeds.len()),
            Cell::Interval(mean, interval, 2),
            Cell::Number(beside.published, 2),
            verdict,
        ]
    };
    let mut arms: Vec<&Arm> = all.iter().map(|beside| beside.arm).collect();
    arms.dedup_by_key(|arm| arm.name.as_str());
    let notes = vec![
        format!(
            "[low, high]: {:.0}% prediction interval, mean ± t s √(1 + 1/n): where one more seed falls if seeds are \
             normally distributed. One in twenty published runs may lie outside by chance.",
            100.0 * confidence
        ),
        published_note(paper, &arms),
    ];
    let columns = ["arm", "measured", "level", "seeds", "mean", "published", "published run"];
    Table::new("The paper's single runs beside our seeds, in return", columns, all.iter().map(row).collect(), notes)
}

/// Every number of the paper that an arm's runs repeat.
fn beside<'a>(analysis: &Analysis, paper: &Published, arm: &'a Arm) -> Vec<Beside<'a>> {
    let shared = analysis.stages_of_paper(arm);
    let of = |models: &[PublishedArm; 3]| models.iter().find(|model| model.preset == arm.preset).copied();
    let columns = || (0..analysis.levels.len()).filter_map(|level| Some((level, analysis.paper_column(level)?)));
    let right_after = columns().filter(|(_, column)| *column < shared).filter_map(|(level, column)| {
        let seeds = arm.levels[level].as_ref()?.seeds.values().map(|seed| seed.mean).collect();
        let published = of(&paper.right_after)?.levels[column].mean;
        Some(Beside { arm, when: "right after training".to_owned(), level, seeds, published })
    });
    let evaluated = columns().find(|(_, column)| paper.evaluated_after(*column) && *column < shared);
    let after = evaluated.into_iter().flat_map(|(last, _)| {
        columns().filter_map(move |(level, column)| {
            let matrix = arm.matrix.as_ref()?;
            let row = matrix.rows.iter().find(|row| row.after.is_some_and(|after| after.level == last))?;
            let place = matrix.levels.iter().position(|own| *own == level)?;
            let seeds = row.cells[place].as_ref()?.seeds.values().copied().collect();
            let published = of(&paper.after_level_3)?.levels[column].mean;
            let when = format!("after level {}", analysis.levels[last].name);
            Some(Beside { arm, when, level, seeds, published })
        })
    });
    right_after.chain(after).collect()
}
