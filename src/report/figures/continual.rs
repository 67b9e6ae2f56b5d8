//! Measures of continual learning, and the curriculum against afresh: the measured loss of plasticity.

use std::collections::BTreeMap;

use charts::{About, Axis, IntervalChart, IntervalPanel, IntervalSeries, Layout, Reference, Width};
use rl_stats::{Estimate, Time};

use super::super::analysis::{
    AgainstAfresh, Analysis, Continual, LevelContrast, OverLevels, OverSeeds, Paired, PairedTimes,
};
use super::super::topic::Topic;
use super::{NamedFigure, caption, level_label, point, style};

pub(super) fn figures(analysis: &Analysis) -> Vec<NamedFigure> {
    let mut figures: Vec<NamedFigure> = [measures(analysis), forgetting(analysis)].into_iter().flatten().collect();
    figures.extend([differences(analysis), sooner(analysis)].into_iter().flatten());
    figures
}

fn over_seeds(measure: &OverSeeds) -> charts::Estimate {
    point(&measure.mean, measure.seeds.values())
}

/// The curricula with measures, by their indices.
fn measured(analysis: &Analysis) -> Vec<(usize, &Continual)> {
    let arms = analysis.arms.iter().enumerate();
    arms.filter_map(|(index, arm)| Some((index, arm.continual.as_ref()?))).collect()
}

/// The sentences that both figures of whole curricula end with.
fn of_whole_curricula(analysis: &Analysis, arms: &[usize]) -> [String; 3] {
    [
        "Marks: means over the seeds that have finished all stages; dots: single seeds.".to_owned(),
        caption::intervals(analysis, arms),
        caption::missing(analysis, arms),
    ]
}

/// Every measure, each arm's.
fn measures(analysis: &Analysis) -> Option<NamedFigure> {
    type Of = fn(&Continual) -> &Option<OverSeeds>;
    // All but the first are changes; that one's 0 is the worst result there is.
    const MEASURES: [(&str, Of, Option<&str>); 6] = [
        ("average performance", |m| &m.average_performance, None),
        ("backward transfer", |m| &m.backward_transfer, Some("no effect")),
        ("forward transfer", |m| &m.forward_transfer, Some("no effect")),
        ("forgetting", |m| &m.forgetting, Some("no effect")),
        ("isolated forgetting", |m| &m.isolated_forgetting, Some("no effect")),
        ("zero-shot transfer", |m| &m.zero_shot_transfer, Some("no effect")),
    ];
    let arms = measured(analysis);
    let indices: Vec<usize> = arms.iter().map(|&(index, _)| index).collect();
    let series = |index: usize, measure: Option<&OverSeeds>| IntervalSeries {
        name: analysis.arms[index].name.clone(),
        style: style(analysis, index),
        estimates: vec![measure.map(over_seeds)],
    };
    let panel = |(title, of, zero): &(&str, Of, Option<&str>)| IntervalPanel {
        title: (*title).to_owned(),
        categories: vec![String::new()],
        series: arms.iter().map(|&(index, measures)| series(index, of(measures).as_ref())).collect(),
        references: zero.map(|name| Reference::across(name, 0.0)).into_iter().collect(),
    };
    let panels = MEASURES.iter().map(panel).collect();
    (!arms.is_empty()).then(|| NamedFigure {
        name: "continual-learning".to_owned(),
        topic: Topic::Continual,
        caption: caption::join(
            ["Measures of continual learning, of normalised returns. Forgetting is a loss: above 0 something is \
                 forgotten. Transfer is a gain: below 0 the past harms."
                .to_owned()]
            .into_iter()
            .chain(of_whole_curricula(analysis, &indices)),
        ),
        drawing: IntervalChart {
            about: About::new("Continual learning", "Average performance, transfer and forgetting of each arm."),
            layout: Layout { width: Width::Page, columns: 3, panel_height: 95.0 },
            values: Axis::new("normalised return"),
            panels,
            ..IntervalChart::default()
        }
        .draw(),
        tables: vec!["continual-learning".to_owned()],
    })
}

/// What is lost of each level.
fn forgetting(analysis: &Analysis) -> Option<NamedFigure> {
    let arms = measured(analysis);
    let indices: Vec<usize> = arms.iter().map(|&(index, _)| index).collect();
    let on_level = |index: usize, measures: &Continual, level: usize| {
        let stage = analysis.arms[index].stages.iter().position(|stage| stage.level == level)?;
        measures.forgetting_by_stage.get(stage)?.as_ref().map(over_seeds)
    };
    let series = |&(index, measures): &(usize, &Continual)| IntervalSeries {
        name: analysis.arms[index].name.clone(),
        style: style(analysis, index),
        estimates: (0..analysis.levels.len()).map(|level| on_level(index, measures, level)).collect(),
    };
    let first = "Normalised return on each level right after its own stage minus at the end of all: above 0 it is \
                 forgotten. The last level is 0 by definition.";
    (!arms.is_empty()).then(|| NamedFigure {
        name: "forgetting".to_owned(),
        topic: Topic::Continual,
        caption: caption::join([first.to_owned()].into_iter().chain(of_whole_curricula(analysis, &indices))),
        drawing: IntervalChart {
            about: About::new("Forgetting", "What each arm loses of each level."),
            layout: Layout { width: Width::Page, columns: 1, panel_height: 110.0 },
            values: Axis::new("forgetting"),
            panels: vec![IntervalPanel {
                categories: (0..analysis.levels.len()).map(|level| level_label(analysis, level)).collect(),
                series: arms.iter().map(series).collect(),
                references: vec![Reference::across("nothing forgotten", 0.0)],
                ..IntervalPanel::default()
            }],
            ..IntervalChart::default()
        }
        .draw(),
        tables: vec!["forgetting".to_owned()],
    })
}

/// The comparisons that have a level to show, and the arms in them.
fn contrasts(analysis: &Analysis) -> (Vec<&AgainstAfresh>, Vec<usize>) {
    let with_levels = analysis.against_afresh.iter().filter(|against| against.levels.iter().any(Option::is_some));
    let all: Vec<&AgainstAfresh> = with_levels.collect();
    let arms = all.iter().flat_map(|against| [against.curriculum, against.afresh]).collect();
    (all, arms)
}

/// A panel with a series per arm and a category per level, and one for all levels where `over_levels` has something.
fn by_level(
    analysis: &Analysis,
    title: &str,
    of: impl Fn(&LevelContrast) -> Option<charts::Estimate>,
    over_levels: impl Fn(&AgainstAfresh) -> Option<charts::Estimate>,
    reference: Reference,
) -> IntervalPanel {
    let all = contrasts(analysis).0;
    let has_mean = all.iter().any(|against| over_levels(against).is_some());
    let levels = (0..analysis.levels.len()).map(|level| level_label(analysis, level));
    let mean = has_mean.then(|| "mean over levels".to_owned());
    let series = |against: &&AgainstAfresh| {
        let levels = against.levels.iter().map(|level| level.as_ref().and_then(&of));
        let mean = has_mean.then(|| over_levels(against));
        IntervalSeries {
            name: analysis.arms[against.curriculum].name.clone(),
            style: style(analysis, against.curriculum),
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
fn differences(analysis: &Analysis) -> Option<NamedFigure> {
    fn pairs(difference: &Estimate, pairs: &BTreeMap<u64, (f64, f64)>) -> charts::Estimate {
        let differences: Vec<f64> = pairs.values().map(|(curriculum, afresh)| curriculum - afresh).collect();
        point(difference, &differences)
    }
    let paired = |paired: &Option<Paired>| paired.as_ref().map(|paired| pairs(&paired.difference, &paired.pairs));
    let over = |over: &Option<OverLevels>| over.as_ref().map(|over| pairs(&over.difference, &over.pairs));
    let share = |share: &Option<Estimate>| share.as_ref().map(|share| point(share, []));
    let (all, arms) = contrasts(analysis);
    let zero = || Reference::across("no difference", 0.0);
    let panels = vec![
        by_level(
            analysis,
            "area under the learning curve: curriculum − afresh, normalised return",
            |level| paired(&level.area),
            |against| over(&against.area),
            zero(),
        ),
        by_level(
            analysis,
            "relative loss of area: (afresh − curriculum) / afresh",
            |level| share(&level.relative_loss),
            |against| share(&against.relative_loss),
            zero(),
        ),
        by_level(
            analysis,
            "final return, greedy: curriculum − afresh, normalised return",
            |level| paired(&level.final_return),
            |against| over(&against.final_return),
            zero(),
        ),
    ];
    let unpaired: usize = all.iter().flat_map(|a| &a.levels).flatten().map(|level| level.unpaired.len()).sum();
    (!all.is_empty()).then(|| NamedFigure {
        name: "plasticity-loss".to_owned(),
        topic: Topic::AgainstAfresh,
        caption: caption::join([
            "Curriculum against afresh, paired by seed, of normalised returns: differences below 0 and relative losses above \
             0 say that the level is learned worse with a past than without one, the nearest thing to a measured loss of \
             plasticity. A difference of areas cannot exceed the area afresh, of which the relative loss is the share: both \
             are averaged over seeds before they are divided. A level that is not learned afresh either shows no loss, and \
             has no relative one; on the first, nobody has a past."
                .to_owned(),
            "Marks: means over pairs; dots: single pairs.".to_owned(),
            caption::intervals(analysis, &arms),
            if unpaired > 0 { format!("Results without a counterpart, left out: {unpaired}.") } else { String::new() },
            caption::missing(analysis, &arms),
        ]),
        drawing: IntervalChart {
            about: About::new("Curriculum against afresh", "Areas and final returns compared, level by level."),
            layout: Layout { width: Width::Page, columns: 1, panel_height: 95.0 },
            // The panels' titles say what they measure.
            values: Axis::default(),
            free_values: true,
            panels,
            ..IntervalChart::default()
        }
        .draw(),
        tables: vec!["against-afresh".to_owned(), "continual-learning".to_owned()],
    })
}

/// Which of the two reaches each threshold sooner, and how many never do.
fn sooner(analysis: &Analysis) -> Option<NamedFigure> {
    let (all, arms) = contrasts(analysis);
    let times_of = |level: &'_ LevelContrast, place: usize| level.thresholds.get(place).cloned();
    let panel = |(place, threshold): (usize, &f64)| {
        let title = format!("normalised return of {threshold}");
        let share = |level: &LevelContrast| {
            let times = times_of(level, place)?;
            // Where nobody ever gets there, nobody is as soon as the other.
            let reached = times.pairs.values().any(|pair| *pair != (Time::Never, Time::Never));
            times.sooner_share.filter(|_| reached).map(|share| point(&share, []))
        };
        by_level(analysis, &title, share, |_| None, Reference::across("as soon", 0.5))
    };
    let panels: Vec<IntervalPanel> = analysis.conventions.thresholds.iter().enumerate().map(panel).collect();
    let censored = |(place, threshold): (usize, &f64)| {
        let of_arm = |against: &&AgainstAfresh| {
            let times: Vec<PairedTimes> =
                against.levels.iter().flatten().filter_map(|level| times_of(level, place)).collect();
            let pairs: usize = times.iter().map(|times| times.pairs.len()).sum();
            let curriculum: usize = times.iter().map(|times| times.curriculum.censored).sum();
            let afresh: usize = times.iter().map(|times| times.afresh.censored).sum();
            let arm = &analysis.arms[against.curriculum].name;
            format!("{arm} {curriculum} in the curriculum and {afresh} afresh, of {pairs}")
        };
        let each: Vec<String> = all.iter().map(of_arm).collect();
        format!("Runs that never reach {threshold}: {}.", each.join("; "))
    };
    let never: Vec<String> = analysis.conventions.thresholds.iter().enumerate().map(censored).collect();
    let has_times = all.iter().flat_map(|a| &a.levels).flatten().any(|level| !level.thresholds.is_empty());
    has_times.then(|| NamedFigure {
        name: "time-to-threshold".to_owned(),
        topic: Topic::AgainstAfresh,
        caption: caption::join([
            "Share of seeds whose learning curve reaches a threshold sooner in the curriculum than afresh; a tie counts \
             half, as when both never get there. A dash: no seed does, with a past or without; on the curriculum's first level \
             the two are the same training."
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
        tables: vec!["time-to-threshold".to_owned()],
    })
}
