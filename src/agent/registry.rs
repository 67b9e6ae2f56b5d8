//! The list of algorithms.

use super::algorithm::Algorithm;
use super::{dqn, ppo};

/// Every algorithm, with its default settings. A new one is a folder beside these and a line here.
const ALGORITHMS: &[fn() -> Box<dyn Algorithm>] =
    &[|| Box::new(ppo::PpoConfig::default()), || Box::new(dqn::DqnConfig::default())];

/// The algorithm of this name, with its default settings.
pub fn by_name(name: &str) -> Option<Box<dyn Algorithm>> {
    ALGORITHMS.iter().map(|make| make()).find(|algorithm| algorithm.name() == name)
}

/// The names of all algorithms.
pub fn names() -> Vec<&'static str> {
    ALGORITHMS.iter().map(|make| make().name()).collect()
}
