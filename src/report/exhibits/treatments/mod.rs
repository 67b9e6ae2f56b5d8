//! What treatments give back: forks beside the runs that they come from and those from scratch.

mod figures;

use std::collections::BTreeMap;

use rl_stats::pairs::estimate_mean;
use rl_stats::ratio::estimate_ratio_of_means;
use rl_stats::{Bootstrap, Estimate};
use serde::Serialize;

use super::exhibit::{Definition, Exhibit, NamedFigure, NamedTable};
use super::parts::notes::{interval_note, ratio_method};
use super::parts::own::Own;
use crate::report::analysis::{Analysis, ArmStage, ForkPair, OverSeeds};
use crate::report::table::{Cell, Table};

/// The section of docs/metrics.md.
const PLACE: &str = "what-treatments-give-back";
/// The key in `report.json`, and the name of the table and of the figure of areas.
pub const TREATMENTS: &str = "treatments";

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
    /// interval of the lost area does not lie above 0, or where one of the two has no interval.
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
        let is_lost = lost.and_then(|lost| lost.interval).is_some_and(|interval| interval.low > 0.0);
        let share = is_lost.then(|| estimate_ratio_of_means(bootstrap, &pairs));
        [gain, lost, share.filter(|share| share.interval.is_some())]
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
        figures::all(self, analysis)
    }
}

impl Treatments {
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
        let shares = self.stages.iter().filter_map(|stage| stage.recovered_share.as_ref());
        let notes = vec![
            "Of the stages that forks have trained, paired by seed. Untreated: the same stage of the runs that they \
             come from. From scratch: a new agent on that level. Recovered share: (treated - untreated) / (from scratch \
             - untreated), of mean areas."
                .to_owned(),
            NO_SHARE.to_owned(),
            interval_note(analysis, gains),
            ratio_method("Recovered shares", shares),
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
const NO_SHARE: &str = "There is no share where the interval of (from scratch − untreated) does not lie above 0, where the \
                        share's own would have no end, or where one seed has none: nothing is known to be lost.";
