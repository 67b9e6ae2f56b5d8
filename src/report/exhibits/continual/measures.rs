//! What the measures of continual learning are: names, formulas and sources.
//!
//! `R[i, j]` is the return on the level of stage j after stage i, `b[j]` that of the untrained model, T the number of
//! stages.

use rl_stats::continual::{ReturnMatrix, mean_entry};

use crate::results::Policy;

/// The measure, table and figure of what is lost of each level.
pub(super) const FORGETTING: &str = "forgetting";

/// A measure of a matrix of returns.
pub struct Measure {
    /// What it is called in tables, figures and definitions, and, with underscores, in `report.json`.
    pub name: &'static str,
    /// Its formula.
    pub formula: &'static str,
    /// The same in words.
    pub meaning: &'static str,
    /// Who defined it.
    pub source: &'static str,
    /// Whether it is a change, of which 0 says that nothing has happened.
    pub is_change: bool,
    /// Whose returns it is of. The sampled policy's have a place only where runs have them.
    pub policy: Policy,
    /// Its value; none where it has none, as with a single stage.
    pub of: fn(&ReturnMatrix) -> Option<f64>,
}

impl Measure {
    /// Its key in `report.json`.
    pub fn key(&self) -> String {
        self.name.replace([' ', '-'], "_")
    }
}

/// Every measure, in the order of tables and figures.
pub const MEASURES: [Measure; 7] = [
    Measure {
        name: "average performance",
        formula: "(1/T) Σⱼ R[T, j]",
        meaning: "mean normalised return on all levels at the end",
        source: "Lopez-Paz & Ranzato 2017 (ACC)",
        is_change: false,
        policy: Policy::Greedy,
        of: ReturnMatrix::average_performance,
    },
    Measure {
        name: "backward transfer",
        formula: "1/(T − 1) Σ_{j<T} (R[T, j] − R[j, j])",
        meaning: "mean change on a level from the end of its own stage to the end of all; below 0 is forgetting",
        source: "Lopez-Paz & Ranzato 2017 (BWT)",
        is_change: true,
        policy: Policy::Greedy,
        of: ReturnMatrix::backward_transfer,
    },
    Measure {
        name: "forward transfer",
        formula: "1/(T − 1) Σ_{j>1} (R[j − 1, j] − b[j])",
        meaning: "mean return on a level right before training on it, minus the untrained model's",
        source: "Lopez-Paz & Ranzato 2017 (FWT)",
        is_change: true,
        policy: Policy::Greedy,
        of: ReturnMatrix::forward_transfer,
    },
    Measure {
        name: "sampled forward transfer",
        formula: "the same of the sampled policy",
        meaning: "it shows harm where greedy returns lie on the floor of the worst return anyway",
        source: "as above",
        is_change: true,
        policy: Policy::Sampled,
        of: ReturnMatrix::forward_transfer,
    },
    Measure {
        name: FORGETTING,
        formula: "(1/T) Σⱼ (R[j, j] − R[T, j]), and each term",
        meaning: "mean loss on a level from the end of its own stage to the end of all",
        source: "Wołczyk et al. 2021 (Continual World), with R̂ in place of the success rate",
        is_change: true,
        policy: Policy::Greedy,
        of: ReturnMatrix::mean_forgetting,
    },
    Measure {
        name: "isolated forgetting",
        formula: "mean over i < j of R[j − 1, i] − R[j, i]",
        meaning: "what one stage destroys of an earlier level",
        source: "Powers et al. 2022 (CORA)",
        is_change: true,
        policy: Policy::Greedy,
        of: |returns| mean_entry(&returns.isolated_forgetting(&ones(returns))),
    },
    Measure {
        name: "zero-shot transfer",
        formula: "mean over i > j of R[j, i] − R[j − 1, i], b[i] standing before the first stage",
        meaning: "what one stage gives to a later level",
        source: "Powers et al. 2022 (CORA)",
        is_change: true,
        policy: Policy::Greedy,
        of: |returns| mean_entry(&returns.zero_shot_transfer(&ones(returns))),
    },
];

/// CORA's divisors: normalised returns are shares of the optimum already.
fn ones(returns: &ReturnMatrix) -> Vec<f64> {
    vec![1.0; returns.tasks()]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_document_defines_every_measure_as_it_is_here() {
        let document = include_str!("../../../../docs/metrics.md");
        for Measure { name, formula, meaning, source, .. } in MEASURES {
            let row = format!("| {name} | {formula}: {meaning} | {source} |");
            assert!(document.contains(&row), "docs/metrics.md has no row {row}");
        }
    }
}
