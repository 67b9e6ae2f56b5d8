//! What a fork does to an agent before it goes on: the same agent, the same random streams, one thing changed.

use std::collections::BTreeMap;
use std::ops::Range;

use serde_json::{Map, Value};

use super::algorithm::Algorithm;
use super::network::{Network, TensorPlace};
use super::state::{AdamState, AgentState};

/// The name of the treatment that changes nothing.
pub const NONE: &str = "none";

/// A change of an agent between two stages. Settings that it changes are in the fork's config.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Treatment {
    /// Its name; also part of the name of the fork's folder.
    pub name: String,
    /// As the user wrote it, for the manifest.
    pub written: Map<String, Value>,
    /// Weights that begin anew.
    pub weights: Parts,
    /// Adam's state that begins anew.
    pub optimizer: Parts,
    /// Layers or towers whose weights and biases are multiplied, and by what.
    pub scales: Vec<(Place, f64)>,
    /// What becomes of the algorithm's copies of its parameters, by their names; others [follow](OfCopy::Follow).
    pub copies: BTreeMap<String, OfCopy>,
    /// Settings, as `--set` takes them.
    pub sets: Vec<String>,
}

/// Parts of a network.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum Parts {
    /// None of it.
    #[default]
    Nothing,
    /// All of it.
    All,
    /// These places.
    Places(Vec<Place>),
}

/// A tower (`policy`), one of its layers (`policy.2`), or a tensor of it (`policy.2.bias`).
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Place(pub String);

/// What becomes of a copy of the parameters, such as DQN's target network.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum OfCopy {
    /// It is changed as the parameters are.
    #[default]
    Follow,
    /// It stays as it is.
    Keep,
    /// It becomes a copy of the changed parameters.
    Renew,
}

impl Place {
    /// The tensors there.
    pub fn tensors<'a>(&'a self, network: &Network) -> impl Iterator<Item = TensorPlace> + use<'a> {
        let Self(name) = self;
        let is_in = move |tensor: &TensorPlace| {
            tensor.name.strip_prefix(name).is_some_and(|rest| rest.is_empty() || rest.starts_with('.'))
        };
        network.tensors().into_iter().filter(is_in)
    }

    /// The tensors there that can be scaled: weights and biases.
    pub fn scaled<'a>(&'a self, network: &Network) -> impl Iterator<Item = TensorPlace> + use<'a> {
        self.tensors(network).filter(|tensor| [".weight", ".bias"].iter().any(|end| tensor.name.ends_with(end)))
    }

    /// Every tower and layer of a network.
    pub fn known(network: &Network) -> Vec<String> {
        let of_tower = |tower: &super::network::Tower| {
            let layers = (0..tower.mlp.blocks().len()).map(|layer| format!("{}.{layer}", tower.name));
            [tower.name.to_owned()].into_iter().chain(layers).collect::<Vec<_>>()
        };
        network.towers().iter().flat_map(of_tower).collect()
    }
}

impl Parts {
    /// Where they lie in the flat slice.
    fn ranges(&self, network: &Network) -> Vec<Range<usize>> {
        let tensors = match self {
            Self::Nothing => Vec::new(),
            Self::All => network.tensors(),
            Self::Places(places) => places.iter().flat_map(|place| place.tensors(network)).collect(),
        };
        tensors.into_iter().map(|tensor| tensor.range).collect()
    }
}

impl Treatment {
    /// Whether it leaves agent and settings as they are.
    pub fn is_none(&self) -> bool {
        let Self { name: _, written: _, weights, optimizer, scales, copies, sets } = self;
        let nothing = [weights, optimizer].iter().all(|parts| **parts == Parts::Nothing);
        nothing && scales.is_empty() && copies.is_empty() && sets.is_empty()
    }

    /// Changes an agent. New weights are those with which a new agent of its seed begins, so that an agent with all
    /// weights and all of Adam anew is a new agent; only its counts go on.
    pub fn apply(&self, algorithm: &dyn Algorithm, network: &Network, agent: &mut AgentState) {
        let AgentState { parameters: new, .. } = AgentState::new(network, agent.seed, &[]);
        if self.weights == Parts::All {
            // What belongs to single units, and what is counted for them, belongs to units that are gone. Transitions belong
            // to none.
            agent.kept.lists.clear();
            agent.kept.numbers.clear();
        }
        // θ₀ of a penalty is no copy of the network as it is now, and stays.
        let is_followed = |name: &&str| self.copies.get(*name).is_none_or(|of_copy| *of_copy == OfCopy::Follow);
        let copies: Vec<&str> = algorithm.copies().iter().copied().filter(is_followed).collect();
        for range in self.weights.ranges(network) {
            agent.replace(&range, &new, &copies);
        }
        for (place, factor) in &self.scales {
            for tensor in place.scaled(network) {
                agent.scale(&tensor.range, *factor as f32, &copies);
            }
        }
        let renewed = self.copies.iter().filter(|(_, of_copy)| **of_copy == OfCopy::Renew);
        agent.renew(&renewed.map(|(name, _)| name.as_str()).collect::<Vec<&str>>());
        match &self.optimizer {
            Parts::All => agent.adam = AdamState::new(agent.parameters.len()),
            parts => {
                for range in parts.ranges(network) {
                    agent.adam.clear_moments(&range);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use coverage_env::Level;

    use super::*;
    use crate::agent::buffers::Data;
    use crate::agent::config::{self, Config};
    use crate::agent::state::Kept;

    /// An agent in which nothing is as in a new one.
    fn trained(config: &Config, level: &Level) -> AgentState {
        let mut agent = config.agent(level, 7);
        agent.parameters.iter_mut().for_each(|p| *p = 2.0 * *p + 1.0);
        agent.kept.copies.values_mut().for_each(|copy| copy.fill(3.0));
        agent.kept.lists.insert("ages".to_owned(), vec![4.0]);
        agent.kept.numbers.insert("steps".to_owned(), 5);
        agent.kept.buffers.add("replay", &[1], Data::U8(vec![7]));
        agent.adam.exp_avg.fill(6.0);
        agent.adam.exp_avg_sq.fill(7.0);
        agent.adam.step = 8;
        agent.counters.timesteps = 9;
        agent
    }

    fn treated(algo: &str, treatment: &Treatment) -> (Network, AgentState, AgentState, AgentState) {
        let config = config::resolve(Some(algo), None, &[], None).unwrap();
        let level = Level::builtin("0").unwrap();
        let (before, new) = (trained(&config, &level), config.agent(&level, 7));
        let mut after = before.clone();
        let network = config.network(&level);
        treatment.apply(&*config.algorithm, &network, &mut after);
        (network, before, new, after)
    }

    fn places(names: &[&str]) -> Parts {
        Parts::Places(names.iter().map(|&name| Place(name.to_owned())).collect())
    }

    #[test]
    fn everything_anew_is_a_new_agent() {
        let all = Treatment { weights: Parts::All, optimizer: Parts::All, ..Treatment::default() };
        for algo in ["ppo", "dqn"] {
            let (_, before, new, after) = treated(algo, &all);
            // It goes on with the transitions of the old one, if it is to.
            let kept = Kept { buffers: before.kept.buffers, ..new.kept };
            assert_eq!(after, AgentState { counters: before.counters, kept, ..new });
        }
        let (_, before, _, after) = treated("dqn", &Treatment::default());
        assert_eq!(before, after);
    }

    #[test]
    fn a_place_is_anew_and_the_rest_stays() {
        let weights = places(&["value", "policy.2"]);
        let part = Treatment { weights: weights.clone(), optimizer: places(&["policy.0"]), ..Treatment::default() };
        let (network, before, new, after) = treated("ppo", &part);
        let in_parts = |parts: &Parts, at: usize| parts.ranges(&network).iter().any(|range| range.contains(&at));
        for at in 0..network.num_parameters() {
            let source = if in_parts(&weights, at) { &new } else { &before };
            assert_eq!(after.parameters[at], source.parameters[at]);
            let is_new = in_parts(&part.optimizer, at);
            assert_eq!(
                (after.adam.exp_avg[at], after.adam.exp_avg_sq[at]),
                if is_new { (0.0, 0.0) } else { (6.0, 7.0) }
            );
        }
        assert_eq!((after.adam.step, &after.kept), (8, &before.kept));
    }

    #[test]
    fn a_layer_is_scaled_and_the_target_network_follows_unless_told_otherwise() {
        let scaled = |of_copy: &[(&str, OfCopy)]| Treatment {
            scales: vec![(Place("q.2".to_owned()), 0.5)],
            copies: of_copy.iter().map(|(name, of_copy)| ((*name).to_owned(), *of_copy)).collect(),
            ..Treatment::default()
        };
        let (network, before, _, after) = treated("dqn", &scaled(&[]));
        let last = network.acting().blocks()[2].weight.start;
        for (at, (before, after)) in before.parameters.iter().zip(&after.parameters).enumerate() {
            assert_eq!(*after, if at < last { *before } else { 0.5 * before });
        }
        let target = |agent: &AgentState| agent.kept.copies["target"].clone();
        assert!(target(&after).iter().enumerate().all(|(at, p)| *p == if at < last { 3.0 } else { 1.5 }));
        assert_eq!(before.adam, after.adam);
        let (_, before, _, after) = treated("dqn", &scaled(&[("target", OfCopy::Keep)]));
        assert_eq!(target(&before), target(&after));
        let (_, _, _, after) = treated("dqn", &scaled(&[("target", OfCopy::Renew)]));
        assert_eq!(target(&after), after.parameters);
    }

    #[test]
    fn places_are_towers_layers_and_tensors() {
        let config = config::resolve(Some("ppo"), None, &[], None).unwrap();
        let network = config.network(&Level::builtin("0").unwrap());
        let names = |place: &str| Place(place.to_owned()).tensors(&network).map(|t| t.name).collect::<Vec<_>>();
        assert_eq!(names("policy.2"), ["policy.2.weight", "policy.2.bias"]);
        assert_eq!(names("policy.2.bias"), ["policy.2.bias"]);
        assert_eq!(names("value").len(), 6);
        assert!(names("pol").is_empty() && names("policy.3").is_empty());
        let known = ["policy", "policy.0", "policy.1", "policy.2", "value", "value.0", "value.1", "value.2"];
        assert_eq!(Place::known(&network), known);
    }
}
