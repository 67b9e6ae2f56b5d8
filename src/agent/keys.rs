//! Every setting that there is: its key, default, allowed values and meaning, and who declares it.

use serde::Serialize;
use serde_json::{Map, Value};

use super::config::Config;
use super::mitigation::{Mitigation, Mitigations};
use super::registry;
use crate::config::{self, Field, Settings, Visitor};

/// One setting.
#[derive(Clone, Debug, Serialize)]
pub struct Key {
    /// As in files and `--set`.
    pub key: &'static str,
    /// Its default, by the name of each config that has it.
    pub defaults: Map<String, Value>,
    /// What it can be.
    pub allowed: String,
    /// `common`, an algorithm, or a mitigation.
    pub declared_by: String,
    /// What it is.
    pub doc: &'static str,
}

/// The settings of these configs, each once, with those of mitigations that are not listed.
pub fn of(configs: &[Config]) -> Vec<Key> {
    let mut keys: Vec<Key> = Vec::new();
    for config in configs {
        let mut complete = config.clone();
        // A mitigation has its settings only where it is listed.
        complete.mitigations = Mitigations::all();
        let mut collect = Collect { config, values: config.to_json(), keys: &mut keys };
        complete.visit(&mut collect);
    }
    keys
}

/// A mitigation that can be listed.
#[derive(Clone, Debug, Serialize)]
pub struct Described {
    /// Its name.
    pub name: &'static str,
    /// What it does, and whose it is.
    pub summary: &'static str,
    /// Its own settings with their defaults, or those that it brings.
    pub settings: Map<String, Value>,
}

/// Every mitigation that can be listed, in the order in which they act.
pub fn mitigations() -> Vec<Described> {
    let described = |mitigation: &dyn Mitigation| {
        let value = |written: &str| serde_json::from_str(written).unwrap_or_else(|_| Value::from(written));
        let brought = mitigation.brings().iter().map(|b| (b.key.to_owned(), value(b.value)));
        let settings = config::to_json(&mut *mitigation.boxed()).into_iter().chain(brought).collect();
        Described { name: mitigation.name(), summary: mitigation.summary(), settings }
    };
    Mitigations::all().iter().filter(|mitigation| !mitigation.is_always_listed()).map(described).collect()
}

struct Collect<'a> {
    config: &'a Config,
    values: Map<String, Value>,
    keys: &'a mut Vec<Key>,
}

impl Visitor for Collect<'_> {
    fn field(&mut self, key: &'static str, doc: &'static str, field: &mut dyn Field) {
        let name = self.config.name.clone();
        let value = self.values.get(key).cloned().unwrap_or_else(|| field.get());
        let declared_by = self.declared_by(key);
        match self.keys.iter_mut().find(|known| known.key == key && known.declared_by == declared_by) {
            Some(known) => {
                known.defaults.insert(name, value);
            }
            None => {
                let defaults = [(name, value)].into_iter().collect();
                self.keys.push(Key { key, defaults, allowed: field.allowed(), declared_by, doc });
            }
        }
    }
}

impl Collect<'_> {
    fn declared_by(&self, key: &str) -> String {
        let name = self.config.algorithm.name();
        let own = registry::by_name(name).is_some_and(|mut own| config::keys(&mut *own).contains(&key));
        match Mitigations::with_key(key) {
            Some(mitigation) => format!("mitigation {mitigation}"),
            None if own => name.to_owned(),
            None => "common".to_owned(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_setting_of_every_algorithm_is_there_once() {
        let configs: Vec<Config> = registry::names().into_iter().filter_map(Config::defaults).collect();
        let keys = of(&configs);
        for config in &configs {
            let settings = config.to_json();
            for (key, value) in settings.iter().filter(|(key, _)| !["name", "algorithm"].contains(&key.as_str())) {
                let found: Vec<&Key> =
                    keys.iter().filter(|k| k.key == key && k.defaults.contains_key(&config.name)).collect();
                let [found] = found[..] else { panic!("{key} of {}: {found:?}", config.name) };
                assert_eq!(found.defaults[&config.name], *value, "{key}");
                assert!(!found.allowed.is_empty() && !found.doc.is_empty(), "{key}");
            }
        }
        let of_key =
            |key: &str| keys.iter().filter(|k| k.key == key).map(|k| k.declared_by.as_str()).collect::<Vec<_>>();
        assert_eq!(of_key("gamma"), ["common"]);
        assert_eq!(of_key("batch_size"), ["ppo", "dqn"]);
        assert_eq!(of_key("l2_coef"), ["mitigation l2"]);
    }
}
