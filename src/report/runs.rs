//! How the runs below a folder stand: what `cpp-rl runs` lists.

mod log_tail;

use std::cmp::Reverse;
use std::collections::BTreeMap;
use std::fs::{self, File};
use std::io::Read;
use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime};

use anyhow::{Context, Result, anyhow};
use serde::{Deserialize, Serialize};

use super::find::{NoRun, find_runs};
use super::{Cell, Table};
use crate::error::UserError;
use crate::experiment::fork::suffix;
use crate::run::{is_held, logs, manifest};
use log_tail::LogTail;

/// A file larger than this is no manifest of ours.
const MAX_MANIFEST_BYTES: u64 = 64 << 20;

/// Everything found below a folder.
#[derive(Debug, Serialize)]
pub struct Listing {
    /// Runs and what else is there, by experiment, arm, curriculum and seed.
    pub runs: Vec<RunState>,
}

/// How one run stands; what could not be found out is absent.
#[derive(Debug, Default, Serialize)]
pub struct RunState {
    /// Its directory.
    pub path: PathBuf,
    /// The arm's name.
    pub arm: Option<String>,
    /// `curriculum` or `level-<L>`.
    pub curriculum: Option<String>,
    /// The seed's number.
    pub seed: Option<u64>,
    /// `running`, `killed` (says that it runs, but its process is gone), another state that its manifest names
    /// (`finished`, `failed`, …), `not begun` (no manifest yet), `unreadable`, or `no run` for a folder without runs.
    pub status: String,
    /// What the manifest or the file system says about it.
    pub why: Option<String>,
    /// The stage it is in or ended in, from 0.
    pub stage: Option<u16>,
    /// Its number of stages.
    pub stages: Option<usize>,
    /// Share of all stages' timesteps that are done, from 0 to 1.
    pub progress: Option<f64>,
    /// Timesteps per second over the last rows of its log.
    pub timesteps_per_second: Option<f64>,
    /// Mean return of the last 100 episodes.
    pub mean_return: Option<f64>,
    /// Seconds since something was written.
    pub age_seconds: Option<f64>,
}

/// What this needs of a manifest. Any state is taken, so that runs of other versions are listed too.
#[derive(Deserialize)]
struct Head {
    status: State,
    arm: String,
    curriculum: String,
    seed: u64,
    stages: Vec<Stage>,
    stages_done: u16,
    #[serde(default)]
    fork: Option<Fork>,
}

#[derive(Deserialize)]
struct Fork {
    after: u16,
    name: String,
}

#[derive(Deserialize)]
struct State {
    state: String,
    why: Option<String>,
}

#[derive(Deserialize)]
struct Stage {
    timesteps: u64,
}

impl Listing {
    /// Looks at everything below a folder.
    ///
    /// # Errors
    /// A folder that cannot be read.
    pub fn read(directory: &Path) -> Result<Self> {
        let found = find_runs(directory).map_err(|error| {
            let remedy = "give the folder of runs (what --out named)";
            UserError::new(format!("cannot read the directory {}: {error}; {remedy}", directory.display()))
        })?;
        let now = SystemTime::now();
        let mut runs: Vec<RunState> = found.runs.into_iter().map(|path| RunState::read(path, now)).collect();
        runs.extend(found.others.into_iter().map(|(path, why)| RunState::other(path, &why)));
        runs.sort_by(|a, b| a.order().cmp(&b.order()));
        Ok(Self { runs })
    }

    /// Puts what runs first, so that it is seen where space is short.
    pub fn live_first(&mut self) {
        self.runs.sort_by_key(|run| Reverse(run.status == "running"));
    }

    /// The table for people, of as many runs as take no more than `lines`.
    pub fn table(&self, lines: usize) -> Table {
        let text = |text: &Option<String>| text.as_deref().map_or(Cell::Missing, Cell::from);
        let number = |value: Option<f64>, decimals| value.map_or(Cell::Missing, |value| Cell::Number(value, decimals));
        let row = |run: &RunState| {
            vec![
                run.experiment().display().to_string().into(),
                text(&run.arm),
                text(&run.curriculum),
                number(run.seed.map(|seed| seed as f64), 0),
                run.status.as_str().into(),
                run.stage.zip(run.stages).map_or(Cell::Missing, |(i, n)| format!("{}/{n}", i + 1).into()),
                run.progress.map_or(Cell::Missing, |share| format!("{:.1}%", 100.0 * share).into()),
                number(run.timesteps_per_second, 0),
                number(run.mean_return.filter(|value| value.is_finite()), 1),
                run.age_seconds.map_or(Cell::Missing, |age| in_words(age).into()),
            ]
        };
        let mut left = lines;
        let fits = |run: &&RunState| {
            let fitting = left.checked_sub(1 + usize::from(run.why.is_some()));
            left = fitting.unwrap_or(0);
            fitting.is_some()
        };
        let shown: Vec<&RunState> = self.runs.iter().take_while(fits).collect();
        let columns =
            ["folder", "arm", "curriculum", "seed", "status", "stage", "done", "timesteps/s", "return", "last write"];
        let mut notes: Vec<String> = shown.iter().filter_map(|run| run.note()).collect();
        notes.push(self.summary(self.runs.len() - shown.len()));
        Table {
            title: String::new(),
            columns: columns.map(str::to_owned).to_vec(),
            rows: shown.into_iter().map(row).collect(),
            notes,
        }
    }

    /// The table for programs: whole paths, numbers in full.
    pub fn full_table(&self) -> Table {
        let text = |text: &Option<String>| text.as_deref().map_or(Cell::Missing, Cell::from);
        let number = |value: Option<f64>| value.map_or(Cell::Missing, |value| Cell::Number(value, 0));
        let row = |run: &RunState| {
            vec![
                run.path.display().to_string().into(),
                text(&run.arm),
                text(&run.curriculum),
                run.seed.map_or(Cell::Missing, |seed| seed.to_string().into()),
                run.status.as_str().into(),
                text(&run.why),
                number(run.stage.map(f64::from)),
                number(run.stages.map(|n| n as f64)),
                number(run.progress),
                number(run.timesteps_per_second),
                number(run.mean_return.filter(|value| value.is_finite())),
                number(run.age_seconds),
            ]
        };
        let columns = [
            "path",
            "arm",
            "curriculum",
            "seed",
            "status",
            "why",
            "stage",
            "stages",
            "progress",
            "timesteps_per_second",
            "mean_return",
            "age_seconds",
        ];
        Table {
            columns: columns.map(str::to_owned).to_vec(),
            rows: self.runs.iter().map(row).collect(),
            ..Table::default()
        }
    }

    /// How many there are of which status.
    fn summary(&self, hidden: usize) -> String {
        let mut counts = BTreeMap::new();
        self.runs.iter().for_each(|run| *counts.entry(run.status.as_str()).or_insert(0_usize) += 1);
        let counts: Vec<String> = counts.iter().map(|(status, count)| format!("{count} {status}")).collect();
        let hidden = if hidden > 0 { format!("; {hidden} are not shown") } else { String::new() };
        if counts.is_empty() { "no runs".to_owned() } else { counts.join(", ") + &hidden }
    }
}

impl RunState {
    fn read(path: PathBuf, now: SystemTime) -> Self {
        let head = match Head::read(&path) {
            Ok(head) => head,
            Err(error) => return Self::unreadable(path, format!("{error:#}")),
        };
        // A log that cannot be read says as little as one that is not there yet.
        let log = LogTail::read(&path.join(logs::PROGRESS)).ok().flatten();
        let killed = head.status.state == "running" && !is_held(&path);
        let (stage, progress) = head.stage_and_progress(log.as_ref());
        let suffix = head.fork.map(|fork| suffix(fork.after, &fork.name)).unwrap_or_default();
        Self {
            arm: Some(head.arm),
            curriculum: Some(head.curriculum + &suffix),
            seed: Some(head.seed),
            status: if killed { "killed".to_owned() } else { head.status.state },
            why: head.status.why,
            stage: Some(stage),
            stages: Some(head.stages.len()),
            progress: Some(progress),
            timesteps_per_second: log.as_ref().and_then(LogTail::rate),
            mean_return: log.as_ref().and_then(|log| log.last("rollout/ep_rew_mean")),
            age_seconds: age(&path, now).map(|age| age.as_secs_f64()),
            path,
        }
    }

    fn unreadable(path: PathBuf, why: String) -> Self {
        Self { path, status: "unreadable".to_owned(), why: Some(why), ..Self::default() }
    }

    fn other(path: PathBuf, why: &NoRun) -> Self {
        match why {
            NoRun::Unreadable(error) => Self::unreadable(path, error.to_string()),
            NoRun::NotBegun => Self { path, status: "not begun".to_owned(), ..Self::default() },
            NoRun::Foreign => Self { path, status: "no run".to_owned(), ..Self::default() },
        }
    }

    /// The experiment's folder, where the path ends in arm, curriculum and seed as usual; the whole path elsewhere.
    fn experiment(&self) -> &Path {
        let usual = || {
            let tail =
                Path::new(self.arm.as_ref()?).join(self.curriculum.as_ref()?).join(format!("seed-{}", self.seed?));
            self.path.ends_with(&tail).then(|| self.path.ancestors().nth(3)).flatten()
        };
        usual().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(&self.path)
    }

    fn order(&self) -> impl Ord + '_ {
        (self.experiment(), self.arm.as_deref(), self.curriculum.as_deref(), self.seed, &self.path)
    }

    /// What a line below the table says of it.
    fn note(&self) -> Option<String> {
        self.why.as_ref().map(|why| format!("{}: {}: {why}", self.path.display(), self.status))
    }
}

impl Head {
    fn read(run: &Path) -> Result<Self> {
        let path = run.join(manifest::FILE);
        let mut text = String::new();
        let read = File::open(&path).and_then(|file| file.take(MAX_MANIFEST_BYTES).read_to_string(&mut text));
        read.context("cannot read manifest.json")?;
        serde_json::from_str(&text).map_err(|error| anyhow!("manifest.json is not cpp-rl's: {error}"))
    }

    /// The stage it is in, and the share of its timesteps that are done.
    fn stage_and_progress(&self, log: Option<&LogTail>) -> (u16, f64) {
        let last = u16::try_from(self.stages.len()).unwrap_or(u16::MAX).saturating_sub(1);
        let logged = log.and_then(|log| Some((log.last("stage")? as u16, log.last("time/total_timesteps")?)));
        let (stage, timesteps) =
            logged.filter(|(stage, _)| *stage >= self.stages_done).unwrap_or((self.stages_done, 0.0));
        let asked = |stage: &Stage| stage.timesteps as f64;
        // Those before were the parent's of a fork.
        let begins = self.fork.as_ref().map_or(0, |fork| usize::from(fork.after) + 1);
        let before: f64 = self.stages.iter().take(usize::from(stage)).skip(begins).map(asked).sum();
        // PPO goes on to the end of its rollout, past the timesteps asked for.
        let within = self.stages.get(usize::from(stage)).map_or(0.0, |s| timesteps.min(asked(s)));
        let total: f64 = self.stages.iter().skip(begins).map(asked).sum();
        (stage.min(last), if total > 0.0 { (before + within) / total } else { 1.0 })
    }
}

/// Time since the log or the manifest was written; none on a clock that went back.
fn age(run: &Path, now: SystemTime) -> Option<Duration> {
    let written = |name: &str| fs::metadata(run.join(name)).and_then(|file| file.modified()).ok();
    let last = [logs::PROGRESS, manifest::FILE].into_iter().filter_map(written).max()?;
    Some(now.duration_since(last).unwrap_or_default())
}

/// An age as people say it.
fn in_words(seconds: f64) -> String {
    match seconds {
        s if s < 120.0 => format!("{s:.0} s"),
        s if s < 7200.0 => format!("{:.0} min", s / 60.0),
        s if s < 172_800.0 => format!("{:.0} h", s / 3600.0),
        s => format!("{:.0} d", s / 86400.0),
    }
}
