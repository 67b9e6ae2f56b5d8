//! What a person sees of a training: bars on a terminal, plain lines elsewhere.

use std::collections::BTreeMap;
use std::time::{Duration, Instant};

use indicatif::{FormattedDuration, MultiProgress, ProgressBar, ProgressStyle};
use tracing::{debug, error, info, warn};

use super::{Event, Experiment};
use crate::messages::{self, Verbosity};

/// Up to this many seeds have a bar each; more share one.
const BARS: usize = 6;
/// Seconds between two plain lines.
const LINE_INTERVAL: Duration = Duration::from_secs(5);

/// Shows [`Event`]s on stderr.
pub struct Progress {
    since: Instant,
    /// Timesteps of one seed when everything is done.
    per_seed: u64,
    stages: usize,
    num_seeds: usize,
    /// The seeds that have begun.
    seeds: BTreeMap<u64, SeedProgress>,
    view: View,
}

#[derive(Clone, Copy)]
struct SeedProgress {
    /// When it was first heard of, and the timesteps done by then.
    first: (Instant, u64),
    /// Done by earlier starts.
    before: u64,
    timesteps: u64,
    stage: u16,
    mean_return: f64,
    failed: bool,
}

enum View {
    Quiet,
    Lines { last: Instant },
    Bars { all: MultiProgress, total: ProgressBar, seeds: BTreeMap<u64, ProgressBar> },
}

impl Progress {
    /// For one experiment.
    pub fn new(experiment: &Experiment, verbosity: Verbosity) -> Self {
        let (per_seed, num_seeds) = (experiment.curriculum.timesteps(), experiment.seeds.len());
        let view =
            if verbosity == Verbosity::Quiet { View::Quiet } else { View::of_stderr(per_seed * num_seeds as u64) };
        Self {
            since: Instant::now(),
            per_seed,
            stages: experiment.curriculum.stages.len(),
            num_seeds,
            seeds: BTreeMap::new(),
            view,
        }
    }

    /// Takes in one event.
    pub fn show(&mut self, event: Event) {
        match event {
            Event::Progress { seed, stage, timesteps, mean_return } => {
                let at = self.seeds.entry(seed).or_insert_with(|| SeedProgress::new(timesteps, 0));
                (at.timesteps, at.stage, at.mean_return) = (timesteps, stage, mean_return);
                self.update(seed);
            }
            Event::AlreadyFinished { seed } => {
                self.seeds.insert(seed, SeedProgress::new(self.per_seed, self.per_seed));
            }
            Event::Resumed { seed, timesteps } => {
                self.seeds.insert(seed, SeedProgress::new(timesteps, timesteps));
                self.milestone(&format!("seed {seed} goes on after {timesteps} timesteps"));
            }
            Event::StageDone { seed, stage } => {
                self.milestone(&format!("seed {seed}: stage {stage} is done, the last is {}", self.stages - 1));
            }
            Event::Failed { seed, why } => {
                self.seeds.entry(seed).or_insert_with(|| SeedProgress::new(0, 0)).failed = true;
                if let View::Bars { seeds, .. } = &self.view
                    && let Some(bar) = seeds.get(&seed)
                {
                    bar.abandon_with_message("failed");
                }
                error!("seed {seed} failed: {why}");
            }
            Event::Notice { seed, what } => warn!("seed {seed}: {what}"),
            Event::Interrupted { seed } => self.milestone(&format!("seed {seed} is saved")),
        }
    }

    /// Runs `print` with the bars out of its way.
    pub fn suspend(&self, print: impl FnOnce()) {
        messages::past_bars(print);
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

    /// Something worth a line where lines are read; bars show it on their own.
    fn milestone(&self, text: &str) {
        match self.view {
            View::Bars { .. } => debug!("{text}"),
            View::Quiet | View::Lines { .. } => info!("{text}"),
        }
    }

    fn update(&mut self, seed: u64) {
        let overall = self.overall();
        let at = self.seeds[&seed];
        match &mut self.view {
            View::Quiet => {}
            View::Lines { last } if last.elapsed() < LINE_INTERVAL => {}
            View::Lines { last } => {
                *last = Instant::now();
                info!("{}", overall.line(self.num_seeds));
            }
            View::Bars { all, total, seeds } => {
                total.set_length(overall.of);
                total.set_position(overall.done);
                total.set_message(overall.figures());
                if self.num_seeds > BARS || self.num_seeds == 1 {
                    return;
                }
                let bar = seeds.entry(seed).or_insert_with(|| {
                    let bar = ProgressBar::new(self.per_seed).with_style(style());
                    all.add(bar.with_prefix(format!("seed {seed}")))
                });
                let own = Figures::of_seed(&at, self.per_seed, self.stages);
                bar.set_position(own.done);
                bar.set_message(own.figures());
                if at.timesteps >= self.per_seed {
                    bar.abandon();
                }
            }
        }
    }

    /// All seeds together.
    fn overall(&self) -> Figures {
        let begun = || self.seeds.values();
        let given_up: u64 = begun().filter(|at| at.failed).map(|at| self.per_seed - at.done(self.per_seed)).sum();
        let done: u64 = begun().map(|at| at.done(self.per_seed)).sum();
        let before: u64 = begun().map(|at| at.before).sum();
        let going = || begun().filter(|at| !at.failed && at.timesteps < self.per_seed);
        let returns = || begun().map(|at| at.mean_return).filter(|mean| mean.is_finite());
        Figures {
            done,
            of: (self.per_seed * self.num_seeds as u64).saturating_sub(given_up),
            rate: rate(done.saturating_sub(before), self.since),
            stages: going().map(|at| at.stage).min().zip(going().map(|at| at.stage).max()),
            num_stages: self.stages,
            mean_return: returns().sum::<f64>() / returns().count() as f64,
        }
    }
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

impl SeedProgress {
    fn new(timesteps: u64, before: u64) -> Self {
        let first = (Instant::now(), timesteps);
        Self { first, before, timesteps, stage: 0, mean_return: f64::NAN, failed: false }
    }

    /// Timesteps that count; PPO goes on to the end of its rollout, past those asked for.
    fn done(&self, per_seed: u64) -> u64 {
        self.timesteps.min(per_seed)
    }
}

/// What is told of one seed, or of all.
struct Figures {
    done: u64,
    of: u64,
    /// Timesteps per second of this start, once there is one.
    rate: Option<f64>,
    /// The first and the last stage that a seed is in, from 0.
    stages: Option<(u16, u16)>,
    num_stages: usize,
    mean_return: f64,
}

impl Figures {
    fn of_seed(at: &SeedProgress, per_seed: u64, num_stages: usize) -> Self {
        let (since, first) = at.first;
        Self {
            done: at.done(per_seed),
            of: per_seed,
            rate: rate(at.timesteps - first, since),
            stages: Some((at.stage, at.stage)),
            num_stages,
            mean_return: at.mean_return,
        }
    }

    /// `stage 2/5  51234/s  00:04:10 left  return 12.3`, what is not known left out.
    fn figures(&self) -> String {
        let mut parts = Vec::new();
        match self.stages {
            Some((first, last)) if first == last => parts.push(format!("stage {}/{}", first + 1, self.num_stages)),
            Some((first, last)) => parts.push(format!("stages {}-{}/{}", first + 1, last + 1, self.num_stages)),
            None => {}
        }
        if let Some(rate) = self.rate {
            let left = Duration::try_from_secs_f64(self.of.saturating_sub(self.done) as f64 / rate);
            parts.push(format!("{rate:.0}/s"));
            parts.extend(left.ok().map(|left| format!("{} left", FormattedDuration(left))));
        }
        if self.mean_return.is_finite() {
            parts.push(format!("return {:.1}", self.mean_return));
        }
        parts.join("  ")
    }

    fn line(&self, num_seeds: usize) -> String {
        let share = 100.0 * self.done as f64 / self.of.max(1) as f64;
        let seeds = count_seeds(num_seeds);
        format!("{share:5.1}%  {} of {} timesteps of {seeds}  {}", self.done, self.of, self.figures())
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
    use super::*;

    fn figures() -> Figures {
        let stages = Some((1, 1));
        Figures { done: 250, of: 1000, rate: Some(2.5), stages, num_stages: 5, mean_return: -12.34 }
    }

    #[test]
    fn figures_are_one_line() {
        assert_eq!(figures().figures(), "stage 2/5  2/s  00:05:00 left  return -12.3");
        let line = figures().line(3);
        assert_eq!(line, format!(" 25.0%  250 of 1000 timesteps of 3 seeds  {}", figures().figures()));
        let apart = Figures { stages: Some((1, 3)), ..figures() };
        assert!(apart.figures().starts_with("stages 2-4/5  "));
    }

    #[test]
    fn seeds_that_were_finished_before_count_as_done_but_not_for_the_rate() {
        let since = Instant::now() - Duration::from_secs(10);
        let seeds = BTreeMap::new();
        let mut progress = Progress { since, per_seed: 100, stages: 1, num_seeds: 4, seeds, view: View::Quiet };
        progress.show(Event::AlreadyFinished { seed: 0 });
        progress.show(Event::Resumed { seed: 1, timesteps: 40 });
        progress.show(Event::Progress { seed: 1, stage: 0, timesteps: 60, mean_return: 1.0 });
        let overall = progress.overall();
        assert_eq!((overall.done, overall.of), (160, 400));
        // 20 timesteps in ten seconds and a little.
        assert!(overall.rate.is_some_and(|rate| (1.9..=2.0).contains(&rate)), "{:?}", overall.rate);
        assert_eq!((overall.stages, overall.mean_return), (Some((0, 0)), 1.0));
        progress.show(Event::Failed { seed: 2, why: String::new() });
        assert_eq!(progress.overall().of, 300);
    }

    #[test]
    fn what_is_not_known_is_left_out() {
        let begun = Figures { rate: None, mean_return: f64::NAN, ..figures() };
        assert_eq!(begun.figures(), "stage 2/5");
        let slow = Figures { rate: Some(f64::MIN_POSITIVE), stages: None, ..figures() };
        assert_eq!(slow.figures(), "0/s  return -12.3");
    }
}
