//! Published methods against loss of plasticity: what one is to the rest of the program, and the list of them.
//!
//! A mitigation is its settings and its formula; it has no state of its own. What it must remember it keeps in the agent
//! ([`Kept`](super::state::Kept)), so that checkpoints hold it and a killed run goes on with the same bits. It sees no
//! engine: it names a [`Pull`], or edits a [`Patient`].

mod l2;
mod l2_init;
mod patient;
mod redo;
mod regimen;
mod shrink_perturb;

use std::any::Any;
use std::fmt::Debug;

pub use l2::{L2, L2Covers, L2Penalty};
pub use patient::Patient;
pub use regimen::Regimen;

use super::Metrics;
use super::config::Config;
use super::engine::{GradientNorms, Pull, Units};
use super::network::Network;
use super::state::AgentState;
use crate::config::{Settings, Visitor, names};

/// Every mitigation, with its default settings, in the order in which they act. A new one is a file beside these and a
/// line here.
const MITIGATIONS: &[fn() -> Box<dyn Mitigation>] = &[
    || Box::new(l2::L2Penalty::default()),
    || Box::new(l2_init::L2Init::default()),
    || Box::new(shrink_perturb::ShrinkPerturb::default()),
    || Box::new(redo::ReDo::default()),
];

/// A method against loss of plasticity, as its settings. Every hook has a default that does nothing and costs nothing.
pub trait Mitigation: Settings + Any + Debug + Send + Sync {
    /// Its name in the setting `mitigations`.
    fn name(&self) -> &'static str;
    /// A number of its own, which its random streams have; never changed and never used again for another.
    fn number(&self) -> u16;
    /// Whether it is there without being listed, as its own settings say.
    fn is_always_listed(&self) -> bool {
        false
    }
    /// Refuses settings that it cannot work with.
    ///
    /// # Errors
    /// The key to change, and what is wrong and what is possible.
    fn check(&self, _config: &Config) -> Result<(), (&'static str, String)> {
        Ok(())
    }
    /// What draws the parameters beside the loss.
    fn pull(&self) -> Option<Pull> {
        None
    }
    /// Acts at the beginning of a stage, the first included.
    fn begin_stage(&self, _patient: &mut Patient<'_>) {}
    /// Whether it ever acts between gradient steps; only then are steps counted.
    fn acts_between_steps(&self) -> bool {
        false
    }
    /// Whether it acts after this gradient step of the agent's life, counted from 1.
    fn acts_after(&self, _step: u64) -> bool {
        false
    }
    /// Acts after a gradient step, knowing what the hidden units did in it.
    fn after_step(&self, _patient: &mut Patient<'_>, _units: &Units) {}
    /// What it adds to a row of the log, given the norms of the last gradient.
    fn metrics(&self, _config: &Config, _norms: &dyn Fn() -> GradientNorms) -> Metrics {
        Metrics::new()
    }
    /// A copy.
    fn boxed(&self) -> Box<dyn Mitigation>;
}

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

    /// The mitigation that has this key among its settings.
    pub fn with_key(key: &str) -> Option<&'static str> {
        let mut all = MITIGATIONS.iter().map(|make| make());
        all.find(|mitigation| crate::config::keys(&mut *mitigation.boxed()).contains(&key)).map(|m| m.name())
    }

    /// Each of them.
    pub fn iter(&self) -> impl Iterator<Item = &dyn Mitigation> {
        self.0.iter().map(|mitigation| &**mitigation)
    }

    /// What draws the parameters beside the loss.
    pub fn pulls(&self) -> Vec<Pull> {
        self.iter().filter_map(Mitigation::pull).collect()
    }

    /// Checks each of them, and that they fit together.
    ///
    /// # Errors
    /// The key to change, and what is wrong and what is possible.
    pub fn check(&self, config: &Config) -> Result<(), (&'static str, String)> {
        self.iter().try_for_each(|mitigation| mitigation.check(config))?;
        let pulling: Vec<&str> = self.iter().filter(|m| m.pull().is_some()).map(|m| m.name()).collect();
        match pulling[..] {
            [] | [_] => Ok(()),
            _ => Err(("mitigations", format!("{} cannot pull at once: choose one of them", pulling.join(" and ")))),
        }
    }

    /// Lets each act on an agent at the beginning of a stage.
    pub fn begin_stage(&self, network: &Network, agent: &mut AgentState, stage: u16) {
        let step = regimen::steps(agent);
        for mitigation in self.iter() {
            mitigation.begin_stage(&mut Patient { network, agent, stage, step });
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
pub(super) struct Listed<'a>(pub &'a mut Mitigations);

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
