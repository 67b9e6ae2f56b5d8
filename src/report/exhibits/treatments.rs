//! What treatments give back: forks beside the runs that they come from and those from scratch.

use std::collections::{BTreeMap, BTreeSet};

use charts::{About, Axis, HeatMap, HeatPanel, IntervalChart, IntervalPanel, IntervalSeries, Layout, Orientation};
use charts::{Reference, Style, Width};
use rl_stats::pairs::{estimate_mean, estimate_ratio_of_means};
use rl_stats::{Bootstrap, Estimate};
use serde::Serialize;

use super::exhibit::{Definition, Exhibit, NamedFigure, NamedTable};
use super::parts::caption;
use super::parts::notes::{interval_note, percentile_note};
use super::parts::own::Own;
use super::parts::style::{level_label, point};
use crate::report::analysis::{Analysis, ArmStage, ForkPair, OverSeeds};
use crate::report::table::{Cell, Table};

/// The section of docs/metrics.md.
const PLACE: &str = "what-treatments-give-back";
/// The key in `report.json`, and the name of the table and of the figure of areas.
pub const TREATMENTS: &str = "treatments";
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

/// Every stage that forks have trained.
#[derive(Debug, Serialize)]
#[serde(transparent)]
pub struct Treatments {
    /// Arm by arm, stage by stage.
    pub stages: Vec<TreatedStage>,
}

/// One stage of the forks of one arm, sequence, switch and treatment.
#[derive(Debug, Serialize)]
pub struct TreatedStage {
    /// The forks, the runs that they come from and those from scratch.
    #[serde(flatten)]
    pub pair: ForkPair,
    /// The stage's number within the sequence.
    pub stage: u16,
    /// Index of its level.
    pub level: usize,
    /// Area under the normalised learning curve.
    pub area: Option<Three>,
    /// Normalised return at the end of the stage.
    pub final_return: Option<Three>,
    /// Mean area treated − untreated, of the seeds that have both.
    pub gain: Option<Estimate>,
    /// Mean area from scratch − untreated, of the seeds that have all three.
    pub lost: Option<Estimate>,
    /// The share of the lost area that the treatment gives back, of the seeds that have all three; none where the
    /// interval of the lost area holds 0, or there is none.
    pub recovered_share: Option<Estimate>,
}

/// One number per seed in the three ways of meeting the stage's level, of the seeds that have forks.
#[derive(Debug, Serialize)]
pub struct Three {
    /// Of the forks.
    pub treated: OverSeeds,
    /// Of the runs that they come from, in the same stage.
    pub untreated: Option<OverSeeds>,
    /// Of new agents on the level.
    pub from_scratch: Option<OverSeeds>,
}

impl Treatments {
    /// Of every arm of forks.
    pub fn new(analysis: &Analysis) -> Self {
        let [areas, returns] = ["area", "normalised_return"].map(|measure| Own::new(analysis, measure));
        let of_fork = |&pair: &ForkPair| {
            let stages = analysis.arms[pair.fork].stages.iter();
            let treated = |stage| TreatedStage::new(pair, stage, &areas, &returns, &analysis.conventions.bootstrap);
            stages.map(treated).collect::<Vec<_>>()
        };
        let mut stages: Vec<TreatedStage> = analysis.forks.iter().flat_map(of_fork).collect();
        stages.retain(|stage| stage.area.is_some() || stage.final_return.is_some());
        Self { stages }
    }

    /// The stages right after a switch, by switch: its title and what was done there.
    fn switches<'a>(&'a self, analysis: &'a Analysis) -> Vec<(String, Vec<&'a TreatedStage>)> {
        let mut switches: BTreeMap<_, (String, Vec<&TreatedStage>)> = BTreeMap::new();
        for stage in &self.stages {
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
}

impl TreatedStage {
    fn new(pair: ForkPair, stage: &ArmStage, areas: &Own, returns: &Own, bootstrap: &Bootstrap) -> Self {
        let three = |own: &Own| {
            let treated = own.after(pair.fork, stage.stage, stage.level)?;
            let beside = |values: Option<&BTreeMap<u64, f64>>| {
                let seeds = values?.iter().filter(|(seed, _)| treated.contains_key(seed));
                OverSeeds::new(seeds.map(|(&seed, &value)| (seed, value)).collect(), bootstrap)
            };
            Some(Three {
                treated: OverSeeds::new(treated.clone(), bootstrap)?,
                untreated: beside(pair.curriculum.and_then(|arm| own.after(arm, stage.stage, stage.level))),
                from_scratch: beside(pair.from_scratch.and_then(|arm| own.on(arm, stage.level))),
            })
        };
        let (area, final_return) = (three(areas), three(returns));
        let [gain, lost, recovered_share] = area.as_ref().map_or([None; 3], |area| area.compared(bootstrap));
        Self { pair, stage: stage.stage, level: stage.level, area, final_return, gain, lost, recovered_share }
    }
}

impl Three {
    /// Treated − untreated; from scratch − untreated; and the ratio of the two, all paired by seed.
    fn compared(&self, bootstrap: &Bootstrap) -> [Option<Estimate>; 3] {
        let Some(untreated) = &self.untreated else { return [None; 3] };
        let gain_of = |(seed, treated): (&u64, &f64)| Some((*seed, treated - untreated.seeds.get(seed)?));
        let gains: BTreeMap<u64, f64> = self.treated.seeds.iter().filter_map(gain_of).collect();
        let gain = (!gains.is_empty()).then(|| estimate_mean(bootstrap, gains.values().copied().collect()));
        let Some(from_scratch) = &self.from_scratch else { return [gain, None, None] };
        let with_loss =
            |(seed, gain): (&u64, &f64)| Some((*gain, from_scratch.seeds.get(seed)? - untreated.seeds.get(seed)?));
        let pairs: Vec<(f64, f64)> = gains.iter().filter_map(with_loss).collect();
        let lost = (!pairs.is_empty()).then(|| estimate_mean(bootstrap, pairs.iter().map(|(_, lost)| *lost).collect()));
        let is_a_difference =
            lost.and_then(|lost| lost.interval).is_some_and(|interval| interval.low > 0.0 || interval.high < 0.0);
        [gain, lost, is_a_difference.then(|| estimate_ratio_of_means(bootstrap, &pairs))]
    }
}

impl Exhibit for Treatments {
    fn key(&self) -> &'static str {
        TREATMENTS
    }

    fn heading(&self) -> &'static str {
        "What treatments give back"
    }

    fn lead(&self) -> &'static str {
        "A fork goes on from a checkpoint of a run under a treatment, with the same random streams. Beside it stand the \
         same stage without a treatment, and a new agent on that level."
    }

    fn absence(&self) -> &'static str {
        "No run is a fork."
    }

    fn definitions(&self) -> Vec<Definition> {
        vec![Definition {
            name: "recovered share",
            meaning:
                "(A_treated − A_untreated) / (A_scratch − A_untreated), of mean areas under the learning curve: 0 \
                      is no better than without a treatment, 1 as good as a new agent"
                    .to_owned(),
            place: PLACE,
        }]
    }

    fn numbers(&self) -> serde_json::Result<Option<String>> {
        if self.stages.is_empty() { Ok(None) } else { serde_json::to_string(self).map(Some) }
    }

    fn tables(&self, analysis: &Analysis) -> Vec<NamedTable> {
        vec![NamedTable::main(TREATMENTS, self.table(analysis))]
    }

    fn fits_many_arms(&self) -> bool {
        true
    }

    fn figures(&self, analysis: &Analysis) -> Vec<NamedFigure> {
        let switches = self.switches(analysis);
        let titled = |of: fn(&TreatedStage, &str) -> Option<charts::Estimate>, ends: bool| -> Vec<Bars> {
            switches.iter().map(|(title, stages)| Bars::new(analysis, title, stages, of, ends)).collect()
        };
        [self.areas_figure(analysis, &titled(area, true)), self.shares_figure(analysis, &titled(share, false))]
            .into_iter()
            .flatten()
            .collect()
    }
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

impl Treatments {
    /// The arms of which something is shown.
    fn arms(&self) -> Vec<usize> {
        let of_stage = |stage: &TreatedStage| [Some(stage.pair.fork), stage.pair.curriculum, stage.pair.from_scratch];
        let all: BTreeSet<usize> = self.stages.iter().flat_map(of_stage).flatten().collect();
        all.into_iter().collect()
    }

    fn areas_figure(&self, analysis: &Analysis, switches: &[Bars]) -> Option<NamedFigure> {
        let about = About::new("Areas with and without a treatment", "Area of the stage after each switch.");
        let drawing = draw(about, Axis::new("area under the learning curve"), switches, &[])?;
        let arms = self.arms();
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

    fn shares_figure(&self, analysis: &Analysis, switches: &[Bars]) -> Option<NamedFigure> {
        let about =
            About::new("What treatments give back", "Recovered share of the lost area, treatment by treatment.");
        let references = [Reference::across("untreated", 0.0), Reference::across("from scratch", 1.0)];
        let drawing = draw(about, Axis::new("recovered share"), switches, &references)?;
        Some(NamedFigure {
            name: RECOVERED.to_owned(),
            caption: caption::join([
                "Recovered share: (treated − untreated) / (from scratch − untreated), of mean areas in the first stage \
                 after each switch, paired by seed. Bars: 95% intervals, percentile bootstrap over seeds, too narrow \
                 with few seeds."
                    .to_owned(),
                NO_SHARE.to_owned(),
                caption::missing(analysis, &self.arms()),
            ]),
            drawing,
            tables: vec![TREATMENTS.to_owned()],
        })
    }

    /// A row per stage that forks have trained.
    fn table(&self, analysis: &Analysis) -> Table {
        let row = |stage: &TreatedStage| {
            let three = stage.area.as_ref().or(stage.final_return.as_ref());
            let seeds = three.map_or(0, |three| three.treated.seeds.len());
            let mean = |value: Option<&OverSeeds>| {
                let cell = value.map_or(Cell::Missing, |value| Cell::Number(value.mean.value, 3));
                cell.of_seeds(value.map_or(0, |value| value.seeds.len()), seeds)
            };
            let means = |three: &Option<Three>| {
                let three = three.as_ref();
                let treated = three.map(|three| &three.treated);
                let untreated = three.and_then(|three| three.untreated.as_ref());
                [untreated, treated, three.and_then(|three| three.from_scratch.as_ref())].map(mean)
            };
            let estimate = |estimate: &Option<Estimate>, decimals: usize| {
                Cell::estimate(estimate, decimals).of_seeds(estimate.as_ref().map_or(0, |e| e.runs), seeds)
            };
            let fixed = [
                analysis.arms[stage.pair.fork].name.as_str().into(),
                Cell::count(usize::from(stage.stage)),
                analysis.levels[stage.level].name.as_str().into(),
                Cell::count(seeds),
            ];
            let compared = [estimate(&stage.gain, 3), estimate(&stage.lost, 3), estimate(&stage.recovered_share, 2)];
            let row = fixed.into_iter().chain(means(&stage.area)).chain(compared).chain(means(&stage.final_return));
            row.collect::<Vec<Cell>>()
        };
        let gains = self.stages.iter().filter_map(|stage| Some((stage.pair.fork, stage.gain.as_ref()?)));
        let shares = self.stages.iter().filter_map(|stage| Some(stage.recovered_share.as_ref()?.runs));
        let notes = vec![
            "Of the stages that forks have trained, paired by seed. Untreated: the same stage of the runs that they \
             come from. From scratch: a new agent on that level. Recovered share: (treated - untreated) / (from scratch \
             - untreated), of mean areas."
                .to_owned(),
            NO_SHARE.to_owned(),
            interval_note(analysis, gains),
            percentile_note("Recovered shares", shares),
        ];
        let columns = [
            "arm",
            "stage",
            "level",
            "seeds",
            "area untreated",
            "area treated",
            "area from scratch",
            "treated - untreated",
            "from scratch - untreated",
            "recovered share",
            "final untreated",
            "final treated",
            "final from scratch",
        ];
        let rows = self.stages.iter().map(row).collect();
        Table::new("What treatments give back, normalised", columns, rows, notes)
    }
}

/// When there is no share.
const NO_SHARE: &str = "There is no share where the interval of (from scratch − untreated) contains 0, or where one seed \
                        has none: nothing is known to be lost.";
