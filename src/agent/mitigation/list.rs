//! The list of mitigations, and those of a run.

use std::any::Any;
use std::sync::Arc;

use super::by_settings;
use super::hooks::{Brought, Mitigation};
use super::patient::Patient;
use crate::agent::engine::{Penalty, Pull};
use crate::agent::network::Network;
use crate::agent::shared::Shared;
use crate::agent::state::AgentState;
use crate::config::{Settings, Visitor, names};

/// Every mitigation, with its default settings, in the order in which they act. A new one is a file beside these, its
/// `mod` line, and a line here.
const MITIGATIONS: &[fn() -> Box<dyn Mitigation>] = &[
    || Box::new(super::l2::L2Penalty::default()),
    || Box::new(super::l2_init::L2Init::default()),
    || Box::new(super::shrink_perturb::ShrinkPerturb::default()),
    || Box::new(super::reset::Reset::default()),
    || Box::new(super::head_rescale::HeadRescale::default()),
    || Box::new(super::adam_reset::AdamReset),
    || Box::new(super::adam_rel::AdamRel),
    || Box::new(super::fire::Fire::default()),
    || Box::new(super::parseval::Parseval::default()),
    || Box::new(super::spectral::Spectral::default()),
    || Box::new(super::churn::Churn::default()),
    || Box::new(super::redo::ReDo::default()),
    || Box::new(super::redo_saturation::ReDoSaturation::default()),
    || Box::new(super::continual_backprop::ContinualBackprop::default()),
    || Box::new(super::self_normalised_resets::SelfNormalisedResets::default()),
    || Box::new(super::soft_shrink_perturb::SoftShrinkPerturb::default()),
    || Box::new(super::weight_clipping::WeightClipping::default()),
    || Box::new(super::normalise_project::NormaliseProject::default()),
    || Box::new(by_settings::ENTROPY_BONUS),
    || Box::new(by_settings::EQUAL_BETAS),
    || Box::new(by_settings::L2_ADAM),
    || Box::new(by_settings::ADAMW),
    || Box::new(by_settings::LAYER_NORM),
    || Box::new(by_settings::CRELU),
    || Box::new(by_settings::FOURIER),
];

/// The mitigations of a run.
#[derive(Debug)]
pub struct Mitigations(Vec<Box<dyn Mitigation>>);

impl Mitigations {
    /// Those of these names, and those that are always there.
    pub fn new(listed: &[&str]) -> Self {
        let all = MITIGATIONS.iter().map(|make| make());
        Self(all.filter(|m| m.is_always_listed() || listed.contains(&m.name())).collect())
    }

    /// The names that can be listed.
    pub fn known() -> Vec<&'static str> {
        let all = MITIGATIONS.iter().map(|make| make());
        all.filter(|mitigation| !mitigation.is_always_listed()).map(|mitigation| mitigation.name()).collect()
    }

    /// Every mitigation that can be listed, as it is without other settings.
    pub fn all() -> Self {
        Self::new(&Self::known())
    }

    /// The mitigation that has this key among its settings.
    pub fn with_key(key: &str) -> Option<&'static str> {
        let mut all = MITIGATIONS.iter().map(|make| make());
        all.find(|mitigation| crate::config::keys(&mut *mitigation.boxed()).contains(&key)).map(|m| m.name())
    }

    /// What those bring that are not among `before`, with their names.
    pub fn brought(&self, before: &Self) -> Vec<(&'static str, Brought)> {
        let is_new = |mitigation: &&dyn Mitigation| before.iter().all(|old| old.name() != mitigation.name());
        let of = |mitigation: &dyn Mitigation| {
            let name = mitigation.name();
            mitigation.brings().iter().map(move |&brought| (name, brought))
        };
        self.iter().filter(is_new).flat_map(of).collect()
    }

    /// The one of this type, if it is there.
    pub fn find<T: Mitigation>(&self) -> Option<&T> {
        self.iter().find_map(|mitigation| (mitigation as &dyn Any).downcast_ref())
    }

    /// Each of them.
    pub fn iter(&self) -> impl Iterator<Item = &dyn Mitigation> {
        self.0.iter().map(|mitigation| &**mitigation)
    }

    /// What draws the parameters beside the loss.
    pub fn pull(&self) -> Option<Pull> {
        self.iter().find_map(Mitigation::pull)
    }

    /// What else is added to the loss's gradient.
    pub fn penalties(&self, network: &Network) -> Vec<Arc<dyn Penalty>> {
        self.iter().filter_map(|mitigation| mitigation.penalty(network)).collect()
    }

    /// Checks each of them, and that they fit together.
    ///
    /// # Errors
    /// The key to change, and what is wrong and what is possible.
    pub fn check(&self, shared: &Shared) -> Result<(), (&'static str, String)> {
        self.iter().try_for_each(|mitigation| mitigation.check(shared))?;
        let recycling: Vec<&str> = self.iter().filter(|m| m.reads_units()).map(|m| m.name()).collect();
        if let [_, _, ..] = recycling[..] {
            let problem = format!("{} cannot replace units at once: choose one of them", recycling.join(" and "));
            return Err(("mitigations", problem));
        }
        let pulling: Vec<&str> = self.iter().filter(|m| m.pull().is_some()).map(|m| m.name()).collect();
        match pulling[..] {
            [] | [_] => Ok(()),
            _ => Err(("mitigations", format!("{} cannot pull at once: choose one of them", pulling.join(" and ")))),
        }
    }

    /// Lets each act on an agent at the beginning of a stage; `copies` names the algorithm's copies of its parameters.
    pub fn begin_stage(&self, network: &Network, agent: &mut AgentState, copies: &[&str], stage: u16) {
        for mitigation in self.iter() {
            // Whatever else is listed, it draws the same: so no count of steps.
            let mut patient = Patient { network, agent, copies, stage, step: 0 };
            mitigation.begin_stage(&mut patient);
            if stage > 0 {
                mitigation.at_switch(&mut patient);
            }
        }
    }
}

impl Settings for Mitigations {
    fn visit(&mut self, v: &mut dyn Visitor) {
        let always = |m: &&mut Box<dyn Mitigation>| m.is_always_listed();
        self.0.iter_mut().filter(always).for_each(|mitigation| mitigation.visit(v));
        Listed(self).visit(v);
        self.0.iter_mut().filter(|m| !m.is_always_listed()).for_each(|mitigation| mitigation.visit(v));
    }
}

/// The setting that lists mitigations, without theirs.
pub struct Listed<'a>(pub &'a mut Mitigations);

impl Settings for Listed<'_> {
    fn visit(&mut self, v: &mut dyn Visitor) {
        let all = &self.0.0;
        let mut listed: Vec<&'static str> = all.iter().filter(|m| !m.is_always_listed()).map(|m| m.name()).collect();
        let before = listed.clone();
        let doc = "methods against loss of plasticity; each adds settings of its own";
        v.field("mitigations", doc, &mut names(&mut listed, Mitigations::known()));
        if listed != before {
            *self.0 = Mitigations::new(&listed);
        }
    }
}

impl Clone for Mitigations {
    fn clone(&self) -> Self {
        Self(self.0.iter().map(|mitigation| mitigation.boxed()).collect())
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;
    use crate::config;

    /// Two with one number would share their random streams; two with one key could not be told apart.
    #[test]
    fn numbers_names_and_keys_are_their_own() {
        let all: Vec<Box<dyn Mitigation>> = MITIGATIONS.iter().map(|make| make()).collect();
        let numbers: BTreeSet<u16> = all.iter().map(|mitigation| mitigation.number()).collect();
        assert!(numbers.len() == all.len() && numbers.iter().all(|&number| number <= 1000));
        let names: BTreeSet<&str> = all.iter().map(|mitigation| mitigation.name()).collect();
        assert_eq!(names.len(), all.len());
        let keys: Vec<&str> = all.iter().flat_map(|mitigation| config::keys(&mut *mitigation.boxed())).collect();
        assert_eq!(keys.iter().collect::<BTreeSet<_>>().len(), keys.len());
    }
}
