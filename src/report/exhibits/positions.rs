//! Areas and returns over the position of a stage within its sequence: what many orders of the levels, or a long
//! sequence, say that a panel for each could not show.

use std::collections::BTreeMap;

use charts::{About, Axis, Curve, CurveChart, CurvePanel, HeatMap, HeatPanel, Layout, Reference, Width};
use rl_stats::pairs::estimate_mean;
use rl_stats::ratio::estimate_ratio_of_means;
use rl_stats::{Bootstrap, Estimate};
use serde::Serialize;

use super::MOST_ARMS;
use super::exhibit::{Definition, Exhibit, NamedFigure, NamedTable};
use super::from_scratch::LEAST_AREA;
use super::parts::caption;
use super::parts::notes::ratio_note;
use super::parts::own::Own;
use super::parts::style::style;
use crate::report::analysis::{Analysis, Protocol};
use crate::report::names::file_name;
use crate::report::table::{Cell, Table};
use crate::results::mean_std;

/// The section of docs/metrics.md.
const PLACE: &str = "over-positions";
/// The name of the table and of the figure with a line per arm.
const POSITIONS: &str = "positions";
/// The table of slopes.
const SLOPES: &str = "slopes";
/// A sequence of more stages than this is long.
pub const MANY_STAGES: usize = 10;
/// Heat maps of more columns than this stand one below the other.
const SIDE_BY_SIDE: usize = 12;
/// What is told of every stage.
const MEASURES: [&str; 3] = ["area", "area - from scratch", "final return"];

/// Arms that differ in their sequence alone, each over the positions of its stages.
#[derive(Debug, Serialize)]
#[serde(transparent)]
pub struct Positions {
    /// In the order of their first arms.
    pub families: Vec<Family>,
}

/// Arms that differ in their sequence alone. An interval is over sequences where there are several, and over seeds where
/// there is one.
#[derive(Debug, Serialize)]
pub struct Family {
    /// The arms' name without their sequence.
    pub name: String,
    /// Indices of the arms, one per sequence.
    pub arms: Vec<usize>,
    /// Position by position, from the first stage on.
    pub positions: Vec<Position>,
    /// By measure: change per stage, by least squares in each sequence (or seed), over these. None with one stage.
    pub slopes: BTreeMap<&'static str, Estimate>,
    /// Of each sequence, position by position.
    #[serde(skip)]
    rows: Vec<Vec<Stage>>,
}

/// All sequences (or seeds) at one position.
#[derive(Debug, Serialize)]
pub struct Position {
    /// From 1.
    pub position: usize,
    /// By measure.
    pub means: BTreeMap<&'static str, Estimate>,
    /// Mean area over the mean area from scratch on the same levels; none where that is next to nothing.
    pub relative_area: Option<Estimate>,
}

/// One stage of one sequence, or of one seed.
#[derive(Clone, Copy, Debug, Default)]
struct Stage {
    area: Option<f64>,
    from_scratch: Option<f64>,
    final_return: Option<f64>,
}

impl Stage {
    fn get(&self, measure: &str) -> Option<f64> {
        match measure {
            "area" => self.area,
            "final return" => self.final_return,
            _ => Some(self.area? - self.from_scratch?),
        }
    }

    fn relative_area(&self) -> Option<f64> {
        let scratch = self.from_scratch.filter(|area| *area >= LEAST_AREA)?;
        Some(self.area? / scratch)
    }
}

/// What a cell of a heat map tells of a stage.
type OfStage = fn(&Stage) -> Option<f64>;

/// Whether some arms differ in their sequence alone, or a sequence is long.
pub fn are_worth_it(analysis: &Analysis) -> bool {
    families(analysis).iter().any(|family| is_shown(analysis, family))
}

fn is_shown(analysis: &Analysis, family: &[usize]) -> bool {
    family.len() > 1 || analysis.arms[family[0]].stages.len() > MANY_STAGES
}

/// The curricula that differ in their sequence alone, together.
fn families(analysis: &Analysis) -> Vec<Vec<usize>> {
    let mut families: Vec<Vec<usize>> = Vec::new();
    for (index, arm) in analysis.arms.iter().enumerate().filter(|(_, arm)| arm.protocol == Protocol::Curriculum) {
        match families.iter_mut().find(|family| analysis.arms[family[0]].differs_in_sequence_alone(arm)) {
            Some(family) => family.push(index),
            None => families.push(vec![index]),
        }
    }
    families
}

impl Positions {
    /// Of every arm that was trained through several sequences, or through a long one.
    pub fn new(analysis: &Analysis) -> Self {
        let own = ["area", "normalised_return"].map(|measure| Own::new(analysis, measure));
        let shown = families(analysis).into_iter().filter(|family| is_shown(analysis, family));
        Self { families: shown.map(|arms| Family::new(analysis, arms, &own)).collect() }
    }
}

impl Family {
    fn new(analysis: &Analysis, arms: Vec<usize>, own: &[Own; 2]) -> Self {
        let bootstrap = &analysis.conventions.bootstrap;
        let rows: Vec<Vec<Stage>> = arms.iter().map(|&arm| of_arm(analysis, arm, own, None)).collect();
        let by_seed = || analysis.arms[arms[0]].seeds.iter().map(|&seed| of_arm(analysis, arms[0], own, Some(seed)));
        let units: Vec<Vec<Stage>> = if arms.len() > 1 { rows.clone() } else { by_seed().collect() };
        let longest = units.iter().map(Vec::len).max().unwrap_or(0);
        let slope_of = |measure: &'static str| {
            let slopes: Vec<f64> = units.iter().filter_map(|stages| slope(stages, measure)).collect();
            (!slopes.is_empty()).then(|| (measure, estimate_mean(bootstrap, slopes)))
        };
        let first = &analysis.arms[arms[0]];
        let sequence = first.sequence.as_ref().map_or(String::new(), |sequence| format!(", {sequence}"));
        Self {
            name: first.name.replacen(&sequence, "", 1),
            positions: (0..longest).map(|place| Position::new(place, &units, bootstrap)).collect(),
            slopes: MEASURES.into_iter().filter_map(slope_of).collect(),
            arms,
            rows,
        }
    }
}

/// The stages of an arm, means over seeds; or those of one of its seeds.
fn of_arm(analysis: &Analysis, arm: usize, [areas, returns]: &[Own; 2], seed: Option<u64>) -> Vec<Stage> {
    let from_scratch = analysis.pairs.iter().find(|pair| pair.curriculum == arm).map(|pair| pair.from_scratch);
    let value = |seeds: Option<&BTreeMap<u64, f64>>| match seed {
        Some(seed) => seeds?.get(&seed).copied(),
        None => seeds.map(|seeds| mean_std(&seeds.values().copied().collect::<Vec<f64>>()).0),
    };
    let stages = analysis.arms[arm].stages.iter();
    let stage = stages.map(|stage| Stage {
        area: value(areas.after(arm, stage.stage, stage.level)),
        from_scratch: value(from_scratch.and_then(|arm| areas.on(arm, stage.level))),
        final_return: value(returns.after(arm, stage.stage, stage.level)),
    });
    stage.collect()
}

/// The change of a measure per stage, by least squares; none of fewer than two stages that have it.
fn slope(stages: &[Stage], measure: &str) -> Option<f64> {
    let numbered = stages.iter().enumerate();
    let (x, y): (Vec<f64>, Vec<f64>) =
        numbered.filter_map(|(place, stage)| Some((place as f64, stage.get(measure)?))).unzip();
    let (middle, level) = (mean_std(&x).0, mean_std(&y).0);
    let squares: f64 = x.iter().map(|x| (x - middle).powi(2)).sum();
    let products: f64 = x.iter().zip(&y).map(|(x, y)| (x - middle) * (y - level)).sum();
    (x.len() > 1).then(|| products / squares)
}

impl Position {
    fn new(place: usize, units: &[Vec<Stage>], bootstrap: &Bootstrap) -> Self {
        let here = || units.iter().filter_map(|stages| stages.get(place));
        let mean = |measure: &'static str| {
            let values: Vec<f64> = here().filter_map(|stage| stage.get(measure)).collect();
            (!values.is_empty()).then(|| (measure, estimate_mean(bootstrap, values)))
        };
        let pairs: Vec<(f64, f64)> = here().filter_map(|stage| stage.area.zip(stage.from_scratch)).collect();
        let scratch: Vec<f64> = pairs.iter().map(|pair| pair.1).collect();
        Self {
            position: place + 1,
            means: MEASURES.into_iter().filter_map(mean).collect(),
            relative_area: (mean_std(&scratch).0 >= LEAST_AREA).then(|| estimate_ratio_of_means(bootstrap, &pairs)),
        }
    }
}

impl Exhibit for Positions {
    fn key(&self) -> &'static str {
        POSITIONS
    }

    fn heading(&self) -> &'static str {
        "Over positions"
    }

    fn lead(&self) -> &'static str {
        "What is learned in the first stage, the second, and so on, over all sequences of the same settings. Where every \
         level stands at every position equally often, a trend is not the levels'."
    }

    fn absence(&self) -> &'static str {
        "No stage is finished."
    }

    fn definitions(&self) -> Vec<Definition> {
        let meaning =
            "change of a measure from one stage to the next, by least squares over the positions of a sequence";
        vec![Definition { name: "slope", meaning: meaning.to_owned(), place: PLACE }]
    }

    fn numbers(&self) -> serde_json::Result<Option<String>> {
        serde_json::to_string(self).map(Some)
    }

    fn tables(&self, _: &Analysis) -> Vec<NamedTable> {
        vec![NamedTable::main(SLOPES, self.slopes()), NamedTable::new(POSITIONS, self.positions())]
    }

    fn fits_many_arms(&self) -> bool {
        true
    }

    fn figures(&self, analysis: &Analysis) -> Vec<NamedFigure> {
        let (several, single): (Vec<&Family>, Vec<&Family>) = self.families.iter().partition(|f| f.arms.len() > 1);
        let of_orders = several.into_iter().map(|family| {
            let sequence = |&arm: &usize| analysis.arms[arm].sequence.clone().unwrap_or_default();
            let names: Vec<String> = family.arms.iter().map(sequence).collect();
            let name = format!("{POSITIONS}-{}", file_name(&family.name));
            heat_map(analysis, name, &format!("{}, sequence by sequence", family.name), names, &[family])
        });
        let of_long = (!single.is_empty()).then(|| {
            let names = single.iter().map(|family| family.name.clone()).collect();
            heat_map(analysis, format!("{POSITIONS}-of-arms"), "Arm by arm", names, &single)
        });
        self.lines(analysis).into_iter().chain(of_orders).chain(of_long).collect()
    }
}

/// Of how many sequences or seeds a family's intervals are.
fn units(family: &Family) -> String {
    match family.arms.len() {
        1 => "seeds".to_owned(),
        sequences => format!("{sequences} sequences"),
    }
}

/// What intervals are of, in notes and captions.
const OVER: &str =
    "Intervals are over sequences, each the mean over its seeds; of a single sequence they are over seeds.";

impl Positions {
    /// The change per stage, a row per family.
    fn slopes(&self) -> Table {
        let row = |family: &Family| {
            let cell = |measure: &&str| Cell::estimate(family.slopes.get(*measure), 4);
            let fixed = [family.name.as_str().into(), units(family).into()];
            fixed.into_iter().chain(MEASURES.iter().map(cell)).collect()
        };
        let columns = ["arm", "over"].into_iter().chain(MEASURES);
        let notes = vec![
            "By least squares over the positions of each sequence, then the mean. Area and final return are normalised."
                .to_owned(),
            OVER.to_owned(),
        ];
        Table::new("Change per stage within a sequence", columns, self.families.iter().map(row).collect(), notes)
    }

    /// A row per family and position.
    fn positions(&self) -> Table {
        let row = |(family, position): (&Family, &Position)| {
            let cell = |measure: &&str| Cell::estimate(position.means.get(*measure), 3);
            let relative = Cell::estimate(&position.relative_area, 3);
            let fixed = [family.name.as_str().into(), units(family).into(), Cell::count(position.position)];
            fixed.into_iter().chain(MEASURES.iter().map(cell)).chain([relative]).collect()
        };
        let rows = || self.families.iter().flat_map(|family| family.positions.iter().map(move |p| (family, p)));
        let columns = ["arm", "over", "position"].into_iter().chain(MEASURES).chain(["relative area"]);
        let notes = vec![
            "Position 1 is the first stage. Relative area: mean area / mean area from scratch on the same levels."
                .to_owned(),
            ratio_note("Relative areas", rows().filter_map(|(_, position)| position.relative_area.as_ref())),
            OVER.to_owned(),
        ];
        Table::new("Areas and returns over positions, normalised", columns, rows().map(row).collect(), notes)
    }

    /// A line per family, a panel per measure. None of more lines than can be told apart.
    fn lines(&self, analysis: &Analysis) -> Option<NamedFigure> {
        let panel = |measure: &'static str| CurvePanel {
            title: measure.replace(" - ", " − "),
            curves: self.families.iter().map(|family| line(analysis, family, measure)).collect(),
            references: (measure == MEASURES[1])
                .then(|| Reference::across("as from scratch", 0.0))
                .into_iter()
                .collect(),
            ..CurvePanel::default()
        };
        let has = |measure: &&&str| {
            self.families.iter().flat_map(|family| &family.positions).any(|p| p.means.contains_key(**measure))
        };
        let panels: Vec<CurvePanel> = MEASURES.iter().filter(has).map(|measure| panel(measure)).collect();
        let arms: Vec<usize> = self.families.iter().flat_map(|family| family.arms.clone()).collect();
        let is_readable = self.families.len() <= MOST_ARMS && !panels.is_empty();
        is_readable.then(|| NamedFigure {
            name: POSITIONS.to_owned(),
            caption: caption::join([
                "What is learned at each position of a sequence: area under the normalised learning curve of the stage, \
                 the same minus the area from scratch on the same level, and normalised return at the end of the stage."
                    .to_owned(),
                format!("Lines: means. Bands: 95% intervals. {OVER}"),
                caption::missing(analysis, &arms),
            ]),
            drawing: CurveChart {
                about: About::new("Over positions", "Areas and returns against the position of the stage."),
                layout: Layout { width: Width::Page, columns: panels.len().min(3), panel_height: 110.0 },
                x: Axis::new("position in the sequence"),
                free_y: true,
                panels,
                ..CurveChart::default()
            }
            .draw(),
            tables: vec![POSITIONS.to_owned(), SLOPES.to_owned()],
        })
    }
}

/// One family's means over positions.
fn line(analysis: &Analysis, family: &Family, measure: &str) -> Curve {
    let mut curve = Curve::new(family.name.as_str(), style(analysis, family.arms[0]));
    for position in &family.positions {
        let Some(mean) = position.means.get(measure) else { continue };
        let x = position.position as f64;
        curve.centre.push((x, mean.value));
        let [low, high] = mean.interval.map_or([f64::NAN; 2], |interval| [interval.low, interval.high]);
        curve.band.push((x, low, high));
    }
    curve
}

/// A row per sequence, a column per position, a panel per measure.
fn heat_map(analysis: &Analysis, name: String, title: &str, rows: Vec<String>, families: &[&Family]) -> NamedFigure {
    let stages: Vec<&Vec<Stage>> = families.iter().flat_map(|family| &family.rows).collect();
    let arms: Vec<usize> = families.iter().flat_map(|family| family.arms.clone()).collect();
    let longest = stages.iter().map(|row| row.len()).max().unwrap_or(0);
    let columns: Vec<String> = (1..=longest).map(|position| position.to_string()).collect();
    let panel = |(title, of): (&str, OfStage)| HeatPanel {
        title: title.to_owned(),
        rows: rows.clone(),
        columns: columns.clone(),
        cells: stages.iter().map(|row| row.iter().map(of).collect()).collect(),
    };
    let measures: [(&str, OfStage); 3] = [
        ("area", |stage| stage.area),
        ("relative area", Stage::relative_area),
        ("final return", |stage| stage.final_return),
    ];
    let mut panels: Vec<HeatPanel> = measures.into_iter().map(panel).collect();
    panels.retain(|panel| panel.cells.iter().flatten().any(Option::is_some));
    let side_by_side = if longest > SIDE_BY_SIDE { 1 } else { panels.len().max(1) };
    NamedFigure {
        name,
        caption: caption::join([
            format!("{title}, over the position of the stage in the sequence. Means over seeds."),
            "Area: under the normalised learning curve. Relative area: area / area from scratch on the same level. Final \
             return: normalised, greedy, from every start cell. Hatched: no result."
                .to_owned(),
            caption::missing(analysis, &arms),
        ]),
        drawing: HeatMap {
            about: About::new(title, "Areas and returns, a row per sequence and a column per position."),
            layout: Layout { width: Width::Page, columns: side_by_side, ..Layout::default() },
            column_label: "position in the sequence".to_owned(),
            values: Axis::new("share of the optimum, or of the area from scratch"),
            decimals: 2,
            panels,
            ..HeatMap::default()
        }
        .draw(),
        tables: vec![POSITIONS.to_owned()],
    }
}
