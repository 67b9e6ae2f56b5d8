//! Figures of what treatments give back.

use std::collections::{BTreeMap, BTreeSet};

use charts::{About, Axis, HeatMap, HeatPanel, IntervalChart, IntervalPanel, IntervalSeries, Layout, Orientation};
use charts::{Reference, Style, Width};

use super::super::exhibit::NamedFigure;
use super::super::parts::caption;
use super::super::parts::notes::ratio_method;
use super::super::parts::style::{level_label, point};
use super::{NO_SHARE, TREATMENTS, TreatedStage, Treatments};
use crate::report::analysis::Analysis;

/// The name of the figure of shares.
const RECOVERED: &str = "recovered-share";
/// Switches that have a panel each; more of them are rows of a heat map.
const MOST_PANELS: usize = 12;
/// Points per bar.
const BAR_HEIGHT: f64 = 16.0;
/// What the runs without a treatment are called in figures.
const UNTREATED: &str = "untreated";
/// What the new agents are called in figures.
const SCRATCH: &str = "from scratch";

/// Areas and recovered shares; neither where no switch has any.
pub(super) fn all(treatments: &Treatments, analysis: &Analysis) -> Vec<NamedFigure> {
    let switches = by_switch(treatments, analysis);
    let titled = |of: fn(&TreatedStage, &str) -> Option<charts::Estimate>, ends: bool| -> Vec<Bars> {
        switches.iter().map(|(title, stages)| Bars::new(analysis, title, stages, of, ends)).collect()
    };
    let areas = areas_figure(treatments, analysis, &titled(area, true));
    areas.into_iter().chain(shares_figure(treatments, analysis, &titled(share, false))).collect()
}

/// The stages right after a switch, by switch: its title and what was done there.
fn by_switch<'a>(treatments: &'a Treatments, analysis: &'a Analysis) -> Vec<(String, Vec<&'a TreatedStage>)> {
    let mut switches: BTreeMap<_, (String, Vec<&TreatedStage>)> = BTreeMap::new();
    for stage in &treatments.stages {
        let arm = &analysis.arms[stage.pair.fork];
        let Some(treatment) = arm.treatment.as_ref().filter(|t| t.after.checked_add(1) == Some(stage.stage)) else {
            continue;
        };
        let suffix = format!(", after {}: {}", treatment.after, treatment.name);
        let untreated = arm.name.replacen(&suffix, "", 1);
        let whose = stage.pair.curriculum.map_or(untreated, |index| analysis.arms[index].name.clone());
        let key = (stage.pair.curriculum, &arm.preset, &arm.sequence, treatment.after);
        let title = || format!("{whose}: {} after stage {}", level_label(analysis, stage.level), treatment.after);
        switches.entry(key).or_insert_with(|| (title(), Vec::new())).1.push(stage);
    }
    switches.into_values().collect()
}

/// The arms of which something is shown.
fn arms(treatments: &Treatments) -> Vec<usize> {
    let of_stage = |stage: &TreatedStage| [Some(stage.pair.fork), stage.pair.curriculum, stage.pair.from_scratch];
    let all: BTreeSet<usize> = treatments.stages.iter().flat_map(of_stage).flatten().collect();
    all.into_iter().collect()
}

/// The area of a bar: a treatment's, or one of the two that it stands between.
fn area(stage: &TreatedStage, bar: &str) -> Option<charts::Estimate> {
    let area = stage.area.as_ref()?;
    let of_bar = match bar {
        UNTREATED => area.untreated.as_ref()?,
        SCRATCH => area.from_scratch.as_ref()?,
        _ => &area.treated,
    };
    Some(point(&of_bar.mean, of_bar.seeds.values()))
}

/// The share that a treatment gives back.
fn share(stage: &TreatedStage, _: &str) -> Option<charts::Estimate> {
    stage.recovered_share.as_ref().map(|share| point(share, []))
}

/// The bars of one switch.
struct Bars {
    title: String,
    bars: Vec<(String, Option<charts::Estimate>)>,
}

impl Bars {
    /// One for each treatment, between those without one and from scratch where these are asked for. Those two are of
    /// the treatment with the most seeds.
    fn new(
        analysis: &Analysis,
        title: &str,
        stages: &[&TreatedStage],
        of: fn(&TreatedStage, &str) -> Option<charts::Estimate>,
        with_ends: bool,
    ) -> Self {
        let name = |stage: &TreatedStage| {
            let treatment = analysis.arms[stage.pair.fork].treatment.as_ref();
            treatment.map_or(String::new(), |treatment| treatment.name.clone())
        };
        let mut bars: Vec<(String, Option<charts::Estimate>)> =
            stages.iter().map(|stage| (name(stage), of(stage, ""))).collect();
        let seeds = |stage: &&&TreatedStage| stage.area.as_ref().map_or(0, |area| area.treated.seeds.len());
        if let Some(widest) = stages.iter().max_by_key(seeds).filter(|_| with_ends) {
            bars.insert(0, (UNTREATED.to_owned(), of(widest, UNTREATED)));
            bars.push((SCRATCH.to_owned(), of(widest, SCRATCH)));
        }
        Self { title: title.to_owned(), bars }
    }

    fn is_empty(&self) -> bool {
        self.bars.iter().all(|(_, estimate)| estimate.is_none())
    }

    fn value(&self, name: &str) -> Option<f64> {
        self.bars.iter().find(|(own, _)| own == name)?.1.as_ref().map(|estimate| estimate.value)
    }
}

/// A panel per switch, or, of many switches, a heat map with a row for each. None without any value.
fn draw(about: About, values: Axis, switches: &[Bars], references: &[Reference]) -> Option<charts::Drawing> {
    let switches: Vec<&Bars> = switches.iter().filter(|bars| !bars.is_empty()).collect();
    let most = switches.iter().map(|bars| bars.bars.len()).max()?;
    let layout = Layout { width: Width::Page, columns: 1, panel_height: BAR_HEIGHT * most as f64 };
    if switches.len() <= MOST_PANELS {
        let panel = |bars: &&Bars| IntervalPanel {
            title: bars.title.clone(),
            categories: bars.bars.iter().map(|(name, _)| name.clone()).collect(),
            series: vec![IntervalSeries {
                name: String::new(),
                style: Style(0),
                estimates: bars.bars.iter().map(|(_, estimate)| estimate.clone()).collect(),
            }],
            references: references.to_vec(),
        };
        let chart = IntervalChart {
            about,
            layout: Layout { columns: switches.len().min(2), ..layout },
            orientation: Orientation::Horizontal,
            values,
            panels: switches.iter().map(panel).collect(),
            ..IntervalChart::default()
        };
        return Some(chart.draw());
    }
    let mut columns: Vec<&str> = Vec::new();
    for (name, _) in switches.iter().flat_map(|bars| &bars.bars) {
        if !columns.contains(&name.as_str()) {
            columns.push(name);
        }
    }
    // What ends every switch's bars ends the columns, too.
    columns.sort_by_key(|name| *name == SCRATCH);
    let cells = |bars: &&Bars| columns.iter().map(|name| bars.value(name)).collect();
    let panel = HeatPanel {
        title: String::new(),
        rows: switches.iter().map(|bars| bars.title.clone()).collect(),
        columns: columns.iter().map(|name| (*name).to_owned()).collect(),
        cells: switches.iter().map(cells).collect(),
    };
    Some(HeatMap { about, layout, values, decimals: 2, panels: vec![panel], ..HeatMap::default() }.draw())
}

/// Areas under each treatment, without one and from scratch.
fn areas_figure(treatments: &Treatments, analysis: &Analysis, switches: &[Bars]) -> Option<NamedFigure> {
    let about = About::new("Areas with and without a treatment", "Area of the stage after each switch.");
    let drawing = draw(about, Axis::new("area under the learning curve"), switches, &[])?;
    let arms = arms(treatments);
    Some(NamedFigure {
        name: TREATMENTS.to_owned(),
        caption: caption::join([
            "Area under the normalised learning curve of the first stage after each switch: without a treatment, \
             under each treatment, and of a new agent on that level. Of the seeds that have forks."
                .to_owned(),
            "Marks: means over seeds; dots: single seeds.".to_owned(),
            caption::intervals(analysis, &arms),
            caption::missing(analysis, &arms),
        ]),
        drawing,
        tables: vec![TREATMENTS.to_owned()],
    })
}

/// The share of the lost area that each treatment gives back.
fn shares_figure(treatments: &Treatments, analysis: &Analysis, switches: &[Bars]) -> Option<NamedFigure> {
    let about = About::new("What treatments give back", "Recovered share of the lost area, treatment by treatment.");
    let references = [Reference::across("untreated", 0.0), Reference::across("from scratch", 1.0)];
    let drawing = draw(about, Axis::new("recovered share"), switches, &references)?;
    Some(NamedFigure {
        name: RECOVERED.to_owned(),
        caption: caption::join([
            "Recovered share: (treated − untreated) / (from scratch − untreated), of mean areas in the first stage \
             after each switch, paired by seed. Bars: 95% intervals over seeds."
                .to_owned(),
            ratio_method(
                "Recovered shares",
                treatments.stages.iter().filter_map(|stage| stage.recovered_share.as_ref()),
            ),
            NO_SHARE.to_owned(),
            caption::missing(analysis, &arms(treatments)),
        ]),
        drawing,
        tables: vec![TREATMENTS.to_owned()],
    })
}
