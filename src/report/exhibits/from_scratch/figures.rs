//! Figures of the curriculum against learning from scratch.

use std::collections::BTreeMap;

use charts::{About, Axis, IntervalChart, IntervalPanel, IntervalSeries, Layout, Reference, Width};
use rl_stats::{Estimate, Time};

use super::super::exhibit::NamedFigure;
use super::super::parts::caption;
use super::super::parts::curves::{MOVING, has_curves, learning_points, on_level, panel_per_level};
use super::super::parts::notes::ratio_note;
use super::super::parts::style::{FROM_SCRATCH, level_label, point, style};
use super::super::parts::timeline::levels_of;
use super::numbers::{Contrast, LevelContrast, OverLevels, Paired, PairedTimes, RELATIVE_LOSS, relative_losses};
use super::{TABLE, TIMES};
use crate::report::analysis::{Analysis, Pair};
use crate::report::names::file_name;

/// Learning curves of each pair, then all pairs compared.
pub(super) fn all(analysis: &Analysis, contrasts: &[Contrast]) -> Vec<NamedFigure> {
    let each = contrasts.iter().filter_map(|contrast| curves(analysis, contrast.pair));
    each.chain(differences(analysis, contrasts)).chain(sooner(analysis, contrasts)).collect()
}

/// One arm in its curriculum and from scratch, level by level: the paper's Figure 5.
fn curves(analysis: &Analysis, pair: Pair) -> Option<NamedFigure> {
    let Pair { curriculum, from_scratch } = pair;
    let (arm, other) = (&analysis.arms[curriculum], &analysis.arms[from_scratch]);
    if !has_curves(arm) && !has_curves(other) {
        return None;
    }
    let curves = |level: usize| {
        vec![
            on_level(arm, level, &format!("{} in the curriculum", arm.name), style(analysis, curriculum)),
            on_level(other, level, "from scratch", FROM_SCRATCH),
        ]
    };
    let about = About::new(
        format!("{}: curriculum against learning from scratch", arm.name),
        "Return during training on each level, after the levels before it and by a new agent.",
    );
    let both = [curriculum, from_scratch];
    Some(NamedFigure {
        name: format!("against-from-scratch-{}", file_name(&arm.name)),
        caption: caption::join([
            format!("{}: {}, in the curriculum and from scratch.", arm.name, MOVING.to_lowercase()),
            format!("Lines: means over seeds; thin lines: single seeds. {}", caption::seeds(analysis, &both)),
            caption::bands(analysis, &both),
            learning_points(analysis, &both),
            caption::missing(analysis, &both),
        ]),
        drawing: panel_per_level(analysis, about, &[arm, other], &levels_of(arm), curves)?.draw(),
        tables: vec![TABLE.to_owned()],
    })
}

/// The comparisons that have a level to show, and the arms in them.
fn with_levels(contrasts: &[Contrast]) -> (Vec<&Contrast>, Vec<usize>) {
    let with_levels = contrasts.iter().filter(|against| against.levels.iter().any(Option::is_some));
    let all: Vec<&Contrast> = with_levels.collect();
    let arms = all.iter().flat_map(|against| [against.pair.curriculum, against.pair.from_scratch]).collect();
    (all, arms)
}

/// A panel with a series per arm and a category per level, and one for all levels where `over_levels` has something.
fn by_level(
    analysis: &Analysis,
    all: &[&Contrast],
    title: &str,
    of: impl Fn(&LevelContrast) -> Option<charts::Estimate>,
    over_levels: impl Fn(&Contrast) -> Option<charts::Estimate>,
    reference: Reference,
) -> IntervalPanel {
    let has_mean = all.iter().any(|against| over_levels(against).is_some());
    let levels = (0..analysis.levels.len()).map(|level| level_label(analysis, level));
    let mean = has_mean.then(|| "mean over levels".to_owned());
    let series = |against: &&Contrast| {
        let levels = against.levels.iter().map(|level| level.as_ref().and_then(&of));
        let mean = has_mean.then(|| over_levels(against));
        IntervalSeries {
            name: analysis.arms[against.pair.curriculum].name.clone(),
            style: style(analysis, against.pair.curriculum),
            estimates: levels.chain(mean).collect(),
        }
    };
    IntervalPanel {
        title: title.to_owned(),
        categories: levels.chain(mean).collect(),
        series: all.iter().map(series).collect(),
        references: vec![reference],
    }
}

/// The differences of areas and of final returns, and what share of the area is lost.
fn differences(analysis: &Analysis, contrasts: &[Contrast]) -> Option<NamedFigure> {
    fn pairs(difference: &Estimate, pairs: &BTreeMap<u64, (f64, f64)>) -> charts::Estimate {
        let differences: Vec<f64> =
            pairs.values().map(|(curriculum, from_scratch)| curriculum - from_scratch).collect();
        point(difference, &differences)
    }
    let paired = |paired: &Option<Paired>| paired.as_ref().map(|paired| pairs(&paired.difference, &paired.pairs));
    let over = |over: &Option<OverLevels>| over.as_ref().map(|over| pairs(&over.difference, &over.pairs));
    let share = |share: &Option<Estimate>| share.as_ref().map(|share| point(share, []));
    let (all, arms) = with_levels(contrasts);
    let zero = || Reference::across("no difference", 0.0);
    let panels = vec![
        by_level(
            analysis,
            &all,
            "area under the learning curve: curriculum − from scratch, normalised return",
            |level| paired(&level.area),
            |against| over(&against.area),
            zero(),
        ),
        by_level(
            analysis,
            &all,
            &format!("{}: (from scratch − curriculum) / from scratch", RELATIVE_LOSS.name),
            |level| share(&level.relative_loss),
            |against| share(&against.relative_loss),
            zero(),
        ),
        by_level(
            analysis,
            &all,
            "final return, greedy: curriculum − from scratch, normalised return",
            |level| paired(&level.final_return),
            |against| over(&against.final_return),
            zero(),
        ),
    ];
    let unpaired: usize = all.iter().flat_map(|a| &a.levels).flatten().map(|level| level.unpaired.len()).sum();
    (!all.is_empty()).then(|| {
        NamedFigure {
        name: "plasticity-loss".to_owned(),
        caption: caption::join([
            "Curriculum against learning from scratch, paired by seed, of normalised returns. Differences below 0, and \
             relative losses above 0, say that the level is learned worse with a past than without one. This is the \
             nearest thing to a measured loss of plasticity. A difference of areas cannot exceed the area from \
             scratch; the relative loss is its share of that area. Both are averaged over seeds before they are \
             divided. A level that is not learned from scratch either shows no loss, and has no relative one. On the \
             first level nobody has a past."
                .to_owned(),
            "Marks: means over pairs; dots: single pairs.".to_owned(),
            caption::intervals(analysis, &arms),
            ratio_note("Relative losses", all.iter().copied().flat_map(relative_losses)),
            if unpaired > 0 { format!("Results without a counterpart, left out: {unpaired}.") } else { String::new() },
            caption::missing(analysis, &arms),
        ]),
        drawing: IntervalChart {
            about: About::new("With a past and from scratch", "Areas and final returns compared, level by level."),
            layout: Layout { width: Width::Page, columns: 1, panel_height: 95.0 },
            // The panels' titles say what they measure.
            values: Axis::default(),
            free_values: true,
            panels,
            ..IntervalChart::default()
        }
        .draw(),
        tables: vec![TABLE.to_owned()],
    }
    })
}

/// Which of the two reaches each threshold sooner, and how many never do.
fn sooner(analysis: &Analysis, contrasts: &[Contrast]) -> Option<NamedFigure> {
    let (all, arms) = with_levels(contrasts);
    let times_of = |level: &'_ LevelContrast, place: usize| level.thresholds.get(place).cloned();
    let panel = |(place, threshold): (usize, &f64)| {
        let title = format!("normalised return of {threshold}");
        let share = |level: &LevelContrast| {
            let times = times_of(level, place)?;
            // Where nobody ever gets there, nobody is as soon as the other.
            let reached = times.pairs.values().any(|pair| *pair != (Time::Never, Time::Never));
            times.sooner_share.filter(|_| reached).map(|share| point(&share, []))
        };
        by_level(analysis, &all, &title, share, |_| None, Reference::across("as soon", 0.5))
    };
    let panels: Vec<IntervalPanel> = analysis.conventions.thresholds.iter().enumerate().map(panel).collect();
    let censored = |(place, threshold): (usize, &f64)| {
        let of_arm = |against: &&Contrast| {
            let times: Vec<PairedTimes> =
                against.levels.iter().flatten().filter_map(|level| times_of(level, place)).collect();
            let pairs: usize = times.iter().map(|times| times.pairs.len()).sum();
            let curriculum: usize = times.iter().map(|times| times.curriculum.censored).sum();
            let from_scratch: usize = times.iter().map(|times| times.from_scratch.censored).sum();
            let arm = &analysis.arms[against.pair.curriculum].name;
            format!("{arm} {curriculum} in the curriculum and {from_scratch} from scratch, of {pairs}")
        };
        let each: Vec<String> = all.iter().map(of_arm).collect();
        format!("Runs that never reach {threshold}: {}.", each.join("; "))
    };
    let never: Vec<String> = analysis.conventions.thresholds.iter().enumerate().map(censored).collect();
    let has_times = all.iter().flat_map(|a| &a.levels).flatten().any(|level| !level.thresholds.is_empty());
    has_times.then(|| {
        NamedFigure {
        name: TIMES.to_owned(),
        caption: caption::join([
            "Share of seeds whose learning curve reaches a threshold sooner in the curriculum than from scratch. A tie \
             counts half, as when both never get there. A dash: no seed does, with a past or without. On the \
             curriculum's first level the two are the same training."
                .to_owned(),
            never.join(" "),
            caption::share_intervals(analysis, &arms),
            caption::missing(analysis, &arms),
        ]),
        drawing: IntervalChart {
            about: About::new("Sooner in the curriculum", "Share of seeds, level by level."),
            layout: Layout { width: Width::Page, columns: 1, panel_height: 80.0 },
            values: Axis { range: Some((-0.08, 1.08)), ..Axis::new("share that is sooner") },
            panels,
            ..IntervalChart::default()
        }
        .draw(),
        tables: vec![TIMES.to_owned()],
    }
    })
}
