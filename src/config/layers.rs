//! Layers of settings, each remembering where it came from: a preset, a file, `--set` flags.

use std::collections::BTreeMap;
use std::fmt;
use std::path::{Path, PathBuf};

use serde_json::{Map, Value};

use super::presets::{preset, preset_names};
use super::{Field, Settings, Visitor};
use crate::text_file;

/// A config file larger than this is not one.
const MAX_FILE_BYTES: u64 = 1 << 20;

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
    Manifest,
    Brought(String),
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
            Self::Manifest => write!(f, "the manifest's settings"),
            Self::Brought(by) => write!(f, "{by}"),
        }
    }
}

impl Origin {
    /// Which layer it is; a higher one replaces what a lower one says.
    fn layer(&self) -> u8 {
        match self {
            Self::Algo | Self::Manifest | Self::Preset(_) => 1,
            Self::File { .. } => 2,
            Self::Brought(_) | Self::Set(_) | Self::Timesteps => 3,
        }
    }

    fn error(&self, problem: impl Into<String>) -> ConfigError {
        ConfigError { origin: self.clone(), problem: problem.into() }
    }
}

/// Settings by key; a later layer replaces what an earlier one said.
type Layer = BTreeMap<String, (Value, Origin)>;

/// The settings of one run from all layers, each taken out by whoever declares it.
#[derive(Clone, Debug)]
pub struct Layers {
    /// What nobody has taken yet.
    left: Layer,
    /// Where every setting came from, taken or not.
    origins: BTreeMap<String, Origin>,
}

impl Layers {
    /// Reads preset, file and `--set key=value` flags, in this order.
    ///
    /// Without `algo` the file must name its preset (`extends`) or be complete, as a run's `config.yaml` is.
    ///
    /// # Errors
    /// A layer that cannot be read, or that contradicts another one.
    pub fn read(
        algo: Option<&str>,
        file: Option<&Path>,
        sets: &[String],
        timesteps: Option<u64>,
    ) -> Result<Self, ConfigError> {
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
                return Err(
                    origin.error(format!("it extends {extends}, but --algo says \"{algo}\": drop one of the two"))
                );
            }
            (Some(algo), _) => preset_layers(algo, &Origin::Algo)?,
            (None, Some((extends, origin))) => preset_layers(&text_of("extends", &extends, &origin)?, &origin)?,
            (None, None) => Layer::new(),
        };
        layers.extend(top);
        Ok(Self::new(layers))
    }

    fn new(layers: Layer) -> Self {
        let origins = layers.iter().map(|(key, (_, origin))| (key.clone(), origin.clone())).collect();
        Self { left: layers, origins }
    }

    /// The settings that a manifest recorded.
    pub fn recorded(settings: &Map<String, Value>) -> Self {
        let setting = |(key, value): (&String, &Value)| (key.clone(), (value.clone(), Origin::Manifest));
        Self::new(settings.iter().map(setting).collect())
    }

    /// Adds `--set key=value` flags, which replace what is there.
    ///
    /// # Errors
    /// A flag that is no `key=value`.
    pub fn with_sets(mut self, sets: &[String]) -> Result<Self, ConfigError> {
        for text in sets {
            let (key, setting) = parse_set(text)?;
            self.left.insert(key, setting);
        }
        Ok(Self::new(self.left))
    }

    /// Adds a setting that the setting `because` brings along, on behalf of `by`. It stands in that setting's layer, so that it
    /// replaces what layers below say, and nothing else.
    ///
    /// # Errors
    /// A value that is no YAML.
    pub fn bring(&mut self, key: &str, value: &str, because: &str, by: String) -> Result<(), ConfigError> {
        let layer = |key: &str| self.origins.get(key).map_or(0, Origin::layer);
        if self.origins.contains_key(key) && layer(key) >= layer(because) {
            return Ok(());
        }
        let (key, (value, _)) = parse_set(&format!("{key}={value}"))?;
        let origin = Origin::Brought(by);
        self.origins.insert(key.clone(), origin.clone());
        self.left.insert(key, (value, origin));
        Ok(())
    }

    /// Whether a setting is what a manifest recorded.
    pub fn is_recorded(&self, key: &str) -> bool {
        matches!(self.origins.get(key), Some(Origin::Manifest))
    }

    /// Drops settings that a manifest recorded and nobody has taken.
    pub fn forget_recorded(&mut self, is_forgotten: impl Fn(&str) -> bool) {
        self.left.retain(|key, (_, origin)| !(matches!(origin, Origin::Manifest) && is_forgotten(key)));
    }

    /// Gives a setting that had another name its present one, and its values theirs.
    pub fn rename(&mut self, old: &str, new: &str, values: &[(&str, &str)]) {
        let Some((value, origin)) = self.left.remove(old) else { return };
        let renamed = values.iter().find(|(old, _)| value.as_str() == Some(old)).map(|(_, new)| Value::from(*new));
        self.left.entry(new.to_owned()).or_insert((renamed.unwrap_or(value), origin.clone()));
        self.origins.entry(new.to_owned()).or_insert(origin);
    }

    /// Whether a setting is there and not taken yet.
    pub fn contains(&self, key: &str) -> bool {
        self.left.contains_key(key)
    }

    /// The first of these keys that was set outside of a preset: the one to change where several do not fit together.
    pub fn set_by_user<'a>(&self, keys: &[&'a str]) -> Option<&'a str> {
        let of_user = |origin: &Origin| !matches!(origin, Origin::Preset(_) | Origin::Brought(_));
        let by_user = |key: &&&str| self.origins.get(**key).is_some_and(of_user);
        keys.iter().find(by_user).copied()
    }

    /// An error about a setting, naming where it came from; about the preset, where nothing set it.
    pub fn error(&self, key: &str, problem: impl Into<String>) -> ConfigError {
        self.origins.get(key).unwrap_or(&Origin::Algo).error(problem)
    }

    /// Takes a text out.
    ///
    /// # Errors
    /// A value that is no text, or one that `check` refuses.
    pub fn take_text(
        &mut self,
        key: &str,
        check: impl Fn(&str) -> Result<(), String>,
    ) -> Result<Option<String>, ConfigError> {
        let Some((value, origin)) = self.left.remove(key) else { return Ok(None) };
        let text = text_of(key, &value, &origin)?;
        check(&text).map_err(|problem| origin.error(problem))?;
        Ok(Some(text))
    }

    /// Takes out every setting that `settings` declares.
    ///
    /// # Errors
    /// The first value that is not allowed.
    pub fn fill(&mut self, settings: &mut dyn Settings) -> Result<(), ConfigError> {
        struct Take<'a> {
            layer: &'a mut Layer,
            error: Option<ConfigError>,
        }
        impl Visitor for Take<'_> {
            fn field(&mut self, key: &'static str, _doc: &'static str, field: &mut dyn Field) {
                if let Some((value, origin)) = self.layer.remove(key)
                    && let Err(allowed) = field.set(&value)
                {
                    let error = origin.error(format!("{key}: expected {allowed}, got {value}"));
                    self.error.get_or_insert(error);
                }
            }
        }
        let mut take = Take { layer: &mut self.left, error: None };
        settings.visit(&mut take);
        take.error.map_or(Ok(()), Err)
    }

    /// Refuses settings that nobody has taken; `remedy` says what may be meant by a key.
    ///
    /// # Errors
    /// The first that is left.
    pub fn finish(self, remedy: impl Fn(&str) -> String) -> Result<(), ConfigError> {
        match self.left.first_key_value() {
            Some((key, (_, origin))) => Err(origin.error(remedy(key))),
            None => Ok(()),
        }
    }
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

/// The known word that `word` was probably meant to be.
pub fn nearest<'a>(word: &str, known: &[&'a str]) -> Option<&'a str> {
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
