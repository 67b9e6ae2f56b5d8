//! Each level in the curriculum against the same level afresh.

use rl_stats::Estimate;

use super::super::analysis::{
    AgainstAfresh, Analysis, LevelContrast, OverLevels, Paired, PairedTimes, ThresholdTimes, TimeSummary,
};
use super::super::{Cell, Table};
use super::{count, interval_note, level_names};

/// The first cells of a row.
fn fixed(analysis: &Analysis, against: &AgainstAfresh, level: String, pairs: usize) -> [Cell; 3] {
    [analysis.arms[against.curriculum].name.as_str().into(), level.into(), count(pairs)]
}

fn notes(analysis: &Analysis) -> Vec<String> {
    let estimates = |against: &AgainstAfresh| {
        let areas = against.levels.iter().flatten().filter_map(|level| level.area.as_ref());
        areas.map(|area| (against.curriculum, area.difference)).collect::<Vec<(usize, Estimate)>>()
    };
    let estimates: Vec<(usize, Estimate)> = analysis.against_afresh.iter().flat_map(estimates).collect();
    let mut notes = vec![
        "Paired by seed. Differences are curriculum - afresh: below 0 the curriculum learns worse. Where few runs afresh \
         get far, the level is hard, and no loss of plasticity can be seen. The curriculum's first level is the same \
         training afresh, so that no seed can do better there."
            .to_owned(),
        interval_note(analysis, estimates.iter().map(|(arm, estimate)| (*arm, estimate))),
        "Shares of seeds: exact intervals (Clopper-Pearson).".to_owned(),
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
    // The intervals are those of differences and shares; a mean of either side is not what is compared.
    let paired = |paired: &Option<Paired>, pairs: usize| {
        let Some(paired) = paired else { return [const { Cell::Missing }; 4] };
        let mean = |estimate: &Estimate| Cell::Number(estimate.value, 3);
        let cells = [
            mean(&paired.curriculum),
            mean(&paired.afresh),
            Cell::estimate(&paired.difference, 3),
            Cell::estimate(&paired.paired_improvement_share, 2),
        ];
        cells.map(|cell| cell.of_seeds(paired.pairs.len(), pairs))
    };
    let of_level = |against: &AgainstAfresh, name: String, contrast: &LevelContrast| {
        let pairs = contrast.seeds.len();
        let reached = |times: &ThresholdTimes| Cell::from(format!("{}/{}", times.seeds - times.censored, times.seeds));
        let reached = (0..analysis.conventions.thresholds.len())
            .map(|place| contrast.afresh_thresholds.get(place).map_or(Cell::Missing, reached));
        let solved = Cell::Number(100.0 * contrast.afresh_solved_share, 1);
        let loss = Cell::estimate(&contrast.relative_loss, 3)
            .of_seeds(contrast.relative_loss.as_ref().map_or(0, |loss| loss.runs), pairs);
        let row = fixed(analysis, against, name, pairs).into_iter().chain(reached).chain([solved]);
        let row = row.chain(paired(&contrast.area, pairs)).chain([loss]);
        row.chain(paired(&contrast.final_return, pairs)).collect::<Vec<Cell>>()
    };
    let over_levels = |against: &AgainstAfresh| {
        let all = against.final_return.as_ref().or(against.area.as_ref())?;
        let pairs = all.pairs.len();
        let means = |over: &Option<OverLevels>| {
            let Some(over) = over else { return [const { Cell::Missing }; 4] };
            let mean = |of: fn(&(f64, f64)) -> f64| {
                let sum: f64 = over.pairs.values().map(of).sum();
                Cell::Number(sum / over.pairs.len() as f64, 3)
            };
            let cells = [mean(|pair| pair.0), mean(|pair| pair.1), Cell::estimate(&over.difference, 3), Cell::Missing];
            cells.map(|cell| cell.of_seeds(over.pairs.len(), pairs))
        };
        let loss = against.relative_loss.as_ref();
        let loss = Cell::estimate(loss, 3).of_seeds(loss.map_or(0, |loss| loss.runs), pairs);
        let name = format!("mean of {}", level_names(analysis, &all.levels));
        // Neither thresholds nor solved starts have a mean over levels that would tell something.
        let nothing = vec![Cell::Missing; analysis.conventions.thresholds.len() + 1];
        let row = fixed(analysis, against, name, pairs).into_iter().chain(nothing);
        let row = row.chain(means(&against.area)).chain([loss]).chain(means(&against.final_return));
        Some(row.collect::<Vec<Cell>>())
    };
    let mut rows = Vec::new();
    for against in &analysis.against_afresh {
        for (level, contrast) in analysis.levels.iter().zip(&against.levels) {
            rows.extend(contrast.as_ref().map(|contrast| of_level(against, level.name.clone(), contrast)));
        }
        rows.extend(over_levels(against));
    }
    let reach = analysis.conventions.thresholds.iter().map(|threshold| format!("reach {threshold} afresh"));
    let rest = [
        "solved afresh %",
        "area",
        "area afresh",
        "difference of areas",
        "seeds with more area",
        "relative loss of area",
        "final",
        "final afresh",
        "difference of finals",
        "seeds with better finals",
    ];
    let columns = ["arm", "level", "pairs"].map(str::to_owned).into_iter().chain(reach);
    Table {
        title: "Each level in the curriculum against afresh, normalised".to_owned(),
        columns: columns.chain(rest.map(str::to_owned)).collect(),
        rows,
        notes: notes(analysis),
    }
}

/// Times to the thresholds.
pub(super) fn times(analysis: &Analysis) -> Table {
    let of_threshold = |against: &AgainstAfresh, name: &str, times: &PairedTimes| {
        let summary = |s: &TimeSummary| [Cell::Text(s.median.to_string()), count(s.censored)];
        let [median, never] = summary(&times.curriculum);
        let [median_afresh, never_afresh] = summary(&times.afresh);
        let sooner = Cell::estimate(&times.sooner_share, 2);
        let cells = [Cell::Number(times.threshold, 2), median, never, median_afresh, never_afresh, sooner];
        fixed(analysis, against, name.to_owned(), times.pairs.len()).into_iter().chain(cells).collect::<Vec<Cell>>()
    };
    let mut rows = Vec::new();
    for against in &analysis.against_afresh {
        for (level, contrast) in analysis.levels.iter().zip(&against.levels) {
            let thresholds = contrast.iter().flat_map(|contrast| &contrast.thresholds);
            rows.extend(thresholds.map(|times| of_threshold(against, &level.name, times)));
        }
    }
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
        rows,
        notes,
    }
}
