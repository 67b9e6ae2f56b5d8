//! Checkpoints: the files that hold an agent as it goes from one stage to the next.
//!
//! docs/checkpoints.md describes the format for readers in other languages; `python/` reads and writes it too.

use std::collections::BTreeMap;
use std::io;
use std::path::{Path, PathBuf};

use bit_mlp::Activation;
use coverage_env::Sensor;
use coverage_env::level::MAX_CELLS;
use coverage_env::sensor;
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};

use super::agent_file::{self, Described};
use super::atomic;
use super::container::{self, Container, FORMAT, NO_CRC, not_ours};
use crate::agent::algorithm::Algorithm;
use crate::agent::network::{Layout, Network, Tower};
use crate::agent::registry;
use crate::agent::state::{AgentState, Counters};
use crate::config::Choice;

pub use super::container::FileError;

/// What the header calls these files.
const KIND: &str = "stage";

/// A stage's agent, and what is known of where it comes from.
#[derive(Clone, Debug)]
pub struct Checkpoint {
    /// The algorithm that trained it, with its default settings.
    pub algorithm: Box<dyn Algorithm>,
    /// What the agent sees with.
    pub sensor: &'static dyn Sensor,
    /// Its network.
    pub network: Network,
    /// The agent.
    pub agent: AgentState,
    /// Whether the file holds optimiser state; if not, `agent.adam` is that of a fresh agent.
    pub has_adam: bool,
    /// Where it comes from.
    pub origin: Origin,
}

/// Where a checkpoint comes from.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Origin {
    /// Height of the maps it was trained on.
    pub height: usize,
    /// Width of the maps it was trained on.
    pub width: usize,
    /// The seed, where one is known.
    pub seed: Option<u64>,
    /// The finished stage.
    pub stage: Option<u16>,
    /// The level of that stage.
    pub level: Option<String>,
    /// The program that trained it.
    pub source: String,
}

/// The header as it stands in the file; the order of its fields is part of the format.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Header {
    crc32: String,
    format: u32,
    kind: String,
    algorithm: String,
    activation: String,
    /// Files of networks without norms have no such field.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    layer_norm: bool,
    /// Files of agents that see the whole map have no such field.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    sensor: Option<String>,
    towers: Map<String, Value>,
    height: usize,
    width: usize,
    adam_step: u64,
    num_timesteps: u64,
    seed: Option<u64>,
    stage: Option<u16>,
    level: Option<String>,
    source: String,
    counters: Counters,
    /// What mitigations count; files of agents without them have no such field.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    extra: BTreeMap<String, u64>,
}

/// A checkpoint that cannot be read: the file, what is wrong, and how to mend it.
#[derive(Debug, thiserror::Error)]
#[error("{}: {problem}", path.display())]
pub struct CheckpointError {
    path: PathBuf,
    problem: FileError,
}

impl Checkpoint {
    /// The bytes of the file.
    pub fn to_bytes(&self) -> Vec<u8> {
        let towers = self.network.towers().iter().map(|t| (t.name.to_owned(), Value::from(t.sizes.clone())));
        let header = Header {
            crc32: NO_CRC.to_owned(),
            format: FORMAT,
            kind: KIND.to_owned(),
            algorithm: self.algorithm.name().to_owned(),
            activation: self.network.activation().name().to_owned(),
            layer_norm: self.network.layout().layer_norm,
            sensor: (self.sensor.name() != default_sensor().name()).then(|| self.sensor.name().to_owned()),
            towers: towers.collect(),
            height: self.origin.height,
            width: self.origin.width,
            adam_step: self.agent.adam.step,
            num_timesteps: self.agent.counters.timesteps,
            seed: self.origin.seed,
            stage: self.origin.stage,
            level: self.origin.level.clone(),
            source: self.origin.source.clone(),
            counters: self.agent.counters,
            extra: self.agent.kept.numbers.clone(),
        };
        container::to_bytes(&header, &agent_file::tensors(&self.agent, &self.network.tensors(), self.has_adam))
    }

    /// Writes the file.
    ///
    /// # Errors
    /// Those of the file system; what stood there before is then still whole, or this is.
    pub fn write(&self, path: &Path) -> io::Result<()> {
        atomic::write(path, &self.to_bytes())
    }

    /// Reads a file and checks all of it.
    ///
    /// # Errors
    /// A file that is missing, cut short, changed, of another format, or not a checkpoint at all.
    pub fn read(path: &Path) -> Result<Self, CheckpointError> {
        let bytes = container::read(path);
        let read = bytes.and_then(|bytes| Self::from_bytes(&bytes));
        read.map_err(|problem| CheckpointError { path: path.to_owned(), problem })
    }

    /// Reads the bytes of a file.
    ///
    /// # Errors
    /// Anything but a whole checkpoint of this format.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, FileError> {
        Self::take(Container::open(bytes, KIND)?).map_err(FileError::Foreign)
    }

    /// Takes it out of a file that fits its checksum.
    fn take(mut file: Container<'_>) -> Result<Self, String> {
        let header: Header = serde_json::from_str(&file.header).map_err(not_ours)?;
        let algorithm =
            registry::by_name(&header.algorithm).ok_or_else(|| format!("unknown algorithm {:?}", header.algorithm))?;
        let sensor = header.sensor()?;
        let network = header.network(&*algorithm, sensor)?;
        let described = Described {
            seed: header.seed.unwrap_or(0),
            adam_step: header.adam_step,
            counters: Counters { timesteps: header.num_timesteps, ..header.counters },
            numbers: header.extra,
        };
        let (agent, has_adam) = agent_file::take(&mut file, &network.tensors(), described)?;
        file.finish()?;
        Ok(Self {
            algorithm,
            sensor,
            agent,
            network,
            has_adam,
            origin: Origin {
                height: header.height,
                width: header.width,
                seed: header.seed,
                stage: header.stage,
                level: header.level,
                source: header.source,
            },
        })
    }
}

/// What an agent sees with where a file does not say it.
fn default_sensor() -> &'static dyn Sensor {
    Default::default()
}

impl Header {
    fn sensor(&self) -> Result<&'static dyn Sensor, String> {
        let Some(name) = &self.sensor else { return Ok(default_sensor()) };
        sensor::by_name(name).ok_or_else(|| format!("unknown sensor {name:?}"))
    }

    /// The network that the header describes, its sizes bounded before anything is allocated.
    fn network(&self, algorithm: &dyn Algorithm, sensor: &dyn Sensor) -> Result<Network, String> {
        let activation = Activation::ALL.iter().find(|(name, _)| *name == self.activation);
        let (_, activation) = activation.ok_or_else(|| format!("unknown activation {:?}", self.activation))?;
        let cells = self.height.checked_mul(self.width).unwrap_or(0);
        if !(1..=MAX_CELLS).contains(&cells) {
            return Err(format!("a map of {}×{} cells is not possible", self.height, self.width));
        }
        let inputs = sensor.shape(self.height, self.width).into_iter().product();
        let first = self.towers.values().next().and_then(Value::as_array).map_or(&[][..], Vec::as_slice);
        let sizes: Vec<usize> = first.iter().filter_map(|v| v.as_u64().map(|v| v as usize)).collect();
        if sizes.len() < 2 || sizes.len() > 10 || sizes.iter().any(|&size| !(1..=1 << 16).contains(&size)) {
            return Err(format!("towers {} are not possible", Value::from(self.towers.clone())));
        }
        let hidden = &sizes[1..sizes.len() - 1];
        let layout = Layout { inputs, hidden: hidden.to_vec(), activation: *activation, layer_norm: self.layer_norm };
        let network = Network::new(layout, algorithm.heads());
        let fits = |t: &Tower| self.towers.get(t.name) == Some(&Value::from(t.sizes.clone()));
        if self.towers.len() != network.towers().len() || !network.towers().iter().all(fits) {
            return Err(format!(
                "its towers {} are not those of {} with the sensor {} on {}×{} maps: all towers share their hidden layers",
                Value::from(self.towers.clone()),
                self.algorithm,
                sensor.name(),
                self.height,
                self.width
            ));
        }
        Ok(network)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::agent::buffers::Data;

    fn checkpoint(algorithm: &str, inputs: usize, hidden: &[usize], activation: Activation) -> Checkpoint {
        let algorithm = registry::by_name(algorithm).unwrap();
        let layout = Layout { inputs, hidden: hidden.to_vec(), activation, layer_norm: false };
        let network = Network::new(layout, algorithm.heads());
        let mut agent = AgentState::new(&network, 3, algorithm.copies());
        agent.adam.step = 17;
        agent.adam.exp_avg.iter_mut().enumerate().for_each(|(i, m)| *m = i as f32);
        agent.counters = Counters { timesteps: 4096, updates: 20, target_calls: 4096 };
        let level = Some("a \"quoted\" level".to_owned());
        let source = "cpp-rl test".to_owned();
        let origin = Origin { height: 3, width: 5, seed: Some(3), stage: Some(0), level, source };
        Checkpoint { algorithm, sensor: default_sensor(), network, agent, has_adam: true, origin }
    }

    fn some() -> [Checkpoint; 3] {
        let mut ppo = checkpoint("ppo", 60, &[7, 5], Activation::Tanh);
        let first = ppo.agent.parameters.clone();
        ppo.agent.kept.copies.insert("first".to_owned(), first);
        ppo.agent.kept.lists.insert("a/list".to_owned(), vec![0.5, -1.0]);
        ppo.agent.kept.numbers.insert("a/number".to_owned(), 1 << 60);
        let mut local = checkpoint("ppo", 36, &[7], Activation::Tanh);
        local.sensor = sensor::by_name("local").unwrap();
        let mut dqn = checkpoint("dqn", 60, &[6], Activation::Relu);
        dqn.agent.kept.buffers.add("replay/inputs", &[1, 2, 1], Data::U64(vec![5, 1 << 59]));
        dqn.agent.kept.buffers.add("replay/actions", &[1], Data::U8(vec![3]));
        dqn.agent.kept.buffers.add("cells", &[2], Data::U16(vec![7, 700]));
        dqn.agent.kept.buffers.add("nothing", &[0, 3], Data::F32(Vec::new()));
        [ppo, dqn, local]
    }

    #[test]
    fn what_is_written_is_read() {
        for checkpoint in some() {
            let bytes = checkpoint.to_bytes();
            let read = Checkpoint::from_bytes(&bytes).unwrap();
            assert_eq!(read.agent, checkpoint.agent);
            assert_eq!(read.origin, checkpoint.origin);
            assert_eq!(read.sensor.name(), checkpoint.sensor.name());
            assert_eq!(read.to_bytes(), bytes);
        }
    }

    /// Files of version 0.1.0 have no such field, and those of agents that see the whole map stay as they were.
    #[test]
    fn the_header_names_any_sensor_but_the_default() {
        let [full, _, mut local] = some();
        let says = |checkpoint: &Checkpoint| {
            let bytes = checkpoint.to_bytes();
            bytes.windows(8).any(|window| window == b"\"sensor\\")
        };
        assert!(!says(&full) && says(&local));
        local.sensor = full.sensor;
        let error = Checkpoint::from_bytes(&local.to_bytes()).unwrap_err().to_string();
        assert!(error.contains("with the sensor full on 3×5 maps"), "{error}");
    }

    #[test]
    fn every_flipped_bit_is_noticed() {
        let bytes = some()[1].to_bytes();
        for at in 0..bytes.len() {
            let mut changed = bytes.clone();
            changed[at] ^= 1 << (at % 8);
            assert!(Checkpoint::from_bytes(&changed).is_err(), "byte {at}");
        }
    }

    #[test]
    fn every_cut_is_noticed() {
        let bytes = some()[1].to_bytes();
        for length in 0..bytes.len() {
            assert!(Checkpoint::from_bytes(&bytes[..length]).is_err(), "cut to {length}");
        }
    }
}
