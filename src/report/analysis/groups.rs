//! Sorting runs into arms: runs that may be pooled differ in their seeds alone.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt;

use serde::Serialize;
use serde_json::{Map, Value};

use super::levels::LevelInfo;
use super::run::{Protocol, Run};
use crate::dose::WEAK;
use crate::error::UserError;
use crate::run::manifest::StageEntry;

/// The setting that names the stages of a curriculum.
const STAGES: &str = "stages";
/// The setting that names the treatment of forks.
const TREATMENT: &str = "treatment";

/// One stage of an arm.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct ArmStage {
    /// Its number within a run.
    pub stage: u16,
    /// Index into the levels of the analysis.
    pub level: usize,
    /// Timesteps asked for.
    pub timesteps: u64,
}

/// One setting that is not the same in all arms.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Difference {
    /// Its key.
    pub key: String,
    /// Its value in each arm, in their order; null where the arm has no such setting.
    pub values: Vec<Value>,
}

/// What sets forks apart from the runs that they come from.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
pub struct Treatment {
    /// The number of the stage after which it begins, from 0.
    pub after: u16,
    /// Its name.
    pub name: String,
}

impl Treatment {
    fn of(run: &Run) -> Option<Self> {
        run.manifest.fork.as_ref().map(|fork| Self { after: fork.after, name: fork.name.clone() })
    }
}

impl fmt::Display for Treatment {
    /// As in `seeds.csv`: `after-0:head-0.02`.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "after-{}:{}", self.after, self.name)
    }
}

/// Runs that may be pooled.
pub(super) struct Group<'a> {
    /// Unique.
    pub(super) name: String,
    pub(super) protocol: Protocol,
    /// The name of the sequence that its runs go through; none from scratch.
    pub(super) sequence: Option<String>,
    pub(super) treatment: Option<Treatment>,
    pub(super) settings: Map<String, Value>,
    pub(super) runs: Vec<&'a Run>,
}

impl<'a> Group<'a> {
    /// The preset's name.
    pub(super) fn preset(&self) -> &str {
        self.runs.first().map_or("", |run| &run.manifest.arm)
    }

    /// The seeds that have a run, ascending.
    pub(super) fn seeds(&self) -> Vec<u64> {
        let seeds: BTreeSet<u64> = self.runs.iter().map(|run| run.manifest.seed).collect();
        seeds.into_iter().collect()
    }

    /// Its stages: those of the curriculum, in which a level may come again, one per level trained on from scratch, or
    /// those that forks train.
    pub(super) fn stages(&self, levels: &[LevelInfo]) -> Vec<ArmStage> {
        let index = |name: &str| levels.iter().position(|level| level.name == name);
        let mut stages: Vec<ArmStage> = Vec::new();
        for run in &self.runs {
            for (stage, entry) in run.manifest.own_stages() {
                let Some(level) = index(&entry.level) else { continue };
                if !stages.iter().any(|known| (known.stage, known.level) == (stage, level)) {
                    stages.push(ArmStage { stage, level, timesteps: entry.timesteps });
                }
            }
        }
        stages.sort_by_key(|stage| (stage.stage, stage.level));
        stages
    }

    /// The runs that have this stage on this level, by seed.
    pub(super) fn runs_on(&self, stage: &ArmStage, level: &str) -> BTreeMap<u64, &'a Run> {
        let has = |run: &&&Run| run.manifest.stages.get(usize::from(stage.stage)).is_some_and(|s| s.level == level);
        self.runs.iter().filter(has).map(|run| (run.manifest.seed, *run)).collect()
    }
}

impl Run {
    /// Everything that a run's results depend on beside its seed.
    fn settings(&self) -> Map<String, Value> {
        let m = &self.manifest;
        let mut settings = m.config.clone();
        settings.insert("engine".to_owned(), m.engine.name().into());
        settings.insert("device".to_owned(), m.device.clone().into());
        // A run that was extended is not one that was as long from the start: its schedules span less.
        if let Some(horizon) = m.stages.iter().find_map(|stage| stage.horizon) {
            settings.insert("horizon".to_owned(), horizon.into());
        }
        // A penalty that is not there has no coefficient, and covers nothing.
        if settings.get("l2").and_then(Value::as_str) == Some("none") {
            settings.remove("l2_coef");
            settings.remove("l2_covers");
        }
        let stage = |s: &StageEntry| Value::from(format!("{} × {}", s.level, s.timesteps));
        // The from scratch runs of one arm have a stage each, on levels of their own, and belong together.
        if self.protocol != Protocol::FromScratch {
            settings.insert(STAGES.to_owned(), m.stages.iter().map(stage).collect());
        }
        if let Some(treatment) = Treatment::of(self) {
            settings.insert(TREATMENT.to_owned(), treatment.to_string().into());
        }
        settings
    }

    /// The name of the sequence that it goes through; none from scratch.
    fn sequence(&self) -> Option<&str> {
        (self.protocol != Protocol::FromScratch).then_some(self.manifest.curriculum.as_str())
    }

    /// What its arm is called, unless settings tell it from a namesake: the preset, its sequence where the preset has
    /// `several`, and the treatment of a fork.
    fn arm_name(&self, several: bool) -> String {
        let sequence = self.sequence().filter(|_| several).map_or(String::new(), |sequence| format!(", {sequence}"));
        let how = match Treatment::of(self) {
            Some(Treatment { after, name }) => format!(", after {after}: {name}"),
            None if self.protocol == Protocol::FromScratch => " (from scratch)".to_owned(),
            None => String::new(),
        };
        format!("{}{sequence}{how}", self.manifest.arm)
    }
}

/// Sorts runs into arms, in the order of their names. Arms that differ in their sequence alone are told apart by its
/// name, forks by their treatment, and arms that still have one name by the settings in which they differ.
///
/// # Errors
/// Two runs that are the same seed of the same arm.
pub(super) fn groups(runs: &[Run]) -> Result<Vec<Group<'_>>, UserError> {
    let mut sequences: BTreeMap<&str, BTreeSet<&str>> = BTreeMap::new();
    for run in runs {
        sequences.entry(&run.manifest.arm).or_default().extend(run.sequence());
    }
    let mut groups: Vec<Group> = Vec::new();
    for run in runs {
        let several = sequences[run.manifest.arm.as_str()].len() > 1;
        let (name, settings) = (run.arm_name(several), run.settings());
        match groups.iter_mut().find(|group| group.name == name && group.settings == settings) {
            Some(group) => group.runs.push(run),
            None => groups.push(Group {
                name,
                protocol: run.protocol,
                sequence: run.sequence().map(str::to_owned),
                treatment: Treatment::of(run),
                settings,
                runs: vec![run],
            }),
        }
    }
    groups.iter().try_for_each(refuse_twins)?;
    let label = |group: &Group| {
        let namesakes: Vec<&Group> = groups.iter().filter(|other| other.name == group.name).collect();
        let show = |key: &String| format!("{key}={}", group.settings.get(key).unwrap_or(&Value::Null));
        match namesakes.len() {
            1 => group.name.clone(),
            _ => {
                let keys: Vec<String> = differing_keys(&namesakes).iter().map(show).collect();
                format!("{} [{}]", group.name, keys.join(", "))
            }
        }
    };
    let labels: Vec<String> = groups.iter().map(label).collect();
    let mut labelled: Vec<(String, Group)> = labels.into_iter().zip(groups).collect();
    labelled.sort_by(|(label, group), (other_label, other)| (&group.name, label).cmp(&(&other.name, other_label)));
    Ok(labelled.into_iter().map(|(name, group)| Group { name, ..group }).collect())
}

/// Refuses two runs that are the same seed of the same arm.
fn refuse_twins(group: &Group) -> Result<(), UserError> {
    let mut seen: BTreeMap<(u64, &str), &Run> = BTreeMap::new();
    for run in &group.runs {
        let key = (run.manifest.seed, run.manifest.curriculum.as_str());
        if let Some(other) = seen.insert(key, run) {
            return Err(UserError::new(format!(
                "{} and {} are the same seed of the same arm: give one of them",
                other.path.display(),
                run.path.display()
            )));
        }
    }
    Ok(())
}

/// Whether two arms' settings are the same but for the curriculum's stages.
pub(super) fn same_but_stages(a: &Map<String, Value>, b: &Map<String, Value>) -> bool {
    let rest = |settings: &Map<String, Value>| {
        let mut settings = settings.clone();
        settings.remove(STAGES);
        settings
    };
    rest(a) == rest(b)
}

/// Whether one is a curriculum and the other its runs from scratch.
pub(super) fn are_counterparts(a: &Group, b: &Group) -> bool {
    let protocols = [a.protocol, b.protocol];
    let are_of_both = protocols.contains(&Protocol::Curriculum) && protocols.contains(&Protocol::FromScratch);
    are_of_both && a.preset() == b.preset() && same_but_stages(&a.settings, &b.settings)
}

/// Tells of arms whose runs were made by several versions of cpp-rl, or with several instruction sets.
pub(super) fn mixed_versions(groups: &[Group]) -> Vec<String> {
    let mixed = |of: fn(&Run) -> Vec<String>| {
        let count = |group: &&Group| group.runs.iter().flat_map(|run| of(run)).collect::<BTreeSet<String>>().len();
        groups.iter().filter(|group| count(group) > 1).map(|group| group.name.as_str()).collect::<Vec<&str>>()
    };
    let told = [
        (mixed(Run::versions), "were made by several versions of cpp-rl"),
        (mixed(Run::instruction_sets), "were made with several instruction sets, and so differ by rounding"),
    ];
    let tell = |(arms, what): (Vec<&str>, &str)| {
        (!arms.is_empty()).then(|| format!("{}: runs of one arm {what}; report.json says which", arms.join(", ")))
    };
    told.into_iter().filter_map(tell).collect()
}

/// The keys whose values are not the same in all of these groups, names aside.
fn differing_keys(groups: &[&Group]) -> Vec<String> {
    let keys: BTreeSet<&String> = groups.iter().flat_map(|group| group.settings.keys()).collect();
    let differs = |key: &&&String| groups.iter().any(|g| g.settings.get(**key) != groups[0].settings.get(**key));
    keys.iter().filter(differs).filter(|key| **key != "name").map(|key| (*key).clone()).collect()
}

/// The settings in which arms differ, with every arm's value; stages only where two curricula differ in them, since
/// runs from scratch have none.
pub(super) fn differences(groups: &[Group]) -> Vec<Difference> {
    let all: Vec<&Group> = groups.iter().collect();
    let curricula: Vec<&Group> = groups.iter().filter(|group| group.protocol == Protocol::Curriculum).collect();
    let one_curriculum = !differing_keys(&curricula).iter().any(|key| key == STAGES);
    let values = |key: &String| groups.iter().map(|g| g.settings.get(key).cloned().unwrap_or(Value::Null)).collect();
    let keys = differing_keys(&all).into_iter().filter(|key| key != STAGES || !one_curriculum);
    keys.map(|key| Difference { values: values(&key), key }).collect()
}

/// Warns of an L2 penalty that cannot have acted.
pub(super) fn weak_dose(group: &Group) -> Option<String> {
    let doses = || group.runs.iter().filter_map(|run| run.manifest.dose.as_ref());
    let name = &group.name;
    let first = doses().next()?;
    match first.l2.as_str() {
        "adamw" => {
            let (planned, shrink) = (first.planned_shrink?, first.shrink?);
            (1.0 - shrink < WEAK).then(|| {
                format!(
                    "{name}: its L2 is too weak to act: over all stages it was to shrink the weights by {:.2}%, and in \
                     32-bit arithmetic it shrinks them by {:.2}%",
                    100.0 * (1.0 - planned),
                    100.0 * (1.0 - shrink)
                )
            })
        }
        "adam" | "loss" => {
            let ratios = doses().flat_map(|dose| dose.l2_ratio.iter().flatten());
            let largest = ratios.copied().fold(f64::NAN, f64::max);
            (largest < WEAK).then(|| {
                format!(
                    "{name}: its L2 may be too weak to act: its gradient is at most {:.2}% of the loss's on average of \
                     a stage",
                    100.0 * largest
                )
            })
        }
        _ => None,
    }
}
