//! One [`Config`] per run: a preset, then a file, then `--set` flags, resolved once and written into the run.

use std::any::Any;
use std::path::Path;

use coverage_env::Level;
use serde_json::{Map, Value};

use super::algorithm::Algorithm;
use super::engine::{Parts, Toward};
use super::mitigation::{Brought, Listed, Mitigations, Regimen};
use super::network::{Head, Network};
use super::registry;
use super::shared::Shared;
use super::stage::Stage;
use super::state::AgentState;
use crate::config::{self, ConfigError, Layers, Settings, Visitor, check_name, choice, nearest};

/// The most bytes that the parameters, the rollout or the replay buffer of one seed may take.
const MAX_BYTES: u64 = 2 << 30;

/// The settings of one run, complete and validated.
#[derive(Clone, Debug)]
pub struct Config {
    /// The arm's name; also the name of its folder.
    pub name: String,
    /// What all algorithms share.
    pub shared: Shared,
    /// The methods against loss of plasticity.
    pub mitigations: Mitigations,
    /// The algorithm and what only it has.
    pub algorithm: Box<dyn Algorithm>,
}

/// Resolves preset, file and `--set key=value` flags, in this order, into a config.
///
/// Without `algo` the file must name its preset (`extends`) or be complete, as a run's `config.yaml` is.
///
/// # Errors
/// The first setting that cannot be taken.
pub fn resolve(
    algo: Option<&str>,
    file: Option<&Path>,
    sets: &[String],
    timesteps: Option<u64>,
) -> Result<Config, ConfigError> {
    Config::from_layers(Layers::read(algo, file, sets, timesteps)?, Some(&Mitigations::new(&[])))
}

impl Config {
    /// The paper's settings for an algorithm; presets say what differs.
    fn new(algorithm: Box<dyn Algorithm>) -> Self {
        let mut shared = Shared::default();
        algorithm.defaults(&mut shared);
        Self { name: algorithm.name().to_owned(), shared, mitigations: Mitigations::new(&[]), algorithm }
    }

    /// The defaults of the algorithm of this name.
    pub fn defaults(algorithm: &str) -> Option<Self> {
        registry::by_name(algorithm).map(Self::new)
    }

    /// Takes settings that a manifest recorded, of this version or an earlier one.
    ///
    /// # Errors
    /// The first setting that cannot be taken.
    pub fn recorded(settings: &Map<String, Value>) -> Result<Self, ConfigError> {
        Self::from_layers(Layers::recorded(settings), None)
    }

    /// The same with these settings, as `--set` takes them. Those of a mitigation that is listed no more go with it; what it
    /// brought has to be set anew.
    ///
    /// # Errors
    /// The first setting that cannot be taken.
    pub fn with_sets(&self, sets: &[String]) -> Result<Self, ConfigError> {
        Self::from_layers(Layers::recorded(&self.to_json()).with_sets(sets)?, Some(&self.mitigations))
    }

    /// Turns merged settings into a config; nothing may be left over. Mitigations that are not among those of `before` bring
    /// their settings; without `before` none does.
    fn from_layers(mut layers: Layers, before: Option<&Mitigations>) -> Result<Self, ConfigError> {
        // Up to version 0.1.0 the engines had other names.
        layers.rename("kernel", "engine", &[("autograd", "libtorch")]);
        let Some(algorithm) = layers.take_text("algorithm", known_algorithm)?.as_deref().and_then(registry::by_name)
        else {
            let names: Vec<&str> = config::preset_names().collect();
            let problem = format!("no algorithm chosen: say --algo with one of {}", names.join(", "));
            return Err(layers.error("algorithm", problem));
        };
        let mut config = Self::new(algorithm);
        if let Some(name) = layers.take_text("name", check_name)? {
            config.name = name;
        }
        layers.fill(&mut Listed(&mut config.mitigations))?;
        if let Some(before) = before {
            let mut left = before.brought(&config.mitigations).into_iter();
            if let Some((name, Brought { key, .. })) = left.find(|(_, brought)| layers.is_recorded(brought.key)) {
                let problem = format!("{name} brought {key}, and is listed no more: set {key}, too");
                return Err(layers.error("mitigations", problem));
            }
            for (name, Brought { key, value, .. }) in config.mitigations.brought(before) {
                layers.bring(key, value, "mitigations", format!("mitigation {name}"))?;
            }
        }
        layers.fill(&mut config)?;
        let misfits = config.mitigations.check(&config.shared).and_then(|()| config.check_brought()).err();
        let misfits = misfits.map(|(key, problem)| layers.error(key, problem));
        let products = config.algorithm.check(&config.shared).err();
        let products = products.map(|misfit| {
            // Whichever of them the user set is the one to change.
            layers.error(layers.set_by_user(misfit.keys).unwrap_or(""), misfit.problem)
        });
        layers.forget_recorded(|key| Mitigations::with_key(key).is_some());
        layers.finish(|key| config.unknown_key(key))?;
        misfits.or(products).map_or(Ok(config), Err)
    }

    /// Refuses a listed mitigation whose settings are another method's.
    fn check_brought(&self) -> Result<(), (&'static str, String)> {
        let brought = self.mitigations.brought(&Mitigations::new(&[]));
        let mut fixed = brought.into_iter().filter(|(_, brought)| !brought.is_dose).peekable();
        let settings = fixed.peek().map(|_| self.to_json()).unwrap_or_default();
        for (name, Brought { key, value, .. }) in fixed {
            let is = settings.get(key).map(Value::to_string).unwrap_or_default();
            if is.trim_matches('"') != value {
                let problem = format!("the mitigation {name} is {key}={value}, and cannot be listed with {key}={is}");
                return Err((key, problem));
            }
        }
        Ok(())
    }

    fn unknown_key(&self, key: &str) -> String {
        let known: Vec<&str> =
            ["name", "algorithm", "extends"].into_iter().chain(config::keys(&mut self.clone())).collect();
        let others = registry::names().into_iter().filter_map(registry::by_name);
        let other = others.into_iter().find(|other| config::keys(&mut *other.boxed()).contains(&key));
        let remedy = match (other, Mitigations::with_key(key)) {
            (Some(other), _) => format!("it is one of {}", other.name()),
            (None, Some(mitigation)) => {
                format!("it is one of the mitigation {mitigation}: list it with mitigations=[{mitigation}]")
            }
            (None, None) => nearest(key, &known).map_or_else(
                || format!("known keys are {}", known.join(", ")),
                |nearest| format!("did you mean \"{nearest}\"?"),
            ),
        };
        format!("unknown key \"{key}\" for algorithm {}; {remedy}", self.algorithm.name())
    }

    /// All settings as one JSON object, in the order of their declaration; [`recorded`](Self::recorded) takes it back.
    pub fn to_json(&self) -> Map<String, Value> {
        let mut all = Map::new();
        all.insert("name".to_owned(), self.name.clone().into());
        all.insert("algorithm".to_owned(), self.algorithm.name().into());
        all.extend(config::to_json(&mut self.clone()));
        all
    }

    /// All settings as a YAML file with a comment on each line; `--config` takes it back.
    pub fn to_yaml(&self) -> String {
        let (name, algorithm) = (Value::from(self.name.clone()), self.algorithm.name());
        format!("name: {name}\nalgorithm: {algorithm}\n{}", config::to_yaml(&mut self.clone()))
    }

    /// The algorithm's settings, if they are of this type.
    pub fn of<T: Algorithm>(&self) -> Option<&T> {
        (&*self.algorithm as &dyn Any).downcast_ref()
    }

    /// The network that is trained on maps of this level's size.
    pub fn network(&self, level: &Level) -> Network {
        Network::new(self.shared.layout(level), self.algorithm.heads())
    }

    /// An agent from scratch, for maps of this level's size.
    pub fn agent(&self, level: &Level, seed: u64) -> AgentState {
        AgentState::new(&self.network(level), seed, self.algorithm.copies())
    }

    /// The mitigations at work on these agents in a stage.
    pub fn regimen<'a>(&self, stage: &Stage, agents: impl Iterator<Item = &'a AgentState>) -> Regimen {
        let network = self.network(&stage.level);
        let copies = self.algorithm.copies();
        let outputs = self.algorithm.outputs();
        Regimen::new(&self.mitigations, &self.shared.optimizer, network, copies, outputs, stage.index, agents)
    }

    /// The copies of its parameters that an agent carries in a stage, by name: the algorithm's, and what a pull draws to.
    pub fn copies(&self) -> Vec<&'static str> {
        let drawn_to = self.mitigations.pull().and_then(|pull| match pull.toward {
            Toward::Zero(_) => None,
            Toward::Copy { name, .. } => Some(name),
        });
        self.algorithm.copies().iter().copied().chain(drawn_to).collect()
    }

    /// What an engine is made of, for these agents on maps of this level's size.
    pub fn parts(&self, level: &Level, agents: Vec<AgentState>) -> Parts {
        let network = self.network(level);
        Parts {
            optimizer: self.shared.optimizer.clone(),
            pull: self.mitigations.pull(),
            penalties: self.mitigations.penalties(&network),
            network,
            agents,
        }
    }

    /// Refuses agents for maps of this level's size that would take more memory than any use of them needs.
    ///
    /// # Errors
    /// Names the settings, what they amount to, and what is possible.
    pub fn check_size(&self, level: &Level) -> Result<(), String> {
        let cells = level.len();
        let parameters = self.num_parameters(level);
        let copies = self.copies();
        let beside = match &copies[..] {
            [] => "gradient and Adam's moments".to_owned(),
            names => format!("gradient, Adam's moments and copies ({})", names.join(", ")),
        };
        let hidden = &self.shared.hidden;
        let what = format!(
            "hidden: {hidden:?}: a network of {parameters} parameters on maps of {cells} cells, with {beside},"
        );
        refuse_large(parameters.saturating_mul(4 * (4 + copies.len() as u64)), what)?;
        let (what, bytes) = self.algorithm.memory(&self.shared, level);
        refuse_large(bytes, what)
    }

    /// Parameters of all towers on maps of this level's size, without making them.
    fn num_parameters(&self, level: &Level) -> u64 {
        let layout = self.shared.layout(level);
        let of_head = |head: &Head| layout.shape(head.outputs).num_parameters();
        self.algorithm.heads().iter().map(of_head).fold(0, u64::saturating_add)
    }
}

impl Settings for Config {
    /// Every setting but `name`, `algorithm` and `extends`, which decide what is declared.
    fn visit(&mut self, v: &mut dyn Visitor) {
        self.shared.visit(v);
        self.mitigations.visit(v);
        self.algorithm.visit(v);
        v.field("engine", "what computes networks: fused or libtorch", &mut choice(&mut self.shared.engine));
    }
}

impl PartialEq for Config {
    fn eq(&self, other: &Self) -> bool {
        self.to_json() == other.to_json()
    }
}

fn known_algorithm(name: &str) -> Result<(), String> {
    let names = registry::names();
    if names.contains(&name) {
        return Ok(());
    }
    Err(format!("algorithm: expected {}, got \"{name}\"", names.join(" or ")))
}

fn refuse_large(bytes: u64, what: String) -> Result<(), String> {
    if bytes <= MAX_BYTES {
        return Ok(());
    }
    let gib = |bytes: u64| bytes as f64 / f64::from(1 << 30);
    Err(format!("{what} takes {:.1} GiB per seed; at most {:.0} GiB are possible", gib(bytes), gib(MAX_BYTES)))
}

#[cfg(test)]
mod tests {
    use coverage_env::level::MAX_CELLS;
    use coverage_env::sensor::SENSORS;

    use super::*;
    use crate::config::preset_names;

    #[test]
    fn parameters_are_counted_as_networks_count_them() {
        let level = Level::from_map("a", "..T\n...").unwrap();
        let largest = Level::from_map("b", &format!("{}.T", ".".repeat(MAX_CELLS - 2))).unwrap();
        for preset in preset_names() {
            for sensor in SENSORS {
                let sets = [format!("sensor={}", sensor.name())];
                let config = resolve(Some(preset), None, &sets, None).unwrap();
                let expected = config.network(&level).num_parameters() as u64;
                assert_eq!(config.num_parameters(&level), expected, "{preset}");
                assert_eq!(config.check_size(&largest), Ok(()), "presets fit the largest maps");
            }
        }
    }

    #[test]
    fn settings_of_earlier_versions_are_read() {
        let config = resolve(Some("ppo"), None, &["engine=libtorch".to_owned()], None).unwrap();
        let mut settings = config.to_json();
        settings.remove("engine");
        settings.remove("mitigations");
        settings.remove("sensor");
        settings.remove("adam_beta1");
        settings.remove("adam_beta2");
        settings.insert("kernel".to_owned(), "autograd".into());
        assert_eq!(Config::recorded(&settings).unwrap(), config);
    }
}
