//! The language of settings: what a setting is, and how a preset, a file and `--set` flags become one list of them.
//!
//! Nothing here knows a setting by its name. Whoever has settings declares each of them once, in [`Settings::visit`]:
//! its key, its meaning and the values it allows. Reading, writing, help texts and the comparison of arms all go through
//! that declaration.

mod field;
mod layers;
mod presets;

use serde_json::{Map, Value};

pub use field::{
    Choice, Field, at_least, below_one, choice, flag, fraction, integer, list, names, non_negative, one_of, positive,
};
pub use layers::{ConfigError, Layers, check_name, nearest};
pub use presets::{PRESETS, preset_names};

/// Receives settings in the order of their declaration.
pub trait Visitor {
    /// `key`: as in files and `--set`; `doc`: one line for `config.yaml` and the documentation.
    fn field(&mut self, key: &'static str, doc: &'static str, field: &mut dyn Field);
}

/// Something that is made of settings.
pub trait Settings {
    /// Shows every setting to `v`, which may change it.
    fn visit(&mut self, v: &mut dyn Visitor);
}

/// Settings as one JSON object, in the order of their declaration.
pub fn to_json(settings: &mut dyn Settings) -> Map<String, Value> {
    struct Collect(Map<String, Value>);
    impl Visitor for Collect {
        fn field(&mut self, key: &'static str, _doc: &'static str, field: &mut dyn Field) {
            self.0.insert(key.to_owned(), field.get());
        }
    }
    let mut collect = Collect(Map::new());
    settings.visit(&mut collect);
    collect.0
}

/// Settings as lines of YAML, with a comment on each line.
pub fn to_yaml(settings: &mut dyn Settings) -> String {
    struct Lines(String);
    impl Visitor for Lines {
        fn field(&mut self, key: &'static str, doc: &'static str, field: &mut dyn Field) {
            self.0.push_str(&format!("{:<39} # {doc}\n", format!("{key}: {}", field.get())));
        }
    }
    let mut lines = Lines(String::new());
    settings.visit(&mut lines);
    lines.0
}

/// The keys in which two recorded configs differ: those of `old` in its order, then those that only `new` has.
pub fn differing_keys<'a>(old: &'a Map<String, Value>, new: &'a Map<String, Value>) -> Vec<&'a String> {
    let keys = old.keys().chain(new.keys().filter(|key| !old.contains_key(*key)));
    keys.filter(|key| old.get(*key) != new.get(*key)).collect()
}

/// The keys of settings, in the order of their declaration.
pub fn keys(settings: &mut dyn Settings) -> Vec<&'static str> {
    struct Keys(Vec<&'static str>);
    impl Visitor for Keys {
        fn field(&mut self, key: &'static str, _doc: &'static str, _field: &mut dyn Field) {
            self.0.push(key);
        }
    }
    let mut keys = Keys(Vec::new());
    settings.visit(&mut keys);
    keys.0
}
