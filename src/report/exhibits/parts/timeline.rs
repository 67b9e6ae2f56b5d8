//! The x axis of figures over a whole curriculum: one stage after another.

use charts::{Axis, Reference, Segment, Stage};

use super::style::{PLANNERS, level_label};
use crate::report::analysis::{Analysis, Arm, LevelInfo, Planner};

/// Levels one after another, each as long as its training, or all of one length where arms train for different times.
pub struct Timeline {
    slots: Vec<Slot>,
    /// Whether x is in timesteps, and not in stages.
    in_timesteps: bool,
}

struct Slot {
    level: usize,
    /// How many stages on the level came before.
    visit: usize,
    from: f64,
    length: f64,
}

/// How long an arm trains on a level: as asked for, or longer, since a rollout is always whole.
pub fn trained_for(arm: &Arm, level: usize) -> Option<f64> {
    let planned = arm.stages.iter().find(|stage| stage.level == level)?.timesteps as f64;
    let last = arm.curves.iter().filter(|curve| curve.level == level).filter_map(|curve| curve.points.last());
    Some(last.map(|point| point.timesteps).fold(planned, f64::max))
}

/// The levels that an arm trains on, in its order.
pub fn levels_of(arm: &Arm) -> Vec<usize> {
    arm.stages.iter().map(|stage| stage.level).collect()
}

impl Timeline {
    /// Of arms that train on these levels, all or some.
    pub fn new(arms: &[&Arm], levels: &[usize]) -> Self {
        let planned = |level: usize| {
            let stages = arms.iter().flat_map(|arm| &arm.stages).filter(move |stage| stage.level == level);
            stages.map(|stage| stage.timesteps).collect::<Vec<u64>>()
        };
        let in_timesteps = levels.iter().all(|&level| planned(level).windows(2).all(|pair| pair[0] == pair[1]));
        let mut from = 0.0;
        let slot = |(index, &level): (usize, &usize)| {
            let visit = levels[..index].iter().filter(|earlier| **earlier == level).count();
            let longest = arms.iter().filter_map(|arm| trained_for(arm, level)).fold(0.0, f64::max);
            let slot = Slot { level, visit, from, length: if in_timesteps { longest } else { 1.0 } };
            from += slot.length;
            slot
        };
        Self { slots: levels.iter().enumerate().map(slot).collect(), in_timesteps }
    }

    /// Maps timesteps of an arm's stage on a level to x; none where the stage has no place. An arm's second stage on a
    /// level has that of the level's second.
    pub fn place(&self, arm: &Arm, stage: u16, level: usize) -> Option<impl Fn(f64) -> f64 + use<>> {
        let visit = arm.stages.iter().filter(|earlier| earlier.level == level && earlier.stage < stage).count();
        let slot = self.slots.iter().find(|slot| (slot.level, slot.visit) == (level, visit))?;
        let scale = if self.in_timesteps { 1.0 } else { trained_for(arm, level)?.max(1.0) };
        let from = slot.from;
        Some(move |timesteps: f64| from + timesteps / scale)
    }

    /// What x is.
    pub fn axis(&self) -> Axis {
        Axis::new(if self.in_timesteps { "timesteps" } else { "stages, each as a share of its timesteps" })
    }

    /// What captions say of x where it is not what a reader expects.
    pub fn note(&self) -> &'static str {
        if self.in_timesteps {
            ""
        } else {
            "Arms train for different times, so that every stage is drawn equally long."
        }
    }

    /// The marked stretches.
    pub fn stages(&self, analysis: &Analysis) -> Vec<Stage> {
        let stage = |slot: &Slot| Stage {
            from: slot.from,
            to: slot.from + slot.length,
            label: level_label(analysis, slot.level),
            short: analysis.levels[slot.level].name.clone(),
        };
        self.slots.iter().map(stage).collect()
    }

    /// A* and the optimum on every level, as `value` shows them.
    pub fn planners(&self, analysis: &Analysis, value: impl Fn(&LevelInfo, f64) -> Option<f64>) -> Vec<Reference> {
        let reference = |(name, planner): (&str, fn(&LevelInfo) -> &Option<Planner>)| {
            let segment = |slot: &Slot| {
                let level = &analysis.levels[slot.level];
                let value = value(level, planner(level).as_ref()?.mean)?;
                Some(Segment { from: slot.from, to: slot.from + slot.length, value })
            };
            Reference { name: name.to_owned(), segments: self.slots.iter().filter_map(segment).collect() }
        };
        let both = PLANNERS.map(reference);
        both.into_iter().filter(|reference| !reference.segments.is_empty()).collect()
    }
}
