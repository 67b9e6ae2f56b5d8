//! Checkpoints: safetensors files that hold an agent, with a header of our own and a checksum over every byte.
//!
//! docs/checkpoints.md describes the format for readers in other languages; `python/` reads and writes it too.

use std::collections::HashMap;
use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use bit_mlp::Activation;
use safetensors::tensor::{Dtype, SafeTensors, TensorView};
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};

use super::atomic;
use crate::agent::network::{Network, TensorPlace};
use crate::agent::state::{AdamState, AgentState, Counters};
use crate::config::Choice;

/// The format's version; a file with another one is refused by name.
pub const FORMAT: u32 = 1;
/// The one key of the safetensors metadata.
const HEADER_KEY: &str = "cpp-rl";
/// Larger files are no checkpoints of ours.
const MAX_BYTES: u64 = 4 << 30;
/// What stands before the checksum's digits: the header is JSON within JSON, so that its quotes are escaped.
const CRC_FIELD: &[u8] = br#"\"crc32\":\""#;
const CRC_DIGITS: usize = 8;

/// A stage's agent, and what is known of where it comes from.
#[derive(Clone, Debug)]
pub struct Checkpoint {
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
}

/// A checkpoint that cannot be read: the file, what is wrong, and how to mend it.
#[derive(Debug, thiserror::Error)]
#[error("{}: {problem}", path.display())]
pub struct CheckpointError {
    path: PathBuf,
    problem: String,
}

impl Checkpoint {
    /// The bytes of the file.
    pub fn to_bytes(&self) -> Vec<u8> {
        let algorithm = if self.network.towers()[0].name == "q" { "dqn" } else { "ppo" };
        let towers = self.network.towers().iter().map(|t| (t.name.to_owned(), Value::from(t.sizes.clone())));
        let header = Header {
            crc32: "0".repeat(CRC_DIGITS),
            format: FORMAT,
            kind: "stage".to_owned(),
            algorithm: algorithm.to_owned(),
            activation: self.network.activation().name().to_owned(),
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
        };
        let mut slices = vec![(String::new(), self.agent.parameters.as_slice())];
        if self.has_adam {
            slices.push(("exp_avg/".to_owned(), &self.agent.adam.exp_avg));
            slices.push(("exp_avg_sq/".to_owned(), &self.agent.adam.exp_avg_sq));
        }
        if let Some(target) = &self.agent.target {
            slices.push(("target/".to_owned(), target));
        }
        let places = self.network.tensors();
        let named = slices.iter().flat_map(|(prefix, flat)| {
            places.iter().map(move |place| {
                let bytes: Vec<u8> = flat[place.range.clone()].iter().flat_map(|v| v.to_le_bytes()).collect();
                (format!("{prefix}{}", place.name), place.shape.clone(), bytes)
            })
        });
        let named: Vec<(String, Vec<usize>, Vec<u8>)> = named.collect();
        let views = named.iter().map(|(name, shape, bytes)| {
            let view = TensorView::new(Dtype::F32, shape.clone(), bytes).expect("a shape holds its bytes");
            (name.as_str(), view)
        });
        let text = serde_json::to_string(&header).expect("a header of plain values");
        let metadata = HashMap::from([(HEADER_KEY.to_owned(), text)]);
        let mut bytes = safetensors::serialize(views, Some(metadata)).expect("names and shapes of our own");
        let at = crc_position(&bytes).expect("the header was just written");
        let crc = format!("{:08x}", crc32fast::hash(&bytes));
        bytes[at..at + CRC_DIGITS].copy_from_slice(crc.as_bytes());
        bytes
    }

    /// Writes the file.
    ///
    /// # Errors
    /// Those of the file system; what stood there before is then still whole.
    pub fn write(&self, path: &Path) -> io::Result<()> {
        atomic::write(path, &self.to_bytes())
    }

    /// Reads a file and checks all of it.
    ///
    /// # Errors
    /// A file that is missing, cut short, changed, of another format, or not a checkpoint at all.
    pub fn read(path: &Path) -> Result<Self, CheckpointError> {
        let error = |problem: String| CheckpointError { path: path.to_owned(), problem };
        let size = fs::metadata(path).map_err(|e| error(format!("cannot read the checkpoint: {e}")))?.len();
        if size > MAX_BYTES {
            return Err(error(format!("{size} bytes are too many for a checkpoint (at most {MAX_BYTES})")));
        }
        let bytes = fs::read(path).map_err(|e| error(format!("cannot read the checkpoint: {e}")))?;
        Self::from_bytes(&bytes).map_err(error)
    }

    /// Reads the bytes of a file.
    fn from_bytes(bytes: &[u8]) -> Result<Self, String> {
        let not_ours = |what: &str| format!("not a checkpoint of cpp-rl ({what}): was the file cut short or changed?");
        let (_, metadata) = SafeTensors::read_metadata(bytes).map_err(|e| not_ours(&e.to_string()))?;
        let text = metadata.metadata().as_ref().and_then(|m| m.get(HEADER_KEY)).ok_or_else(|| {
            "a safetensors file without a cpp-rl header: convert models of other tools with \
             `python -m cpp_rl_gym.sb3 import`"
                .to_owned()
        })?;
        check_format(text)?;
        check_crc(bytes)?;
        let header: Header = serde_json::from_str(text).map_err(|e| not_ours(&e.to_string()))?;
        let network = header.network()?;
        let tensors = SafeTensors::deserialize(bytes).map_err(|e| not_ours(&e.to_string()))?;
        let mut reader = Reader { tensors, places: network.tensors(), taken: 0 };
        let parameters = reader.take("")?.ok_or_else(|| not_ours("its weights are missing"))?;
        let moments = reader.take("exp_avg/")?.zip(reader.take("exp_avg_sq/")?);
        let has_adam = moments.is_some();
        let adam = match moments {
            Some((exp_avg, exp_avg_sq)) => AdamState { exp_avg, exp_avg_sq, step: header.adam_step },
            None => AdamState::new(parameters.len()),
        };
        let target = reader.take("target/")?;
        if reader.taken != reader.tensors.len() {
            return Err(not_ours("it holds tensors that its header does not name"));
        }
        let seed = header.seed.unwrap_or(0);
        let counters = Counters { timesteps: header.num_timesteps, ..header.counters };
        Ok(Self {
            agent: AgentState { seed, parameters, adam, target, counters },
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

impl Header {
    /// The network that the header describes, its sizes bounded before anything is allocated.
    fn network(&self) -> Result<Network, String> {
        let activation = Activation::ALL.iter().find(|(name, _)| *name == self.activation);
        let (_, activation) = activation.ok_or_else(|| format!("unknown activation {:?}", self.activation))?;
        let inputs = self.height.checked_mul(self.width).and_then(|cells| cells.checked_mul(4)).unwrap_or(0);
        if !(1..=1 << 16).contains(&inputs) {
            return Err(format!("a map of {}×{} cells is not possible", self.height, self.width));
        }
        let first = self.towers.values().next().and_then(Value::as_array).map_or(&[][..], Vec::as_slice);
        let sizes: Vec<usize> = first.iter().filter_map(|v| v.as_u64().map(|v| v as usize)).collect();
        if sizes.len() < 2 || sizes.len() > 10 || sizes.iter().any(|&size| !(1..=1 << 16).contains(&size)) {
            return Err(format!("towers {} are not possible", Value::from(self.towers.clone())));
        }
        let hidden = &sizes[1..sizes.len() - 1];
        let network = match self.algorithm.as_str() {
            "ppo" => Network::actor_critic(inputs, hidden, *activation),
            "dqn" => Network::q_network(inputs, hidden, *activation),
            other => return Err(format!("unknown algorithm {other:?}")),
        };
        let fits = |t: &crate::agent::network::Tower| self.towers.get(t.name) == Some(&Value::from(t.sizes.clone()));
        if self.towers.len() != network.towers().len() || !network.towers().iter().all(fits) {
            return Err(format!(
                "its towers {} are not those of {} on {}×{} maps: all towers share their hidden layers",
                Value::from(self.towers.clone()),
                self.algorithm,
                self.height,
                self.width
            ));
        }
        Ok(network)
    }
}

/// Takes flat slices out of named tensors.
struct Reader<'a> {
    tensors: SafeTensors<'a>,
    places: Vec<TensorPlace>,
    taken: usize,
}

impl Reader<'_> {
    /// The flat slice of all tensors with this prefix, or nothing where there are none.
    fn take(&mut self, prefix: &str) -> Result<Option<Vec<f32>>, String> {
        let mut flat = Vec::new();
        for (i, place) in self.places.iter().enumerate() {
            let name = format!("{prefix}{}", place.name);
            let Ok(tensor) = self.tensors.tensor(&name) else {
                if i == 0 {
                    return Ok(None);
                }
                return Err(format!("tensor {name} is missing"));
            };
            if tensor.dtype() != Dtype::F32 || tensor.shape() != place.shape {
                return Err(format!("tensor {name} is not F32 of shape {:?}", place.shape));
            }
            let values = tensor.data().chunks_exact(4).map(|b| f32::from_le_bytes([b[0], b[1], b[2], b[3]]));
            flat.extend(values);
        }
        self.taken += self.places.len();
        Ok(Some(flat))
    }
}

/// Refuses other versions by name, before anything else of the header is believed.
fn check_format(text: &str) -> Result<(), String> {
    let header: Value = serde_json::from_str(text).map_err(|e| format!("its cpp-rl header is damaged: {e}"))?;
    match header.get("format").and_then(Value::as_u64) {
        Some(format) if format == u64::from(FORMAT) => Ok(()),
        Some(format) => Err(format!("checkpoint format {format}; this version of cpp-rl reads format {FORMAT}")),
        None => Err("its cpp-rl header names no format: the file is damaged".to_owned()),
    }
}

/// Compares the checksum with the bytes.
fn check_crc(bytes: &[u8]) -> Result<(), String> {
    let damaged = || "its checksum does not fit its content: the file was damaged or edited".to_owned();
    let at = crc_position(bytes).ok_or_else(damaged)?;
    let mut hasher = crc32fast::Hasher::new();
    hasher.update(&bytes[..at]);
    hasher.update(&[b'0'; CRC_DIGITS]);
    hasher.update(&bytes[at + CRC_DIGITS..]);
    if format!("{:08x}", hasher.finalize()).as_bytes() == &bytes[at..at + CRC_DIGITS] { Ok(()) } else { Err(damaged()) }
}

/// Where the checksum's digits stand, if they stand exactly once within the safetensors header.
fn crc_position(bytes: &[u8]) -> Option<usize> {
    let length = u64::from_le_bytes(bytes.get(..8)?.try_into().ok()?);
    let header = bytes.get(8..usize::try_from(length).ok()?.checked_add(8)?)?;
    let mut found = header.windows(CRC_FIELD.len()).enumerate().filter(|(_, window)| *window == CRC_FIELD);
    let (at, _) = found.next()?;
    let digits = at + CRC_FIELD.len();
    (found.next().is_none() && digits + CRC_DIGITS <= header.len()).then_some(8 + digits)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn checkpoint(network: Network, target: bool) -> Checkpoint {
        let mut agent = AgentState::new(&network, 3, target);
        agent.adam.step = 17;
        agent.adam.exp_avg.iter_mut().enumerate().for_each(|(i, m)| *m = i as f32);
        agent.counters = Counters { timesteps: 4096, updates: 20, target_calls: 4096 };
        let level = Some("a \"quoted\" level".to_owned());
        let source = "cpp-rl test".to_owned();
        let origin = Origin { height: 3, width: 5, seed: Some(3), stage: Some(0), level, source };
        Checkpoint { network, agent, has_adam: true, origin }
    }

    fn both() -> [Checkpoint; 2] {
        [
            checkpoint(Network::actor_critic(60, &[7, 5], Activation::Tanh), false),
            checkpoint(Network::q_network(60, &[6], Activation::Relu), true),
        ]
    }

    #[test]
    fn what_is_written_is_read() {
        for checkpoint in both() {
            let bytes = checkpoint.to_bytes();
            let read = Checkpoint::from_bytes(&bytes).unwrap();
            assert_eq!(read.agent, checkpoint.agent);
            assert_eq!(read.origin, checkpoint.origin);
            assert_eq!(read.to_bytes(), bytes);
        }
    }

    #[test]
    fn every_flipped_bit_is_noticed() {
        let bytes = both()[1].to_bytes();
        for at in 0..bytes.len() {
            let mut changed = bytes.clone();
            changed[at] ^= 1 << (at % 8);
            assert!(Checkpoint::from_bytes(&changed).is_err(), "byte {at}");
        }
    }

    #[test]
    fn every_cut_is_noticed() {
        let bytes = both()[1].to_bytes();
        for length in 0..bytes.len() {
            assert!(Checkpoint::from_bytes(&bytes[..length]).is_err(), "cut to {length}");
        }
    }

    #[test]
    fn another_format_is_refused_by_name() {
        let bytes = both()[1].to_bytes();
        let (_, metadata) = SafeTensors::read_metadata(&bytes).unwrap();
        let header = &metadata.metadata().as_ref().unwrap()[HEADER_KEY];
        let newer = header.replace("\"format\":1", "\"format\":2");
        assert_eq!(check_format(&newer).unwrap_err(), "checkpoint format 2; this version of cpp-rl reads format 1");
    }
}
