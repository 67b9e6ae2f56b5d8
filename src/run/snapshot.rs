//! The file of a [`Snapshot`]: what a run that was stopped in the midst of a stage goes on from.

use std::collections::BTreeMap;
use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use super::agent_file::{self, Described};
use super::atomic;
use super::container::{self, Container, FORMAT, FileError, NO_CRC, Tensor, not_ours};
use super::logs::Marks;
use crate::agent::buffers::{Buffers, Data};
use crate::agent::network::Network;
use crate::agent::snapshot::{Position, Snapshot};
use crate::agent::state::Counters;
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
    /// Up to version 0.1.0: transitions of the replay buffer, and the slot that is filled next.
    #[serde(default, skip_serializing)]
    replay: Option<(u64, u64)>,
    /// What mitigations count.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    extra: BTreeMap<String, u64>,
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
        let Snapshot { agent, position, buffers } = &self.snapshot;
        let mut tensors = agent_file::tensors(agent, &network.tensors(), true);
        tensors.extend(buffers.iter().map(|(name, buffer)| Tensor::buffer(name, buffer)));
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
            replay: None,
            extra: agent.kept.numbers.clone(),
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
        let described = Described {
            seed: header.seed,
            adam_step: header.adam_step,
            counters: Counters { timesteps: header.num_timesteps, ..header.counters },
            numbers: header.extra,
        };
        let (agent, has_adam) = agent_file::take(&mut file, &network.tensors(), described)?;
        if !has_adam {
            return Err(not_ours("its optimiser state is missing"));
        }
        let mut buffers = take_buffers(&mut file)?;
        if let Some((_, next)) = header.replay {
            buffers.add("replay/next", &[1], Data::U64(vec![next]));
        }
        file.finish()?;
        Ok(Self {
            stage: header.stage,
            snapshot: Snapshot { agent, position: header.position, buffers },
            dose: header.dose,
            seconds: header.seconds,
            marks: header.marks,
        })
    }
}

/// The arrays that are left once the agent is taken; whether they make sense is for the algorithm.
fn take_buffers(file: &mut Container<'_>) -> Result<Buffers, String> {
    let mut buffers = Buffers::default();
    for name in file.left().collect::<Vec<_>>() {
        if let Some(buffer) = file.buffer(&name)? {
            buffers.insert(&name, buffer);
        }
    }
    Ok(buffers)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::agent::config::{self, Config};
    use crate::agent::dqn::{Observed, ReplayState};
    use crate::agent::engine::EngineKind;
    use crate::agent::{self, Stage};
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
        let agents = vec![config.agent(&level, 3)];
        let mut learner = agent::learner(&config, &stage, agents, EngineKind::Fused);
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
            let network = config.network(&stage.level);
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
        let network = config.network(&stage.level);
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
        let network = config.network(&stage.level);
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("1.safetensors");
        let refused = || SavedSnapshot::read(&path, &network).unwrap_err();
        assert!(matches!(refused(), FileError::Unreadable(_)), "there is none");
        fs::create_dir(&path).unwrap();
        assert!(matches!(refused(), FileError::Unreadable(_)), "not a file");
        fs::remove_dir(&path).unwrap();
        saved.write(&path, &network).unwrap();
        let larger = config::resolve(Some("ppo"), None, &["hidden=[4]".to_owned()], None).unwrap();
        let other = SavedSnapshot::read(&path, &larger.network(&stage.level)).unwrap_err();
        assert!(matches!(other, FileError::Foreign(_)), "{other}");
        assert!(SavedSnapshot::read(&path, &network).is_ok());
    }

    /// A stage that began with what the stage before has left, and has overwritten some of it.
    #[test]
    fn transitions_of_earlier_stages_come_back_and_are_checked() {
        let sets = ["hidden=[3]", "max_steps=9", "num_envs=2", "batch_size=4", "buffer_size=100", "learning_starts=10"];
        let sets: Vec<String> = sets.into_iter().chain(["replay_kept=true"]).map(str::to_owned).collect();
        let config = config::resolve(Some("dqn"), None, &sets, None).unwrap();
        let stage = |index, map| {
            let level = Arc::new(Level::from_map("l", map).unwrap());
            Stage { index, level, timesteps: 64, horizon: 64 }
        };
        let (first, second) = (stage(0, "..T\n.#."), stage(1, "#..\nT.."));
        let advanced = |stage: &Stage, agent| {
            let mut learner = agent::learner(&config, stage, vec![agent], EngineKind::Fused);
            learner.advance();
            learner
        };
        let left = advanced(&first, config.agent(&first.level, 3)).leaving(0);
        assert_eq!(left.kept.buffers.get("replay/inputs").map(|buffer| &buffer.shape[..]), Some(&[64, 2, 1][..]));
        let learner = advanced(&second, left);
        assert!(learner.snapshot(0).agent.kept.buffers.is_empty(), "the stage has taken it over");
        let saved = SavedSnapshot {
            stage: 1,
            snapshot: learner.snapshot(0),
            dose: StageDose::default(),
            seconds: 0.0,
            marks: Marks::new(),
        };
        let network = config.network(&second.level);
        let read = SavedSnapshot::from_bytes(&saved.to_bytes(&network), &network).unwrap();
        assert_eq!(read.snapshot, saved.snapshot);
        read.snapshot.check(&config, &second).unwrap();
        let replay = ReplayState::read(&read.snapshot.buffers).unwrap();
        assert_eq!((replay.next, replay.actions.len(), replay.carried.len()), (28, 100, 36));
        let of = |transitions: usize, inputs: usize, active: &[u16]| {
            let mut observed = Observed::new(inputs);
            (0..2 * transitions).for_each(|_| observed.push(active));
            observed
        };
        for (carried, fits) in [
            (of(36, 24, &[23]), true),
            (of(72, 24, &[]), true),
            (of(73, 24, &[]), false),
            (of(36, 25, &[24]), false),
            (of(36, 65, &[]), false),
        ] {
            let mut snapshot = read.snapshot.clone();
            ReplayState { carried, ..replay.clone() }.write(&mut snapshot.buffers);
            let checked = snapshot.check(&config, &second).map_err(|error| error.to_string());
            let refused = checked.is_err_and(|error| error.contains("of earlier stages"));
            assert_eq!(refused, !fits);
        }
    }

    #[test]
    fn what_cannot_be_is_refused() {
        let (config, stage, saved) = saved("dqn");
        let refused = |change: fn(&mut Snapshot)| {
            let mut snapshot = saved.snapshot.clone();
            change(&mut snapshot);
            snapshot.check(&config, &stage).unwrap_err().to_string()
        };
        assert!(refused(|s| s.agent.parameters.truncate(3)).contains("network has another size"));
        assert!(refused(|s| s.buffers = Buffers::default()).contains("another algorithm"));
        assert!(refused(|s| s.agent.kept.copies.clear()).contains("another algorithm"));
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
            let mut replay = ReplayState::read(&snapshot.buffers).unwrap();
            change(&mut replay);
            replay.write(&mut snapshot.buffers);
            assert!(snapshot.check(&config, &stage).unwrap_err().to_string().contains("replay buffer"));
        }
    }
}
