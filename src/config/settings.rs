//! Layers of settings, each remembering where it came from, and their resolution into a [`Config`].

use std::collections::BTreeMap;
use std::fmt;
use std::path::{Path, PathBuf};

use serde_json::Value;

use super::presets::{preset, preset_names};
use super::{Algorithm, Config, DqnConfig, Field, L2, PpoConfig, Visitor};
use crate::text_file;

/// A config file larger than this is not one.
const MAX_FILE_BYTES: u64 = 1 << 20;
/// Samples of a rollout; each takes some tens of bytes.
const MAX_ROLLOUT: usize = 1 << 22;

/// A setting that cannot be taken: where it stands, what is wrong, and how to mend it.
#[derive(Debug, thiserror::Error)]
#[error("{origin}: {problem}")]
pub struct ConfigError {
    origin: Origin,
    problem: String,
}

/// Where a setting came from.
#[derive(Clone, Debug)]
enum Origin {
    Preset(String),
    File { path: PathBuf, at: Option<(u64, u64)> },
    Set(String),
    Timesteps,
    Algo,
}

impl fmt::Display for Origin {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Preset(name) => write!(f, "preset {name}"),
            Self::File { path, at: Some((line, column)) } => write!(f, "{}:{line}:{column}", path.display()),
            Self::File { path, at: None } => write!(f, "{}", path.display()),
            Self::Set(text) => write!(f, "--set {text}"),
            Self::Timesteps => write!(f, "--timesteps"),
            Self::Algo => write!(f, "--algo"),
        }
    }
}

impl Origin {
    fn error(&self, problem: impl Into<String>) -> ConfigError {
        ConfigError { origin: self.clone(), problem: problem.into() }
    }
}

/// Settings by key; a later layer replaces what an earlier one said.
type Layer = BTreeMap<String, (Value, Origin)>;

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
    let mut top = Layer::new();
    if let Some(path) = file {
        top = read_file(path)?;
    }
    for text in sets {
        let (key, setting) = parse_set(text)?;
        top.insert(key, setting);
    }
    if let Some(timesteps) = timesteps {
        top.insert("timesteps".to_owned(), (timesteps.into(), Origin::Timesteps));
    }
    if let Some(algo) = algo {
        refuse_contradiction(algo, &top)?;
    }
    let mut layers = match (algo, top.remove("extends")) {
        (Some(algo), Some((extends, origin))) if extends.as_str() != Some(algo) => {
            return Err(origin.error(format!("it extends {extends}, but --algo says \"{algo}\": drop one of the two")));
        }
        (Some(algo), _) => preset_layers(algo, &Origin::Algo)?,
        (None, Some((extends, origin))) => preset_layers(&text_of("extends", &extends, &origin)?, &origin)?,
        (None, None) => Layer::new(),
    };
    layers.extend(top);
    build(layers)
}

/// Refuses a file that says it is another algorithm or preset than `--algo` does.
fn refuse_contradiction(algo: &str, top: &Layer) -> Result<(), ConfigError> {
    let base = preset_layers(algo, &Origin::Algo)?;
    let says = |layer: &Layer, key: &str| layer.get(key).and_then(|(value, _)| value.as_str()).map(str::to_owned);
    for key in ["algorithm", "name"] {
        let Some((value, origin)) = top.get(key) else { continue };
        let file = says(top, key);
        let contradicts = match key {
            "algorithm" => file != says(&base, key),
            // A name of one's own is welcome; that of another preset is a file for another arm.
            _ => file.as_deref().is_some_and(|name| name != algo && preset(name).is_some()),
        };
        if contradicts {
            return Err(origin.error(format!("{key} is {value}, but --algo says \"{algo}\": drop one of the two")));
        }
    }
    Ok(())
}

/// Turns merged settings into a config; nothing may be left over.
fn build(mut settings: Layer) -> Result<Config, ConfigError> {
    let Some((algorithm, origin)) = settings.remove("algorithm") else {
        let names: Vec<&str> = preset_names().collect();
        return Err(Origin::Algo.error(format!("no algorithm chosen: say --algo with one of {}", names.join(", "))));
    };
    let mut config = match algorithm.as_str() {
        Some("ppo") => Config::new(Algorithm::Ppo(PpoConfig::default())),
        Some("dqn") => Config::new(Algorithm::Dqn(DqnConfig::default())),
        _ => return Err(origin.error(format!("algorithm: expected ppo or dqn, got {algorithm}"))),
    };
    if let Some((name, origin)) = settings.remove("name") {
        config.name = text_of("name", &name, &origin)?;
        check_name(&config.name).map_err(|problem| origin.error(problem))?;
    }

    let mut take = Take { settings, known: vec!["name", "algorithm", "extends"], error: None };
    let l2_origin = take.settings.get("l2_coef").map_or(Origin::Algo, |(_, origin)| origin.clone());
    // Whichever of them the user set is the one to change.
    let products = ["num_envs", "n_steps", "buffer_size"].into_iter().filter_map(|key| take.settings.get(key));
    let of_user = products.map(|(_, origin)| origin).find(|origin| !matches!(origin, Origin::Preset(_)));
    let products_origin = of_user.cloned().unwrap_or(Origin::Algo);
    config.visit(&mut take);
    if let Some(error) = take.error {
        return Err(error);
    }
    if let Some((key, (_, origin))) = take.settings.first_key_value() {
        return Err(origin.error(unknown_key(key, &take.known, config.algorithm.name())));
    }
    if config.optimizer.l2 == L2::None && config.optimizer.l2_coef != 0.0 {
        return Err(
            l2_origin.error("l2_coef has no effect while l2 is none: choose l2=adamw, adam or loss, or drop it")
        );
    }
    check_products(&config).map_err(|problem| products_origin.error(problem))?;
    Ok(config)
}

/// Settings that are possible one by one, but not together.
fn check_products(config: &Config) -> Result<(), String> {
    match &config.algorithm {
        Algorithm::Dqn(dqn) if dqn.buffer_size < config.num_envs => Err(format!(
            "buffer_size: expected room for a transition of each environment, {} (num_envs) or more, got {}",
            config.num_envs, dqn.buffer_size
        )),
        Algorithm::Ppo(ppo) if ppo.n_steps * config.num_envs > MAX_ROLLOUT => Err(format!(
            "n_steps × num_envs: {} × {} makes {} samples in a rollout; at most {MAX_ROLLOUT} are possible",
            ppo.n_steps,
            config.num_envs,
            ppo.n_steps * config.num_envs
        )),
        _ => Ok(()),
    }
}

/// Reads the declared settings out of a layer.
struct Take {
    settings: Layer,
    known: Vec<&'static str>,
    error: Option<ConfigError>,
}

impl Visitor for Take {
    fn field(&mut self, key: &'static str, _doc: &'static str, field: &mut dyn Field) {
        self.known.push(key);
        if let Some((value, origin)) = self.settings.remove(key)
            && let Err(allowed) = field.set(&value)
        {
            let error = origin.error(format!("{key}: expected {allowed}, got {value}"));
            self.error.get_or_insert(error);
        }
    }
}

fn unknown_key(key: &str, known: &[&str], algorithm: &str) -> String {
    let others = [Algorithm::Ppo(PpoConfig::default()), Algorithm::Dqn(DqnConfig::default())].map(Config::new);
    let remedy = match others.iter().find(|config| config.to_json().contains_key(key)) {
        Some(other) => format!("it is one of {}", other.algorithm.name()),
        None => nearest(key, known).map_or_else(
            || format!("known keys are {}", known.join(", ")),
            |nearest| format!("did you mean \"{nearest}\"?"),
        ),
    };
    format!("unknown key \"{key}\" for algorithm {algorithm}; {remedy}")
}

/// The known word that `word` was probably meant to be.
fn nearest<'a>(word: &str, known: &[&'a str]) -> Option<&'a str> {
    let distances = known.iter().map(|k| (strsim::damerau_levenshtein(k, word), *k));
    distances.min().filter(|(distance, k)| *distance <= 1 + k.len() / 3).map(|(_, nearest)| nearest)
}

/// Refuses a name that is not to be a folder's, which an arm's and a study's become.
///
/// # Errors
/// Says what it may be.
pub fn check_name(name: &str) -> Result<(), String> {
    let fits = |c: char| c.is_ascii_alphanumeric() || "-_.+".contains(c);
    if (1..=64).contains(&name.len()) && name.chars().all(fits) && !name.starts_with('.') {
        return Ok(());
    }
    Err(format!("name: expected 1 to 64 letters, digits, '-', '_', '+' or '.' (not first), got {name:?}"))
}

fn text_of(key: &str, value: &Value, origin: &Origin) -> Result<String, ConfigError> {
    value.as_str().map(str::to_owned).ok_or_else(|| origin.error(format!("{key}: expected a text, got {value}")))
}

/// The layers of a preset, its bases first.
fn preset_layers(name: &str, origin: &Origin) -> Result<Layer, ConfigError> {
    let text = preset(name).ok_or_else(|| {
        let names: Vec<&str> = preset_names().collect();
        let meant = nearest(name, &names).map_or_else(String::new, |nearest| format!("did you mean {nearest:?}? "));
        origin.error(format!("unknown preset {name:?}; {meant}presets are {}", names.join(", ")))
    })?;
    let here = Origin::Preset(name.to_owned());
    let mut own = parse(text, |_| here.clone())?;
    let mut layers = match own.remove("extends") {
        Some((base, _)) => preset_layers(&text_of("extends", &base, &here)?, &here)?,
        None => Layer::new(),
    };
    layers.extend(own);
    layers.insert("name".to_owned(), (name.into(), here));
    Ok(layers)
}

fn read_file(path: &Path) -> Result<Layer, ConfigError> {
    let origin = Origin::File { path: path.to_owned(), at: None };
    let text = text_file::read(path, MAX_FILE_BYTES)
        .map_err(|error| origin.error(format!("cannot read the config file: {error}")))?;
    parse(&text, |at| Origin::File { path: path.to_owned(), at })
}

/// Parses `key: value` YAML; `origin` makes the origin of a setting from its line and column.
fn parse(text: &str, origin: impl Fn(Option<(u64, u64)>) -> Origin) -> Result<Layer, ConfigError> {
    type File = BTreeMap<String, serde_saphyr::Spanned<Value>>;
    if text.lines().all(|line| line.trim().is_empty() || line.trim_start().starts_with('#')) {
        return Ok(Layer::new());
    }
    let file: File = serde_saphyr::from_str(text).map_err(|error| {
        let at = error.location().map(|l| (l.line(), l.column()));
        let message = error.without_snippet().render_with_formatter(&serde_saphyr::UserMessageFormatter);
        // The place stands before it already.
        let place = at.map_or_else(String::new, |(line, column)| format!(" at line {line}, column {column}"));
        let message = message.strip_suffix(&place).unwrap_or(&message);
        origin(at).error(format!("not a list of `key: value` settings: {message}"))
    })?;
    let place = |spanned: &serde_saphyr::Spanned<Value>| (spanned.referenced.line(), spanned.referenced.column());
    Ok(file.into_iter().map(|(key, spanned)| (key, (spanned.value.clone(), origin(Some(place(&spanned)))))).collect())
}

fn parse_set(text: &str) -> Result<(String, (Value, Origin)), ConfigError> {
    let origin = Origin::Set(text.to_owned());
    let (key, value) =
        text.split_once('=').ok_or_else(|| origin.error("expected key=value, such as --set learning_rate=3e-4"))?;
    let value = serde_saphyr::from_str(value.trim()).unwrap_or_else(|_| Value::from(value.trim()));
    Ok((key.trim().to_owned(), (value, origin)))
}
