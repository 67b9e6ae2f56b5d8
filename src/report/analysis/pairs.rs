//! Which runs from scratch belong to which curriculum, and which runs forks come from.

use std::cmp::Reverse;
use std::path::Path;

use serde::Serialize;

use super::arm::Arm;
use super::groups::Group;
use super::run::{Protocol, Run};

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
        let is_counterpart =
            |other: &Arm| other.protocol == Protocol::FromScratch && other.differs_in_sequence_alone(arm);
        let from_scratch = arms.iter().position(is_counterpart)?;
        Some(Pair { curriculum, from_scratch })
    };
    curricula.filter_map(pair).collect()
}

/// Forks, the runs that they come from, and those from scratch.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct ForkPair {
    /// Index of the forks' arm.
    pub fork: usize,
    /// Index of the arm that goes through the same sequence undisturbed; none where it is not in the comparison.
    pub curriculum: Option<usize>,
    /// Index of the arm from scratch that belongs to it.
    pub from_scratch: Option<usize>,
}

/// Every arm of forks. A treatment may change settings, so that these do not tell where forks come from. Of the arms that
/// go through the same sequence, it is the one whose path has most in common with the parent's in their manifests: the
/// whole folder may have been moved since.
pub(super) fn of_forks(groups: &[Group], arms: &[Arm], pairs: &[Pair]) -> Vec<ForkPair> {
    let forks = arms.iter().enumerate().filter(|(_, arm)| arm.protocol == Protocol::Fork);
    let pair = |(fork, arm): (usize, &Arm)| {
        let of_preset = |protocol: Protocol| {
            let same = move |(_, other): &(usize, &Arm)| other.protocol == protocol && other.preset == arm.preset;
            arms.iter().enumerate().filter(same)
        };
        let same_sequence = of_preset(Protocol::Curriculum).filter(|(_, other)| other.sequence == arm.sequence);
        let nearest = |(index, _): &(usize, &Arm)| (Reverse(folders_shared(&groups[fork], &groups[*index])), *index);
        let curriculum = same_sequence.min_by_key(nearest).map(|(index, _)| index);
        let from_scratch = match curriculum {
            Some(index) => pairs.iter().find(|pair| pair.curriculum == index).map(|pair| pair.from_scratch),
            // Without the sequence's own runs nothing tells namesakes apart.
            None => {
                let mut all = of_preset(Protocol::FromScratch).map(|(index, _)| index);
                all.next().filter(|_| all.next().is_none())
            }
        };
        ForkPair { fork, curriculum, from_scratch }
    };
    forks.map(pair).collect()
}

/// How many folders, from the last one up, some fork's parent has in common with a run of its seed.
fn folders_shared(forks: &Group, others: &Group) -> usize {
    let shared = |parent: &str, path: &Path| {
        let [parent, path] = [Path::new(parent), path].map(|path| path.components().rev());
        parent.zip(path).take_while(|(a, b)| a == b).count()
    };
    let of_fork = |fork: &&Run| {
        let parent = &fork.manifest.fork.as_ref()?.parent;
        let same_seed = others.runs.iter().filter(|run| run.manifest.seed == fork.manifest.seed);
        same_seed.map(|run| shared(parent, &run.path)).max()
    };
    forks.runs.iter().filter_map(of_fork).max().unwrap_or(0)
}
