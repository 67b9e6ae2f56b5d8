//! What a person sees of a training: bars on a terminal, plain lines elsewhere.

use std::collections::BTreeMap;
use std::fmt::Write;
use std::io::{IsTerminal, stderr};
use std::time::{Duration, Instant};

use indicatif::{MultiProgress, ProgressBar, ProgressState, ProgressStyle};

use super::{Event, Experiment};
use crate::error::tell;

/// Up to this many seeds have a bar each; more share one.
const BARS: usize = 8;
/// Seconds between two plain lines.
const LINE_INTERVAL: Duration = Duration::from_secs(5);

/// How much is shown on stderr.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Verbosity {
    /// Failures only.
    Quiet,
    /// Progress.
    Normal,
    /// The resolved settings and every stage's end too.
    Verbose,
}

/// Shows [`Event`]s on stderr.
pub struct Progress {
    start: Instant,
    /// Timesteps of all seeds when everything is done.
    total: u64,
    per_seed: u64,
    stages: usize,
    seeds: BTreeMap<u64, SeedProgress>,
    num_seeds: usize,
    verbose: bool,
    view: View,
}

#[derive(Clone, Copy)]
struct SeedProgress {
    timesteps: u64,
    /// Done by earlier starts.
    before: u64,
    stage: u16,
    mean_return: f64,
}

enum View {
    Quiet,
    Lines { last: Instant },
    Bars { all: MultiProgress, total: ProgressBar, seeds: BTreeMap<u64, ProgressBar> },
}

impl Progress {
    /// For one experiment.
    pub fn new(experiment: &Experiment, verbosity: Verbosity) -> Self {
        let start = Instant::now();
        let per_seed = experiment.curriculum.timesteps();
        let total = per_seed * experiment.seeds.len() as u64;
        let view = if verbosity == Verbosity::Quiet {
            View::Quiet
        } else if stderr().is_terminal() {
            let all = MultiProgress::new();
            let style = "{bar:30} {percent:>3}%  {human_pos}/{human_len} timesteps  {rate}  left {eta}  {msg}";
            let style = ProgressStyle::with_template(style).unwrap_or_else(|_| ProgressStyle::default_bar());
            let style = style.with_key("rate", |state: &ProgressState, out: &mut dyn Write| {
                // A rate that cannot be written is not shown.
                let _ = write!(out, "{:.0}/s", state.per_sec());
            });
            let bar = all.add(ProgressBar::new(total).with_style(style));
            View::Bars { all, total: bar, seeds: BTreeMap::new() }
        } else {
            View::Lines { last: start }
        };
        let stages = experiment.curriculum.stages.len();
        let num_seeds = experiment.seeds.len();
        let verbose = verbosity == Verbosity::Verbose;
        Self { start, total, per_seed, stages, seeds: BTreeMap::new(), num_seeds, verbose, view }
    }

    /// Takes in one event.
    pub fn show(&mut self, event: Event) {
        match event {
            Event::Progress { seed, stage, timesteps, mean_return } => {
                let before = self.seeds.get(&seed).map_or(0, |seed| seed.before);
                self.seeds.insert(seed, SeedProgress { timesteps, before, stage, mean_return });
                self.update(seed);
            }
            Event::Resumed { seed, timesteps } => {
                let at = SeedProgress { timesteps, before: timesteps, stage: 0, mean_return: f64::NAN };
                self.seeds.insert(seed, at);
                self.line(&format!("seed {seed} goes on after {timesteps} timesteps"));
            }
            Event::StageDone { seed, stage } => {
                self.line(&format!("seed {seed}: stage {stage} is done, the last is {}", self.stages - 1));
            }
            Event::Notice { seed, what } => self.important(&format!("seed {seed}: {what}")),
            Event::Interrupted { seed } => self.line(&format!("seed {seed} is saved")),
            Event::Failed { seed, why } => self.important(&format!("seed {seed} failed: {why}")),
        }
    }

    /// Runs `print` with the bars out of its way.
    pub fn suspend(&self, print: impl FnOnce()) {
        match &self.view {
            View::Bars { all, .. } => all.suspend(print),
            View::Quiet | View::Lines { .. } => print(),
        }
    }

    /// Takes the bars away.
    pub fn finish(&self) {
        if let View::Bars { all, .. } = &self.view {
            // A terminal that cannot be cleared is no reason to fail.
            let _ = all.clear();
        }
    }

    fn done(&self) -> (u64, u64) {
        let sum = |of: fn(&SeedProgress) -> u64| self.seeds.values().map(of).sum::<u64>();
        (sum(|seed| seed.timesteps.max(seed.before)), sum(|seed| seed.before))
    }

    fn update(&mut self, seed: u64) {
        let (done, before) = self.done();
        let summary = self.summary(done, before);
        let (per_seed, stages) = (self.per_seed, self.stages);
        match &mut self.view {
            View::Quiet => {}
            View::Lines { last } if last.elapsed() < LINE_INTERVAL => {}
            View::Lines { last } => {
                *last = Instant::now();
                tell(summary);
            }
            View::Bars { all, total, seeds } => {
                total.set_position(done.min(self.total));
                let at = self.seeds[&seed];
                if self.num_seeds > BARS {
                    total.set_message(format!("return {:.1}", mean_return(&self.seeds)));
                    return;
                }
                let bar = seeds.entry(seed).or_insert_with(|| {
                    let style = "  {prefix:10} {bar:30} {percent:>3}%  {msg}";
                    let style = ProgressStyle::with_template(style).unwrap_or_else(|_| ProgressStyle::default_bar());
                    all.add(ProgressBar::new(per_seed).with_style(style).with_prefix(format!("seed {seed}")))
                });
                bar.set_position(at.timesteps.min(per_seed));
                bar.set_message(format!("stage {}/{}  return {:.1}", at.stage + 1, stages, at.mean_return));
                if at.timesteps >= per_seed {
                    bar.abandon();
                }
            }
        }
    }

    fn summary(&self, done: u64, before: u64) -> String {
        let seconds = self.start.elapsed().as_secs_f64();
        let rate = (done - before) as f64 / seconds.max(1e-9);
        let left = Duration::from_secs_f64(self.total.saturating_sub(done) as f64 / rate.max(1e-9));
        let left = indicatif::HumanDuration(left);
        format!(
            "{:5.1}%  {done} of {} timesteps  {rate:.0}/s  about {left} left  return {:.1} over {} seeds",
            // PPO goes on to the end of its rollout, past the timesteps asked for.
            (100.0 * done as f64 / self.total as f64).min(100.0),
            self.total,
            mean_return(&self.seeds),
            self.seeds.len()
        )
    }

    /// A line for whoever watches.
    fn line(&self, text: &str) {
        match &self.view {
            View::Quiet => {}
            View::Bars { .. } if !self.verbose => {}
            View::Lines { .. } | View::Bars { .. } => self.important(text),
        }
    }

    /// A line that nobody may miss.
    fn important(&self, text: &str) {
        self.suspend(|| tell(text));
    }
}

/// Mean over the seeds of their moving returns.
fn mean_return(seeds: &BTreeMap<u64, SeedProgress>) -> f64 {
    let returns = || seeds.values().map(|seed| seed.mean_return).filter(|r| r.is_finite());
    returns().sum::<f64>() / returns().count() as f64
}
