//! Each level in the curriculum against the same level learned from scratch: the measured loss of plasticity.

mod figures;
mod numbers;
mod tables;

use serde::Serialize;

pub use numbers::{
    AreaMeasure, Contrast, LEAST_AREA, LevelContrast, OverLevels, Paired, PairedTimes, RELATIVE_LOSS,
    TRANSFER_BY_AREAS, TimeSummary, transfer_by_areas,
};

use super::exhibit::{Definition, Exhibit, NamedFigure, NamedTable};
use crate::report::analysis::{Analysis, Pair};
use crate::report::parallel;

/// A setting that only DQN has: its runs explore at their beginning.
const EXPLORATION: &str = "exploration_initial_eps";
/// The table of areas and final returns.
const TABLE: &str = "against-from-scratch";
/// The table and the figure of times to thresholds.
const TIMES: &str = "time-to-threshold";

/// Every curriculum against its runs from scratch.
#[derive(Debug, Serialize)]
#[serde(transparent)]
pub struct FromScratch {
    /// A pair of arms each.
    pub contrasts: Vec<Contrast>,
    /// Whether one of them is DQN's, whose two sides differ in exploration, too.
    #[serde(skip)]
    has_dqn: bool,
}

impl FromScratch {
    /// Of every pair.
    pub fn new(analysis: &Analysis) -> Self {
        let is_dqn = |pair: &Pair| analysis.arms[pair.curriculum].settings.contains_key(EXPLORATION);
        let has_dqn = analysis.pairs.iter().any(is_dqn);
        Self { has_dqn, contrasts: parallel::map(&analysis.pairs, |&pair| Contrast::new(analysis, pair)) }
    }
}

impl Exhibit for FromScratch {
    fn key(&self) -> &'static str {
        "from_scratch"
    }

    fn heading(&self) -> &'static str {
        "The curriculum against learning from scratch"
    }

    fn lead(&self) -> &'static str {
        if !self.has_dqn {
            return "The same algorithm, settings and seed number, with a past and without one. Negative transfer and a \
                    hard level look like lost plasticity here: read it with the plasticity measures.";
        }
        "The same algorithm, settings and seed number, with a past and without one. DQN's two sides differ in \
         exploration, too. From scratch it begins with random actions: ε falls from 1 to 0.05. In a curriculum it does \
         so on the first level only; later ones have ε = 0.05 throughout. An arm whose exploration_initial_eps is 0.05 \
         has the same ε on both sides: it tells how much of a difference is the exploration's. Negative transfer and a \
         hard level look like lost plasticity here: read it with the plasticity measures."
    }

    fn absence(&self) -> &'static str {
        "No arm has finished a level both in a curriculum and from scratch (cpp-rl train with the same settings)."
    }

    fn definitions(&self) -> Vec<Definition> {
        let one = |name, meaning: &str| Definition { name, meaning: meaning.to_owned(), place: numbers::PLACE };
        vec![
            one("area", "area under the normalised learning curve of a stage, per timestep"),
            RELATIVE_LOSS.definition(),
            one(
                "time to threshold",
                "timesteps until the learning curve first reaches a normalised return; a seed that never does is \
                 censored, not dropped",
            ),
        ]
    }

    fn numbers(&self) -> serde_json::Result<Option<String>> {
        serde_json::to_string(self).map(Some)
    }

    fn tables(&self, analysis: &Analysis) -> Vec<NamedTable> {
        vec![
            NamedTable::main(TABLE, tables::curves(analysis, &self.contrasts)),
            NamedTable::new(TIMES, tables::times(analysis, &self.contrasts)),
        ]
    }

    fn figures(&self, analysis: &Analysis) -> Vec<NamedFigure> {
        figures::all(analysis, &self.contrasts)
    }
}
