//! `scripts/recompute-controls`, which says what age and orders do, on numbers that are made here.

use std::fmt::Write as _;
use std::fs;
use std::path::Path;
use std::process::Command;

use crate::ROOT;
use crate::recomputed::{Row, assert_same_figures, assert_same_tables, close, compute, find, number, rows};
use crate::sandbox::Sandbox;

const SCRIPT: &str = "recompute-controls";

/// A table that the script makes of a seeds.csv; none where there is no Python.
fn table(sandbox: &Sandbox, seeds: &Path, name: &str) -> Option<Vec<Row>> {
    let out = sandbox.path("controls");
    compute(SCRIPT, &[seeds], &out).then(|| rows(&out.join(format!("{name}.csv"))))
}

/// One seed's life: its sequence, itself, and level and area of each stage.
type Life = (String, u64, Vec<(&'static str, f64)>);

/// A seeds.csv of lives.
fn seeds_csv(lives: &[Life]) -> String {
    let mut text = "arm,sequence,treatment,seed,stage,level,measure,value\n".to_owned();
    for (sequence, seed, stages) in lives {
        for (stage, (level, area)) in stages.iter().enumerate() {
            let place = format!("\"x, {sequence}\",{sequence},,{seed},{stage},{level}");
            writeln!(text, "{place},area,{area}\n{place},timesteps,9").expect("a string");
        }
    }
    text
}

/// Level a has 0.3 more than b, and b more than c; each position takes 0.1, with seed 3 0.2; seed 4 has 1 more throughout, and
/// level c 0.06 more after a.
#[test]
fn slopes_over_positions_are_without_levels() {
    let sandbox = Sandbox::new();
    let of_level = |level: char| match level {
        'a' => ("a", 0.9),
        'b' => ("b", 0.6),
        _ => ("c", 0.3),
    };
    let area = |seed: u64, order: &str, at: usize| {
        let step = if seed == 3 { 0.2 } else { 0.1 };
        let (level, area) = of_level(order.chars().nth(at).expect("a level"));
        let after_a = at > 0 && level == "c" && &order[at - 1..at] == "a";
        (level, area - step * at as f64 + f64::from(seed == 4) + if after_a { 0.06 } else { 0.0 })
    };
    let orders = ["abc", "acb", "bac", "bca", "cab", "cba"];
    let life = |(seed, order): (u64, &&str)| {
        (format!("order-{order}"), seed, (0..3).map(|at| area(seed, order, at)).collect::<Vec<_>>())
    };
    let lives: Vec<Life> = (0..).zip(&orders).map(life).collect();
    let file = sandbox.path("seeds.csv");
    fs::write(&file, seeds_csv(&lives)).expect("writable");
    let Some(orders) = table(&sandbox, &file, "orders") else { return };
    let mean = |values: &[f64]| values.iter().sum::<f64>() / values.len() as f64;
    let level_mean = |name: &str, position: std::ops::Range<usize>| {
        let stages = lives.iter().flat_map(|(_, _, stages)| &stages[position.clone()]);
        mean(&stages.filter(|(level, _)| *level == name).map(|(_, area)| *area).collect::<Vec<_>>())
    };
    // Seed by seed, from the definition; the quantile of Student's t with five degrees of freedom is from a printed table.
    let check = |outcome: &str, values: &[f64]| {
        let row = find(&orders, &[("outcome", outcome)]);
        let squares: f64 = values.iter().map(|value| (value - mean(values)).powi(2)).sum();
        let half = 2.570_582 * (squares / 5.0 / 6.0).sqrt();
        close(number(row, "mean"), mean(values));
        assert!((number(row, "low") - (mean(values) - half)).abs() < 1e-6, "{row:?}");
        assert_eq!(row["seeds"], "6");
    };
    let slope = |(_, _, stages): &Life| {
        let rest = |at: usize| stages[at].1 - level_mean(stages[at].0, 1..3);
        rest(2) - rest(1)
    };
    check("slope over positions 1 to the last", &lives.iter().map(slope).collect::<Vec<_>>());
    let loss = |(_, _, stages): &Life| {
        let rest = |at: usize| stages[at].1 - level_mean(stages[at].0, 0..1);
        (rest(1) + rest(2)) / 2.0 - rest(0)
    };
    check("area with a past minus at position 0", &lives.iter().map(loss).collect::<Vec<_>>());
    let positions = table(&sandbox, &file, "positions").expect("python3");
    close(number(find(&positions, &[("position", "0"), ("level", "b")]), "mean"), 0.6);
    // Position 1 of level b: seeds 0 (a, b, c) and 5 (c, b, a).
    close(number(find(&positions, &[("position", "1"), ("level", "b")]), "mean"), 0.5);
    let predecessors = table(&sandbox, &file, "predecessors").expect("python3");
    let of =
        |level: &str, after: &str| number(find(&predecessors, &[("level", level), ("after level", after)]), "mean");
    // What c has after a is what it lacks after b, since the mean of the level is taken away.
    assert!(of("c", "a") > of("c", "b") && predecessors.len() == 7, "{predecessors:?}");

    let twice = [lives[0].clone(), ("order-cba".to_owned(), 0, lives[5].2.clone())];
    assert!(refused(&sandbox, &twice).contains("seed 0 goes through several orders"));
    let mut short = lives;
    short[2].2.pop();
    assert!(refused(&sandbox, &short).contains("seeds 2 have fewer than 3 stages"));
}

/// The second arm has 0.3 more at the positions after the first, and 0.02 more a position for each of the seed's number.
#[test]
fn two_arms_of_orders_are_compared_seed_by_seed() {
    let sandbox = Sandbox::new();
    let noise = [0.0, 0.03, -0.02, 0.01, 0.04, -0.01];
    let orders = [["a", "b", "c"], ["a", "c", "b"], ["b", "a", "c"], ["b", "c", "a"], ["c", "a", "b"], ["c", "b", "a"]];
    let lives = |extra: f64, growth: f64| -> Vec<Life> {
        let life = |(seed, order): (u64, &[&'static str; 3])| {
            let (own, growth) = (noise[seed as usize], growth * seed as f64);
            let level = |name: &str| if name == "a" { 0.5 } else { 0.3 };
            let more = |at: usize| if at > 0 { extra + growth * at as f64 } else { 0.0 };
            let stage = |at: usize| (order[at], level(order[at]) + own * (at + 1) as f64 + more(at));
            (format!("order-{}", order.concat()), seed, (0..3).map(stage).collect::<Vec<_>>())
        };
        (0..).zip(&orders).map(life).collect()
    };
    let (first, second) = (seeds_csv(&lives(0.0, 0.0)), seeds_csv(&lives(0.3, 0.02)));
    let (_, second) = second.split_once('\n').expect("a head");
    let file = sandbox.path("seeds.csv");
    fs::write(&file, first + &second.replace("\"x, ", "\"x-head, ")).expect("writable");
    let Some(orders) = table(&sandbox, &file, "orders") else { return };
    let of = |arm: &str, outcome: &str| find(&orders, &[("arm", arm), ("outcome", outcome)]).clone();
    let (slope, loss) = ("slope over positions 1 to the last", "area with a past minus at position 0");
    // Of 0.02 times the seeds 0 to 5; what the means of levels have of it cancels over balanced orders.
    close(number(&of("x-head - x", slope), "mean"), 0.05);
    // 0.3 and 0.03 times the seed. The means of levels at position 0 are those of both arms.
    let row = of("x-head - x", loss);
    close(number(&row, "mean"), 0.375);
    // The deviation of 0 to 5, and the quantile of Student's t from a printed table.
    let half = 2.570_582 * 0.03 * 3.5_f64.sqrt() / 6.0_f64.sqrt();
    assert!((number(&row, "low") - (0.375 - half)).abs() < 1e-6 && row["seeds"] == "6", "{row:?}");
    // The rule is for the arm that nothing is done to.
    assert_eq!((of("x", slope)["verdict"].as_str(), of("x-head", slope)["verdict"].as_str()), ("no growth shown", ""));
}

/// What the script says of lives that it does not take.
fn refused(sandbox: &Sandbox, lives: &[Life]) -> String {
    let file = sandbox.path("refused.csv");
    fs::write(&file, seeds_csv(lives)).expect("writable");
    let script = Path::new(ROOT).join("scripts").join(SCRIPT);
    let output = Command::new("python3").arg(script).arg(&file).output().expect("python3");
    assert_eq!(output.status.code(), Some(2));
    String::from_utf8_lossy(&output.stderr).into_owned()
}

#[test]
fn ages_are_compared_seed_by_seed() {
    let sandbox = Sandbox::new();
    let noise = [0.0, 0.02, 0.01, -0.01, 0.005];
    let mut lives = Vec::new();
    for (seed, noise) in noise.into_iter().enumerate() {
        let mut add = |sequence: &str, levels: &[&'static str], last: f64| {
            let mut stages: Vec<(&str, f64)> = levels.iter().map(|level| (*level, 0.5)).collect();
            stages.last_mut().expect("a stage").1 = last;
            lives.push((sequence.to_owned(), seed as u64, stages));
        };
        let common = seed as f64;
        add("curriculum-01234", &["0", "1", "2", "3"], common + 0.9);
        add("young-2", &["1", "2"], common + 0.8);
        add("old-2", &["1", "1", "2"], common + 0.6 - noise);
        add("young-3", &["2", "3"], common + 0.8);
        add("old-3", &["2", "2", "2", "3"], common + 0.7);
    }
    let file = sandbox.path("seeds.csv");
    fs::write(&file, seeds_csv(&lives)).expect("writable");
    let Some(contrasts) = table(&sandbox, &file, "age-contrasts") else { return };
    let mean = noise.iter().sum::<f64>() / 5.0;
    let age = find(&contrasts, &[("stage", "all"), ("contrast of areas", "old - young")]);
    close(number(age, "mean"), (-0.2 - mean - 0.1) / 2.0);
    assert_eq!(age["verdict"], "age matters");
    let at = |stage: &str, contrast: &str| {
        number(find(&contrasts, &[("stage", stage), ("contrast of areas", contrast)]), "mean")
    };
    close(at("2", "old - young"), -0.2 - mean);
    close(at("3", "old - young"), -0.1);
    // Stage 2 of the curriculum has 0.5, stage 3 has 0.9 and what a seed has in common.
    close(at("3", "curriculum - old"), 0.2);
    close(at("2", "curriculum - old"), 0.5 - 2.0 - 0.6 + mean);
}

/// The whole way, with what the program makes at this moment.
#[test]
fn orders_and_ages_are_trained_reported_and_compared() {
    let sandbox = Sandbox::new();
    let studies = Path::new(ROOT).join("configs/studies");
    for (name, expected) in [("why-orders", "orders"), ("why-age", "ages")] {
        let file = studies.join(format!("{name}.yaml"));
        let options = "--timesteps 4096 --seeds 0,119 --plasticity-interval 0 --jobs 2";
        sandbox.succeeds(&format!("study {} {options}", file.display()));
        sandbox.succeeds(&format!("compare runs/{name} --out {name}"));
        let Some(rows) = table(&sandbox, &sandbox.path(&format!("{name}/seeds.csv")), expected) else { return };
        assert!(rows.len() > 5 && rows.iter().all(|row| row["seeds"] == "2"), "{rows:?}");
    }
    assert!(sandbox.path("runs/why-orders/ppo-eps-head/order-43210/seed-119").is_dir(), "the last order");
}

/// What docs/results/why/controls shows follows from the numbers of single seeds beside it.
#[test]
fn the_published_controls_follow_from_their_seeds() {
    let controls = Path::new(ROOT).join("docs/results/why/controls");
    let entries = fs::read_dir(controls).expect("a folder").map(|entry| entry.expect("an entry").path());
    let folders: Vec<_> = entries.filter(|path| path.is_dir()).collect();
    assert!(!folders.is_empty());
    folders.iter().for_each(|folder| follows_from_its_seeds(folder));
}

#[test]
fn the_published_long_runs_follow_from_their_seeds() {
    for name in ["long", "long-dqn"] {
        follows_from_its_seeds(&Path::new(ROOT).join("docs/results/why").join(name));
    }
}

/// The tables and figures of a folder are those that its script makes of the seeds.csv.gz in it.
fn follows_from_its_seeds(folder: &Path) {
    let sandbox = Sandbox::new();
    let out = sandbox.path("again");
    let script = if folder.join("verdicts.csv").exists() { "recompute-why" } else { SCRIPT };
    if compute(script, &[&folder.join("seeds.csv.gz")], &out) {
        assert_same_tables(&out, folder);
        assert_same_figures(&out, folder);
    }
}
