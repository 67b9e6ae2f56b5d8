//! The loop: train a stage, evaluate on all levels, checkpoint; for every seed, on as many threads as there are jobs.

mod cohort;
pub mod progress;
pub mod saving;

use std::collections::VecDeque;
use std::path::PathBuf;
use std::sync::Mutex;
use std::sync::mpsc::channel;
use std::thread;

use anyhow::{Error, Result, anyhow};
use coverage_env::Level;
use rustix::process::{Resource, Rlimit, getrlimit, setrlimit};
use serde_json::Value;
use tch::Device;

use crate::agent::{Backend, Stage};
use crate::config::Config;
use crate::curriculum::Curriculum;
use crate::dose::Dose;
use crate::run::evaluations::Row;
use crate::run::manifest::{self, Host, Manifest, StageEntry, Status, Versions, now};
use crate::run::{Plan, RunDir};
use saving::{Saving, Stop};

/// Everything that one start of training needs.
#[derive(Clone, Debug)]
pub struct Experiment {
    /// The settings of every run.
    pub config: Config,
    /// What is trained and evaluated on.
    pub curriculum: Curriculum,
    /// One run for each.
    pub seeds: Vec<u64>,
    /// The experiment's folder.
    pub out: PathBuf,
    /// Threads that train.
    pub jobs: usize,
    /// How networks are computed.
    pub backend: Backend,
    /// Whether runs that are there already go on.
    pub resume: bool,
    /// Timesteps between two measurements of plasticity; 0 for none.
    pub plasticity_interval: u64,
    /// How often running stages are saved.
    pub saving: Saving,
    /// Asks for an early end.
    pub stop: Stop,
    /// The command as it was typed, for the manifest.
    pub command: Vec<String>,
}

/// What happens while an experiment runs, for whoever shows it.
#[derive(Clone, Debug)]
pub enum Event {
    /// A seed made an update.
    Progress {
        /// The seed.
        seed: u64,
        /// The stage's number.
        stage: u16,
        /// Timesteps of all stages so far.
        timesteps: u64,
        /// Mean return of the last 100 episodes.
        mean_return: f64,
    },
    /// All stages of a seed were done by earlier starts.
    AlreadyFinished {
        /// The seed.
        seed: u64,
    },
    /// A seed was there before: these timesteps were done by an earlier start.
    Resumed {
        /// The seed.
        seed: u64,
        /// Timesteps done before.
        timesteps: u64,
    },
    /// A stage's checkpoint and evaluations are written.
    StageDone {
        /// The seed.
        seed: u64,
        /// The stage's number.
        stage: u16,
    },
    /// Something that the user should know of a seed which goes on.
    Notice {
        /// The seed.
        seed: u64,
        /// What.
        what: String,
    },
    /// A stop was requested, and the seed is saved.
    Interrupted {
        /// The seed.
        seed: u64,
    },
    /// A seed cannot go on.
    Failed {
        /// The seed.
        seed: u64,
        /// Why.
        why: String,
    },
}

/// What an experiment left.
#[derive(Debug, Default)]
pub struct Outcome {
    /// The runs whose stages are all done, in the order of the seeds.
    pub finished: Vec<FinishedRun>,
    /// The seeds that were saved before their end, since a stop was requested.
    pub interrupted: Vec<u64>,
    /// The seeds that could not go on, and why.
    pub failed: Vec<(u64, Error)>,
}

/// A run whose stages are all done.
#[derive(Clone, Debug)]
pub struct FinishedRun {
    /// The seed.
    pub seed: u64,
    /// Its directory.
    pub path: PathBuf,
    /// All its evaluations.
    pub evaluations: Vec<Row>,
}

impl Experiment {
    /// The directory of a seed's run.
    pub fn run_path(&self, seed: u64) -> PathBuf {
        self.out.join(&self.config.name).join(&self.curriculum.name).join(format!("seed-{seed}"))
    }

    /// Trains all seeds; `on_event` is called on this thread.
    ///
    /// # Errors
    /// What keeps runs from starting at all. A seed that fails later is part of the outcome; the others go on.
    pub fn run(&self, mut on_event: impl FnMut(Event)) -> Result<Outcome> {
        tch::set_num_threads(1);
        allow_open_files();
        self.seeds.iter().try_for_each(|&seed| RunDir::look(&self.run_path(seed), &self.plan(seed)))?;
        // Directories are opened when their turn comes, since a process can have only so many files open.
        let cohorts: VecDeque<&[u64]> = self.seeds.chunks(self.cohort_size()).collect();
        let cohorts = Mutex::new(cohorts);
        let next = || cohorts.lock().unwrap_or_else(|poisoned| poisoned.into_inner()).pop_front();
        let mut outcome = Outcome::default();
        let (events, received) = channel();
        thread::scope(|scope| -> Result<()> {
            let worker = |_| {
                let (events, next) = (events.clone(), &next);
                scope.spawn(move || {
                    let mut outcome = Outcome::default();
                    while let Some(seeds) = next().filter(|_| !self.stop.is_requested()) {
                        outcome.extend(cohort::train(self, seeds, &events));
                    }
                    outcome
                })
            };
            let workers: Vec<_> = (0..self.jobs).map(worker).collect();
            drop(events);
            received.iter().for_each(&mut on_event);
            for worker in workers {
                outcome.extend(worker.join().map_err(|_| anyhow!("a training thread panicked: please report this"))?);
            }
            Ok(())
        })?;
        outcome.finished.sort_by_key(|run| self.seeds.iter().position(|&seed| seed == run.seed));
        outcome.interrupted.sort_unstable();
        outcome.failed.sort_unstable_by_key(|(seed, _)| *seed);
        Ok(outcome)
    }

    fn level(&self, stage: usize) -> &Level {
        &self.curriculum.stages[stage].level
    }

    /// Seeds that train side by side: stacked ones share a thread's work, fused ones gain nothing from company.
    fn cohort_size(&self) -> usize {
        match self.backend {
            Backend::Fused => 1,
            Backend::Autograd(_) => self.seeds.len().div_ceil(self.jobs).max(1),
        }
    }

    /// What the run of a seed is to be.
    fn plan(&self, seed: u64) -> Plan<'_> {
        Plan {
            manifest: self.manifest(seed),
            config: &self.config,
            stages: &self.curriculum.stages,
            extensible: self.curriculum.extensible,
            resume: self.resume,
        }
    }

    fn manifest(&self, seed: u64) -> Manifest {
        let stage = |stage: &Stage| StageEntry {
            level: stage.level.name().to_owned(),
            map: stage.level.to_map(),
            timesteps: stage.timesteps,
            horizon: None,
        };
        Manifest {
            format: manifest::FORMAT,
            status: Status::Running,
            arm: self.config.name.clone(),
            curriculum: self.curriculum.name.clone(),
            seed,
            stages: self.curriculum.stages.iter().map(stage).collect(),
            stages_done: 0,
            marks: Vec::new(),
            levels: self.curriculum.levels.iter().map(|level| level.name().to_owned()).collect(),
            config: self.config.to_json(),
            dose: Dose::new(&self.config, &self.curriculum, &Value::Null).to_json(),
            kernel: self.backend.name().to_owned(),
            device: match self.backend {
                Backend::Autograd(Device::Cuda(index)) => format!("cuda:{index}"),
                _ => "cpu".to_owned(),
            },
            versions: Versions::here(),
            host: Host::here(),
            command: self.command.clone(),
            plasticity_interval: self.plasticity_interval,
            starts: Vec::new(),
            started: now(),
            updated: now(),
            seconds: 0.0,
        }
    }
}

/// Lets this process open as many files as it can be let. A run that trains has four open; seeds that are stacked all
/// train at once, and may be more than the usual limit allows.
fn allow_open_files() {
    let limit = getrlimit(Resource::Nofile);
    // Where it is refused, the file that cannot be opened is an error of its seed.
    let _ = setrlimit(Resource::Nofile, Rlimit { current: limit.maximum, ..limit });
}

impl Outcome {
    fn extend(&mut self, other: Self) {
        self.finished.extend(other.finished);
        self.interrupted.extend(other.interrupted);
        self.failed.extend(other.failed);
    }
}

impl FinishedRun {
    fn new(seed: u64, dir: &RunDir) -> Self {
        Self { seed, path: dir.path().to_owned(), evaluations: dir.evaluations().to_vec() }
    }
}
