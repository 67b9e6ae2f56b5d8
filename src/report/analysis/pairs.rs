//! Which runs from scratch belong to which curriculum.

use serde::Serialize;

use super::arm::Arm;
use super::groups::same_but_stages;
use super::run::Protocol;

/// A curriculum and the runs from scratch of the same settings.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct Pair {
    /// Index of the curriculum's arm.
    pub curriculum: usize,
    /// Index of the arm from scratch.
    pub from_scratch: usize,
}

/// Every curriculum with its runs from scratch.
pub(super) fn of_arms(arms: &[Arm]) -> Vec<Pair> {
    let curricula = arms.iter().enumerate().filter(|(_, arm)| arm.protocol == Protocol::Curriculum);
    let pair = |(curriculum, arm): (usize, &Arm)| {
        let is_counterpart = |other: &Arm| {
            let same = other.preset == arm.preset && same_but_stages(&other.settings, &arm.settings);
            other.protocol == Protocol::FromScratch && same
        };
        let from_scratch = arms.iter().position(is_counterpart)?;
        Some(Pair { curriculum, from_scratch })
    };
    curricula.filter_map(pair).collect()
}
