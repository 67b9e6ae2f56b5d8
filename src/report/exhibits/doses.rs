//! Outcomes over the dose: the arms of a sweep, which a study file names `arm+key-value`.

use std::collections::BTreeMap;

use charts::{About, Axis, Curve, CurveChart, CurvePanel, Layout, Reference, Style, Width};
use rl_stats::Estimate;
use rl_stats::pairs::estimate_mean;
use serde::Serialize;

use super::exhibit::{Exhibit, NamedFigure, NamedTable};
use super::parts::caption;
use super::parts::own::Own;
use crate::report::analysis::{Analysis, Arm, ArmStage, Protocol};
use crate::report::names::file_name;
use crate::report::table::{Cell, Table};
use crate::results::mean_std;

/// The key in `report.json`, and the name of the table.
const DOSES: &str = "doses";
/// What is told of every dose.
const MEASURES: [&str; 2] = ["mean area", "mean final return"];

/// Every number that a sweep varies.
#[derive(Debug, Serialize)]
#[serde(transparent)]
pub struct Doses {
    /// One per arm that is swept and setting.
    pub sweeps: Vec<Sweep>,
}

/// One setting of one swept arm.
#[derive(Debug, Serialize)]
pub struct Sweep {
    /// The swept arm's name in the study file.
    pub arm: String,
    /// The setting.
    pub setting: String,
    /// Arms that differ in this setting alone, a line each.
    pub lines: Vec<Line>,
}

/// Arms that differ in one setting and in their sequence at most.
#[derive(Debug, Serialize)]
pub struct Line {
    /// The other swept settings and how the arms are trained.
    pub name: String,
    /// By dose, ascending.
    pub doses: Vec<Dose>,
}

/// The arms of one dose: over sequences where there are several, and over seeds of a single one.
#[derive(Debug, Serialize)]
pub struct Dose {
    /// The setting's value.
    pub value: f64,
    /// Indices of the arms.
    pub arms: Vec<usize>,
    /// By measure: the mean over the stages of a run. None where no run has all of them.
    pub means: BTreeMap<&'static str, Estimate>,
}

/// A swept setting of an arm: its key, its value, and what is left of the arm's name without it.
type Swept<'a> = (&'a str, f64, String);

/// The arms of each line of a sweep, with their doses.
type Lines = BTreeMap<String, Vec<(f64, usize)>>;

/// The swept settings of an arm whose values are numbers: the swept arm's name, and each setting with its value and with
/// what is left of the name without it.
fn swept(arm: &Arm) -> Option<(&str, Vec<Swept<'_>>)> {
    let (base, suffix) = arm.preset.split_once('+')?;
    let parts: Vec<&str> = suffix.split('+').collect();
    let number = |place: usize| {
        let (key, _) = parts[place].split_once('-')?;
        let rest = parts.iter().enumerate().filter(|(other, _)| *other != place).map(|(_, part)| *part);
        Some((key, arm.settings.get(key)?.as_f64()?, rest.collect::<Vec<_>>().join(", ")))
    };
    Some((base, (0..parts.len()).filter_map(number).collect()))
}

impl Doses {
    /// Of every arm whose name says that it is of a sweep; forks stand in an exhibit of their own.
    pub fn new(analysis: &Analysis) -> Self {
        let own = ["area", "normalised_return"].map(|measure| Own::new(analysis, measure));
        // By swept arm and setting, then by line.
        let mut sweeps: BTreeMap<(&str, &str), Lines> = BTreeMap::new();
        for (index, arm) in analysis.arms.iter().enumerate().filter(|(_, arm)| arm.protocol != Protocol::Fork) {
            let Some((base, settings)) = swept(arm) else { continue };
            for (key, value, rest) in settings {
                let how = if arm.protocol == Protocol::Curriculum { "in the curriculum" } else { "from scratch" };
                let line = if rest.is_empty() { how.to_owned() } else { format!("{rest}, {how}") };
                sweeps.entry((base, key)).or_default().entry(line).or_default().push((value, index));
            }
        }
        let line = |(name, mut arms): (String, Vec<(f64, usize)>)| {
            arms.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
            let doses = arms.chunk_by(|a, b| a.0 == b.0).map(|same| Dose::new(analysis, same, &own)).collect();
            Line { name, doses }
        };
        let sweep = |((arm, setting), lines): ((&str, &str), Lines)| {
            let lines = lines.into_iter().map(line).filter(|line| line.doses.len() > 1);
            Sweep { arm: arm.to_owned(), setting: setting.to_owned(), lines: lines.collect() }
        };
        Self { sweeps: sweeps.into_iter().map(sweep).filter(|sweep| !sweep.lines.is_empty()).collect() }
    }
}

impl Dose {
    fn new(analysis: &Analysis, arms: &[(f64, usize)], own: &[Own; 2]) -> Self {
        let of_measure = |(measure, own): (&'static str, &Own)| {
            let by_arm: Vec<Vec<f64>> = arms.iter().map(|(_, arm)| over_stages(analysis, *arm, own)).collect();
            let values = match &by_arm[..] {
                [one] => one.clone(),
                several => several.iter().filter(|seeds| !seeds.is_empty()).map(|seeds| mean_std(seeds).0).collect(),
            };
            (!values.is_empty()).then(|| (measure, estimate_mean(&analysis.conventions.bootstrap, values)))
        };
        Self {
            value: arms.first().map_or(f64::NAN, |(value, _)| *value),
            arms: arms.iter().map(|(_, arm)| *arm).collect(),
            means: MEASURES.into_iter().zip(own).filter_map(of_measure).collect(),
        }
    }
}

/// Each seed's mean over all stages of an arm, of seeds that have them all.
fn over_stages(analysis: &Analysis, arm: usize, own: &Own) -> Vec<f64> {
    let stages = &analysis.arms[arm].stages;
    let of_seed = |seed: &u64| {
        let value = |stage: &ArmStage| own.after(arm, stage.stage, stage.level)?.get(seed).copied();
        Some(mean_std(&stages.iter().map(value).collect::<Option<Vec<f64>>>()?).0)
    };
    analysis.arms[arm].seeds.iter().filter_map(of_seed).collect()
}

/// What intervals are of, in notes and captions.
const OVER: &str = "Intervals are over seeds, or over sequences where a dose has several.";

impl Exhibit for Doses {
    fn key(&self) -> &'static str {
        DOSES
    }

    fn heading(&self) -> &'static str {
        "Doses"
    }

    fn lead(&self) -> &'static str {
        "The arms of a sweep over the values of a setting."
    }

    fn absence(&self) -> &'static str {
        "No arm is one of a sweep over numbers (grid: in a study file)."
    }

    fn numbers(&self) -> serde_json::Result<Option<String>> {
        if self.sweeps.is_empty() { Ok(None) } else { serde_json::to_string(self).map(Some) }
    }

    fn tables(&self, _: &Analysis) -> Vec<NamedTable> {
        vec![NamedTable::new(DOSES, self.table())]
    }

    fn fits_many_arms(&self) -> bool {
        true
    }

    fn figures(&self, analysis: &Analysis) -> Vec<NamedFigure> {
        self.sweeps.iter().filter_map(|sweep| figure(analysis, sweep)).collect()
    }
}

impl Doses {
    /// A row per dose of each line.
    fn table(&self) -> Table {
        let row = |(sweep, line, dose): (&Sweep, &Line, &Dose)| {
            let cell = |measure: &&str| Cell::estimate(dose.means.get(*measure), 3);
            let texts = [&sweep.arm, &sweep.setting, &line.name].map(|text| Cell::from(text.as_str()));
            let dose = Cell::Text(dose.value.to_string());
            texts.into_iter().chain([dose]).chain(MEASURES.iter().map(cell)).collect()
        };
        let lines = self.sweeps.iter().flat_map(|sweep| sweep.lines.iter().map(move |line| (sweep, line)));
        let doses = lines.flat_map(|(sweep, line)| line.doses.iter().map(move |dose| (sweep, line, dose)));
        let columns = ["arm", "setting", "trained", "value"].into_iter().chain(MEASURES);
        let notes = vec![
            "Normalised means over the stages of a run: of areas under the learning curves, and of returns at the end of \
             each stage."
                .to_owned(),
            OVER.to_owned(),
        ];
        Table::new("Outcomes over the dose", columns, doses.map(row).collect(), notes)
    }
}

/// A panel per measure, a line per line, over the logarithm of the dose. Doses that have none are levels across. None
/// without two doses that can be drawn.
fn figure(analysis: &Analysis, sweep: &Sweep) -> Option<NamedFigure> {
    let has = |measure: &&&str| {
        let doses = sweep.lines.iter().flat_map(|line| &line.doses);
        doses.filter(|dose| dose.value > 0.0 && dose.means.contains_key(**measure)).count() > 1
    };
    let panel = |measure: &&str| {
        let curve = |(place, line): (usize, &Line)| {
            let mut curve = Curve::new(line.name.as_str(), Style(place));
            for dose in line.doses.iter().filter(|dose| dose.value > 0.0) {
                let Some(mean) = dose.means.get(*measure) else { continue };
                let x = dose.value.log10();
                curve.centre.push((x, mean.value));
                let [low, high] = mean.interval.map_or([f64::NAN; 2], |interval| [interval.low, interval.high]);
                curve.band.push((x, low, high));
            }
            curve
        };
        let across = |line: &Line| {
            let none = line.doses.iter().filter(|dose| dose.value <= 0.0);
            let level = |dose: &Dose| {
                let name = format!("{} = {}, {}", sweep.setting, dose.value, line.name);
                Some(Reference::across(name, dose.means.get(*measure)?.value))
            };
            none.filter_map(level).collect::<Vec<Reference>>()
        };
        CurvePanel {
            title: (*measure).to_owned(),
            curves: sweep.lines.iter().enumerate().map(curve).collect(),
            references: sweep.lines.iter().flat_map(across).collect(),
            ..CurvePanel::default()
        }
    };
    let panels: Vec<CurvePanel> = MEASURES.iter().filter(has).map(panel).collect();
    let arms: Vec<usize> = sweep.lines.iter().flat_map(|line| &line.doses).flat_map(|dose| dose.arms.clone()).collect();
    let title = format!("{}: outcomes over {}", sweep.arm, sweep.setting);
    (!panels.is_empty()).then(|| NamedFigure {
        name: format!("dose-{}-{}", file_name(&sweep.arm), file_name(&sweep.setting)),
        caption: caption::join([
            format!(
                "{title}, normalised: means over the stages of a run of areas and of returns at the end of a stage."
            ),
            format!("Lines: means. Bands: 95% intervals. {OVER} A dose of 0 is a line across."),
            caption::missing(analysis, &arms),
        ]),
        drawing: CurveChart {
            about: About::new(title, "Areas and returns against the dose, on a logarithmic axis."),
            layout: Layout { width: Width::Page, columns: panels.len(), panel_height: 120.0 },
            x: Axis { powers: true, ..Axis::new(sweep.setting.as_str()) },
            free_y: true,
            panels,
            ..CurveChart::default()
        }
        .draw(),
        tables: vec![DOSES.to_owned()],
    })
}
