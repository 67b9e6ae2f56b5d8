//! Tables of the curriculum against learning from scratch.

use rl_stats::Estimate;

use super::super::parts::notes::{interval_note, level_names, ratio_note};
use super::numbers::{
    Contrast, LevelContrast, OverLevels, Paired, PairedTimes, RELATIVE_LOSS, TimeSummary, relative_losses,
};
use crate::report::analysis::{Analysis, ThresholdTimes};
use crate::report::table::{Cell, Table};

/// The first cells of a row.
fn fixed(analysis: &Analysis, against: &Contrast, level: String, pairs: usize) -> [Cell; 3] {
    [analysis.arms[against.pair.curriculum].name.as_str().into(), level.into(), Cell::count(pairs)]
}

fn notes(analysis: &Analysis, contrasts: &[Contrast]) -> Vec<String> {
    let estimates = |against: &Contrast| {
        let areas = against.levels.iter().flatten().filter_map(|level| level.area.as_ref());
        areas.map(|area| (against.pair.curriculum, area.difference)).collect::<Vec<(usize, Estimate)>>()
    };
    let estimates: Vec<(usize, Estimate)> = contrasts.iter().flat_map(estimates).collect();
    let mut notes = vec![
        "Paired by seed; on later levels a pair shares its first weights alone. Differences are curriculum - from scratch: below 0 the curriculum learns worse. Where few \
         runs from scratch get far, the level is hard, and shows no loss of plasticity. The curriculum's first level \
         is the same training as from scratch: no seed can do better there."
            .to_owned(),
        interval_note(analysis, estimates.iter().map(|(arm, estimate)| (*arm, estimate))),
        "Shares of seeds: exact intervals (Clopper-Pearson).".to_owned(),
    ];
    let unpaired: usize = contrasts.iter().flat_map(|a| &a.levels).flatten().map(|l| l.unpaired.len()).sum();
    if unpaired > 0 {
        notes.push(format!("{unpaired} results have no counterpart of the same seed and level, and are left out."));
    }
    notes
}

fn p_value(p: Option<f64>) -> Cell {
    p.map_or(Cell::Missing, |p| Cell::Number(p, 4))
}

/// Areas under the learning curves and final returns.
pub(super) fn curves(analysis: &Analysis, contrasts: &[Contrast]) -> Table {
    // The intervals are those of differences and shares; a mean of either side is not what is compared.
    let paired = |paired: &Option<Paired>, pairs: usize| {
        let Some(paired) = paired else { return [const { Cell::Missing }; 5] };
        let mean = |estimate: &Estimate| Cell::Number(estimate.value, 3);
        let cells = [
            mean(&paired.curriculum),
            mean(&paired.from_scratch),
            Cell::estimate(&paired.difference, 3),
            p_value(paired.p_holm),
            Cell::estimate(&paired.paired_improvement_share, 2),
        ];
        cells.map(|cell| cell.of_seeds(paired.pairs.len(), pairs))
    };
    let of_level = |against: &Contrast, name: String, contrast: &LevelContrast| {
        let pairs = contrast.seeds.len();
        let reached = |times: &ThresholdTimes| Cell::from(format!("{}/{}", times.seeds - times.censored, times.seeds));
        let reached = (0..analysis.conventions.thresholds.len())
            .map(|place| contrast.from_scratch_thresholds.get(place).map_or(Cell::Missing, reached));
        let solved = Cell::Number(100.0 * contrast.from_scratch_solved_share, 1);
        let loss = Cell::estimate(&contrast.relative_loss, 3)
            .of_seeds(contrast.relative_loss.as_ref().map_or(0, |loss| loss.runs), pairs);
        let row = fixed(analysis, against, name, pairs).into_iter().chain(reached).chain([solved]);
        let row = row.chain(paired(&contrast.area, pairs)).chain([loss]);
        row.chain(paired(&contrast.final_return, pairs)).collect::<Vec<Cell>>()
    };
    let over_levels = |against: &Contrast| {
        let all = against.final_return.as_ref().or(against.area.as_ref())?;
        let pairs = all.pairs.len();
        let means = |over: &Option<OverLevels>| {
            let Some(over) = over else { return [const { Cell::Missing }; 5] };
            let mean = |of: fn(&(f64, f64)) -> f64| {
                let sum: f64 = over.pairs.values().map(of).sum();
                Cell::Number(sum / over.pairs.len() as f64, 3)
            };
            let difference = Cell::estimate(&over.difference, 3);
            let cells = [mean(|pair| pair.0), mean(|pair| pair.1), difference, p_value(over.p_value), Cell::Missing];
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
    for against in contrasts {
        for (level, contrast) in analysis.levels.iter().zip(&against.levels) {
            rows.extend(contrast.as_ref().map(|contrast| of_level(against, level.name.clone(), contrast)));
        }
        rows.extend(over_levels(against));
    }
    let reach = analysis.conventions.thresholds.iter().map(|threshold| format!("reach {threshold} from scratch"));
    let rest = [
        "solved from scratch %",
        "area",
        "area from scratch",
        "difference of areas",
        "p of areas",
        "seeds with more area",
        RELATIVE_LOSS.name,
        "final",
        "final from scratch",
        "difference of finals",
        "p of finals",
        "seeds with better finals",
    ];
    let columns = ["arm", "level", "pairs"].map(str::to_owned).into_iter().chain(reach);
    let title = "Each level in the curriculum against learning from scratch, normalised";
    let mut notes = notes(analysis, contrasts);
    notes.push(ratio_note("Relative losses", contrasts.iter().flat_map(relative_losses)));
    notes.push(
        "p: Student's paired test, adjusted by Holm for the levels of an arm, so that they can be read together; on \
         the mean over levels as it is. Where all differences are the same there is none."
            .to_owned(),
    );
    Table::new(title, columns.chain(rest.map(str::to_owned)), rows, notes)
}

/// Times to the thresholds.
pub(super) fn times(analysis: &Analysis, contrasts: &[Contrast]) -> Table {
    let of_threshold = |against: &Contrast, name: &str, times: &PairedTimes| {
        let summary = |s: &TimeSummary| [Cell::Text(s.median.to_string()), Cell::count(s.censored)];
        let [median, never] = summary(&times.curriculum);
        let [median_from_scratch, never_from_scratch] = summary(&times.from_scratch);
        let sooner = Cell::estimate(&times.sooner_share, 2);
        let cells = [Cell::Number(times.threshold, 2), median, never, median_from_scratch, never_from_scratch, sooner];
        fixed(analysis, against, name.to_owned(), times.pairs.len()).into_iter().chain(cells).collect::<Vec<Cell>>()
    };
    let mut rows = Vec::new();
    for against in contrasts {
        for (level, contrast) in analysis.levels.iter().zip(&against.levels) {
            let thresholds = contrast.iter().flat_map(|contrast| &contrast.thresholds);
            rows.extend(thresholds.map(|times| of_threshold(against, &level.name, times)));
        }
    }
    let columns = [
        "arm",
        "level",
        "pairs",
        "threshold",
        "median time",
        "never",
        "median time from scratch",
        "never from scratch",
        "seeds that are sooner",
    ];
    let mut notes = notes(analysis, contrasts);
    notes.push(
        "Timesteps of the stage until the learning curve first reaches that share of the optimum. Never is later than \
         any time; the count of seeds that never do is beside it."
            .to_owned(),
    );
    Table::new("Time to a threshold in the curriculum and from scratch", columns, rows, notes)
}
