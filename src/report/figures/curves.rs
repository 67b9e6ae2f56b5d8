//! Learning curves: the study's Figures 2 to 5, and its Figure 6 as it was drawn.

use charts::{About, Axis, Curve, CurveChart, CurvePanel, Layout, Reference, Style, Width};

use super::super::analysis::{AgainstAfresh, Analysis, Arm, LevelInfo, Protocol};
use super::super::names::file_name;
use super::super::published_curves::PublishedCurve;
use super::super::topic::Topic;
use super::timeline::{Timeline, levels_of, trained_for};
use super::track::{Seeds, Track};
use super::{AFRESH, NamedFigure, arms_of, caption, level_label, short_name, style};

/// How the study's own curves look: dashed, in a colour that no arm has.
const PUBLISHED: Style = Style(AFRESH.0 + 7);
const RETURN: &str = "return";
const NORMALISED: &str = "normalised return";
/// What is drawn of returns during training.
const MOVING: &str = "Mean return of the last 100 episodes during training";

pub(super) fn figures(analysis: &Analysis) -> Vec<NamedFigure> {
    let curricula = arms_of(analysis, Protocol::Curriculum);
    let mut figures: Vec<NamedFigure> =
        curricula.iter().filter(|(_, arm)| has_curves(arm)).map(|&(index, arm)| of_arm(analysis, index, arm)).collect();
    figures.extend(by_sequence(&curricula).into_iter().filter_map(|arms| of_arms(analysis, &arms)));
    figures.extend(afresh(analysis));
    figures.extend(analysis.against_afresh.iter().filter_map(|against| against_afresh(analysis, against)));
    figures
}

fn has_curves(arm: &Arm) -> bool {
    arm.curves.iter().any(|curve| !curve.points.is_empty())
}

/// Of how many seeds the points of these arms' curves are, where that is not one number.
fn points(analysis: &Analysis, arms: &[usize]) -> String {
    let of_arm = |&arm: &usize| analysis.arms[arm].curves.iter().flat_map(|curve| curve.mean.iter().flatten());
    caption::points(arms.iter().map(of_arm))
}

/// Curricula that share the order of their levels, together.
pub(super) fn by_sequence<'a>(curricula: &[(usize, &'a Arm)]) -> Vec<Vec<(usize, &'a Arm)>> {
    let mut groups: Vec<Vec<(usize, &Arm)>> = Vec::new();
    for &(index, arm) in curricula {
        match groups.iter_mut().find(|group| levels_of(group[0].1) == levels_of(arm)) {
            Some(group) => group.push((index, arm)),
            None => groups.push(vec![(index, arm)]),
        }
    }
    groups
}

/// The learning curve of an arm over the levels that it has in common with `timeline`.
fn along(timeline: &Timeline, arm: &Arm, curve: &mut Curve, y: impl Fn(usize, f64) -> f64) {
    for stage in &arm.curves {
        if let Some(x) = timeline.place(arm, stage.level) {
            Track::from(stage).append(curve, Seeds::Shown, x, |value| y(stage.level, value));
        }
    }
}

/// One arm over its curriculum: the study's Figures 2 to 4.
fn of_arm(analysis: &Analysis, index: usize, arm: &Arm) -> NamedFigure {
    let timeline = Timeline::new(&[arm], &levels_of(arm));
    let mut curve = Curve::new(arm.name.as_str(), style(analysis, index));
    along(&timeline, arm, &mut curve, |_, value| value);
    let published = published(analysis, arm, &timeline);
    let beside = if published.is_some() { "Thin dashes: the study's own curves, of one seed." } else { "" };
    let title = format!("{} over its curriculum", arm.name);
    NamedFigure {
        name: format!("learning-curve-{}", file_name(&arm.name)),
        topic: Topic::Learning,
        caption: caption::join([
            format!("{}: {}, one level after another.", arm.name, MOVING.to_lowercase()),
            format!("Line: mean over seeds; thin lines: single seeds. {}", caption::seeds(analysis, &[index])),
            caption::bands(analysis, &[index]),
            points(analysis, &[index]),
            beside.to_owned(),
            "A* and the optimum are means over every start cell.".to_owned(),
            caption::missing(analysis, &[index]),
        ]),
        drawing: CurveChart {
            about: About::new(title, "Return during training, level after level, with planners as lines."),
            layout: Layout { width: Width::Page, columns: 1, panel_height: 150.0 },
            x: timeline.axis(),
            y: Axis::new(RETURN),
            panels: vec![CurvePanel {
                curves: [curve].into_iter().chain(published).collect(),
                references: timeline.planners(analysis, |_, value| Some(value)),
                stages: timeline.stages(analysis),
                ..CurvePanel::default()
            }],
            ..CurveChart::default()
        }
        .draw(),
        tables: Vec::new(),
    }
}

/// The study's own curves on the stages that an arm has in common with it, if it trained as long there.
fn published(analysis: &Analysis, arm: &Arm, timeline: &Timeline) -> Option<Curve> {
    let study = analysis.published.as_ref()?;
    let timesteps = study.right_after.iter().find(|model| model.preset == arm.preset)?.timesteps;
    let shared = arm.stages.iter().enumerate().take(study.shared_stages(arm, &analysis.levels));
    let mut curve = Curve { thin: true, ..Curve::new("published (one seed)", PUBLISHED) };
    for (place, stage) in shared.filter(|(_, stage)| stage.timesteps == timesteps) {
        let x = timeline.place(arm, stage.level)?;
        let is_here = |own: &&PublishedCurve| own.preset == arm.preset && own.level == place;
        for own in analysis.published_curves.iter().filter(is_here) {
            // A line of its own, for each level and repeated run.
            curve.centre.push((x(0.0), f64::NAN));
            curve.centre.extend(own.points.iter().map(|&(timesteps, value)| (x(timesteps), value)));
        }
    }
    (!curve.centre.is_empty()).then_some(curve)
}

/// All arms of one curriculum on one axis: the study's Figure 6 as it was drawn. None for a single arm, which has a
/// figure of its own.
fn of_arms(analysis: &Analysis, arms: &[(usize, &Arm)]) -> Option<NamedFigure> {
    let arms: Vec<(usize, &Arm)> = arms.iter().copied().filter(|(_, arm)| has_curves(arm)).collect();
    let [(_, first), _, ..] = arms[..] else { return None };
    let levels = levels_of(first);
    let indices: Vec<usize> = arms.iter().map(|&(index, _)| index).collect();
    let timeline = Timeline::new(&arms.iter().map(|&(_, arm)| arm).collect::<Vec<_>>(), &levels);
    let all_optima = levels.iter().all(|&level| analysis.levels[level].optimal.is_some());
    let value = |level: &LevelInfo, value: f64| if all_optima { level.normalised(value) } else { Some(value) };
    let curve = |&(index, arm): &(usize, &Arm)| {
        let mut curve = Curve::new(arm.name.as_str(), style(analysis, index));
        let y = |level: usize, of: f64| value(&analysis.levels[level], of).unwrap_or(f64::NAN);
        along(&timeline, arm, &mut curve, y);
        curve
    };
    let scale = if all_optima {
        "0 is the worst return there is, 1 the proved mean optimum of the level."
    } else {
        "Returns are not normalised: a level has no proved optimum."
    };
    let panel = CurvePanel {
        curves: arms.iter().map(curve).collect(),
        references: timeline.planners(analysis, value),
        stages: timeline.stages(analysis),
        ..CurvePanel::default()
    };
    Some(NamedFigure {
        name: "learning-curves".to_owned(),
        topic: Topic::Learning,
        caption: caption::join([
            format!("{MOVING}, all arms (the study's Figure 6 as it was drawn)."),
            format!(
                "{scale} Lines: means over seeds; thin lines: single seeds. {}",
                caption::seeds(analysis, &indices)
            ),
            caption::bands(analysis, &indices),
            points(analysis, &indices),
            timeline.note().to_owned(),
            caption::missing(analysis, &indices),
        ]),
        drawing: CurveChart {
            about: About::new("All arms over the curriculum", "Return during training, level after level."),
            layout: Layout { width: Width::Page, columns: 1, panel_height: 170.0 },
            x: timeline.axis(),
            y: Axis::new(if all_optima { NORMALISED } else { RETURN }),
            panels: vec![panel],
            ..CurveChart::default()
        }
        .draw(),
        tables: vec!["aggregates".to_owned()],
    })
}

/// A* and the optimum of one level.
fn planners(level: &LevelInfo) -> Vec<Reference> {
    let both = [("A*", &level.astar), ("optimum", &level.optimal)];
    both.into_iter().filter_map(|(name, planner)| Some(Reference::across(name, planner.as_ref()?.mean))).collect()
}

/// The learning curve of an arm on one level, in timesteps of that level.
fn on_level(arm: &Arm, level: usize, name: &str, style: Style) -> Curve {
    let mut curve = Curve::new(name, style);
    for stage in arm.curves.iter().filter(|curve| curve.level == level) {
        Track::from(stage).append(&mut curve, Seeds::Shown, |timesteps| timesteps, |value| value);
    }
    curve
}

/// A panel per level; x is as long as the longest training of these arms.
fn by_level(
    analysis: &Analysis,
    about: About,
    arms: &[&Arm],
    levels: &[usize],
    curves: impl Fn(usize) -> Vec<Curve>,
) -> CurveChart {
    let panel = |&level: &usize| CurvePanel {
        title: level_label(analysis, level),
        curves: curves(level),
        references: planners(&analysis.levels[level]),
        ..CurvePanel::default()
    };
    let longest = arms.iter().flat_map(|arm| levels.iter().filter_map(|&level| trained_for(arm, level)));
    let longest = longest.fold(0.0, f64::max);
    CurveChart {
        about,
        layout: Layout { width: Width::Page, columns: 3, panel_height: 95.0 },
        // Curves begin with the first row of a log, training at 0.
        x: Axis { range: Some((0.0, longest)), ..Axis::new("timesteps on the level") },
        y: Axis::new(RETURN),
        panels: levels.iter().map(panel).collect(),
        ..CurveChart::default()
    }
}

/// Every arm afresh, level by level.
fn afresh(analysis: &Analysis) -> Option<NamedFigure> {
    let arms: Vec<(usize, &Arm)> =
        arms_of(analysis, Protocol::Afresh).into_iter().filter(|(_, arm)| has_curves(arm)).collect();
    let indices: Vec<usize> = arms.iter().map(|&(index, _)| index).collect();
    let trained = |level: &usize| arms.iter().any(|(_, arm)| levels_of(arm).contains(level));
    let levels: Vec<usize> = (0..analysis.levels.len()).filter(trained).collect();
    let curves = |level: usize| {
        let curve = |&(index, arm): &(usize, &Arm)| on_level(arm, level, &short_name(arm), style(analysis, index));
        arms.iter().map(curve).collect()
    };
    let about = About::new("Every level afresh", "Return during training of fresh agents, a panel per level.");
    (!arms.is_empty()).then(|| NamedFigure {
        name: "learning-curves-afresh".to_owned(),
        topic: Topic::Learning,
        caption: caption::join([
            format!("{MOVING}, a fresh agent on each level: what each arm can learn without a past."),
            format!("Lines: means over seeds; thin lines: single seeds. {}", caption::seeds(analysis, &indices)),
            caption::bands(analysis, &indices),
            points(analysis, &indices),
            caption::missing(analysis, &indices),
        ]),
        drawing: by_level(analysis, about, &arms.iter().map(|&(_, arm)| arm).collect::<Vec<_>>(), &levels, curves)
            .draw(),
        tables: Vec::new(),
    })
}

/// One arm in its curriculum and afresh, level by level: the study's Figure 5.
fn against_afresh(analysis: &Analysis, against: &AgainstAfresh) -> Option<NamedFigure> {
    let AgainstAfresh { curriculum, afresh, .. } = *against;
    let (arm, other) = (&analysis.arms[curriculum], &analysis.arms[afresh]);
    if !has_curves(arm) && !has_curves(other) {
        return None;
    }
    let curves = |level: usize| {
        vec![
            on_level(arm, level, &format!("{} in the curriculum", arm.name), style(analysis, curriculum)),
            on_level(other, level, "afresh", AFRESH),
        ]
    };
    let about = About::new(
        format!("{}: curriculum against afresh", arm.name),
        "Return during training on each level, after the levels before it and by a fresh agent.",
    );
    let both = [curriculum, afresh];
    Some(NamedFigure {
        name: format!("against-afresh-{}", file_name(&arm.name)),
        topic: Topic::AgainstAfresh,
        caption: caption::join([
            format!("{}: {}, in the curriculum and afresh.", arm.name, MOVING.to_lowercase()),
            format!("Lines: means over seeds; thin lines: single seeds. {}", caption::seeds(analysis, &both)),
            caption::bands(analysis, &both),
            points(analysis, &both),
            caption::missing(analysis, &both),
        ]),
        drawing: by_level(analysis, about, &[arm, other], &levels_of(arm), curves).draw(),
        tables: vec!["against-afresh".to_owned()],
    })
}
