//! What `compare` makes of runs, on runs that are written here: every number in them is known.

use std::fs;

use cpp_rl::report::analysis::{Analysis, Protocol};
use cpp_rl::report::exhibits::aggregates::Aggregates;
use cpp_rl::report::exhibits::continual::Continual;
use cpp_rl::report::exhibits::from_scratch::{Contrast, LevelContrast, transfer_by_areas};
use cpp_rl::report::exhibits::improvement::Improvements;
use cpp_rl::report::{Format, exhibits, export};
use rl_stats::{Interval, Time};
use serde_json::{Value, json};
use tempfile::TempDir;

use crate::fakes::{self, CURRICULUM, FROM_SCRATCH_B, Fake, MAX_STEPS, Skill, analysis, optimum, read, table, tables};
use crate::numbers::assert_near;

/// The only pair's contrast.
fn only_pair(analysis: &Analysis) -> Contrast {
    Contrast::new(analysis, analysis.pairs[0])
}

/// The contrast on level b, the only one with runs from scratch.
fn contrast_on_b(analysis: &Analysis) -> LevelContrast {
    let b = analysis.level("b").expect("level b");
    only_pair(analysis).levels[b].clone().expect("a contrast")
}

#[test]
fn one_seed_has_no_interval_and_says_so() {
    let analysis = analysis(&[CURRICULUM, FROM_SCRATCH_B]);
    let names: Vec<&str> = analysis.arms.iter().map(|arm| arm.name.as_str()).collect();
    assert_eq!(names, ["ppo", "ppo (from scratch)"]);
    assert!(analysis.differences.is_empty(), "{:?}", analysis.differences);
    let arm = &analysis.arms[0];
    let outcome = arm.levels[0].as_ref().expect("a result");
    assert_near(outcome.mean, optimum("a").mean, 1e-12);
    assert_eq!(outcome.std, None);
    assert_near(outcome.seeds[&0].std, optimum("a").std, 1e-12); // over start cells
    assert_eq!(outcome.return_mean.interval, None);
    let aggregates = Aggregates::new(&analysis);
    assert!(aggregates.arms[0].as_ref().is_some_and(|a| a.mean.interval.is_none() && a.mean.runs == 1));
    assert!(contrast_on_b(&analysis).area.as_ref().is_some_and(|area| area.difference.interval.is_none()));
    assert!(arm.curves[0].mean.iter().flatten().all(|band| band.low.is_none() && band.seeds == 1));
    let text: String = exhibits::main_tables(&analysis, &exhibits::all(&analysis))
        .iter()
        .map(|table| table.render(Format::Table))
        .collect();
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
    let aggregates = Aggregates::new(&analysis);
    let aggregates = aggregates.arms[0].as_ref().expect("aggregates");
    assert_eq!(aggregates.interquartile_mean.interval, Some(Interval { low: 1.0, high: 1.0 }));
    assert_near(aggregates.optimality_gap.value, 0.0, 1e-12);
    // At the end level a is worth 0 or 1 and level b 1.
    let continual = Continual::new(&analysis);
    let continual = continual.arms[0].as_ref().expect("measures");
    let mean = |measure: &str| continual.get(measure).expect("measured").mean.value;
    assert_near(mean("average performance"), 0.75, 1e-12);
    assert_near(mean("backward transfer"), -0.5, 1e-12);
    assert_near(mean("forward transfer"), 0.0, 1e-12);
    assert_near(mean("forgetting"), 0.25, 1e-12);
    assert_near(continual.forgetting_by_stage[0].as_ref().expect("measured").mean.value, 0.5, 1e-12);
    assert_near(mean("isolated forgetting"), 0.5, 1e-12);
    assert_near(mean("zero-shot transfer"), 0.0, 1e-12);
    let interval = continual.get("backward transfer").and_then(|m| m.mean.interval).expect("an interval");
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
    let fails_b = Fake { skill: |_, _| Skill::Lost, ..FROM_SCRATCH_B };
    let runs: Vec<Fake> = (0..8).map(|seed| Fake { seed, ..if seed < 2 { fails_b } else { FROM_SCRATCH_B } }).collect();
    let analysis = analysis(&runs);
    let outcome = analysis.arms[0].levels[0].as_ref().expect("a result");
    let (worst, best) = (-f64::from(MAX_STEPS), optimum("b").mean);
    assert_near(outcome.return_mean.value, (2.0 * worst + 6.0 * best) / 8.0, 1e-9);
    assert_near(outcome.return_median.value, best, 1e-9);
    // Two of eight go at either end, and with them both that fail.
    assert_near(outcome.return_iqm.value, best, 1e-9);
    // Of eight the lowest and the highest hold the median with 99%; the second ones with 93% only.
    let median = outcome.return_median.interval.expect("an interval");
    assert_near(median.low, worst, 1e-9);
    assert_near(median.high, best, 1e-9);
    let interval = outcome.return_iqm.interval.expect("an interval");
    // Half of the resamples hold two that fail or fewer, and some four or more.
    assert_near(interval.high, best, 1e-9);
    assert!(interval.low < best - 0.25 * (best - worst) && interval.low > worst, "{interval:?}");
    let csv = table(&analysis, "returns", Format::Csv);
    let row = csv.lines().nth(1).expect("a row");
    let numbers: Vec<f64> = row.split(',').skip(3).map(|field| field.parse().expect("a number")).collect();
    assert!(
        csv.starts_with("arm,level,seeds,mean,mean low,mean high,median,")
            && row.starts_with("ppo (from scratch),b,8,")
    );
    assert_near(numbers[0], outcome.return_mean.value, 1e-9);
    assert_near(numbers[7], interval.low, 1e-9);
}

#[test]
fn a_curriculum_is_measured_against_from_scratch_seed_by_seed() {
    // Level b is learned by half of the seeds in the curriculum, and at once from scratch.
    let fails_b = Fake { curve: |level, share| if level == "b" { 0.0 } else { share }, ..CURRICULUM };
    let mut runs = Vec::new();
    for seed in 0..4 {
        runs.push(Fake { seed, ..if seed < 2 { CURRICULUM } else { fails_b } });
        runs.push(Fake { seed, ..FROM_SCRATCH_B });
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
    assert_near(contrast.relative_loss.expect("an area from scratch").value, 0.6875, 1e-9);
    let against = only_pair(&analysis);
    assert_eq!(against.area.as_ref().expect("areas").levels, [1]);
    assert_near(against.relative_loss.expect("an area from scratch").value, 0.6875, 1e-9);
    // Nothing can be gained over an area of 1.
    assert!(transfer_by_areas(&analysis, against.pair.curriculum).is_none());
    let csv = table(&analysis, "against-from-scratch", Format::Csv);
    assert!(csv.contains("\nppo,b,4,4/4,4/4,100,") && csv.contains("\nppo,mean of b,4,,,,"), "{csv}");
    let final_return = contrast.final_return.as_ref().expect("final returns");
    assert_near(final_return.difference.value, 0.0, 1e-12);
    assert_eq!(final_return.paired_improvement_share.map(|share| share.value), Some(0.5));
    let [half, most] = &contrast.thresholds[..] else { panic!("two thresholds") };
    // Rows are 250 timesteps apart: 0.5 is reached at 500, 0.9 at 1,000, by two seeds of four.
    assert_eq!((half.threshold, half.pairs[&0]), (0.5, (Time::At(500.0), Time::At(250.0))));
    assert_eq!((most.threshold, most.pairs[&3]), (0.9, (Time::Never, Time::At(250.0))));
    assert_eq!((half.curriculum.median, half.curriculum.censored), (Time::Never, 2));
    assert_eq!((half.from_scratch.median, half.from_scratch.censored), (Time::At(250.0), 0));
    assert_eq!(half.sooner_share.map(|share| share.value), Some(0.0));
    assert_eq!(Improvements::new(&analysis).pairs.len(), 0); // two protocols are never compared as arms
}

#[test]
fn nothing_is_compared_on_the_first_level_of_a_curriculum() {
    let from_scratch_a = Fake { levels: &["a"], curve: |_, share| share, ..FROM_SCRATCH_B };
    // Level b is worth an area of 0.02 from scratch, of which no share can be told.
    let hard = Fake { curve: |_, _| 0.02, ..FROM_SCRATCH_B };
    let seeds = |run: Fake| [run, Fake { seed: 1, ..run }];
    let analysis = analysis(&[seeds(CURRICULUM), seeds(from_scratch_a), seeds(hard)].concat());
    let against = only_pair(&analysis);
    let [a, b] = &against.levels[..] else { panic!("two levels") };
    let [a, b] = [a, b].map(|contrast| contrast.as_ref().expect("a contrast"));
    let area = a.area.as_ref().expect("areas");
    assert!(a.is_first && area.difference.value == 0.0 && area.paired_improvement_share.is_none());
    assert!(a.thresholds.iter().all(|times| times.sooner_share.is_none()));
    assert!(!b.is_first && b.relative_loss.is_none() && b.thresholds[0].sooner_share.is_some());
    assert_eq!((b.from_scratch_thresholds[0].censored, b.from_scratch_thresholds[0].seeds), (2, 2));
    // Over both levels areas are 0.625 in the curriculum, and (0.625 + 0.02) / 2 from scratch.
    let from_scratch = (0.625 + 0.02) / 2.0;
    assert_near(against.relative_loss.expect("an area").value, (from_scratch - 0.625) / from_scratch, 1e-9);
    assert_near(
        transfer_by_areas(&analysis, against.pair.curriculum).expect("something to gain").value,
        (0.625 - from_scratch) / (1.0 - from_scratch),
        1e-9,
    );
}

#[test]
fn a_level_that_nobody_solves_is_censored_and_not_dropped() {
    let lost = Fake { skill: |_, _| Skill::Lost, curve: |_, _| 0.0, ..FROM_SCRATCH_B };
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
    let continual = Continual::new(&analysis);
    let performance = continual.arms[0].as_ref().and_then(|c| c.get("average performance")).expect("measured");
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
    assert!(markdown.contains("One seed has no spread"), "{markdown}");
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
    let text: String = tables(&fakes::analysis(&whole)).iter().map(|t| t.table.render(Format::Markdown)).collect();
    assert!(!text.contains("(n = "), "{text}");
}

#[test]
fn a_number_of_fewer_seeds_than_its_row_says_so() {
    // One seed of two solves no start, and so has no length where solved; one has no learning curve.
    let lost = Fake { seed: 1, skill: |_, _| Skill::Lost, ..FROM_SCRATCH_B };
    let root = TempDir::new().expect("a folder");
    for run in [FROM_SCRATCH_B, lost, CURRICULUM, Fake { seed: 1, ..CURRICULUM }] {
        let path = run.write(root.path());
        if run.seed == 1 && run.from_scratch {
            fs::remove_file(path.join("progress.csv")).expect("the log is there");
        }
    }
    let analysis = read(&root);
    let markdown = table(&analysis, "optimality-gap", Format::Markdown);
    assert!(markdown.contains("| 1.00 (n = 1) |"), "{markdown}");
    let markdown = table(&analysis, "against-from-scratch", Format::Markdown);
    assert!(markdown.contains("| ppo | b | 2 | 1/1 | 1/1 | 50.0 | 0.625 (n = 1) | 1.000 (n = 1) | -0.375 (n = 1) |"));
    let csv = table(&analysis, "time-to-threshold", Format::Csv);
    assert!(csv.contains("\nppo,b,1,0.5,"), "{csv}");
}

#[test]
fn runs_of_several_versions_are_told_of_and_extended_ones_not_pooled() {
    let other = Fake { seed: 1, commit: "def", instruction_set: "avx512", ..FROM_SCRATCH_B };
    let mixed = analysis(&[FROM_SCRATCH_B, other]);
    assert_eq!(
        (mixed.arms.len(), &mixed.runs[1].versions[..]),
        (1, &["cpp-rl 1.0 (commit def, libtorch 2.0)".to_owned()][..])
    );
    let warnings = mixed.warnings.join("\n");
    assert!(warnings.contains("ppo (from scratch): runs of one arm were made by several versions"), "{warnings}");
    assert!(
        warnings.contains("ppo (from scratch): runs of one arm were made with several instruction sets"),
        "{warnings}"
    );
    assert!(analysis(&[FROM_SCRATCH_B, Fake { seed: 1, ..FROM_SCRATCH_B }]).warnings.is_empty());

    let extended = analysis(&[FROM_SCRATCH_B, Fake { seed: 1, horizon: Some(500), ..FROM_SCRATCH_B }]);
    let names: Vec<&str> = extended.arms.iter().map(|arm| arm.name.as_str()).collect();
    assert_eq!(names, ["ppo (from scratch) [horizon=500]", "ppo (from scratch) [horizon=null]"]);
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
    let analysis =
        analysis(&[CURRICULUM, FROM_SCRATCH_B, Fake { seed: 1, ..FROM_SCRATCH_B }, Fake { seed: 2, ..CURRICULUM }]);
    let missing: Vec<(usize, u64, &[String])> =
        analysis.missing.iter().map(|missing| (missing.arm, missing.seed, &missing.levels[..])).collect();
    let [a, b] = ["a", "b"].map(str::to_owned);
    assert_eq!(missing, [(0, 1, &[a, b.clone()][..]), (1, 2, &[b][..])]);
}

#[test]
fn runs_that_were_never_made_are_missing() {
    let from_scratch_a = Fake { levels: &["a"], ..FROM_SCRATCH_B };
    let analysis = analysis(&[
        CURRICULUM,
        Fake { seed: 1, ..CURRICULUM },
        from_scratch_a,
        FROM_SCRATCH_B,
        Fake { seed: 1, ..from_scratch_a },
    ]);
    let [missing] = &analysis.missing[..] else { panic!("{:?}", analysis.missing) };
    assert_eq!((missing.arm, missing.seed, &missing.levels[..]), (1, 1, &["b".to_owned()][..]));
    assert_eq!(contrast_on_b(&analysis).unpaired, [1]);
    // No seed has both levels but seed 0.
    let against = only_pair(&analysis);
    let over_levels = against.area.as_ref().expect("measured");
    assert_eq!((over_levels.pairs.keys().collect::<Vec<_>>(), &over_levels.levels[..]), (vec![&0], &[0, 1][..]));
}

#[test]
fn arms_are_compared_unpaired_and_long_logs_shortened() {
    let better = Fake { arm: "dqn", ..FROM_SCRATCH_B };
    let worse = Fake { skill: |_, _| Skill::Lost, ..FROM_SCRATCH_B };
    let root = TempDir::new().expect("a folder");
    for seed in 0..3 {
        Fake { seed, ..better }.write(root.path());
        let path = Fake { seed: seed + 7, ..worse }.write(root.path());
        fs::write(path.join("progress.csv"), worse.progress(1)).expect("the folder is writable");
    }
    let analysis = read(&root);
    let improvements = Improvements::new(&analysis);
    let [improvement] = &improvements.pairs[..] else { panic!("one pair of arms") };
    assert_eq!(analysis.arms[improvement.x].name, "dqn (from scratch)");
    assert_eq!((improvement.probability.value, improvement.probability.runs), (1.0, 3));
    assert_eq!(analysis.arms[1].curves[0].points.len(), 100);
    assert_near(analysis.arms[1].curves[0].points[0].timesteps, 5.5, 1e-12);
}

#[test]
fn few_seeds_are_never_certain() {
    let better = Fake { arm: "dqn", ..FROM_SCRATCH_B };
    let worse = Fake { skill: |_, _| Skill::Lost, ..FROM_SCRATCH_B };
    let runs: Vec<Fake> = (0..5).flat_map(|seed| [Fake { seed, ..better }, Fake { seed, ..worse }]).collect();
    let csv = table(&analysis(&runs), "probability-of-improvement", Format::Markdown);
    // All of five: the lower bound p has p^5 = 0.025.
    assert!(csv.contains("| 1.000 [0.478, 1.000] |") && csv.contains("exact (Clopper-Pearson)"), "{csv}");
}

#[test]
fn differences_on_several_levels_are_read_together() {
    // Seeds differ in how much they lose on level b.
    let curves: [fn(&str, f64) -> f64; 4] = [
        |level, share| if level == "b" { 0.1 * share } else { share },
        |level, share| if level == "b" { 0.2 * share } else { share },
        |level, share| if level == "b" { 0.4 * share } else { share },
        |level, share| if level == "b" { 0.8 * share } else { share },
    ];
    let runs: Vec<Fake> = (0..4)
        .flat_map(|seed| [Fake { seed, curve: curves[seed as usize], ..CURRICULUM }, Fake { seed, ..FROM_SCRATCH_B }])
        .collect();
    let analysis = analysis(&runs);
    let contrast = contrast_on_b(&analysis);
    // Areas are 0.625 of 0.1, 0.2, 0.4 and 0.8, and 1 from scratch: the mean difference is 0.765625, its standard
    // error 0.09674, t 7.9142 with 3 degrees of freedom.
    let p = contrast.area.as_ref().and_then(|area| area.p_holm).expect("a test");
    assert_near(p, 0.004_205_644_770_8, 1e-12);
    assert_eq!(contrast.final_return.as_ref().and_then(|last| last.p_holm), None, "all differences are the same");
    let over = only_pair(&analysis);
    assert_eq!(over.area.as_ref().and_then(|area| area.p_value), Some(p), "one level alone is one contrast");
}

/// An agent that loses a chance on a level to come: greedy returns lie on the floor before and after.
#[test]
fn sampled_returns_show_harm_that_greedy_ones_hide() {
    let sampled = |stage: Option<usize>, level| match stage {
        Some(stage) if stage < level => Skill::Lost,
        _ => Skill::Perfect,
    };
    let analysis = analysis(&[Fake { sampled: Some(sampled), ..CURRICULUM }, Fake { seed: 1, ..CURRICULUM }]);
    let continual = Continual::new(&analysis);
    let continual = continual.arms[0].as_ref().expect("measures");
    let of = |measure: &str| continual.get(measure).expect("measured");
    assert_near(of("forward transfer").mean.value, 0.0, 1e-12);
    assert_near(of("sampled forward transfer").mean.value, -1.0, 1e-12);
    assert_eq!((of("forward transfer").seeds.len(), of("sampled forward transfer").seeds.len()), (2, 1));
    let values = analysis.seed_values.iter().filter(|value| value.measure == "sampled_return" && value.level == 1);
    let values: Vec<(u64, Option<u16>, f64)> = values.map(|v| (v.seed, v.stage, v.value)).collect();
    let best = crate::fakes::optimum("b").mean;
    assert_eq!(values, [(0, None, best), (0, Some(0), -20.0), (0, Some(1), best)]);
    let table = table(&analysis, "continual-learning", Format::Csv);
    assert!(table.starts_with("arm,seeds,") && table.contains("sampled forward transfer,"), "{table}");
}

#[test]
fn a_report_is_written_as_files() {
    let root = TempDir::new().expect("a folder");
    for seed in 0..2 {
        Fake { seed, ..CURRICULUM }.write(root.path());
        Fake { seed, ..FROM_SCRATCH_B }.write(root.path());
    }
    let analysis = read(&root);
    let out = root.path().join("report");
    export::write(&analysis, &exhibits::all(&analysis), &out, "cpp-rl compare").expect("the folder is writable");
    let text = |name: &str| fs::read_to_string(out.join(name)).expect("the file is there");
    let seeds = text("seeds.csv");
    assert!(seeds.starts_with("arm,sequence,treatment,seed,stage,level,measure,value\n"), "{seeds}");
    assert!(!seeds.contains("sampled_") && !text("tables/continual-learning.csv").contains("sampled"));
    for row in ["ppo,curriculum,,1,,a,return,-20", "ppo,curriculum,,0,1,b,timesteps,1000"] {
        assert!(seeds.lines().any(|line| line == row), "{row} is not in\n{seeds}");
    }
    assert!(seeds.contains("\nppo (from scratch),level-b,,1,0,b,time_to_0.9,250\n"), "{seeds}");
    let json: Value = serde_json::from_str(&text("report.json")).expect("JSON");
    assert_eq!(json["arms"][0]["matrix"]["rows"][0]["after"], Value::Null);
    assert_eq!(
        json["exhibits"]["from_scratch"][0]["levels"][1]["thresholds"][1]["pairs"]["1"][0],
        json!({ "at": 1000.0 })
    );
    for named in tables(&analysis) {
        assert!(text("tables.md").contains(&named.table.title), "{}", named.name);
        assert!(text(&format!("tables/{}.csv", named.name)).lines().count() > 1, "{}", named.name);
    }
    assert_eq!(text("tables.tex").matches("\\begin{tabular}").count(), tables(&analysis).len());
}
