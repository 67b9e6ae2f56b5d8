//! What `compare` makes of runs, on runs that are written here: every number in them is known.

use std::fmt::Write;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use coverage_env::Level;
use coverage_env::planner::Optimal;
use cpp_rl::evaluate::{self, Starts};
use cpp_rl::report::analysis::{Analysis, LevelContrast, Protocol};
use cpp_rl::report::{Format, export, tables};
use cpp_rl::run::manifest::{Engine, Host, Manifest, StageEntry, Start, Status, Versions};
use rl_stats::{Interval, Time};
use serde_json::{Value, json};
use tempfile::TempDir;

use crate::numbers::assert_near;

const MAPS: [(&str, &str); 2] = [("a", "..#.\n.T..\n...T\n"), ("b", "T...\n..#.\n..#T\n")];
const MAX_STEPS: u32 = 20;
const TIMESTEPS: u64 = 1000;

/// How an agent does in an evaluation.
#[derive(Clone, Copy, PartialEq)]
pub(crate) enum Skill {
    /// As well as can be, from every start.
    Perfect,
    /// Not at all.
    Lost,
}

/// A run to be written.
#[derive(Clone, Copy)]
pub(crate) struct Fake {
    pub(crate) arm: &'static str,
    pub(crate) seed: u64,
    pub(crate) levels: &'static [&'static str],
    pub(crate) afresh: bool,
    pub(crate) stages_done: u16,
    /// Of each stage.
    pub(crate) timesteps: u64,
    /// In the evaluation after a stage (none: before the first) on a level, both by number.
    pub(crate) skill: fn(Option<usize>, usize) -> Skill,
    /// The normalised moving return at a share of a stage, given its level's name.
    pub(crate) curve: fn(&str, f64) -> f64,
    /// How it stands, given whether all stages are done.
    pub(crate) status: fn(bool) -> Status,
    /// The commit that made it.
    pub(crate) commit: &'static str,
    /// The instruction set of its kernel.
    pub(crate) instruction_set: &'static str,
    /// Timesteps that its schedules span, if it was extended.
    pub(crate) horizon: Option<u64>,
}

pub(crate) const CURRICULUM: Fake = Fake {
    arm: "ppo",
    seed: 0,
    levels: &["a", "b"],
    afresh: false,
    stages_done: 2,
    timesteps: TIMESTEPS,
    // What was trained last is known, and nothing else.
    skill: |stage, level| if stage == Some(level) { Skill::Perfect } else { Skill::Lost },
    curve: |_, share| share,
    status: |finished| if finished { Status::Finished } else { Status::Running },
    commit: "abc",
    instruction_set: "avx2",
    horizon: None,
};

pub(crate) const AFRESH_B: Fake = Fake {
    levels: &["b"],
    afresh: true,
    stages_done: 1,
    skill: |_, _| Skill::Perfect,
    curve: |_, _| 1.0,
    ..CURRICULUM
};

fn map(level: &str) -> String {
    let own = MAPS.iter().find(|(name, _)| *name == level).map(|(_, map)| (*map).to_owned());
    own.or_else(|| Level::builtin(level).map(|level| level.to_map())).expect("a level that is known")
}

fn max_steps(level: &str) -> u32 {
    if Level::builtin(level).is_some() { 200 } else { MAX_STEPS }
}

impl Fake {
    /// Its directory below `root`.
    fn path(&self, root: &Path) -> PathBuf {
        let folder = if self.afresh { format!("level-{}", self.levels[0]) } else { "curriculum".to_owned() };
        root.join(self.arm).join(folder).join(format!("seed-{}", self.seed))
    }

    pub(crate) fn write(&self, root: &Path) -> PathBuf {
        let path = self.path(root);
        fs::create_dir_all(&path).expect("a folder");
        let stage = |level: &&str| StageEntry {
            level: (*level).to_owned(),
            map: map(level),
            timesteps: self.timesteps,
            horizon: self.horizon,
        };
        let versions = Versions { cpp_rl: "1.0".to_owned(), git: self.commit.to_owned(), libtorch: "2.0".to_owned() };
        let host = Host { name: String::new(), platform: String::new(), cores: 1 };
        let start = Start {
            time: String::new(),
            command: Vec::new(),
            versions: versions.clone(),
            host: host.clone(),
            instruction_set: self.instruction_set.to_owned(),
            timesteps: 0,
        };
        let config = json!({ "name": self.arm, "max_steps": max_steps(self.levels[0]), "timesteps": self.timesteps });
        let finished = usize::from(self.stages_done) == self.levels.len();
        let mut manifest = Manifest {
            format: 1,
            status: (self.status)(finished),
            arm: self.arm.to_owned(),
            curriculum: if self.afresh { format!("level-{}", self.levels[0]) } else { "curriculum".to_owned() },
            seed: self.seed,
            stages: self.levels.iter().map(stage).collect(),
            stages_done: self.stages_done,
            marks: Vec::new(),
            levels: self.levels.iter().map(|level| (*level).to_owned()).collect(),
            config: config.as_object().expect("an object").clone(),
            dose: Value::Null,
            engine: Engine::Fused,
            device: "cpu".to_owned(),
            plasticity_interval: 0,
            versions,
            host,
            command: Vec::new(),
            starts: vec![start],
            started: String::new(),
            updated: String::new(),
            seconds: 0.0,
        };
        manifest.write(&path).expect("a manifest");
        fs::write(path.join("evaluations.csv"), self.evaluations()).expect("evaluations");
        fs::write(path.join("progress.csv"), self.progress(self.timesteps / 4)).expect("a log");
        path
    }

    /// Evaluations before the first stage and after every stage, finished or not.
    fn evaluations(&self) -> String {
        let mut text = "phase,stage,level,start,return,length,solved\n".to_owned();
        let times = [None].into_iter().chain((0..self.levels.len()).map(Some));
        for stage in times {
            for (number, name) in self.levels.iter().enumerate() {
                let phase = if stage.is_some() { "after" } else { "before" };
                let limit = max_steps(name);
                for best in optimum(name).episodes {
                    let (return_, length, solved) = match (self.skill)(stage, number) {
                        Skill::Perfect => (best.return_, best.length, true),
                        Skill::Lost => (-i64::from(limit), limit, false),
                    };
                    let (stage, [row, column]) = (stage.unwrap_or(0), best.start);
                    writeln!(text, "{phase},{stage},{name},{row} {column},{return_},{length},{solved}")
                        .expect("memory");
                }
            }
        }
        text
    }

    /// A row every so many timesteps.
    fn progress(&self, every: u64) -> String {
        let mut text = "stage,level,time/total_timesteps,cumulative_timesteps,rollout/ep_rew_mean\n".to_owned();
        for (stage, level) in self.levels.iter().enumerate() {
            let (worst, best) = (-f64::from(max_steps(level)), optimum(level).mean);
            for timesteps in (every..=self.timesteps).step_by(every as usize) {
                let value = worst + (best - worst) * (self.curve)(level, timesteps as f64 / self.timesteps as f64);
                let cumulative = stage as u64 * self.timesteps + timesteps;
                writeln!(text, "{stage},{level},{timesteps},{cumulative},{value}").expect("memory");
            }
        }
        text
    }
}

fn optimum(level: &str) -> cpp_rl::results::LevelResult {
    let limit = max_steps(level);
    let level = Arc::new(Level::from_map(level, &map(level)).expect("a valid map"));
    evaluate::planner(&mut Optimal::new(), &level, limit, Starts::Exhaustive).expect("a level within reach")
}

fn read(root: &TempDir) -> Analysis {
    Analysis::read(&[root.path().to_owned()]).expect("runs that can be read")
}

/// The analysis of these runs.
fn analysis(runs: &[Fake]) -> Analysis {
    let root = TempDir::new().expect("a folder");
    runs.iter().for_each(|run| {
        run.write(root.path());
    });
    read(&root)
}

/// One of its tables.
fn table(analysis: &Analysis, name: &str, format: Format) -> String {
    let all = tables::all(analysis);
    let named = all.iter().find(|named| named.name == name);
    named.unwrap_or_else(|| panic!("no table {name}")).table.render(format)
}

/// The contrast on level b, the only one with runs afresh.
fn contrast_on_b(analysis: &Analysis) -> &LevelContrast {
    let b = analysis.level("b").expect("level b");
    analysis.against_afresh[0].levels[b].as_ref().expect("a contrast")
}

#[test]
fn one_seed_has_no_interval_and_says_so() {
    let analysis = analysis(&[CURRICULUM, AFRESH_B]);
    let names: Vec<&str> = analysis.arms.iter().map(|arm| arm.name.as_str()).collect();
    assert_eq!(names, ["ppo", "ppo (afresh)"]);
    assert!(analysis.differences.is_empty(), "{:?}", analysis.differences);
    let arm = &analysis.arms[0];
    let outcome = arm.levels[0].as_ref().expect("a result");
    assert_near(outcome.mean, optimum("a").mean, 1e-12);
    assert_eq!(outcome.std, None);
    assert_near(outcome.seeds[&0].std, optimum("a").std, 1e-12); // over start cells
    assert_eq!(outcome.return_mean.interval, None);
    assert!(arm.aggregates.as_ref().is_some_and(|a| a.mean.interval.is_none() && a.mean.runs == 1));
    assert!(contrast_on_b(&analysis).area.as_ref().is_some_and(|area| area.difference.interval.is_none()));
    assert!(arm.curves[0].mean.iter().flatten().all(|band| band.low.is_none() && band.seeds == 1));
    let text: String = tables::main(&analysis).iter().map(|table| table.render(Format::Table)).collect();
    assert!(text.contains("One seed has no interval: ppo") && text.contains("one seed tells nothing"), "{text}");
    assert!(text.contains(&format!("{:.2} ± {:.2}", optimum("a").mean, optimum("a").std)), "{text}");
}

#[test]
fn thirty_seeds_give_what_was_computed_by_hand() {
    // Half of the seeds lose level a at the end, the other half keeps it.
    let keeps =
        Fake { skill: |stage, level| if stage >= Some(level) { Skill::Perfect } else { Skill::Lost }, ..CURRICULUM };
    let seeds: Vec<Fake> =
        (0..30).map(|seed| Fake { seed, ..if seed % 2 == 0 { CURRICULUM } else { keeps } }).collect();
    let analysis = analysis(&seeds);
    let arm = &analysis.arms[0];
    assert_eq!((arm.protocol, arm.seeds.len()), (Protocol::Curriculum, 30));
    // The whole diagonal is optimal.
    let aggregates = arm.aggregates.as_ref().expect("aggregates");
    assert_eq!(aggregates.interquartile_mean.interval, Some(Interval { low: 1.0, high: 1.0 }));
    assert_near(aggregates.optimality_gap.value, 0.0, 1e-12);
    // At the end level a is worth 0 or 1 and level b 1.
    let continual = arm.continual.as_ref().expect("measures");
    let mean = |measure: &Option<cpp_rl::report::analysis::OverSeeds>| measure.as_ref().expect("measured").mean.value;
    assert_near(mean(&continual.average_performance), 0.75, 1e-12);
    assert_near(mean(&continual.backward_transfer), -0.5, 1e-12);
    assert_near(mean(&continual.forward_transfer), 0.0, 1e-12);
    assert_near(mean(&continual.forgetting), 0.25, 1e-12);
    assert_near(mean(&continual.forgetting_by_stage[0]), 0.5, 1e-12);
    assert_near(mean(&continual.isolated_forgetting), 0.5, 1e-12);
    assert_near(mean(&continual.zero_shot_transfer), 0.0, 1e-12);
    let interval = continual.backward_transfer.as_ref().and_then(|m| m.mean.interval).expect("an interval");
    // ± 1.96 · 0.5 / √30, in steps of 1/30.
    assert!((interval.low + 0.68).abs() < 0.05 && (interval.high + 0.32).abs() < 0.05, "{interval:?}");
    let matrix = arm.matrix.as_ref().expect("a matrix");
    assert_eq!(matrix.rows.len(), 3);
    let end = matrix.rows[2].cells[0].as_ref().expect("a result");
    assert_near(end.normalised.expect("an optimum"), 0.5, 1e-12);
    assert_eq!((end.seeds.len(), matrix.rows[2].after.map(|stage| stage.level)), (30, Some(1)));
}

#[test]
fn a_level_has_mean_median_and_iqm_with_their_intervals() {
    let fails_b = Fake { skill: |_, _| Skill::Lost, ..AFRESH_B };
    let runs: Vec<Fake> = (0..8).map(|seed| Fake { seed, ..if seed < 2 { fails_b } else { AFRESH_B } }).collect();
    let analysis = analysis(&runs);
    let outcome = analysis.arms[0].levels[0].as_ref().expect("a result");
    let (worst, best) = (-f64::from(MAX_STEPS), optimum("b").mean);
    assert_near(outcome.return_mean.value, (2.0 * worst + 6.0 * best) / 8.0, 1e-9);
    assert_near(outcome.return_median.value, best, 1e-9);
    // Two of eight go at either end, and with them both that fail.
    assert_near(outcome.return_iqm.value, best, 1e-9);
    let interval = outcome.return_iqm.interval.expect("an interval");
    // Half of the resamples hold two that fail or fewer, and some four or more.
    assert_near(interval.high, best, 1e-9);
    assert!(interval.low < best - 0.25 * (best - worst) && interval.low > worst, "{interval:?}");
    let csv = table(&analysis, "returns", Format::Csv);
    let row = csv.lines().nth(1).expect("a row");
    let numbers: Vec<f64> = row.split(',').skip(3).map(|field| field.parse().expect("a number")).collect();
    assert!(csv.starts_with("arm,level,seeds,mean,mean low,mean high,median,") && row.starts_with("ppo (afresh),b,8,"));
    assert_near(numbers[0], outcome.return_mean.value, 1e-9);
    assert_near(numbers[7], interval.low, 1e-9);
}

#[test]
fn a_curriculum_is_measured_against_afresh_seed_by_seed() {
    // Level b is learned by half of the seeds in the curriculum, and at once afresh.
    let fails_b = Fake { curve: |level, share| if level == "b" { 0.0 } else { share }, ..CURRICULUM };
    let mut runs = Vec::new();
    for seed in 0..4 {
        runs.push(Fake { seed, ..if seed < 2 { CURRICULUM } else { fails_b } });
        runs.push(Fake { seed, ..AFRESH_B });
    }
    let analysis = analysis(&runs);
    let contrast = contrast_on_b(&analysis);
    assert_eq!((&contrast.seeds[..], &contrast.unpaired[..]), (&[0, 1, 2, 3][..], &[][..]));
    // From 0.25 to 1 in a straight line, its mean is 0.625; of two seeds it is 0.
    let area = contrast.area.as_ref().expect("areas");
    assert_near(area.curriculum.value, 0.3125, 1e-9);
    assert_near(area.difference.value, -0.6875, 1e-9);
    let share = area.paired_improvement_share.expect("not the first level");
    // None of four pairs: (1 - p)^4 = 0.025.
    let interval = share.interval.expect("an interval");
    assert_eq!((share.value, interval.low), (0.0, 0.0));
    assert_near(interval.high, 1.0 - 0.025_f64.powf(0.25), 1e-9);
    assert_near(contrast.relative_loss.expect("an area afresh").value, 0.6875, 1e-9);
    let against = &analysis.against_afresh[0];
    assert_eq!(against.area.as_ref().expect("areas").levels, [1]);
    assert_near(against.relative_loss.expect("an area afresh").value, 0.6875, 1e-9);
    // Nothing can be gained over an area of 1.
    assert!(against.area_transfer.is_none());
    let csv = table(&analysis, "against-afresh", Format::Csv);
    assert!(csv.contains("\nppo,b,4,4/4,4/4,100,") && csv.contains("\nppo,mean of b,4,,,,"), "{csv}");
    let final_return = contrast.final_return.as_ref().expect("final returns");
    assert_near(final_return.difference.value, 0.0, 1e-12);
    assert_eq!(final_return.paired_improvement_share.map(|share| share.value), Some(0.5));
    let [half, most] = &contrast.thresholds[..] else { panic!("two thresholds") };
    // Rows are 250 timesteps apart: 0.5 is reached at 500, 0.9 at 1,000, by two seeds of four.
    assert_eq!((half.threshold, half.pairs[&0]), (0.5, (Time::At(500.0), Time::At(250.0))));
    assert_eq!((most.threshold, most.pairs[&3]), (0.9, (Time::Never, Time::At(250.0))));
    assert_eq!((half.curriculum.median, half.curriculum.censored), (Time::Never, 2));
    assert_eq!((half.afresh.median, half.afresh.censored), (Time::At(250.0), 0));
    assert_eq!(half.sooner_share.map(|share| share.value), Some(0.0));
    assert_eq!(analysis.improvements.len(), 0); // two protocols are never compared as arms
}

#[test]
fn nothing_is_compared_on_the_first_level_of_a_curriculum() {
    let afresh_a = Fake { levels: &["a"], curve: |_, share| share, ..AFRESH_B };
    // Level b is worth an area of 0.02 afresh, of which no share can be told.
    let hard = Fake { curve: |_, _| 0.02, ..AFRESH_B };
    let seeds = |run: Fake| [run, Fake { seed: 1, ..run }];
    let analysis = analysis(&[seeds(CURRICULUM), seeds(afresh_a), seeds(hard)].concat());
    let [a, b] = &analysis.against_afresh[0].levels[..] else { panic!("two levels") };
    let [a, b] = [a, b].map(|contrast| contrast.as_ref().expect("a contrast"));
    let area = a.area.as_ref().expect("areas");
    assert!(a.is_first && area.difference.value == 0.0 && area.paired_improvement_share.is_none());
    assert!(a.thresholds.iter().all(|times| times.sooner_share.is_none()));
    assert!(!b.is_first && b.relative_loss.is_none() && b.thresholds[0].sooner_share.is_some());
    assert_eq!((b.afresh_thresholds[0].censored, b.afresh_thresholds[0].seeds), (2, 2));
    // Over both levels areas are 0.625 in the curriculum, and (0.625 + 0.02) / 2 afresh.
    let against = &analysis.against_afresh[0];
    let afresh = (0.625 + 0.02) / 2.0;
    assert_near(against.relative_loss.expect("an area").value, (afresh - 0.625) / afresh, 1e-9);
    assert_near(against.area_transfer.expect("something to gain").value, (0.625 - afresh) / (1.0 - afresh), 1e-9);
}

#[test]
fn a_level_that_nobody_solves_is_censored_and_not_dropped() {
    let lost = Fake { skill: |_, _| Skill::Lost, curve: |_, _| 0.0, ..AFRESH_B };
    let analysis = analysis(&[lost, Fake { seed: 1, ..lost }, Fake { seed: 2, ..lost }]);
    let outcome = analysis.arms[0].levels[0].as_ref().expect("a result");
    assert_eq!((outcome.solved_share, outcome.thresholds[0].censored, outcome.thresholds[0].seeds), (0.0, 3, 3));
    assert_eq!(outcome.thresholds[0].median, Time::Never);
    assert_near(outcome.optimality_gap.expect("an optimum").value, 1.0, 1e-12);
    let best = optimum("b");
    let optimal_length: f64 = best.episodes.iter().map(|e| f64::from(e.length)).sum();
    let ratio = f64::from(MAX_STEPS) * best.episodes.len() as f64 / optimal_length;
    assert_near(outcome.steps.expect("an optimum").value, ratio, 1e-12);
    assert!(outcome.steps_solved.is_none());
}

#[test]
fn an_interrupted_run_is_listed_and_its_unfinished_stage_is_no_result() {
    let root = TempDir::new().expect("a folder");
    let whole = CURRICULUM.write(root.path());
    let cut = Fake { seed: 1, stages_done: 1, ..CURRICULUM }.write(root.path());
    let log = fs::read_to_string(cut.join("progress.csv")).expect("a log");
    // As a kill leaves it: the last number has lost its end, and still is one.
    fs::write(cut.join("progress.csv"), &log[..log.len() - 2]).expect("the folder is writable");
    let analysis = read(&root);
    let arm = &analysis.arms[0];
    assert_eq!(arm.seeds, [0, 1]);
    let seeds = |level: usize| arm.levels[level].as_ref().expect("a result").seeds.len();
    assert_eq!((seeds(0), seeds(1)), (2, 1));
    let [missing] = &analysis.missing[..] else { panic!("{:?}", analysis.missing) };
    assert_eq!((missing.seed, &missing.levels[..], missing.why.as_str()), (1, &["b".to_owned()][..], "unfinished"));
    let warnings = analysis.warnings.join("\n");
    assert!(warnings.contains("1 of 2 stages are done (unfinished)"), "{warnings}");
    assert!(warnings.contains("1 rows of its logs are cut off"), "{warnings}");
    // Its curve goes as far as its log, and each point says of how many seeds it is.
    let counts: Vec<usize> = arm.curves[1].mean.iter().flatten().map(|band| band.seeds).collect();
    assert_eq!(counts, [2, 2, 2, 1]);
    // Only the seed that has finished counts for the end of the curriculum.
    let performance = arm.continual.as_ref().and_then(|c| c.average_performance.as_ref()).expect("measured");
    assert_eq!(performance.seeds.keys().collect::<Vec<_>>(), [&0]);
    fs::remove_file(whole.join("progress.csv")).expect("the log is there");
    assert!(read(&root).warnings.iter().any(|warning| warning.contains("no learning curve")));
}

#[test]
fn a_cell_of_fewer_seeds_says_so_and_never_shows_the_spread_of_episodes() {
    let mut runs = vec![CURRICULUM];
    runs.extend((1..5).map(|seed| Fake { seed, stages_done: 1, ..CURRICULUM }));
    let analysis = analysis(&runs);
    assert_eq!(analysis.arms[0].levels[1].as_ref().map(|level| (level.std, level.seeds.len())), Some((None, 1)));
    let (a, b) = (optimum("a").mean, optimum("b").mean);
    let markdown = table(&analysis, "right-after-training", Format::Markdown);
    assert!(markdown.contains(&format!("| ppo | 5 | {a:.2} ± 0.00 | {b:.2} (n = 1) |")), "{markdown}");
    assert!(markdown.contains("one seed has no spread"), "{markdown}");
    let markdown = table(&analysis, "matrix-ppo", Format::Markdown);
    let worst = -f64::from(MAX_STEPS);
    assert!(markdown.contains(&format!("| level b | {worst:.2} (n = 1) | {b:.2} (n = 1) |")), "{markdown}");
    assert!(markdown.contains("over 5 seeds, each the mean over every start cell"), "{markdown}");
    let markdown = table(&analysis, "aggregates", Format::Markdown);
    assert!(markdown.contains("| ppo | 1–5 | a, b | 1.000 |"), "{markdown}");
    assert!(markdown.contains("One seed has no interval: ppo."), "{markdown}");
    let csv = table(&analysis, "right-after-training", Format::Csv);
    assert!(csv.starts_with("arm,seeds,level a mean,level a std,level b mean,level b std,level b seeds\n"), "{csv}");
    // Of whole runs alone there is nothing to say.
    let whole: Vec<Fake> = (0..2).map(|seed| Fake { seed, ..CURRICULUM }).collect();
    let text: String = tables::all(&self::analysis(&whole)).iter().map(|t| t.table.render(Format::Markdown)).collect();
    assert!(!text.contains("(n = "), "{text}");
}

#[test]
fn a_number_of_fewer_seeds_than_its_row_says_so() {
    // One seed of two solves no start, and so has no length where solved; one has no learning curve.
    let lost = Fake { seed: 1, skill: |_, _| Skill::Lost, ..AFRESH_B };
    let root = TempDir::new().expect("a folder");
    for run in [AFRESH_B, lost, CURRICULUM, Fake { seed: 1, ..CURRICULUM }] {
        let path = run.write(root.path());
        if run.seed == 1 && run.afresh {
            fs::remove_file(path.join("progress.csv")).expect("the log is there");
        }
    }
    let analysis = read(&root);
    let markdown = table(&analysis, "optimality-gap", Format::Markdown);
    assert!(markdown.contains("| 1.00 (n = 1) |"), "{markdown}");
    let markdown = table(&analysis, "against-afresh", Format::Markdown);
    assert!(markdown.contains("| ppo | b | 2 | 1/1 | 1/1 | 50.0 | 0.625 (n = 1) | 1.000 (n = 1) | -0.375 (n = 1) |"));
    let csv = table(&analysis, "time-to-threshold", Format::Csv);
    assert!(csv.contains("\nppo,b,1,0.5,"), "{csv}");
}

#[test]
fn runs_of_several_versions_are_told_of_and_extended_ones_not_pooled() {
    let other = Fake { seed: 1, commit: "def", instruction_set: "avx512", ..AFRESH_B };
    let mixed = analysis(&[AFRESH_B, other]);
    assert_eq!(
        (mixed.arms.len(), &mixed.runs[1].versions[..]),
        (1, &["cpp-rl 1.0 (commit def, libtorch 2.0)".to_owned()][..])
    );
    let warnings = mixed.warnings.join("\n");
    assert!(warnings.contains("ppo (afresh): runs of one arm were made by several versions"), "{warnings}");
    assert!(warnings.contains("ppo (afresh): runs of one arm were made with several instruction sets"), "{warnings}");
    assert!(analysis(&[AFRESH_B, Fake { seed: 1, ..AFRESH_B }]).warnings.is_empty());

    let extended = analysis(&[AFRESH_B, Fake { seed: 1, horizon: Some(500), ..AFRESH_B }]);
    let names: Vec<&str> = extended.arms.iter().map(|arm| arm.name.as_str()).collect();
    assert_eq!(names, ["ppo (afresh) [horizon=500]", "ppo (afresh) [horizon=null]"]);
}

#[test]
fn one_run_that_cannot_be_read_does_not_hide_the_others() {
    let root = TempDir::new().expect("a folder");
    CURRICULUM.write(root.path());
    let [broken, damaged] = [2, 3].map(|seed| Fake { seed, ..CURRICULUM }.write(root.path()));
    let not_begun = Fake { seed: 4, ..CURRICULUM }.path(root.path());
    fs::create_dir_all(&not_begun).expect("a folder");
    fs::write(broken.join("manifest.json"), "{}").expect("the folder is writable");
    fs::write(damaged.join("progress.csv"), "a,b\n1,2\n").expect("the folder is writable");
    fs::write(not_begun.join(".lock"), "").expect("the folder is writable");
    let analysis = read(&root);
    assert_eq!((analysis.arms[0].seeds.as_slice(), analysis.left_out.len()), (&[0][..], 3));
    let table = table(&analysis, "missing", Format::Csv);
    for (path, why) in
        [(&broken, "not a manifest of cpp-rl"), (&damaged, "has no column stage"), (&not_begun, "has not begun")]
    {
        let left_out = analysis.left_out.iter().find(|left_out| left_out.path == *path).expect("it is named");
        assert!(left_out.why.contains(why) && table.contains(&left_out.path.display().to_string()), "{left_out:?}");
        assert!(analysis.warnings.iter().any(|warning| warning.contains(why)), "{:?}", analysis.warnings);
    }
    let error = Analysis::read(&[broken]).expect_err("nothing else is there");
    assert!(format!("{error:#}").contains("not a manifest of cpp-rl"), "{error:#}");
}

#[test]
fn seeds_that_only_the_counterpart_has_are_missing() {
    let analysis = analysis(&[CURRICULUM, AFRESH_B, Fake { seed: 1, ..AFRESH_B }, Fake { seed: 2, ..CURRICULUM }]);
    let missing: Vec<(usize, u64, &[String])> =
        analysis.missing.iter().map(|missing| (missing.arm, missing.seed, &missing.levels[..])).collect();
    let [a, b] = ["a", "b"].map(str::to_owned);
    assert_eq!(missing, [(0, 1, &[a, b.clone()][..]), (1, 2, &[b][..])]);
}

#[test]
fn runs_that_were_never_made_are_missing() {
    let afresh_a = Fake { levels: &["a"], ..AFRESH_B };
    let analysis =
        analysis(&[CURRICULUM, Fake { seed: 1, ..CURRICULUM }, afresh_a, AFRESH_B, Fake { seed: 1, ..afresh_a }]);
    let [missing] = &analysis.missing[..] else { panic!("{:?}", analysis.missing) };
    assert_eq!((missing.arm, missing.seed, &missing.levels[..]), (1, 1, &["b".to_owned()][..]));
    assert_eq!(contrast_on_b(&analysis).unpaired, [1]);
    // No seed has both levels but seed 0.
    let over_levels = analysis.against_afresh[0].area.as_ref().expect("measured");
    assert_eq!((over_levels.pairs.keys().collect::<Vec<_>>(), &over_levels.levels[..]), (vec![&0], &[0, 1][..]));
}

#[test]
fn rows_without_a_return_are_counted_and_stepped_over() {
    let root = TempDir::new().expect("a folder");
    let path = AFRESH_B.write(root.path());
    let log = fs::read_to_string(path.join("progress.csv")).expect("a log");
    let mut lines: Vec<String> = log.lines().map(str::to_owned).collect();
    for line in [1, 3] {
        let start = lines[line].rfind(',').expect("columns");
        lines[line].replace_range(start + 1.., "NaN");
    }
    fs::write(path.join("progress.csv"), lines.join("\n") + "\n").expect("the folder is writable");
    let analysis = read(&root);
    assert_eq!((analysis.runs[0].log_rows, analysis.runs[0].rows_without_return), (4, 2));
    assert!(
        analysis.warnings[0].contains("2 of 4 rows of progress.csv have no mean return"),
        "{:?}",
        analysis.warnings
    );
    let seed = &analysis.arms[0].levels[0].as_ref().expect("a result").seeds[&0];
    assert_near(seed.area.expect("a curve"), 1.0, 1e-9);
    assert_eq!(seed.times[0], Time::At(500.0));
    let values = &analysis.arms[0].curves[0].seeds[&0];
    assert_eq!(values.iter().map(Option::is_some).collect::<Vec<_>>(), [false, true, false, true]);
}

#[test]
fn plasticity_is_read_where_it_was_logged() {
    let root = TempDir::new().expect("a folder");
    let first = CURRICULUM.write(root.path());
    Fake { seed: 1, ..CURRICULUM }.write(root.path());
    let head = "stage,level,timesteps,cumulative_timesteps,plasticity/policy.0/dormant_0.1,plasticity/weight_norm\n";
    fs::write(first.join("plasticity.csv"), format!("{head}0,a,500,500,0.25,NaN\n1,b,500,1500,0.75,3\n"))
        .expect("writable");
    let analysis = read(&root);
    let dormant = |stage| {
        let series = analysis.arms[0].plasticity.iter().filter(|series| series.stage == stage);
        series.filter(|series| series.measure == "plasticity/policy.0/dormant_0.1").collect::<Vec<_>>()
    };
    let [second] = dormant(1)[..] else { panic!("one series per measure and stage") };
    assert_eq!(second.points[0].cumulative_timesteps, 1500.0);
    assert_eq!((second.seeds.len(), second.seeds[&0][0]), (1, Some(0.75)));
    assert_eq!(second.mean[0].map(|band| (band.value, band.low)), Some((0.75, None)));
    assert_eq!(analysis.arms[0].plasticity.len(), 4);
    // A value that is none is counted, by measure.
    assert_eq!(analysis.runs[0].plasticity_rows, 2);
    assert_eq!(analysis.runs[0].plasticity_without_value, [("plasticity/weight_norm".to_owned(), 1)].into());
    let warning = "without a value in some of the 2 rows of plasticity.csv: plasticity/weight_norm 1";
    assert!(analysis.warnings.iter().any(|other| other.contains(warning)), "{:?}", analysis.warnings);
    let csv = table(&analysis, "plasticity-ppo", Format::Csv);
    assert_eq!(
        csv,
        "measure,level a,level a low,level a high,level b,level b low,level b high\n\
         policy.0/dormant_0.1,0.25,,,0.75,,\nweight_norm,,,,3,,\n"
    );
}

#[test]
fn plasticity_at_the_end_of_a_stage_is_compared_with_afresh() {
    let root = TempDir::new().expect("a folder");
    for seed in 0..3 {
        for run in [Fake { seed, ..CURRICULUM }, Fake { seed, ..AFRESH_B }] {
            let path = run.write(root.path());
            let rows = |stage: usize| {
                // The last row counts, whatever stood before it.
                let end = if run.afresh { 1.0 } else { 3.0 + stage as f64 } + seed as f64;
                format!("{stage},{},500,500,99\n{stage},{},1000,1000,{end}\n", run.levels[stage], run.levels[stage])
            };
            let rows: String = (0..run.levels.len()).map(rows).collect();
            let head = "stage,level,timesteps,cumulative_timesteps,plasticity/grad_norm\n";
            fs::write(path.join("plasticity.csv"), format!("{head}{rows}")).expect("the folder is writable");
        }
    }
    // A stage that is not done has no end.
    Fake { seed: 2, stages_done: 1, ..CURRICULUM }.write(root.path());
    let analysis = read(&root);
    let markdown = table(&analysis, "plasticity-ppo", Format::Markdown);
    assert!(markdown.contains("| grad_norm | 4.000 [3.000, 5.000] | 4.500 [4.000, 5.000] (n = 2) |"), "{markdown}");
    let markdown = table(&analysis, "plasticity-differences-ppo", Format::Markdown);
    assert!(markdown.contains("| grad_norm | – | 3.000 [3.000, 3.000] |"), "{markdown}");
    assert_eq!(analysis.against_afresh[0].plasticity[0].value.seeds, [(0, 3.0), (1, 3.0)].into());
}

#[test]
fn arms_are_compared_unpaired_and_long_logs_shortened() {
    let better = Fake { arm: "dqn", ..AFRESH_B };
    let worse = Fake { skill: |_, _| Skill::Lost, ..AFRESH_B };
    let root = TempDir::new().expect("a folder");
    for seed in 0..3 {
        Fake { seed, ..better }.write(root.path());
        let path = Fake { seed: seed + 7, ..worse }.write(root.path());
        fs::write(path.join("progress.csv"), worse.progress(1)).expect("the folder is writable");
    }
    let analysis = read(&root);
    let [improvement] = &analysis.improvements[..] else { panic!("one pair of arms") };
    assert_eq!(analysis.arms[improvement.x].name, "dqn (afresh)");
    assert_eq!((improvement.probability.value, improvement.probability.runs), (1.0, 3));
    assert_eq!(analysis.arms[1].curves[0].points.len(), 100);
    assert_near(analysis.arms[1].curves[0].points[0].timesteps, 5.5, 1e-12);
}

#[test]
fn the_published_figures_stand_beside_the_studys_curriculum() {
    let study = Fake { levels: &["0", "1", "2", "3"], stages_done: 4, ..CURRICULUM };
    let analysis = analysis(&[study]);
    let table = |name: &str, format: Format| table(&analysis, name, format);
    let right_after = table("right-after-training", Format::Csv);
    assert!(
        right_after.contains("ppo (published),1,42.723,1.48,36.783,44.46,29.739,46.56,40.316,2.13"),
        "{right_after}"
    );
    let after = table("after-level-3", Format::Csv);
    assert!(after.contains("ppo (published),1,-194.45,2.38,-196.1,6.23,-199.55,1.96,40.55,2.2"), "{after}");
    let after = table("after-level-3", Format::Markdown);
    assert!(after.contains("(the study's Tables 2-4)") && after.contains("Published: one seed"), "{after}");
    assert!(after.contains("Trained for another time here: ppo (1000 timesteps on a level, not 500000)."), "{after}");
    let planners = table("planners", Format::Csv);
    assert!(
        planners.contains("0,A* (published),20,42.25,,40,45,") && planners.contains("\n0,random,55,-"),
        "{planners}"
    );
    let other = table("after-level-0", Format::Markdown);
    assert!(!other.contains("ublished") && !other.contains("the study's"), "{other}");
}

#[test]
fn published_figures_stand_beside_nothing_that_they_do_not_describe() {
    assert!(analysis(&[CURRICULUM]).published.is_none());
    // The study's models knew levels 1 and 2 when they were trained on level 3.
    let skipping = analysis(&[Fake { levels: &["0", "3"], ..CURRICULUM }]);
    let right_after = table(&skipping, "right-after-training", Format::Csv);
    assert!(right_after.contains("ppo (published),1,42.723,1.48,,\n"), "{right_after}");
    assert!(!table(&skipping, "after-level-3", Format::Markdown).contains("ublished"));
    let backwards = analysis(&[Fake { levels: &["3", "0"], ..CURRICULUM }]);
    let right_after = table(&backwards, "right-after-training", Format::Csv);
    assert!(!right_after.contains("ppo (published)") && right_after.contains("A* (published)"), "{right_after}");
    // Level 3 in name alone.
    let root = TempDir::new().expect("a folder");
    let path = Fake { levels: &["0", "3"], ..CURRICULUM }.write(root.path());
    let mut manifest = Manifest::read(&path).expect("a manifest");
    manifest.stages[1].map = map("a");
    manifest.write(&path).expect("the folder is writable");
    let planners = table(&read(&root), "planners", Format::Csv);
    assert!(planners.contains("\n0,A* (published)") && !planners.contains("\n3,A* (published)"), "{planners}");
    // Another step limit makes other returns.
    manifest.stages[1].map = map("3");
    manifest.config.insert("max_steps".to_owned(), json!(100));
    manifest.write(&path).expect("the folder is writable");
    assert!(read(&root).published.is_none());
}

#[test]
fn a_report_is_written_as_files() {
    let root = TempDir::new().expect("a folder");
    for seed in 0..2 {
        Fake { seed, ..CURRICULUM }.write(root.path());
        Fake { seed, ..AFRESH_B }.write(root.path());
    }
    let analysis = read(&root);
    let out = root.path().join("report");
    export::write(&analysis, &out, "cpp-rl compare").expect("the folder is writable");
    let text = |name: &str| fs::read_to_string(out.join(name)).expect("the file is there");
    let json: Value = serde_json::from_str(&text("report.json")).expect("JSON");
    assert_eq!(json["arms"][0]["matrix"]["rows"][0]["after"], Value::Null);
    assert_eq!(json["against_afresh"][0]["levels"][1]["thresholds"][1]["pairs"]["1"][0], json!({ "at": 1000.0 }));
    for named in tables::all(&analysis) {
        assert!(text("tables.md").contains(&named.table.title), "{}", named.name);
        assert!(text(&format!("tables/{}.csv", named.name)).lines().count() > 1, "{}", named.name);
    }
    assert_eq!(text("tables.tex").matches("\\begin{tabular}").count(), tables::all(&analysis).len());
}
