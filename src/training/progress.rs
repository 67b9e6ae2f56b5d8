//! What a person sees of a training: bars on a terminal, plain lines elsewhere.

use std::collections::BTreeMap;
use std::time::{Duration, Instant};

use indicatif::{FormattedDuration, MultiProgress, ProgressBar, ProgressStyle};
use tracing::{debug, error, info, warn};

use super::{Event, Experiment, run_label};
use crate::messages::{self, Verbosity};

/// Up to this many seeds of one experiment have a bar each; more share one.
const BARS: usize = 6;
/// Seconds between two plain lines.
const LINE_INTERVAL: Duration = Duration::from_secs(5);

/// Shows [`Event`]s on stderr.
pub struct Progress<'a> {
    since: Instant,
    experiments: &'a [Experiment],
    /// The runs that have begun, by experiment and seed.
    runs: BTreeMap<(usize, u64), RunProgress>,
    view: View,
}

#[derive(Clone, Copy)]
struct RunProgress {
    /// When it was first heard of, and the timesteps done by then.
    first: (Instant, u64),
    /// Done by earlier starts.
    before: u64,
    timesteps: u64,
    /// Timesteps when all its stages are done.
    of: u64,
    stage: u16,
    mean_return: f64,
    failed: bool,
}

enum View {
    Quiet,
    Lines { last: Instant },
    Bars { all: MultiProgress, total: ProgressBar, seeds: BTreeMap<u64, ProgressBar> },
}

impl<'a> Progress<'a> {
    /// For experiments that train together.
    pub fn new(experiments: &'a [Experiment], verbosity: Verbosity) -> Self {
        let total = experiments.iter().map(timesteps_of).sum();
        let view = if verbosity == Verbosity::Quiet { View::Quiet } else { View::of_stderr(total) };
        Self { since: Instant::now(), experiments, runs: BTreeMap::new(), view }
    }

    /// Takes in one event of an experiment, which is named by its place.
    pub fn show(&mut self, experiment: usize, event: Event) {
        let experiments = self.experiments;
        let label = |seed: u64| run_label(experiments, experiment, seed);
        let curriculum = &experiments[experiment].curriculum;
        let of = curriculum.timesteps();
        // A fork's agent has those of its parent behind it.
        let own = |timesteps: u64| timesteps.saturating_sub(curriculum.timesteps_of_parent());
        match event {
            Event::Progress { seed, stage, timesteps, mean_return } => {
                let id = (experiment, seed);
                let timesteps = own(timesteps);
                let at = self.runs.entry(id).or_insert_with(|| RunProgress::new(timesteps, 0, of));
                (at.timesteps, at.stage, at.mean_return) = (timesteps, stage, mean_return);
                self.update(id);
            }
            Event::AlreadyFinished { seed } => {
                self.runs.insert((experiment, seed), RunProgress::new(of, of, of));
            }
            Event::Resumed { seed, timesteps } => {
                self.runs.insert((experiment, seed), RunProgress::new(own(timesteps), own(timesteps), of));
                self.milestone(&format!("{} goes on after {timesteps} timesteps", label(seed)));
            }
            Event::StageDone { seed, stage } => {
                let last = curriculum.stages.len() - 1;
                self.milestone(&format!("{}: stage {stage} is done, the last is {last}", label(seed)));
            }
            Event::Failed { seed, why } => {
                let id = (experiment, seed);
                self.runs.entry(id).or_insert_with(|| RunProgress::new(0, 0, of)).failed = true;
                if let View::Bars { seeds, .. } = &self.view
                    && let Some(bar) = seeds.get(&seed)
                {
                    bar.abandon_with_message("failed");
                }
                error!("{} failed: {why}", label(seed));
            }
            Event::Notice { seed, what } => warn!("{}: {what}", label(seed)),
            Event::Interrupted { seed } => self.milestone(&format!("{} is saved", label(seed))),
        }
    }

    /// Takes the bars away.
    pub fn finish(&self) {
        if let View::Bars { all, total, seeds } = &self.view {
            messages::set_bars(None);
            // Unfinished and abandoned bars would be drawn once more when they are dropped.
            seeds.values().chain([total]).for_each(ProgressBar::finish_and_clear);
            // A terminal that cannot be cleared is no reason to fail.
            let _ = all.clear();
        }
    }

    /// Prints a line about it where lines are read. Bars show it anyway.
    fn milestone(&self, text: &str) {
        match self.view {
            View::Bars { .. } => debug!("{text}"),
            View::Quiet | View::Lines { .. } => info!("{text}"),
        }
    }

    fn update(&mut self, id: (usize, u64)) {
        let overall = self.overall();
        let at = self.runs[&id];
        match &mut self.view {
            View::Quiet => {}
            View::Lines { last } if last.elapsed() < LINE_INTERVAL => {}
            View::Lines { last } => {
                *last = Instant::now();
                info!("{}", overall.line());
            }
            View::Bars { all, total, seeds } => {
                total.set_length(overall.of);
                total.set_position(overall.done);
                total.set_message(overall.figures());
                let [experiment] = self.experiments else { return };
                if !(2..=BARS).contains(&experiment.seeds.len()) {
                    return;
                }
                let (_, seed) = id;
                let bar = seeds.entry(seed).or_insert_with(|| {
                    let bar = ProgressBar::new(at.of).with_style(style());
                    all.add(bar.with_prefix(format!("seed {seed}")))
                });
                let own = Figures::of_seed(&at, experiment.curriculum.stages.len());
                bar.set_position(own.done);
                bar.set_message(own.figures());
                if at.timesteps >= at.of {
                    bar.abandon();
                }
            }
        }
    }

    /// All runs together.
    fn overall(&self) -> Figures {
        let begun = || self.runs.values();
        let given_up: u64 = begun().filter(|at| at.failed).map(|at| at.of - at.done()).sum();
        let done: u64 = begun().map(RunProgress::done).sum();
        let before: u64 = begun().map(|at| at.before).sum();
        let of = self.experiments.iter().map(timesteps_of).sum::<u64>().saturating_sub(given_up);
        let num_runs = self.experiments.iter().map(|experiment| experiment.seeds.len()).sum();
        let detail = match self.experiments {
            [experiment] => {
                let going = || begun().filter(|at| at.is_going());
                let returns = || begun().map(|at| at.mean_return).filter(|mean| mean.is_finite());
                Detail::Stages {
                    of_those: going().map(|at| at.stage).min().zip(going().map(|at| at.stage).max()),
                    num: experiment.curriculum.stages.len(),
                    mean_return: returns().sum::<f64>() / returns().count() as f64,
                }
            }
            // Stages and returns of different experiments have nothing in common.
            _ => Detail::Runs { ended: begun().filter(|at| !at.is_going()).count() },
        };
        Figures { done, of, num_runs, rate: rate(done.saturating_sub(before), self.since), detail }
    }
}

/// Timesteps of all seeds of an experiment.
fn timesteps_of(experiment: &Experiment) -> u64 {
    experiment.curriculum.timesteps() * experiment.seeds.len() as u64
}

impl View {
    /// Bars where stderr is a terminal that can show them.
    fn of_stderr(total: u64) -> Self {
        let all = MultiProgress::new();
        if all.is_hidden() {
            return Self::Lines { last: Instant::now() };
        }
        let bar = ProgressBar::new(total).with_style(style()).with_prefix("total");
        let total = all.add(bar);
        messages::set_bars(Some(all.clone()));
        Self::Bars { all, total, seeds: BTreeMap::new() }
    }
}

/// A bar, and beside it as much of the figures as the terminal is wide: all of them on 80 columns.
fn style() -> ProgressStyle {
    let template = "{prefix:9} {bar:10} {percent:>3}%  {wide_msg}";
    ProgressStyle::with_template(template).unwrap_or_else(|_| ProgressStyle::default_bar())
}

impl RunProgress {
    fn new(timesteps: u64, before: u64, of: u64) -> Self {
        let first = (Instant::now(), timesteps);
        Self { first, before, timesteps, of, stage: 0, mean_return: f64::NAN, failed: false }
    }

    /// Timesteps that count; PPO goes on to the end of its rollout, past those asked for.
    fn done(&self) -> u64 {
        self.timesteps.min(self.of)
    }

    fn is_going(&self) -> bool {
        !self.failed && self.timesteps < self.of
    }
}

/// What is told of one run, or of all.
struct Figures {
    done: u64,
    of: u64,
    num_runs: usize,
    /// Timesteps per second of this start, once there is one.
    rate: Option<f64>,
    detail: Detail,
}

/// What is told beside the timesteps.
enum Detail {
    /// Of seeds of one experiment: the first and the last stage that one of them is in, from 0, of so many.
    Stages { of_those: Option<(u16, u16)>, num: usize, mean_return: f64 },
    /// Of several experiments: how many runs have ended.
    Runs { ended: usize },
}

impl Figures {
    fn of_seed(at: &RunProgress, num_stages: usize) -> Self {
        let (since, first) = at.first;
        Self {
            done: at.done(),
            of: at.of,
            num_runs: 1,
            rate: rate(at.timesteps - first, since),
            detail: Detail::Stages {
                of_those: Some((at.stage, at.stage)),
                num: num_stages,
                mean_return: at.mean_return,
            },
        }
    }

    /// `stage 2/5  51234/s  00:04:10 left  return 12.3`, what is not known left out; of several experiments
    /// `3/20 runs  51234/s  00:04:10 left`.
    fn figures(&self) -> String {
        let mut parts = Vec::new();
        match self.detail {
            Detail::Stages { of_those: Some((first, last)), num, .. } if first == last => {
                parts.push(format!("stage {}/{num}", first + 1));
            }
            Detail::Stages { of_those: Some((first, last)), num, .. } => {
                parts.push(format!("stages {}-{}/{num}", first + 1, last + 1));
            }
            Detail::Stages { of_those: None, .. } => {}
            Detail::Runs { ended } => parts.push(format!("{ended}/{} runs", self.num_runs)),
        }
        if let Some(rate) = self.rate {
            let left = Duration::try_from_secs_f64(self.of.saturating_sub(self.done) as f64 / rate);
            parts.push(format!("{rate:.0}/s"));
            parts.extend(left.ok().map(|left| format!("{} left", FormattedDuration(left))));
        }
        if let Detail::Stages { mean_return, .. } = self.detail
            && mean_return.is_finite()
        {
            parts.push(format!("return {mean_return:.1}"));
        }
        parts.join("  ")
    }

    fn line(&self) -> String {
        let share = 100.0 * self.done as f64 / self.of.max(1) as f64;
        let seeds = match self.detail {
            Detail::Stages { .. } => format!(" of {}", count_seeds(self.num_runs)),
            // The figures tell their number.
            Detail::Runs { .. } => String::new(),
        };
        format!("{share:5.1}%  {} of {} timesteps{seeds}  {}", self.done, self.of, self.figures())
    }
}

/// `1 seed`, `3 seeds`.
pub fn count_seeds(seeds: usize) -> String {
    if seeds == 1 { "1 seed".to_owned() } else { format!("{seeds} seeds") }
}

/// Timesteps per second since then, once some are done.
fn rate(timesteps: u64, since: Instant) -> Option<f64> {
    let seconds = since.elapsed().as_secs_f64();
    (timesteps > 0 && seconds > 0.0).then(|| timesteps as f64 / seconds)
}

#[cfg(test)]
mod tests {
    use coverage_env::Level;

    use super::*;
    use crate::agent::engine::EngineKind;
    use crate::experiment::Curriculum;

    const STAGE: Detail = Detail::Stages { of_those: Some((1, 1)), num: 5, mean_return: -12.34 };

    fn figures() -> Figures {
        Figures { done: 250, of: 1000, num_runs: 3, rate: Some(2.5), detail: STAGE }
    }

    #[test]
    fn figures_are_one_line() {
        assert_eq!(figures().figures(), "stage 2/5  2/s  00:05:00 left  return -12.3");
        let line = figures().line();
        assert_eq!(line, format!(" 25.0%  250 of 1000 timesteps of 3 seeds  {}", figures().figures()));
        let detail = Detail::Stages { of_those: Some((1, 3)), num: 5, mean_return: -12.34 };
        assert!(Figures { detail, ..figures() }.figures().starts_with("stages 2-4/5  "));
        let study = Figures { num_runs: 20, detail: Detail::Runs { ended: 4 }, ..figures() };
        assert_eq!(study.line(), " 25.0%  250 of 1000 timesteps  4/20 runs  2/s  00:05:00 left");
    }

    /// Four seeds of 100 timesteps on each of the levels.
    fn experiments(levels: &[&str]) -> Vec<Experiment> {
        let single = |&id: &&str| Curriculum::single(Level::builtin(id).unwrap(), 100);
        levels.iter().map(|id| Experiment::example(single(id), &[0, 1, 2, 3], EngineKind::Fused)).collect()
    }

    fn progress(experiments: &[Experiment]) -> Progress<'_> {
        let since = Instant::now() - Duration::from_secs(10);
        Progress { since, experiments, runs: BTreeMap::new(), view: View::Quiet }
    }

    #[test]
    fn seeds_that_were_finished_before_count_as_done_but_not_for_the_rate() {
        let experiments = experiments(&["0"]);
        let mut progress = progress(&experiments);
        progress.show(0, Event::AlreadyFinished { seed: 0 });
        progress.show(0, Event::Resumed { seed: 1, timesteps: 40 });
        progress.show(0, Event::Progress { seed: 1, stage: 0, timesteps: 60, mean_return: 1.0 });
        let overall = progress.overall();
        assert_eq!((overall.done, overall.of), (160, 400));
        // 20 timesteps in ten seconds and a little.
        assert!(overall.rate.is_some_and(|rate| (1.9..=2.0).contains(&rate)), "{:?}", overall.rate);
        assert!(overall.figures().starts_with("stage 1/1  ") && overall.figures().ends_with("return 1.0"));
        progress.show(0, Event::Failed { seed: 2, why: String::new() });
        assert_eq!(progress.overall().of, 300);
    }

    #[test]
    fn the_seeds_of_several_experiments_are_told_apart() {
        let experiments = experiments(&["0", "1"]);
        let mut progress = progress(&experiments);
        progress.show(0, Event::Progress { seed: 1, stage: 0, timesteps: 100, mean_return: 1.0 });
        progress.show(1, Event::Progress { seed: 1, stage: 0, timesteps: 20, mean_return: 2.0 });
        progress.show(1, Event::Failed { seed: 2, why: String::new() });
        let overall = progress.overall();
        assert_eq!((overall.done, overall.of), (120, 700));
        assert!(overall.figures().starts_with("2/8 runs  "), "{}", overall.figures());
    }

    #[test]
    fn what_is_not_known_is_left_out() {
        let unknown = |of_those| Detail::Stages { of_those, num: 5, mean_return: f64::NAN };
        let begun = Figures { rate: None, detail: unknown(Some((1, 1))), ..figures() };
        assert_eq!(begun.figures(), "stage 2/5");
        let slow = Figures { rate: Some(f64::MIN_POSITIVE), detail: unknown(None), ..figures() };
        assert_eq!(slow.figures(), "0/s");
    }
}
