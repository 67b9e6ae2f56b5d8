//! Measures of continual learning.

use rl_stats::Estimate;

use super::super::analysis::{Analysis, Continual, OverSeeds};
use super::super::{Cell, Table};
use super::{columns, count, interval_note};

fn measured(analysis: &Analysis) -> impl Iterator<Item = (usize, &Continual)> {
    let arms = analysis.arms.iter().enumerate();
    arms.filter_map(|(arm, a)| Some((arm, a.continual.as_ref()?)))
}

fn cell(measure: &Option<OverSeeds>) -> Cell {
    Cell::estimate(measure.as_ref().map(|measure| &measure.mean), 3)
}

fn seeds(measures: &Continual) -> usize {
    measures.average_performance.as_ref().map_or(0, |measure| measure.seeds.len())
}

/// What the intervals are of.
fn shown(analysis: &Analysis) -> impl Iterator<Item = (usize, &Estimate)> {
    measured(analysis).filter_map(|(arm, measures)| Some((arm, &measures.average_performance.as_ref()?.mean)))
}

/// A row per curriculum, a column per measure.
pub(super) fn measures(analysis: &Analysis) -> Table {
    let row = |(arm, m): (usize, &Continual)| {
        let measures = [
            &m.average_performance,
            &m.backward_transfer,
            &m.forward_transfer,
            &m.forgetting,
            &m.isolated_forgetting,
            &m.zero_shot_transfer,
        ];
        let fixed: [Cell; 2] = [analysis.arms[arm].name.as_str().into(), count(seeds(m))];
        let against = analysis.against_afresh.iter().find(|against| against.curriculum == arm);
        let transfer = against.and_then(|against| against.area_transfer.as_ref());
        let area_transfer = Cell::estimate(transfer, 3).of_seeds(transfer.map_or(0, |t| t.runs), seeds(m));
        fixed.into_iter().chain(measures.into_iter().map(cell)).chain([area_transfer]).collect()
    };
    let names = [
        "arm",
        "seeds",
        "average performance",
        "backward transfer",
        "forward transfer",
        "forgetting",
        "isolated forgetting",
        "zero-shot transfer",
        "transfer by areas",
    ];
    Table {
        title: "Continual learning, of normalised returns".to_owned(),
        columns: names.map(str::to_owned).to_vec(),
        rows: measured(analysis).map(row).collect(),
        notes: vec![
            "Of seeds that have finished all stages; transfer by areas of those that have areas on all levels that were \
             also trained afresh. docs/metrics.md defines the measures."
                .to_owned(),
            interval_note(analysis, shown(analysis)),
        ],
    }
}

/// What is lost on each level from the end of its own stage to the end of all.
pub(super) fn forgetting(analysis: &Analysis) -> Table {
    let row = |(arm, m): (usize, &Continual)| {
        let arm = &analysis.arms[arm];
        let on_level = |level: usize| {
            let stage = arm.stages.iter().position(|stage| stage.level == level)?;
            m.forgetting_by_stage.get(stage)?.as_ref()
        };
        let cells = (0..analysis.levels.len()).map(|level| Cell::estimate(on_level(level).map(|f| &f.mean), 3));
        [arm.name.as_str().into(), count(seeds(m))].into_iter().chain(cells).collect()
    };
    Table {
        title: "Forgetting: normalised return right after a level's own stage minus at the end of all".to_owned(),
        columns: columns(&["arm", "seeds"], analysis.levels.iter().map(|level| level.name.clone())),
        rows: measured(analysis).map(row).collect(),
        notes: vec![interval_note(analysis, shown(analysis))],
    }
}
