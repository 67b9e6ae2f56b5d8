//! What a report says of sequences and of forks, on runs that are written here.

use cpp_rl::report::Format;
use cpp_rl::report::analysis::{Analysis, Protocol};
use cpp_rl::report::exhibits::{self, treatments::Treatments};
use cpp_rl::report::render;

use crate::fakes::{CURRICULUM, FROM_SCRATCH_B, Fake, analysis, table};

/// Learns nothing on level b after level a: its area there is 0.
const WARM: Fake = Fake { curve: |level, _| if level == "a" { 1.0 } else { 0.0 }, ..CURRICULUM };
/// Goes on after level a under a treatment that gives half of it back.
const FORK: Fake = Fake { fork: Some((0, "head-0.02")), curve: |_, _| 0.5, ..CURRICULUM };

fn with_seeds(runs: &[Fake], seeds: u64) -> Vec<Fake> {
    runs.iter().flat_map(|&run| (0..seeds).map(move |seed| Fake { seed, ..run })).collect()
}

fn names(analysis: &Analysis) -> Vec<&str> {
    analysis.arms.iter().map(|arm| arm.name.as_str()).collect()
}

#[test]
fn arms_are_told_apart_by_their_sequence() {
    let other = Fake { levels: &["b", "a"], sequence: "order-10", ..CURRICULUM };
    let dqn = Fake { arm: "dqn", sequence: "order-01", ..CURRICULUM };
    let analysis = analysis(&[Fake { sequence: "order-01", ..CURRICULUM }, other, FROM_SCRATCH_B, dqn]);
    assert_eq!(names(&analysis), ["dqn", "ppo (from scratch)", "ppo, order-01", "ppo, order-10"]);
    assert_eq!(analysis.pairs.len(), 2, "each order has its runs from scratch");
    let longer = Fake { timesteps: 2000, ..CURRICULUM };
    let analysis = crate::fakes::analysis(&[
        CURRICULUM,
        Fake { sequence: "order-10", ..longer },
        Fake { levels: &["b", "a"], sequence: "order-10", seed: 1, ..CURRICULUM },
    ]);
    let labels = names(&analysis);
    assert_eq!(labels[0], "ppo, curriculum");
    assert!(labels[1].starts_with("ppo, order-10 [stages=") && labels[2].starts_with("ppo, order-10 ["), "{labels:?}");
}

#[test]
fn forks_are_arms_of_their_own_with_the_stages_that_they_train() {
    let analysis = analysis(&with_seeds(&[WARM, FORK, FROM_SCRATCH_B], 3));
    assert_eq!(names(&analysis), ["ppo", "ppo (from scratch)", "ppo, after 0: head-0.02"]);
    let fork = &analysis.arms[2];
    assert_eq!(fork.protocol, Protocol::Fork);
    assert_eq!(fork.stages.iter().map(|stage| (stage.stage, stage.level)).collect::<Vec<_>>(), [(1, 1)]);
    assert!(fork.levels[0].is_none() && fork.levels[1].is_some());
    assert_eq!(fork.curves.len(), 1);
    assert!(analysis.missing.is_empty(), "{:?}", analysis.missing);
    let [pair] = analysis.forks[..] else { panic!("{:?}", analysis.forks) };
    assert_eq!((pair.fork, pair.curriculum, pair.from_scratch), (2, Some(0), Some(1)));
    let runs: Vec<(u16, usize)> =
        analysis.runs.iter().filter(|run| run.arm == 2).map(|run| (run.stages_done, run.stages)).collect();
    assert_eq!(runs, [(1, 1); 3]);
    // What they did not train is in no table: neither as a row nor as an empty cell.
    for name in ["right-after-training", "aggregates"] {
        assert!(!table(&analysis, name, Format::Csv).contains("head-0.02"), "{name}");
    }
    for named in crate::fakes::tables(&analysis) {
        let csv = named.table.render(Format::Csv);
        assert!(!csv.contains("head-0.02,a"), "{}: {csv}", named.name);
    }
}

#[test]
fn a_fork_that_is_not_done_lacks_its_own_stages_alone() {
    let begun = Fake { stages_done: 1, seed: 1, ..FORK };
    let analysis = analysis(&[WARM, Fake { seed: 1, ..WARM }, FORK, begun]);
    let [missing] = &analysis.missing[..] else { panic!("{:?}", analysis.missing) };
    assert_eq!((missing.seed, &missing.levels[..]), (1, &["b".to_owned()][..]));
    assert!(
        analysis.warnings.iter().any(|warning| warning.contains("0 of 1 stages are done")),
        "{:?}",
        analysis.warnings
    );
}

#[test]
fn seeds_csv_names_the_treatment() {
    let analysis = analysis(&[WARM, FORK]);
    let csv = render::seeds(&analysis);
    assert!(csv.starts_with("arm,sequence,treatment,seed,stage,level,measure,value\n"), "{csv}");
    assert!(csv.contains("\"ppo, after 0: head-0.02\",curriculum,after-0:head-0.02,0,1,b,area,0.5\n"), "{csv}");
    assert!(csv.contains("\nppo,curriculum,,0,1,b,area,0\n"), "{csv}");
    let of_fork = |line: &&str| line.contains("after-0:");
    // Stage 0 is the parent's; before the first stage it was evaluated on every level.
    assert!(csv.lines().filter(of_fork).all(|line| line.contains(",0,1,") || line.contains(",0,,")), "{csv}");
}

/// By hand: 0 without a treatment, 0.5 under it, 1 from scratch, so that half of what was lost is given back.
#[test]
fn treatments_give_back_a_share_of_what_was_lost() {
    let wavy = Fake { curve: |_, share| if share > 0.3 { 1.0 } else { 0.9 }, ..FROM_SCRATCH_B };
    let runs = with_seeds(&[WARM, FORK], 5);
    let scratch = (0..5).map(|seed| Fake { seed, ..if seed % 2 == 0 { wavy } else { FROM_SCRATCH_B } });
    let analysis = analysis(&runs.into_iter().chain(scratch).collect::<Vec<_>>());
    let [stage] = &Treatments::new(&analysis).stages[..] else { panic!("one stage") };
    let area = stage.area.as_ref().expect("areas");
    let value = |of: &Option<cpp_rl::report::analysis::OverSeeds>| of.as_ref().expect("a mean").mean.value;
    assert_eq!((area.treated.mean.value, value(&area.untreated)), (0.5, 0.0));
    let from_scratch = value(&area.from_scratch);
    assert!(from_scratch > 0.95 && from_scratch < 1.0, "{from_scratch}");
    let share = stage.recovered_share.expect("a share");
    assert!((share.value - 0.5 / from_scratch).abs() < 1e-12);
    let interval = share.interval.expect("several seeds");
    assert!(interval.low <= share.value && share.value <= interval.high && interval.low < interval.high);
    let csv = table(&analysis, "treatments", Format::Csv);
    assert!(csv.contains("\"ppo, after 0: head-0.02\",1,b,5,0,0.5,"), "{csv}");
    let figures = exhibits::sections(&analysis, &exhibits::all(&analysis)).into_iter().flat_map(|s| s.figures);
    let figures: Vec<String> = figures.map(|figure| figure.name).collect();
    assert!(["treatments", "recovered-share"].iter().all(|name| figures.iter().any(|f| f == name)), "{figures:?}");
}

#[test]
fn no_share_is_told_where_nothing_is_known_to_be_lost() {
    // From scratch is now as bad as with a past, now better.
    let scratch = |seed: u64| Fake { seed, curve: if seed == 0 { |_, _| 0.3 } else { |_, _| 0.0 }, ..FROM_SCRATCH_B };
    let runs = with_seeds(&[WARM, FORK], 3).into_iter().chain((0..3).map(scratch)).collect::<Vec<_>>();
    let analysis = analysis(&runs);
    let [stage] = &Treatments::new(&analysis).stages[..] else { panic!("one stage") };
    assert!(stage.lost.is_some() && stage.recovered_share.is_none());
    let markdown = table(&analysis, "treatments", Format::Markdown);
    assert!(markdown.contains("There is no share where the interval"), "{markdown}");
    // What is known to be gained is no loss either: from scratch nothing is learned, and with a past half of it.
    let learned = Fake { curve: |_, _| 0.5, ..WARM };
    let gained = with_seeds(&[learned, FORK], 3).into_iter().chain((0..3).map(|seed| {
        let curve: fn(&str, f64) -> f64 = if seed == 0 { |_, _| 0.1 } else { |_, _| 0.0 };
        Fake { seed, curve, ..FROM_SCRATCH_B }
    }));
    let stages = Treatments::new(&crate::fakes::analysis(&gained.collect::<Vec<_>>())).stages;
    assert!(stages[0].lost.and_then(|lost| lost.interval).is_some_and(|interval| interval.high < 0.0), "{stages:?}");
    assert!(stages[0].recovered_share.is_none());
    // One seed has no interval, and so no share.
    let analysis = crate::fakes::analysis(&[WARM, FORK, FROM_SCRATCH_B]);
    assert!(Treatments::new(&analysis).stages[0].recovered_share.is_none());
}

/// What was lost is skewed, so that its studentised interval is above 0. Student's is not: by Fieller the share may be
/// anything.
#[test]
fn no_share_is_told_where_its_interval_has_no_end() {
    let curves: [fn(&str, f64) -> f64; 5] = [|_, _| 0.1, |_, _| 0.15, |_, _| 0.2, |_, _| 0.3, |_, _| 1.0];
    let scratch = (0..5).map(|seed| Fake { seed, curve: curves[seed as usize], ..FROM_SCRATCH_B });
    let analysis = analysis(&with_seeds(&[WARM, FORK], 5).into_iter().chain(scratch).collect::<Vec<_>>());
    let [stage] = &Treatments::new(&analysis).stages[..] else { panic!("one stage") };
    let lost = stage.lost.and_then(|lost| lost.interval).expect("an interval");
    assert!(lost.low > 0.0, "{lost:?}");
    assert!(stage.recovered_share.is_none(), "{:?}", stage.recovered_share);
    let markdown = table(&analysis, "treatments", Format::Markdown);
    assert!(markdown.contains("where the share's own would have no end"), "{markdown}");
    // The share of the area that a past loses stands there without its interval.
    let markdown = table(&analysis, "against-from-scratch", Format::Markdown);
    assert!(markdown.contains("| 1.000 |") && markdown.contains("Relative losses: Fieller's interval."), "{markdown}");
    assert!(markdown.contains("There is no interval where it would have no end"), "{markdown}");
}

#[test]
fn forks_find_their_parents_among_namesakes() {
    // Two parents of one name and sequence, of differing settings: the parent's path tells which it is.
    let far = Fake { timesteps: 500, ..WARM };
    let root = tempfile::TempDir::new().expect("a folder");
    WARM.write(&root.path().join("elsewhere"));
    far.write(&root.path().join("other"));
    FORK.write(root.path());
    let analysis = Analysis::read(&[root.path().to_owned()]).expect("runs that can be read");
    let pair = analysis.forks[0];
    let parent = &analysis.arms[pair.curriculum.expect("a parent")];
    assert_eq!(parent.settings["timesteps"], 1000, "{}", parent.name);
}
