//! The file of a [`Snapshot`]: what a run that was stopped in the midst of a stage goes on from.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use safetensors::tensor::Dtype;
use serde::{Deserialize, Serialize};

use super::atomic;
use super::container::{self, Container, FORMAT, FileError, NO_CRC, Tensor, not_ours};
use super::logs::Marks;
use crate::agent::dqn::ReplayState;
use crate::agent::network::Network;
use crate::agent::snapshot::{Position, Snapshot};
use crate::agent::state::{AdamState, AgentState, Counters};
use crate::dose::StageDose;

/// What the header calls these files.
const KIND: &str = "snapshot";
/// The end of their names, which begin with the cumulative timesteps.
const EXTENSION: &str = "safetensors";
/// What is appended to the name of a damaged one.
const DAMAGED: &str = ".damaged";

/// A snapshot, and what the run's directory was like when it was taken.
#[derive(Clone, Debug)]
pub(super) struct SavedSnapshot {
    /// The stage it was taken in.
    pub stage: u16,
    /// The seed's state.
    pub snapshot: Snapshot,
    /// What the stage has measured of the L2 penalty.
    pub dose: StageDose,
    /// Seconds spent on the run.
    pub seconds: f64,
    /// How far the files had grown that the rest of the stage adds to.
    pub marks: Marks,
}

/// The header as it stands in the file.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Header {
    crc32: String,
    format: u32,
    kind: String,
    seed: u64,
    stage: u16,
    num_timesteps: u64,
    adam_step: u64,
    counters: Counters,
    position: Position,
    /// Transitions of the replay buffer, and the slot that is filled next.
    replay: Option<(usize, usize)>,
    dose: StageDose,
    seconds: f64,
    marks: Marks,
    source: String,
}

/// The folder of a run's snapshots.
pub(super) fn folder(run: &Path) -> PathBuf {
    run.join("checkpoints").join("latest")
}

/// The file of the snapshot taken after this many timesteps of all stages.
pub(super) fn path(run: &Path, timesteps: u64) -> PathBuf {
    folder(run).join(format!("{timesteps}.{EXTENSION}"))
}

/// The cumulative timesteps of all snapshots of a run, the latest first.
///
/// # Errors
/// Those of the file system.
pub(super) fn list(run: &Path) -> io::Result<Vec<u64>> {
    let mut found = Vec::new();
    for entry in fs::read_dir(folder(run))? {
        let path = PathBuf::from(entry?.file_name());
        if path.extension().is_some_and(|extension| extension == EXTENSION) {
            found.extend(path.file_stem().and_then(|stem| stem.to_str()?.parse::<u64>().ok()));
        }
    }
    found.sort_unstable_by(|a, b| b.cmp(a));
    Ok(found)
}

/// Renames a damaged snapshot, so that it is no longer in the way and nobody removes it; returns its new name.
///
/// # Errors
/// Those of the file system.
pub(super) fn set_aside(file: &Path) -> io::Result<PathBuf> {
    let mut name = file.as_os_str().to_owned();
    name.push(DAMAGED);
    let aside = PathBuf::from(name);
    fs::rename(file, &aside)?;
    Ok(aside)
}

impl SavedSnapshot {
    /// Writes the file, whole or not at all.
    ///
    /// # Errors
    /// Those of the file system.
    pub(super) fn write(&self, path: &Path, network: &Network) -> io::Result<()> {
        atomic::write(path, &self.to_bytes(network))
    }

    /// Reads a file and checks that it is whole; whether it fits the stage is for [`Snapshot::check`].
    ///
    /// # Errors
    /// Without the file's name.
    pub(super) fn read(path: &Path, network: &Network) -> Result<Self, FileError> {
        Self::from_bytes(&container::read(path)?, network)
    }

    fn to_bytes(&self, network: &Network) -> Vec<u8> {
        let Snapshot { agent, position, replay } = &self.snapshot;
        let places = network.tensors();
        let mut tensors: Vec<Tensor> = Tensor::network("", &places, &agent.parameters).collect();
        tensors.extend(Tensor::network("exp_avg/", &places, &agent.adam.exp_avg));
        tensors.extend(Tensor::network("exp_avg_sq/", &places, &agent.adam.exp_avg_sq));
        if let Some(target) = &agent.target {
            tensors.extend(Tensor::network("target/", &places, target));
        }
        tensors.extend(replay.iter().flat_map(replay_tensors));
        let header = Header {
            crc32: NO_CRC.to_owned(),
            format: FORMAT,
            kind: KIND.to_owned(),
            seed: agent.seed,
            stage: self.stage,
            num_timesteps: agent.counters.timesteps,
            adam_step: agent.adam.step,
            counters: agent.counters,
            position: position.clone(),
            replay: replay.as_ref().map(|replay| (replay.actions.len(), replay.next)),
            dose: self.dose,
            seconds: self.seconds,
            marks: self.marks.clone(),
            source: super::SOURCE.to_owned(),
        };
        container::to_bytes(&header, &tensors)
    }

    fn from_bytes(bytes: &[u8], network: &Network) -> Result<Self, FileError> {
        Self::take(Container::open(bytes, KIND)?, network).map_err(FileError::Foreign)
    }

    /// Takes it out of a file that fits its checksum.
    fn take(mut file: Container<'_>, network: &Network) -> Result<Self, String> {
        let header: Header = serde_json::from_str(&file.header).map_err(not_ours)?;
        let places = network.tensors();
        let mut flat = |prefix| file.network(prefix, &places);
        let missing = || not_ours("some of its weights are missing");
        let parameters = flat("")?.ok_or_else(missing)?;
        let exp_avg = flat("exp_avg/")?.ok_or_else(missing)?;
        let exp_avg_sq = flat("exp_avg_sq/")?.ok_or_else(missing)?;
        let target = flat("target/")?;
        let replay = header.replay.map(|(len, next)| take_replay(&mut file, len, next)).transpose()?;
        file.finish()?;
        let agent = AgentState {
            seed: header.seed,
            parameters,
            adam: AdamState { exp_avg, exp_avg_sq, step: header.adam_step },
            target,
            counters: Counters { timesteps: header.num_timesteps, ..header.counters },
        };
        Ok(Self {
            stage: header.stage,
            snapshot: Snapshot { agent, position: header.position, replay },
            dose: header.dose,
            seconds: header.seconds,
            marks: header.marks,
        })
    }
}

/// The replay buffer's tensors; K transitions, the observations before and after each.
fn replay_tensors(replay: &ReplayState) -> [Tensor; 5] {
    let len = replay.actions.len();
    let words = replay.visited.len() / (2 * len).max(1);
    let tensor = |name: &str, dtype, shape: &[usize], bytes| Tensor {
        name: format!("replay/{name}"),
        dtype,
        shape: shape.to_vec(),
        bytes,
    };
    [
        tensor("cells", Dtype::U16, &[len, 2], replay.cells.iter().flat_map(|v| v.to_le_bytes()).collect()),
        tensor("visited", Dtype::U64, &[len, 2, words], replay.visited.iter().flat_map(|v| v.to_le_bytes()).collect()),
        tensor("actions", Dtype::U8, &[len], replay.actions.clone()),
        Tensor::floats("replay/rewards", &[len], &replay.rewards),
        tensor("terminated", Dtype::U8, &[len], replay.terminated.iter().map(|&t| u8::from(t)).collect()),
    ]
}

/// The replay buffer of `len` transitions.
fn take_replay(file: &mut Container<'_>, len: usize, next: usize) -> Result<ReplayState, String> {
    let words = file.shape("replay/visited").and_then(|shape| shape.last().copied()).unwrap_or(0);
    let mut take = |name: &str, dtype, shape: &[usize]| {
        let name = format!("replay/{name}");
        file.take(&name, dtype, shape)?.ok_or_else(|| not_ours(format!("tensor {name} is missing")))
    };
    let (cells, _) = take("cells", Dtype::U16, &[len, 2])?.as_chunks();
    let (visited, _) = take("visited", Dtype::U64, &[len, 2, words])?.as_chunks();
    Ok(ReplayState {
        next,
        cells: cells.iter().map(|&v| u16::from_le_bytes(v)).collect(),
        visited: visited.iter().map(|&v| u64::from_le_bytes(v)).collect(),
        actions: take("actions", Dtype::U8, &[len])?.to_vec(),
        rewards: container::floats(take("rewards", Dtype::F32, &[len])?).collect(),
        terminated: take("terminated", Dtype::U8, &[len])?.iter().map(|&t| t != 0).collect(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::agent::{self, Backend, Stage};
    use crate::config::{self, Config};
    use crate::run::logs::Mark;
    use coverage_env::Level;
    use std::sync::Arc;

    /// Small networks on a map that is not square, after three rows of the log.
    fn saved(algo: &str) -> (Config, Stage, SavedSnapshot) {
        let mut sets = vec!["hidden=[3]", "max_steps=9", "num_envs=2"];
        sets.extend(match algo {
            "dqn" => ["batch_size=4", "buffer_size=50", "learning_starts=10"],
            _ => ["batch_size=8", "n_steps=16", "n_epochs=2"],
        });
        let sets: Vec<String> = sets.into_iter().map(str::to_owned).collect();
        let config = config::resolve(Some(algo), None, &sets, None).unwrap();
        let level = Arc::new(Level::from_map("l", "..T\n.#.").unwrap());
        let stage = Stage { index: 1, level: level.clone(), timesteps: 60, horizon: 60 };
        let agents = vec![agent::fresh(&config, &level, 3)];
        let mut learner = agent::learner(&config, &stage, agents, Backend::Fused);
        learner.advance();
        let saved = SavedSnapshot {
            stage: 1,
            snapshot: learner.snapshot(0),
            dose: StageDose::default(),
            seconds: 1.5,
            marks: Marks::from([("progress.csv".to_owned(), Mark { bytes: 5, crc: 6 })]),
        };
        (config, stage, saved)
    }

    #[test]
    fn what_is_written_is_read_and_fits_its_stage() {
        for algo in ["ppo", "dqn"] {
            let (config, stage, saved) = saved(algo);
            let network = agent::network(&config, &stage.level);
            let read = SavedSnapshot::from_bytes(&saved.to_bytes(&network), &network).unwrap();
            assert_eq!(read.snapshot, saved.snapshot);
            assert_eq!((read.stage, read.dose, read.seconds, &read.marks), (1, saved.dose, 1.5, &saved.marks));
            read.snapshot.check(&config, &stage).unwrap();
            let elsewhere = Stage { index: 2, ..stage };
            assert!(read.snapshot.check(&config, &elsewhere).unwrap_err().to_string().contains("random streams"));
        }
    }

    #[test]
    fn every_flipped_bit_and_every_cut_is_noticed() {
        let (config, stage, saved) = saved("dqn");
        let network = agent::network(&config, &stage.level);
        let bytes = saved.to_bytes(&network);
        for at in 0..bytes.len() {
            let mut changed = bytes.clone();
            changed[at] ^= 1 << (at % 8);
            let damaged =
                |bytes: &[u8]| matches!(SavedSnapshot::from_bytes(bytes, &network), Err(FileError::Damaged(_)));
            assert!(damaged(&changed), "byte {at}");
            assert!(damaged(&bytes[..at]), "cut to {at}");
        }
    }

    /// What is whole must not pass for damaged, which is passed over.
    #[test]
    fn what_is_whole_but_cannot_be_read_is_not_called_damaged() {
        let (config, stage, saved) = saved("ppo");
        let network = agent::network(&config, &stage.level);
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("1.safetensors");
        let refused = || SavedSnapshot::read(&path, &network).unwrap_err();
        assert!(matches!(refused(), FileError::Unreadable(_)), "there is none");
        fs::create_dir(&path).unwrap();
        assert!(matches!(refused(), FileError::Unreadable(_)), "not a file");
        fs::remove_dir(&path).unwrap();
        saved.write(&path, &network).unwrap();
        let larger = config::resolve(Some("ppo"), None, &["hidden=[4]".to_owned()], None).unwrap();
        let other = SavedSnapshot::read(&path, &agent::network(&larger, &stage.level)).unwrap_err();
        assert!(matches!(other, FileError::Foreign(_)), "{other}");
        assert!(SavedSnapshot::read(&path, &network).is_ok());
    }

    #[test]
    fn what_cannot_be_is_refused() {
        let (config, stage, saved) = saved("dqn");
        let refused = |change: fn(&mut Snapshot)| {
            let mut snapshot = saved.snapshot.clone();
            change(&mut snapshot);
            snapshot.check(&config, &stage).unwrap_err().to_string()
        };
        let replay = |snapshot: &mut Snapshot, change: fn(&mut ReplayState)| change(snapshot.replay.as_mut().unwrap());
        assert!(refused(|s| s.agent.parameters.truncate(3)).contains("network has another size"));
        assert!(refused(|s| s.replay = None).contains("another algorithm"));
        assert!(refused(|s| s.position.timesteps = 1 << 40).contains("counts"));
        assert!(refused(|s| s.position.states.truncate(1)).contains("number of environments"));
        assert!(refused(|s| s.position.starts.swap(0, 1)).contains("random streams"));
        assert!(refused(|s| s.position.states[0].agent = 60_000).contains("outside the map"));
        assert!(refused(|s| s.position.states[1].steps = 9).contains("over"));
        assert!(refused(|s| s.position.episodes.count = 50).contains("window"));
        let replays: [fn(&mut ReplayState); 4] =
            [|r| r.next = 70, |r| r.cells[3] = 6, |r| r.actions[0] = 4, |r| r.rewards.truncate(1)];
        for change in replays {
            let mut snapshot = saved.snapshot.clone();
            replay(&mut snapshot, change);
            assert!(snapshot.check(&config, &stage).unwrap_err().to_string().contains("replay buffer"));
        }
    }
}
