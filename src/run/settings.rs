//! Whether a run may be continued with the settings that a start asks for.

use std::path::Path;

use anyhow::Result;
use serde_json::{Map, Value};

use super::Plan;
use super::manifest::{self, Manifest, StageEntry};
use crate::config::differing_keys;
use crate::error::UserError;

/// The manifest that a run continues with, and whether the run was finished and is to be extended.
///
/// # Errors
/// A run that exists although a new one is wanted, or that had other settings.
pub(super) fn settle(run: &Path, plan: &Plan<'_>) -> Result<(Manifest, bool)> {
    if !run.join(manifest::FILE).exists() {
        return Ok((Manifest::new(plan), false));
    }
    if !plan.resume {
        let message = "holds a run already: continue it with --resume, or choose another folder with --out";
        return Err(UserError::new(format!("{} {message}", run.display())).into());
    }
    let mut manifest = Manifest::read(run)?;
    refuse_changes(run, &manifest, plan)?;
    let asked = plan.curriculum.stages[0].timesteps;
    let longer = manifest.stages[0].timesteps < asked;
    let was_finished = usize::from(manifest.stages_done) == manifest.stages.len();
    if longer {
        manifest.extend(asked);
    }
    Ok((manifest, longer && was_finished))
}

/// Refuses to continue a run with anything but the settings it began with, or more timesteps where that is possible.
fn refuse_changes(run: &Path, old: &Manifest, plan: &Plan<'_>) -> Result<()> {
    let new = &Manifest::new(plan);
    let timesteps = |manifest: &Manifest| manifest.stages.iter().map(|stage| stage.timesteps).sum::<u64>();
    let extended =
        plan.curriculum.extensible && old.stages.len() == new.stages.len() && timesteps(old) < timesteps(new);
    let mut changes = differences(&old.config, &new.config);
    changes.retain(|change| !(extended && change.starts_with("timesteps: ")));
    let same = |(old, new): (&StageEntry, &StageEntry)| {
        (&old.level, &old.map) == (&new.level, &new.map) && (extended || old.timesteps == new.timesteps)
    };
    if old.stages.len() != new.stages.len() || !old.stages.iter().zip(&new.stages).all(same) {
        let list = |m: &Manifest| m.stages.iter().map(|s| format!("{} × {}", s.level, s.timesteps)).collect::<Vec<_>>();
        let (old, new) = (list(old).join(", "), list(new).join(", "));
        changes.push(format!("stages: {old} → {new}{}", if old == new { " (a map has changed)" } else { "" }));
    }
    let others = |m: &Manifest| [m.seed.to_string(), m.engine.name().to_owned(), m.device.clone()];
    for (key, (old, new)) in ["seed", "engine", "device"].into_iter().zip(others(old).into_iter().zip(others(new))) {
        if old != new {
            changes.push(format!("{key}: {old} → {new}"));
        }
    }
    // Wherever the parent lies by now.
    let fork = |manifest: &Manifest| {
        manifest.fork.as_ref().map(|fork| (fork.after, Value::Object(fork.treatment.clone()).to_string()))
    };
    if fork(old) != fork(new) {
        let show = |manifest| fork(manifest).map_or("none".to_owned(), |(after, how)| format!("after {after} {how}"));
        changes.push(format!("fork: {} → {}", show(old), show(new)));
    }
    if changes.is_empty() {
        return Ok(());
    }
    Err(UserError::new(format!(
        "{} was started with other settings:\n  {}\ncontinue it with its own settings, or start a new run with --out",
        run.display(),
        changes.join("\n  ")
    ))
    .into())
}

/// The keys in which two configs differ, as `key: old → new`.
pub fn differences(old: &Map<String, Value>, new: &Map<String, Value>) -> Vec<String> {
    let show = |value: Option<&Value>| value.map_or_else(|| "absent".to_owned(), Value::to_string);
    differing_keys(old, new)
        .into_iter()
        .map(|key| format!("{key}: {} → {}", show(old.get(key)), show(new.get(key))))
        .collect()
}
