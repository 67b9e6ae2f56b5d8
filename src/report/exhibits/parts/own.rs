//! Numbers of single seeds on the level of their own stage, by arm and stage.

use std::collections::BTreeMap;

use crate::report::analysis::{Analysis, SeedValue};

/// One measure of every stage of every arm, right after the stage and on its own level.
pub struct Own<'a> {
    /// By arm, stage and level: each seed's.
    values: BTreeMap<(usize, u16, usize), BTreeMap<u64, f64>>,
    analysis: &'a Analysis,
}

impl<'a> Own<'a> {
    /// Of a measure of `seeds.csv`.
    pub fn new(analysis: &'a Analysis, measure: &str) -> Self {
        let mut values: BTreeMap<(usize, u16, usize), BTreeMap<u64, f64>> = BTreeMap::new();
        for SeedValue { arm, seed, stage, level, value, .. } in
            analysis.seed_values.iter().filter(|value| value.measure == measure)
        {
            if let Some(stage) = *stage {
                values.entry((*arm, stage, *level)).or_default().insert(*seed, *value);
            }
        }
        Self { values, analysis }
    }

    /// Each seed's in an arm after a stage on a level; none where no seed has it.
    pub fn after(&self, arm: usize, stage: u16, level: usize) -> Option<&BTreeMap<u64, f64>> {
        self.values.get(&(arm, stage, level))
    }

    /// Each seed's in an arm right after its first stage on a level.
    pub fn on(&self, arm: usize, level: usize) -> Option<&BTreeMap<u64, f64>> {
        let stage = self.analysis.arms[arm].stages.iter().find(|stage| stage.level == level)?;
        self.after(arm, stage.stage, level)
    }
}
