//! When agents in training are evaluated, and how.

use std::sync::Arc;

use coverage_env::Level;

use crate::agent::Stage;
use crate::agent::config::Config;
use crate::agent::network::Network;
use crate::agent::state::AgentState;
use crate::evaluate::{self, Choose, Starts};
use crate::results::{LevelResult, Policy};

/// Evaluations in the midst of stages. They read agents and draw from streams of their own: a run is the same with them and
/// without.
#[derive(Clone, Debug, Default)]
pub struct Midway {
    /// Timesteps of a stage from one to the next; 0 for none.
    pub every: u64,
    /// On which levels; none for the one that is trained on.
    pub levels: Vec<Arc<Level>>,
    /// Whether the agent of a stage with the highest greedy mean return on its level is kept.
    pub keep_best: bool,
}

impl Midway {
    /// Whether the update that takes a stage from `before` timesteps to `after` is evaluated: the first at or past each
    /// multiple.
    pub(super) fn is_due(&self, before: u64, after: u64) -> bool {
        self.every > 0 && before / self.every < after / self.every
    }

    /// The levels that an agent is evaluated on in the midst of a stage: those chosen, and the stage's own where the best agent
    /// on it is wanted.
    pub(super) fn levels(&self, stage: &Stage) -> Vec<Arc<Level>> {
        let mut levels = self.levels.clone();
        let has_own = levels.iter().any(|level| level.name() == stage.level.name());
        if levels.is_empty() || (self.keep_best && !has_own) {
            levels.push(stage.level.clone());
        }
        levels
    }
}

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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_update_at_or_past_each_multiple_is_evaluated() {
        let evaluated = |every, rows: &[u64]| {
            let midway = Midway { every, ..Midway::default() };
            let updates = [0].iter().chain(rows).zip(rows);
            let due = updates.filter(|(before, after)| midway.is_due(**before, **after));
            due.map(|(_, after)| *after).collect::<Vec<u64>>()
        };
        let rows = [64, 128, 192, 256, 320];
        assert!(evaluated(0, &rows).is_empty());
        assert_eq!(evaluated(1, &rows), rows);
        assert_eq!(evaluated(128, &rows), [128, 256]);
        assert_eq!(evaluated(100, &rows), [128, 256, 320]);
        assert!(evaluated(1000, &rows).is_empty());
    }
}
