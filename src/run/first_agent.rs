//! The agent that a run begins with, and agents at the end of a stage.

use std::path::Path;

use super::checkpoint::Checkpoint;
use super::{Plan, stage_checkpoint};
use crate::agent::config::Config;
use crate::agent::network::Network;
use crate::agent::state::AgentState;
use crate::error::UserError;
use crate::experiment::Fork;

/// The agent with which a run begins: a new one, or its parent's after the treatment.
///
/// # Errors
/// A parent without the stage's checkpoint, or with one that is not what the fork expects.
pub(super) fn first_agent(plan: &Plan<'_>, network: &Network) -> Result<AgentState, UserError> {
    let Some(parents) = plan.parents else {
        return Ok(plan.config.agent(&plan.curriculum.stages[0].level, plan.seed));
    };
    let Fork { after, treatment, .. } = &parents.fork;
    let parent = parents.of(plan.seed);
    let remedy = format!("train the parent, {}, up to the end of stage {after}", parent.display());
    let copies = plan.config.algorithm.copies();
    let mut agent = stage_agent(parent, *after, plan, copies, network)
        .map_err(|problem| UserError::new(format!("the fork has nothing to go on from: {problem}; {remedy}")))?;
    treatment.apply(&*plan.config.algorithm, network, &mut agent);
    Ok(agent)
}

/// The agent after a stage of a run, if its checkpoint is of that seed, stage and level, has these copies of its
/// parameters, fits the network, and brings what the next stage begins with.
///
/// # Errors
/// Names the file, and what is wrong with it.
pub(super) fn stage_agent(
    run: &Path,
    stage: u16,
    plan: &Plan<'_>,
    copies: &[&str],
    network: &Network,
) -> Result<AgentState, String> {
    let file = stage_checkpoint(run, stage);
    let found = Checkpoint::read(&file).map_err(|problem| problem.to_string())?;
    let Checkpoint { agent, origin, sensor, has_adam, network: found, .. } = found;
    let level = plan.curriculum.stages.get(usize::from(stage)).map(|stage| stage.level.name().to_owned());
    let own = (origin.seed, origin.stage, origin.level) == (Some(plan.seed), Some(stage), level);
    let whole = has_adam && copies.iter().all(|&name| agent.kept.copies.contains_key(name));
    // Of another size it would be refused later, together with all seeds that it is computed together with.
    let alike = sensor.name() == plan.config.shared.sensor.name() && found.tensors() == network.tensors();
    if !(own && whole && alike) {
        return Err(format!("{}: not a checkpoint of this seed, stage and level that fits the run", file.display()));
    }
    let Config { algorithm, shared, .. } = plan.config;
    let fits = algorithm.check_agent(&agent, shared, &plan.curriculum.stages[usize::from(stage)].level);
    fits.map_err(|problem| format!("{}: {problem}", file.display()))?;
    Ok(agent)
}
