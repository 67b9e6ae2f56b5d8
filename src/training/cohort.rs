//! Seeds that train on one thread: opened, trained stage by stage, saved on the way.

use std::panic::{AssertUnwindSafe, catch_unwind};

use anyhow::{Error, Result, anyhow};

use super::evaluation;
use super::saving::SinceSaved;
use super::{Event, Experiment, FinishedRun, Link, Outcome};
use crate::agent::snapshot::Snapshot;
use crate::agent::state::AgentState;
use crate::agent::{self, Metrics, Stage};
use crate::measure::probe::{Measurement, Monitor};
use crate::results::{LevelResult, Policy};
use crate::run::evaluations::Phase;
use crate::run::{Opened, RunDir, Standing};

/// Takes these seeds up where they stand and trains them to their end, or until a stop is requested.
pub(super) fn train(experiment: &Experiment, seeds: &[u64], link: &Link<'_>) -> Outcome {
    let mut outcome = Outcome::default();
    let mut cohorts: Vec<Cohort<'_>> = Vec::new();
    for &seed in seeds {
        match guarded(|| Run::open(experiment, seed, link)) {
            Ok(Taken::Finished(run)) => {
                link.tell(Event::AlreadyFinished { seed });
                outcome.finished.push(run);
            }
            Ok(Taken::Run(run)) => match cohorts.iter_mut().find(|cohort| cohort.runs[0].place() == run.place()) {
                Some(cohort) => cohort.runs.push(*run),
                None => cohorts.push(Cohort { experiment, link, runs: vec![*run] }),
            },
            Err(error) => {
                link.tell(Event::Failed { seed, why: format!("{error:#}") });
                outcome.failed.push((seed, error));
            }
        }
    }
    for mut cohort in cohorts {
        cohort.tell_of_other_company(seeds.len());
        let stopped = guarded(|| Ok(cohort.train())).unwrap_or_else(|error| {
            let why = format!("{error:#}");
            cohort.each(|_, _, _| Err(anyhow!(why.clone())));
            Stopped::AtItsEnd
        });
        outcome.extend(cohort.outcome(stopped));
    }
    outcome
}

/// Makes an error of a panic, such as libtorch's where a GPU has no memory left: other seeds go on, and what they leave is
/// told.
///
/// What `work` changes must be fit for being told of and dropped after a panic, whatever state it is in.
fn guarded<T>(work: impl FnOnce() -> Result<T>) -> Result<T> {
    catch_unwind(AssertUnwindSafe(work)).unwrap_or_else(|panic| {
        let message = panic.downcast_ref::<String>().map(String::as_str).or(panic.downcast_ref::<&str>().copied());
        Err(anyhow!("a panic ended its training: {}", message.unwrap_or("please report this")))
    })
}

/// Runs that advance together: they stand at the same timestep of the same stage.
struct Cohort<'a> {
    experiment: &'a Experiment,
    link: &'a Link<'a>,
    runs: Vec<Run>,
}

/// One seed of a cohort.
struct Run {
    seed: u64,
    dir: RunDir,
    agent: AgentState,
    /// Where its first stage goes on, if not at its beginning.
    snapshot: Option<Snapshot>,
    /// Timesteps of the stages before this one.
    before: u64,
    /// `train/n_updates` of the last row.
    updates: f64,
    failure: Option<Error>,
}

/// A seed as it was found.
enum Taken {
    Run(Box<Run>),
    Finished(FinishedRun),
}

/// Whether a stage came to its end.
#[derive(PartialEq, Eq)]
enum Stopped {
    AtItsEnd,
    BySignal,
}

impl Run {
    fn open(experiment: &Experiment, seed: u64, link: &Link<'_>) -> Result<Taken> {
        let Opened { dir, standing, notices } = RunDir::open(&experiment.run_path(seed), &experiment.plan(seed))?;
        for what in notices {
            link.tell(Event::Notice { seed, what });
        }
        let timesteps = standing.timesteps();
        let (agent, snapshot) = match standing {
            Standing::Finished => return Ok(Taken::Finished(FinishedRun::new(seed, &dir))),
            Standing::Fresh(agent) | Standing::Between(agent) => (*agent, None),
            Standing::Within(snapshot) => (snapshot.agent.clone(), Some(*snapshot)),
        };
        if timesteps > 0 {
            link.tell(Event::Resumed { seed, timesteps });
        }
        let before = agent.counters.timesteps - snapshot.as_ref().map_or(0, |snapshot| snapshot.position.timesteps);
        let updates = agent.counters.updates as f64;
        Ok(Taken::Run(Box::new(Self { seed, dir, agent, snapshot, before, updates, failure: None })))
    }

    /// What runs that advance together have in common.
    fn place(&self) -> (u16, u64, Option<u64>) {
        let stage = self.dir.stages_done();
        let timesteps = self.snapshot.as_ref().map_or(0, |snapshot| snapshot.position.timesteps);
        (stage, timesteps, self.dir.horizon(stage))
    }

    /// Does something with the run, unless it has failed; an error is its failure.
    fn attempt(&mut self, link: &Link<'_>, what: impl FnOnce(&mut Self) -> Result<()>) {
        if self.failure.is_some() {
            return;
        }
        if let Err(error) = what(self) {
            let why = format!("{error:#}");
            // The manifest may be what cannot be written; the failure is reported all the same.
            let _ = self.dir.fail(&why);
            link.tell(Event::Failed { seed: self.seed, why });
            self.failure = Some(error);
        }
    }

    /// Takes in a row of the log.
    fn log(&mut self, stage: &Stage, timesteps: u64, row: &Metrics, link: &Link<'_>) -> Result<()> {
        let cumulative = self.before + timesteps;
        check_finite(row, self.updates).map_err(|what| {
            let newest = self.dir.newest_checkpoint().map_or("none yet".to_owned(), |file| file.display().to_string());
            anyhow!(
                "{what} by timestep {cumulative} (update {}): the last good checkpoint is {newest}; a smaller \
                 learning_rate or max_grad_norm may help",
                value(row, "train/n_updates")
            )
        })?;
        self.updates = value(row, "train/n_updates");
        self.dir.log(stage, timesteps, cumulative, row)?;
        let (seed, stage, mean_return) = (self.seed, stage.index, value(row, "rollout/ep_rew_mean"));
        link.tell(Event::Progress { seed, stage, timesteps: cumulative, mean_return });
        Ok(())
    }

    /// Evaluates an agent in the midst of a stage, and keeps it if it is the best of the stage so far.
    fn evaluate_midway(
        &mut self,
        experiment: &Experiment,
        stage: &Stage,
        timesteps: u64,
        agent: &AgentState,
    ) -> Result<()> {
        let Experiment { config, midway, .. } = experiment;
        let network = config.network(&stage.level);
        let results = evaluation::of_agent(config, &network, agent, stage.index, &midway.levels(stage));
        self.dir.log_learning(stage, timesteps, self.before + timesteps, &results)?;
        let own =
            |(policy, result): &&(Policy, LevelResult)| *policy == Policy::Greedy && result.level == stage.level.name();
        match results.iter().find(own).filter(|_| midway.keep_best) {
            Some((_, result)) => self.dir.keep_best(stage, agent, result.mean),
            None => Ok(()),
        }
    }

    /// Takes in a measurement of plasticity.
    fn log_plasticity(&mut self, stage: &Stage, timesteps: u64, measurement: &Measurement) -> Result<()> {
        self.dir.log_plasticity(stage, timesteps, self.before + timesteps, measurement)
    }
}

impl Cohort<'_> {
    /// Says where seeds that were computed together with others go on without them, since a kill left them at another timestep.
    fn tell_of_other_company(&self, seeds: usize) {
        let first = &self.runs[0];
        let joined = self.experiment.engine.joins_seeds();
        if !joined || self.runs.len() == seeds || first.agent.counters.timesteps == 0 {
            return;
        }
        let together: Vec<String> = self.runs.iter().map(|run| run.seed.to_string()).collect();
        let what = format!(
            "it goes on with {} of the {seeds} seeds that it is computed with ({}), since the others stand elsewhere: its \
             numbers will differ by rounding",
            together.len(),
            together.join(", ")
        );
        self.link.tell(Event::Notice { seed: first.seed, what });
    }

    /// Trains all stages that are left.
    fn train(&mut self) -> Stopped {
        let network = self.experiment.config.network(self.experiment.level(0));
        let yaml = self.experiment.config.to_yaml();
        self.each(|experiment, _, run| {
            run.dir.write_config(&yaml)?;
            if !run.dir.evaluations().is_empty() {
                return Ok(());
            }
            let (config, levels) = (&experiment.config, &experiment.curriculum.levels);
            let stage = run.dir.stages_done();
            let results = evaluation::of_agent(config, &network, &run.agent, stage, levels);
            run.dir.evaluated(Phase::Before, stage, run.agent.counters.timesteps, &results)
        });
        let (first, _, horizon) = self.runs[0].place();
        for stage in &self.experiment.curriculum.stages[usize::from(first)..] {
            let stage = Stage { horizon: horizon.unwrap_or(stage.horizon), ..stage.clone() };
            if self.train_stage(&stage) == Stopped::BySignal {
                self.each(|_, link, run| {
                    run.dir.interrupt()?;
                    link.tell(Event::Interrupted { seed: run.seed });
                    Ok(())
                });
                return Stopped::BySignal;
            }
            self.each(|experiment, link, run| {
                let (config, levels) = (&experiment.config, &experiment.curriculum.levels);
                let results = evaluation::of_agent(config, &network, &run.agent, stage.index, levels);
                run.dir.evaluated(Phase::After, stage.index, run.agent.counters.timesteps, &results)?;
                run.dir.finish_stage(&stage, &run.agent)?;
                link.tell(Event::StageDone { seed: run.seed, stage: stage.index });
                Ok(())
            });
        }
        Stopped::AtItsEnd
    }

    fn train_stage(&mut self, stage: &Stage) -> Stopped {
        let Self { experiment, link, .. } = *self;
        let config = &experiment.config;
        let snapshot = |run: &mut Run| {
            let beginning = || Snapshot::beginning(config, stage, run.agent.clone());
            run.snapshot.take().unwrap_or_else(beginning)
        };
        let snapshots = self.runs.iter_mut().map(snapshot).collect();
        let mut learner = match agent::resume(config, stage, snapshots, experiment.engine) {
            Ok(learner) => learner,
            Err(error) => {
                self.each(|_, _, _| Err(anyhow!("{error}")));
                return Stopped::AtItsEnd;
            }
        };
        let monitor = Monitor::new(experiment.plasticity_interval, config, stage);
        if let Some(monitor) = monitor.as_ref().filter(|_| learner.timesteps() == 0) {
            for (s, run) in self.runs.iter_mut().enumerate() {
                run.attempt(link, |run| run.log_plasticity(stage, 0, &monitor.at_beginning(&*learner, s)));
            }
        }
        let mut since = SinceSaved::new();
        let mut saved_at = learner.timesteps();
        while learner.timesteps() < stage.timesteps && self.runs.iter().any(|run| run.failure.is_none()) {
            let stop = link.is_stop_requested();
            if stop && saved_at < learner.timesteps() {
                self.save(stage, &*learner);
            }
            if stop {
                return Stopped::BySignal;
            }
            let before = learner.timesteps();
            let measured = monitor.as_ref().and_then(|monitor| monitor.before(&*learner));
            let rows = learner.advance();
            for (s, (run, row)) in self.runs.iter_mut().zip(&rows).enumerate() {
                run.attempt(link, |run| {
                    run.log(stage, learner.timesteps(), row, link)?;
                    if experiment.midway.is_due(before, learner.timesteps()) {
                        run.evaluate_midway(experiment, stage, learner.timesteps(), learner.agents()[s])?;
                    }
                    let Some(measured) = &measured else { return Ok(()) };
                    let measurement = measured.after(&*learner, s, value(row, "train/grad_norm"));
                    run.log_plasticity(stage, learner.timesteps(), &measurement)
                });
            }
            // At the end of a stage its checkpoint follows, but what can be extended goes on in the stage's midst.
            let at_end = learner.timesteps() >= stage.timesteps;
            let due = since.is_due(experiment.saving);
            let saved = if at_end { experiment.curriculum.extensible } else { due };
            if saved {
                self.save(stage, &*learner);
                saved_at = learner.timesteps();
            }
        }
        for (s, run) in self.runs.iter_mut().enumerate() {
            run.agent = learner.leaving(s);
            run.before = run.agent.counters.timesteps;
        }
        Stopped::AtItsEnd
    }

    fn save(&mut self, stage: &Stage, learner: &dyn agent::Learner) {
        for (s, run) in self.runs.iter_mut().enumerate() {
            run.attempt(self.link, |run| run.dir.save(stage, learner.snapshot(s)));
        }
    }

    /// Does something with each run that has not failed.
    fn each(&mut self, what: impl Fn(&Experiment, &Link<'_>, &mut Run) -> Result<()>) {
        for run in &mut self.runs {
            run.attempt(self.link, |run| what(self.experiment, self.link, run));
        }
    }

    fn outcome(self, stopped: Stopped) -> Outcome {
        let mut outcome = Outcome::default();
        for run in self.runs {
            match run.failure {
                Some(why) => outcome.failed.push((run.seed, why)),
                None if stopped == Stopped::BySignal => outcome.interrupted.push(run.seed),
                None => outcome.finished.push(FinishedRun::new(run.seed, &run.dir)),
            }
        }
        outcome
    }
}

/// Refuses a row in which the loss, the gradient or the weights are no numbers any more; `updates` were made before it.
fn check_finite(row: &Metrics, updates: f64) -> Result<(), String> {
    for name in ["train/loss", "train/grad_norm", "train/weight_norm"] {
        let value = value(row, name);
        // DQN has neither loss nor gradient where it makes no update, as at the beginning of a stage.
        let absent = value.is_nan() && name != "train/weight_norm" && self::value(row, "train/n_updates") == updates;
        if !value.is_finite() && !absent {
            return Err(format!("{name} became {value}"));
        }
    }
    Ok(())
}

fn value(row: &Metrics, name: &str) -> f64 {
    row.iter().find(|(column, _)| *column == name).map_or(f64::NAN, |(_, value)| *value)
}

#[cfg(test)]
mod tests {
    use std::panic::panic_any;

    use super::*;

    #[test]
    fn a_panic_is_an_error_in_words() {
        assert_eq!(guarded(|| Ok(3)).unwrap(), 3);
        let of = |work: fn() -> Result<()>| guarded(work).unwrap_err().to_string();
        assert_eq!(of(|| Err(anyhow!("an error"))), "an error");
        assert!(of(|| panic!("out of memory")).contains("panic ended its training: out of memory"));
        assert!(of(|| panic_any("a text".to_owned())).contains("panic ended its training: a text"));
    }
}
