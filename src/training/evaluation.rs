//! How agents in training are evaluated.

use std::sync::Arc;

use coverage_env::Level;

use crate::agent::config::Config;
use crate::agent::network::Network;
use crate::agent::state::AgentState;
use crate::evaluate::{self, Choose, Starts};
use crate::results::{LevelResult, Policy};

/// What an agent earns on these levels from every start cell, in this stage: the greedy results, then the sampled ones.
pub(super) fn of_agent(
    config: &Config,
    network: &Network,
    agent: &AgentState,
    stage: u16,
    levels: &[Arc<Level>],
) -> Vec<(Policy, LevelResult)> {
    let of_level = |policy: Policy, level: &Arc<Level>| {
        let mut choose = match policy {
            Policy::Greedy => Choose::Greedy,
            Policy::Sampled => Choose::in_training(config.algorithm.behaviour(None), agent, stage, level),
        };
        let (sensor, max_steps) = (config.shared.sensor, config.shared.max_steps);
        evaluate::network(network, sensor, &agent.parameters, level, max_steps, Starts::Exhaustive, &mut choose)
    };
    let of_policy = |policy| levels.iter().map(move |level| (policy, of_level(policy, level)));
    Policy::ALL.into_iter().flat_map(of_policy).collect()
}
