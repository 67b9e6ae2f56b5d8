//! What a study would train, and how long it would take.

use std::collections::BTreeMap;
use std::iter::repeat;
use std::path::PathBuf;
use std::time::Duration;

use anyhow::Result;
use indicatif::HumanDuration;
use serde::Serialize;

use crate::agent::Stage;
use crate::agent::config::Config;
use crate::agent::engine::EngineKind;
use crate::cli::output::write_stdout;
use crate::experiment::estimate::{measure_rate, trial_of_each};
use crate::messages::tell;
use crate::report::{Cell, Format, Table};
use crate::run::manifest::Manifest;
use crate::training::{Experiment, Work, queue, seconds_until_done};

/// Stages that a person is shown of one run; programs are told of all.
const SHOWN_STAGES: usize = 8;

/// Every run of a study, and the time of all.
#[derive(Debug, Serialize)]
pub struct Estimate {
    study: String,
    experiments: usize,
    runs: Vec<PlannedRun>,
    /// Timesteps of all runs.
    timesteps: u64,
    /// Those that are still to do.
    timesteps_left: u64,
    /// Threads that train.
    jobs: usize,
    /// Timesteps per second of one thread, by arm; of arms of which something is left.
    rates: BTreeMap<String, f64>,
    /// About how long all that is left takes.
    seconds: f64,
}

/// One run.
#[derive(Debug, Serialize)]
struct PlannedRun {
    arm: String,
    sequence: String,
    seed: u64,
    path: PathBuf,
    stages: Vec<PlannedStage>,
    timesteps: u64,
    timesteps_left: u64,
}

#[derive(Debug, Serialize)]
struct PlannedStage {
    level: String,
    timesteps: u64,
}

impl Estimate {
    /// Looks at what is there already. A short trial measures the speed of each arm of which something is left.
    ///
    /// # Errors
    /// An engine that is not there.
    pub fn new(
        study: &str,
        experiments: &[Experiment],
        jobs: usize,
        engine: impl Fn(&Config) -> Result<EngineKind>,
    ) -> Result<Self> {
        let mut runs: Vec<PlannedRun> = Vec::new();
        let mut left: Vec<BTreeMap<u64, u64>> = Vec::new();
        for experiment in experiments {
            let of_seed: BTreeMap<u64, u64> =
                experiment.seeds.iter().map(|&seed| (seed, timesteps_left(experiment, seed))).collect();
            runs.extend(of_seed.iter().map(|(&seed, &left)| PlannedRun::new(experiment, seed, left)));
            left.push(of_seed);
        }
        let mut to_measure: BTreeMap<&str, &Experiment> = BTreeMap::new();
        for (experiment, left) in experiments.iter().zip(&left) {
            if left.values().any(|&left| left > 0) {
                to_measure.entry(&experiment.config.name).or_insert(experiment);
            }
        }
        let trial = trial_of_each(to_measure.len());
        let mut rates = BTreeMap::new();
        for (arm, Experiment { config, curriculum, .. }) in to_measure {
            rates.insert(arm.to_owned(), measure_rate(config, &curriculum.levels[0], engine(config)?, trial));
        }
        // Seeds that share a thread are counted one after another, which is more than they take.
        let seconds = queue(experiments, jobs).into_iter().map(|Work { experiment, seeds }| {
            let timesteps: u64 = seeds.iter().map(|seed| left[experiment][seed]).sum();
            rates.get(&experiments[experiment].config.name).map_or(0.0, |rate| timesteps as f64 / rate)
        });
        let seconds = seconds_until_done(seconds, jobs);
        let total = |of: fn(&PlannedRun) -> u64| runs.iter().map(of).fold(0, u64::saturating_add);
        Ok(Self {
            study: study.to_owned(),
            experiments: experiments.len(),
            timesteps: total(|run| run.timesteps),
            timesteps_left: total(|run| run.timesteps_left),
            runs,
            jobs,
            rates,
            seconds,
        })
    }

    /// One line.
    pub fn summary(&self) -> String {
        const SHOWN: usize = 8;
        let mut rates: Vec<String> = self.rates.iter().map(|(arm, rate)| format!("{arm} {rate:.0}")).collect();
        if rates.len() > SHOWN {
            rates.truncate(SHOWN);
            rates.push("…".to_owned());
        }
        let rates = if rates.is_empty() { "nothing is left".to_owned() } else { rates.join(", ") };
        let time = HumanDuration(Duration::try_from_secs_f64(self.seconds).unwrap_or(Duration::MAX));
        let Self { study, experiments, runs, timesteps_left, jobs, .. } = self;
        format!(
            "{study}: {} of {}, {timesteps_left} timesteps to go: about {time} on {jobs} threads (timesteps/s of one: \
             {rates})",
            counted(runs.len(), "run"),
            counted(*experiments, "experiment"),
        )
    }

    /// Prints every run, and what people are to know beside the list.
    ///
    /// # Errors
    /// A stdout that cannot be written.
    pub fn print(&self, format: Format) -> Result<()> {
        write_stdout(&match format {
            Format::Json => serde_json::to_string(self)? + "\n",
            format => self.table(format).render(format),
        })?;
        if matches!(format, Format::Json | Format::Csv) {
            tell(self.summary());
        }
        Ok(())
    }

    fn table(&self, format: Format) -> Table {
        let shown = if format == Format::Csv { usize::MAX } else { SHOWN_STAGES };
        let number = |number: u64| Cell::Number(number as f64, 0);
        let row = |run: &PlannedRun| {
            vec![
                run.arm.as_str().into(),
                run.sequence.as_str().into(),
                number(run.seed),
                run.stages(shown).into(),
                number(run.timesteps),
                number(run.timesteps_left),
            ]
        };
        let columns = ["arm", "sequence", "seed", "stages (level × timesteps)", "timesteps", "to go"];
        let notes = if format == Format::Csv { Vec::new() } else { vec![self.summary()] };
        let mut rows: Vec<Vec<Cell>> = self.runs.iter().map(row).collect();
        if format != Format::Csv {
            let all: [Cell; 4] = ["all", "", "", ""].map(Cell::from);
            rows.push(all.into_iter().chain([number(self.timesteps), number(self.timesteps_left)]).collect());
        }
        Table { title: String::new(), columns: columns.map(str::to_owned).to_vec(), rows, notes }
    }
}

impl PlannedRun {
    fn new(experiment: &Experiment, seed: u64, timesteps_left: u64) -> Self {
        let stage = |stage: &Stage| PlannedStage { level: stage.level.name().to_owned(), timesteps: stage.timesteps };
        Self {
            arm: experiment.config.name.clone(),
            sequence: experiment.name(),
            seed,
            path: experiment.run_path(seed),
            stages: experiment.curriculum.trained().iter().map(stage).collect(),
            timesteps: experiment.curriculum.timesteps(),
            timesteps_left,
        }
    }

    /// `0, 1, 2 × 500000` where all stages are equally long, else `0 × 500000, 1 × 100000`; the first `shown` of many.
    fn stages(&self, shown: usize) -> String {
        let equal = self.stages.windows(2).all(|pair| pair[0].timesteps == pair[1].timesteps);
        let stage = |stage: &PlannedStage| {
            if equal { stage.level.clone() } else { format!("{} × {}", stage.level, stage.timesteps) }
        };
        let mut list: Vec<String> = self.stages.iter().take(shown).map(stage).collect();
        if self.stages.len() > shown {
            list.push(format!("… {} stages", self.stages.len()));
        }
        let each = self.stages.first().filter(|_| equal).map(|stage| format!(" × {}", stage.timesteps));
        list.join(", ") + &each.unwrap_or_default()
    }
}

/// `1 run`, `2 runs`.
fn counted(count: usize, what: &str) -> String {
    format!("{count} {what}{}", if count == 1 { "" } else { "s" })
}

/// Timesteps that a seed has still to do, of stages which it has not finished or which are to become longer.
fn timesteps_left(experiment: &Experiment, seed: u64) -> u64 {
    // Without --resume nothing may be there.
    let manifest = experiment.resume.then(|| Manifest::read(&experiment.run_path(seed)).ok()).flatten();
    let finished = manifest.map_or_else(Vec::new, |manifest| {
        let finished = manifest.stages.iter().take(manifest.stages_done.into());
        finished.map(|stage| stage.timesteps).collect()
    });
    let done = finished.into_iter().chain(repeat(0));
    let stages = experiment.curriculum.stages.iter().zip(done).skip(experiment.curriculum.begins.into());
    stages.map(|(stage, done)| stage.timesteps.saturating_sub(done)).fold(0, u64::saturating_add)
}
