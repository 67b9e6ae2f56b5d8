//! The training loop: train a stage, evaluate on all levels, write a checkpoint. It does so for every seed of every
//! experiment, on as many threads as there are jobs.

mod cohort;
pub mod evaluation;
pub mod progress;
mod queue;
pub mod saving;

use std::path::PathBuf;
use std::sync::mpsc::{Sender, channel};
use std::thread::{self, ScopedJoinHandle};

use anyhow::{Error, Result, anyhow};
use coverage_env::Level;
use rustix::process::{Resource, Rlimit, getrlimit, setrlimit};

use crate::agent::config::Config;
use crate::agent::engine::EngineKind;
use crate::experiment::Curriculum;
use crate::run::evaluations::Row;
use crate::run::manifest::Engine;
use crate::run::{Parents, Plan, RunDir};
use evaluation::Midway;
use queue::Queue;
use saving::{Saving, Stop};

pub use queue::{Work, queue, seconds_until_done};

/// What is trained, for each of its seeds.
#[derive(Clone, Debug)]
pub struct Experiment {
    /// The settings of every run.
    pub config: Config,
    /// What is trained and evaluated on.
    pub curriculum: Curriculum,
    /// One run for each.
    pub seeds: Vec<u64>,
    /// What they go on from, if they are forks.
    pub parents: Option<Parents>,
    /// The experiment's folder.
    pub out: PathBuf,
    /// How networks are computed.
    pub engine: EngineKind,
    /// Whether existing runs are continued.
    pub resume: bool,
    /// Timesteps between two measurements of plasticity; 0 for none.
    pub plasticity_interval: u64,
    /// Evaluations in the midst of stages.
    pub midway: Midway,
    /// How often running stages are saved.
    pub saving: Saving,
    /// The command as it was typed, for the manifest.
    pub command: Vec<String>,
}

/// What happens while an experiment runs, told to whoever shows it.
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
    /// A seed is continued: an earlier start did these timesteps.
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
    /// Something that the user should know about a seed. The seed goes on.
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

/// What an experiment left, each list in the order of the seeds.
#[derive(Debug, Default)]
pub struct Outcome {
    /// The runs whose stages are all done.
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

/// Trains all seeds of all experiments from one queue, on as many threads as there are jobs.
///
/// `on_event` gets each event, `on_end` each experiment that has ended. Both are called on this thread, with the
/// experiment's place in the list.
///
/// # Errors
/// What keeps runs from starting at all. A seed that fails later is part of the outcome, and the others go on.
pub fn train(
    experiments: &[Experiment],
    jobs: usize,
    stop: &Stop,
    mut on_event: impl FnMut(usize, Event),
    mut on_end: impl FnMut(usize, &Outcome),
) -> Result<Vec<Outcome>> {
    allow_open_files();
    for experiment in experiments {
        let look = |&seed: &u64| RunDir::look(&experiment.run_path(seed), &experiment.plan(seed));
        experiment.seeds.iter().try_for_each(look)?;
    }
    let work = queue(experiments, jobs);
    let mut left = vec![0; experiments.len()];
    work.iter().for_each(|work| left[work.experiment] += 1);
    // A directory is opened when its turn comes, since a process can have only so many files open.
    let queue = Queue::new(experiments, work);
    let mut outcomes: Vec<Outcome> = experiments.iter().map(|_| Outcome::default()).collect();
    let (news, received) = channel();
    thread::scope(|scope| -> Result<()> {
        let worker = |_| {
            let (news, queue) = (news.clone(), &queue);
            scope.spawn(move || {
                while let Some(taken) = queue.take(stop) {
                    let Work { experiment, seeds } = taken.work;
                    let link = Link { experiment, news: &news, stop };
                    let outcome = cohort::train(&experiments[experiment], seeds, &link);
                    link.send(News::Ended(outcome));
                }
            })
        };
        let workers: Vec<_> = (0..jobs).map(worker).collect();
        drop(news);
        for (i, news) in received {
            match news {
                News::Event(event) => on_event(i, event),
                News::Ended(outcome) => {
                    outcomes[i].extend(outcome);
                    left[i] -= 1;
                    if left[i] == 0 {
                        on_end(i, &outcomes[i]);
                    }
                }
            }
        }
        let joined = workers.into_iter().try_for_each(ScopedJoinHandle::join);
        joined.map_err(|_| anyhow!("a training thread panicked: please report this"))
    })?;
    Ok(outcomes)
}

/// How a training thread sends news and is asked to stop.
struct Link<'a> {
    /// The experiment that it is at.
    experiment: usize,
    news: &'a Sender<(usize, News)>,
    stop: &'a Stop,
}

/// What a thread tells.
enum News {
    Event(Event),
    /// A cohort's training has ended.
    Ended(Outcome),
}

impl Link<'_> {
    fn tell(&self, event: Event) {
        self.send(News::Event(event));
    }

    fn send(&self, news: News) {
        // Nobody listens only if the thread that waits for this one has panicked.
        let _ = self.news.send((self.experiment, news));
    }

    fn is_stop_requested(&self) -> bool {
        self.stop.is_requested()
    }
}

impl Experiment {
    /// `ppo, level-0`: the arm and the curriculum, with the fork if it is one.
    pub fn label(&self) -> String {
        format!("{}, {}", self.config.name, self.name())
    }

    /// The curriculum's name, and what says how a fork differs from it: the name of the folder below the arm's.
    pub fn name(&self) -> String {
        let suffix = self.parents.as_ref().map(|parents| parents.fork.suffix());
        self.curriculum.name.clone() + &suffix.unwrap_or_default()
    }

    /// The experiment's own folder.
    pub fn folder(&self) -> PathBuf {
        self.out.join(&self.config.name).join(self.name())
    }

    /// The directory of a seed's run.
    pub fn run_path(&self, seed: u64) -> PathBuf {
        self.folder().join(format!("seed-{seed}"))
    }

    fn level(&self, stage: usize) -> &Level {
        &self.curriculum.stages[stage].level
    }

    /// How many seeds a thread trains together. The libtorch engine gains from it, the fused engine does not.
    fn cohort_size(&self, jobs: usize) -> usize {
        if self.engine.joins_seeds() { self.seeds.len().div_ceil(jobs).max(1) } else { 1 }
    }

    /// What the run of a seed is to be.
    fn plan(&self, seed: u64) -> Plan<'_> {
        let engine = if self.engine.joins_seeds() { Engine::Libtorch } else { Engine::Fused };
        Plan {
            config: &self.config,
            curriculum: &self.curriculum,
            parents: self.parents.as_ref(),
            seed,
            engine,
            device: self.engine.device().to_string(),
            plasticity_interval: self.plasticity_interval,
            evaluate_every: self.midway.every,
            keep_best: self.midway.keep_best,
            command: &self.command,
            resume: self.resume,
        }
    }
}

/// Raises the limit of open files as far as allowed. A run that trains has four files open. Seeds that are computed
/// together all train at once, and can need more files than the usual limit allows.
fn allow_open_files() {
    let limit = getrlimit(Resource::Nofile);
    // If this is refused, a file that cannot be opened is an error of its seed.
    let _ = setrlimit(Resource::Nofile, Rlimit { current: limit.maximum, ..limit });
}

#[cfg(test)]
impl Experiment {
    /// One that is never carried out.
    fn example(curriculum: Curriculum, seeds: &[u64], engine: EngineKind) -> Self {
        Self {
            config: crate::agent::config::resolve(Some("ppo"), None, &[], None).unwrap(),
            curriculum,
            seeds: seeds.to_vec(),
            parents: None,
            out: PathBuf::new(),
            engine,
            resume: false,
            plasticity_interval: 0,
            midway: Midway::default(),
            saving: Saving::default(),
            command: Vec::new(),
        }
    }
}

/// `seed 3` where there is one experiment; `ppo, level-0, seed 3` where there are several.
pub fn run_label(experiments: &[Experiment], experiment: usize, seed: u64) -> String {
    match experiments {
        [_] => format!("seed {seed}"),
        several => format!("{}, seed {seed}", several[experiment].label()),
    }
}

impl Outcome {
    fn extend(&mut self, other: Self) {
        self.finished.extend(other.finished);
        self.finished.sort_by_key(|run| run.seed);
        self.interrupted.extend(other.interrupted);
        self.interrupted.sort_unstable();
        self.failed.extend(other.failed);
        self.failed.sort_by_key(|(seed, _)| *seed);
    }
}

impl FinishedRun {
    fn new(seed: u64, dir: &RunDir) -> Self {
        Self { seed, path: dir.path().to_owned(), evaluations: dir.evaluations().to_vec() }
    }
}
