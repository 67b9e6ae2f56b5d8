//! The loop: train a stage, evaluate on all levels, checkpoint; for every seed, on as many threads as there are jobs.

pub mod progress;

use std::collections::VecDeque;
use std::path::PathBuf;
use std::sync::Mutex;
use std::sync::mpsc::{Sender, channel};
use std::thread;

use anyhow::{Result, anyhow};
use coverage_env::Level;
use serde_json::Value;
use tch::Device;

use crate::agent::network::Network;
use crate::agent::state::AgentState;
use crate::agent::{self, Backend, Metrics, Stage};
use crate::config::Config;
use crate::curriculum::Curriculum;
use crate::dose::Dose;
use crate::evaluate::{self, Choose, Starts};
use crate::plasticity::Monitor;
use crate::results::LevelResult;
use crate::run::evaluations::{Phase, Row};
use crate::run::manifest::{self, Host, Manifest, StageEntry, Status, Versions, now};
use crate::run::{Opened, RunDir};

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
    /// The seeds that could not go on, and why.
    pub failed: Vec<(u64, String)>,
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
        if !self.resume {
            self.seeds.iter().try_for_each(|&seed| RunDir::refuse_existing(&self.run_path(seed)))?;
        }
        let mut runs = Vec::new();
        for &seed in &self.seeds {
            runs.push((seed, RunDir::open(&self.run_path(seed), self.manifest(seed), self.resume)?));
        }
        let mut outcome = Outcome::default();
        let mut waiting = Vec::new();
        for (seed, opened) in runs {
            match opened {
                Opened::Finished(dir) => outcome.finished.push(FinishedRun::new(seed, &dir)),
                Opened::Fresh(dir) => waiting.push((dir, agent::fresh(&self.config, self.level(0), seed))),
                Opened::Resumed(dir, agent) => waiting.push((dir, *agent)),
            }
        }

        let cohorts = Mutex::new(self.cohorts(waiting));
        let next = || cohorts.lock().unwrap_or_else(|poisoned| poisoned.into_inner()).pop_front();
        let (events, received) = channel();
        thread::scope(|scope| -> Result<()> {
            let worker = |_| {
                let (events, next) = (events.clone(), &next);
                scope.spawn(move || {
                    let mut outcome = Outcome::default();
                    while let Some(cohort) = next() {
                        outcome.extend(cohort.train(self, &events));
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
        outcome.failed.sort();
        Ok(outcome)
    }

    fn level(&self, stage: usize) -> &Level {
        &self.curriculum.stages[stage].level
    }

    /// Seeds that train side by side: stacked ones must stand at the same stage, fused ones gain nothing from company.
    fn cohorts(&self, waiting: Vec<(RunDir, AgentState)>) -> VecDeque<Cohort> {
        let size = match self.backend {
            Backend::Fused => 1,
            Backend::Autograd(_) => waiting.len().div_ceil(self.jobs).max(1),
        };
        let mut cohorts: VecDeque<Cohort> = VecDeque::new();
        for (dir, agent) in waiting {
            let stage = dir.stages_done();
            match cohorts.back_mut().filter(|cohort| cohort.stage == stage && cohort.runs.len() < size) {
                Some(cohort) => cohort.runs.push(Run::new(self, dir, agent)),
                None => cohorts.push_back(Cohort { stage, runs: vec![Run::new(self, dir, agent)] }),
            }
        }
        cohorts
    }

    fn manifest(&self, seed: u64) -> Manifest {
        let stage = |stage: &Stage| StageEntry {
            level: stage.level.name().to_owned(),
            map: stage.level.to_map(),
            timesteps: stage.timesteps,
        };
        Manifest {
            format: manifest::FORMAT,
            status: Status::Running,
            arm: self.config.name.clone(),
            curriculum: self.curriculum.name.clone(),
            seed,
            stages: self.curriculum.stages.iter().map(stage).collect(),
            stages_done: 0,
            levels: self.curriculum.levels.iter().map(|level| level.name().to_owned()).collect(),
            config: self.config.to_json(),
            dose: Dose::new(&self.config, &self.curriculum, &Value::Null).to_json(),
            kernel: self.backend.name().to_owned(),
            device: match self.backend {
                Backend::Autograd(Device::Cuda(index)) => format!("cuda:{index}"),
                _ => "cpu".to_owned(),
            },
            plasticity_interval: self.plasticity_interval,
            versions: Versions::here(),
            host: Host::here(),
            command: self.command.clone(),
            started: now(),
            updated: now(),
            seconds: 0.0,
        }
    }
}

impl Outcome {
    fn extend(&mut self, other: Self) {
        self.finished.extend(other.finished);
        self.failed.extend(other.failed);
    }
}

impl FinishedRun {
    fn new(seed: u64, dir: &RunDir) -> Self {
        Self { seed, path: dir.path().to_owned(), evaluations: dir.evaluations().to_vec() }
    }
}

/// Runs that advance together.
struct Cohort {
    /// The next stage.
    stage: u16,
    runs: Vec<Run>,
}

/// One seed of a cohort.
struct Run {
    dir: RunDir,
    agent: AgentState,
    dose: Dose,
    /// `train/n_updates` of the last row.
    updates: f64,
    failure: Option<String>,
}

impl Run {
    fn new(experiment: &Experiment, dir: RunDir, agent: AgentState) -> Self {
        let dose = Dose::new(&experiment.config, &experiment.curriculum, dir.dose());
        let updates = agent.counters.updates as f64;
        Self { dir, agent, dose, updates, failure: None }
    }

    /// Does something with the run, unless it has failed; an error is its failure.
    fn attempt(&mut self, events: &Sender<Event>, what: impl FnOnce(&mut Self) -> Result<()>) {
        if self.failure.is_some() {
            return;
        }
        if let Err(error) = what(self) {
            let why = format!("{error:#}");
            // The manifest may be what cannot be written; the failure is reported all the same.
            let _ = self.dir.fail(&why);
            let _ = events.send(Event::Failed { seed: self.agent.seed, why: why.clone() });
            self.failure = Some(why);
        }
    }
}

impl Cohort {
    /// Trains all stages that are left.
    fn train(mut self, experiment: &Experiment, events: &Sender<Event>) -> Outcome {
        let network = agent::network(&experiment.config, experiment.level(0));
        let yaml = experiment.config.to_yaml();
        for run in &mut self.runs {
            run.dir.take_up();
            run.attempt(events, |run| {
                run.dir.write_config(&yaml)?;
                if run.dir.stages_done() > 0 {
                    let (seed, timesteps) = (run.agent.seed, run.agent.counters.timesteps);
                    let _ = events.send(Event::Resumed { seed, timesteps });
                    return Ok(());
                }
                let results = evaluate_all(experiment, &network, &run.agent);
                run.dir.evaluated(Phase::Before, 0, &results)
            });
        }
        for stage in &experiment.curriculum.stages[usize::from(self.stage)..] {
            self.train_stage(experiment, stage, events);
            for run in &mut self.runs {
                run.attempt(events, |run| {
                    let results = evaluate_all(experiment, &network, &run.agent);
                    run.dir.evaluated(Phase::After, stage.index, &results)?;
                    run.dose.end_stage(&run.agent.parameters);
                    let dose = run.dose.to_json();
                    run.dir.finish_stage(stage, &network, &run.agent, dose)?;
                    let _ = events.send(Event::StageDone { seed: run.agent.seed, stage: stage.index });
                    Ok(())
                });
            }
        }
        let mut outcome = Outcome::default();
        for run in self.runs {
            match run.failure {
                None => outcome.finished.push(FinishedRun::new(run.agent.seed, &run.dir)),
                Some(why) => outcome.failed.push((run.agent.seed, why)),
            }
        }
        outcome
    }

    fn train_stage(&mut self, experiment: &Experiment, stage: &Stage, events: &Sender<Event>) {
        let agents = self.runs.iter().map(|run| run.agent.clone()).collect();
        let before: Vec<u64> = self.runs.iter().map(|run| run.agent.counters.timesteps).collect();
        let mut learner = agent::learner(&experiment.config, stage, agents, experiment.backend);
        let monitor = Monitor::new(experiment.plasticity_interval, &experiment.config, stage);
        while learner.timesteps() < stage.timesteps && self.runs.iter().any(|run| run.failure.is_none()) {
            let measured = monitor.as_ref().and_then(|monitor| monitor.before(&*learner, self.runs.len()));
            let rows = learner.advance();
            for (s, ((run, row), before)) in self.runs.iter_mut().zip(&rows).zip(&before).enumerate() {
                let timesteps = before + learner.timesteps();
                run.attempt(events, |run| {
                    check_finite(row, run.updates, timesteps)?;
                    run.updates = value(row, "train/n_updates");
                    run.dose.measure(row);
                    run.dir.log(stage, learner.timesteps(), timesteps, row)?;
                    if let Some(measured) = &measured {
                        let measures = measured.after(&*learner, s, value(row, "train/grad_norm"));
                        run.dir.log_plasticity(stage, learner.timesteps(), timesteps, &measures)?;
                    }
                    let (seed, stage, mean_return) = (run.agent.seed, stage.index, value(row, "rollout/ep_rew_mean"));
                    let _ = events.send(Event::Progress { seed, stage, timesteps, mean_return });
                    Ok(())
                });
            }
        }
        for (run, agent) in self.runs.iter_mut().zip(learner.states()) {
            run.agent = agent;
        }
    }
}

/// Every level, every start cell, the greedy policy.
fn evaluate_all(experiment: &Experiment, network: &Network, agent: &AgentState) -> Vec<LevelResult> {
    let max_steps = experiment.config.max_steps;
    let of_level = |level| {
        let choose = &mut Choose::Greedy;
        evaluate::network(network, &agent.parameters, level, max_steps, Starts::Exhaustive, choose)
    };
    experiment.curriculum.levels.iter().map(of_level).collect()
}

/// Refuses a row in which the loss, the gradient or the weights are no numbers any more; `updates` were made before it.
fn check_finite(row: &Metrics, updates: f64, timesteps: u64) -> Result<()> {
    for name in ["train/loss", "train/grad_norm", "train/weight_norm"] {
        let value = value(row, name);
        // DQN has neither loss nor gradient where it makes no update, as at the beginning of a stage.
        let absent = value.is_nan() && name != "train/weight_norm" && self::value(row, "train/n_updates") == updates;
        if !value.is_finite() && !absent {
            return Err(anyhow!(
                "{name} became {value} by timestep {timesteps}: the last finished stage is kept; a smaller \
                 learning_rate or max_grad_norm may help"
            ));
        }
    }
    Ok(())
}

fn value(row: &Metrics, name: &str) -> f64 {
    row.iter().find(|(column, _)| *column == name).map_or(f64::NAN, |(_, value)| *value)
}
