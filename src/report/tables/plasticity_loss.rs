//! Each level in the curriculum against the same level afresh.

use rl_stats::Estimate;

use super::super::analysis::{AgainstAfresh, Analysis, LevelContrast, Paired, PairedTimes, TimeSummary};
use super::super::{Cell, Table};
use super::{count, interval_note};

fn rows(analysis: &Analysis, cells: impl Fn(&LevelContrast) -> Vec<Vec<Cell>>) -> Vec<Vec<Cell>> {
    let mut rows = Vec::new();
    for against in &analysis.against_afresh {
        let arm = analysis.arms[against.curriculum].name.as_str();
        for (level, contrast) in analysis.levels.iter().zip(&against.levels) {
            let Some(contrast) = contrast else { continue };
            for cells in cells(contrast) {
                let fixed: [Cell; 3] = [arm.into(), level.name.as_str().into(), count(contrast.seeds.len())];
                rows.push(fixed.into_iter().chain(cells).collect());
            }
        }
    }
    rows
}

fn notes(analysis: &Analysis) -> Vec<String> {
    let areas = |against: &AgainstAfresh| {
        let areas = against.levels.iter().flatten().filter_map(|level| level.area.as_ref());
        areas.map(|area| (against.curriculum, area.difference)).collect::<Vec<(usize, Estimate)>>()
    };
    let areas: Vec<(usize, Estimate)> = analysis.against_afresh.iter().flat_map(areas).collect();
    let mut notes = vec![
        "Paired by seed. Differences are curriculum - afresh: below 0 the curriculum learns worse. Where few starts \
         are solved afresh, the level is hard, and no loss of plasticity can be seen."
            .to_owned(),
        interval_note(analysis, areas.iter().map(|(arm, estimate)| (*arm, estimate))),
    ];
    let unpaired: usize =
        analysis.against_afresh.iter().flat_map(|a| &a.levels).flatten().map(|l| l.unpaired.len()).sum();
    if unpaired > 0 {
        notes.push(format!("{unpaired} results have no counterpart of the same seed and level, and are left out."));
    }
    notes
}

/// Areas under the learning curves and final returns.
pub(super) fn curves(analysis: &Analysis) -> Table {
    let paired = |paired: &Option<Paired>| {
        let Some(paired) = paired else { return vec![Cell::Missing; 4] };
        let Paired { curriculum, afresh, difference, paired_improvement_share, .. } = paired;
        let mean = |value: f64| Cell::Number(value, 3);
        let difference = Cell::estimate(difference, 3);
        vec![mean(curriculum.value), mean(afresh.value), difference, Cell::estimate(paired_improvement_share, 2)]
    };
    let cells = |contrast: &LevelContrast| {
        let solved = Cell::Number(100.0 * contrast.afresh_solved_share, 1);
        vec![[vec![solved], paired(&contrast.area), paired(&contrast.final_return)].concat()]
    };
    let names = [
        "arm",
        "level",
        "pairs",
        "solved afresh %",
        "area",
        "area afresh",
        "difference of areas",
        "seeds with more area",
        "final",
        "final afresh",
        "difference of finals",
        "seeds with better finals",
    ];
    Table {
        title: "Each level in the curriculum against afresh, normalised".to_owned(),
        columns: names.map(str::to_owned).to_vec(),
        rows: rows(analysis, cells),
        notes: notes(analysis),
    }
}

/// Times to the thresholds.
pub(super) fn times(analysis: &Analysis) -> Table {
    let cells = |contrast: &LevelContrast| {
        let of_threshold = |times: &PairedTimes| {
            let summary = |s: &TimeSummary| [Cell::Text(s.median.to_string()), count(s.censored)];
            let [median, never] = summary(&times.curriculum);
            let [median_afresh, never_afresh] = summary(&times.afresh);
            let sooner = Cell::estimate(&times.sooner_share, 2);
            vec![Cell::Number(times.threshold, 2), median, never, median_afresh, never_afresh, sooner]
        };
        contrast.thresholds.iter().map(of_threshold).collect()
    };
    let names = [
        "arm",
        "level",
        "pairs",
        "threshold",
        "median time",
        "never",
        "median time afresh",
        "never afresh",
        "seeds that are sooner",
    ];
    let mut notes = notes(analysis);
    notes.push(
        "Timesteps of the stage until the learning curve first reaches that share of the optimum; never is later than \
         any time, and the count of seeds that never do is beside it."
            .to_owned(),
    );
    Table {
        title: "Time to a threshold in the curriculum against afresh".to_owned(),
        columns: names.map(str::to_owned).to_vec(),
        rows: rows(analysis, cells),
        notes,
    }
}
