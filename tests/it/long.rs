//! `scripts/recompute-controls` on agents that go through many levels, with numbers that are made here.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::fs;
use std::path::Path;
use std::process::Command;

use crate::ROOT;
use crate::recomputed::{Row, close, compute, find, number, rows};
use crate::sandbox::Sandbox;

const SCRIPT: &str = "recompute-controls";
const TABLES: [&str; 3] = ["long", "positions", "measures"];
const HEAD: &str = "arm,sequence,treatment,seed,stage,level,measure,value\n";
/// As many as seeds; each of them begins at another of the levels.
const SEEDS: usize = 4;
const LEVELS: usize = 7;
/// By how much the loss of the base grows with each position, by seed.
const GROWTH: [f64; SEEDS] = [0.01, 0.02, 0.03, 0.02];
/// The timesteps to 0.9 on each level, by seed. The last one comes before no level.
const TIMES: [[&str; LEVELS]; SEEDS] = [
    ["90", "80", "70", "60", "50", "40", "99"],
    ["95", "94", "93", "92", "91", "90", "99"],
    ["inf", "inf", "50", "40", "30", "20", "99"],
    ["10", "10", "10", "10", "10", "10", "99"],
];
/// The quantile of Student's t with three degrees of freedom, from a printed table.
const QUANTILE: f64 = 3.182_446;

/// The losses of the base, of a treatment and of another one on top of it.
fn loss(arm: &str, seed: usize, at: usize) -> f64 {
    match arm {
        _ if at == 0 => 0.0,
        "x" => 0.1 + GROWTH[seed] * at as f64,
        "x-head" => 0.02 + 0.001 * seed as f64,
        _ => 0.01 * (seed % 2) as f64,
    }
}

fn scratch(seed: usize, level: usize) -> f64 {
    0.9 - 0.01 * level as f64 + 0.02 * seed as f64
}

/// A seeds.csv of these arms.
fn seeds_csv(arms: &[&str]) -> String {
    let mut text = HEAD.to_owned();
    let mut add = |place: &str, values: &[(&str, String)]| {
        values.iter().for_each(|(measure, value)| writeln!(text, "{place},{measure},{value}").expect("a string"));
    };
    for (seed, times) in TIMES.iter().enumerate() {
        for level in 0..LEVELS {
            let place = format!("x (from scratch),level-g-{level},,{seed},0,g-{level}");
            add(&place, &[("timesteps", "100".into()), ("area", scratch(seed, level).to_string())]);
        }
        for arm in arms {
            for (at, time) in times.iter().enumerate() {
                let level = (seed + at) % LEVELS;
                let place = format!("\"{arm}, order-1-shift-{seed}\",order-1-shift-{seed},,{seed},{at},g-{level}");
                let area = scratch(seed, level) - loss(arm, seed, at);
                let time = (*time).to_owned();
                add(&place, &[("timesteps", "100".into()), ("area", area.to_string()), ("time_to_0.9", time)]);
            }
        }
    }
    text
}

/// The tables that the script makes of a seeds.csv; none where there is no Python.
fn tables(sandbox: &Sandbox, seeds: &Path) -> Option<BTreeMap<&'static str, Vec<Row>>> {
    let out = sandbox.path("answers");
    if !compute(SCRIPT, &[seeds], &out) {
        return None;
    }
    let there =
        TABLES.into_iter().map(|name| (name, out.join(format!("{name}.csv")))).filter(|(_, file)| file.exists());
    Some(there.map(|(name, file)| (name, rows(&file))).collect())
}

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}

/// The standard error of the mean.
fn error(values: &[f64]) -> f64 {
    let squares: f64 = values.iter().map(|value| (value - mean(values)).powi(2)).sum();
    (squares / (values.len() - 1) as f64 / values.len() as f64).sqrt()
}

/// The two-sided p-value of Student's test of four values. With three degrees of freedom it has a closed form.
fn p(values: &[f64]) -> f64 {
    let u = (mean(values) / error(values)).abs() / 3.0_f64.sqrt();
    1.0 - std::f64::consts::FRAC_2_PI * (u.atan() + u / (1.0 + u * u))
}

fn by_seed(of: impl Fn(usize) -> f64) -> [f64; SEEDS] {
    std::array::from_fn(of)
}

#[test]
fn growth_and_contrasts_over_many_levels_are_what_their_definition_says() {
    let sandbox = Sandbox::new();
    let file = sandbox.path("seeds.csv");
    fs::write(&file, seeds_csv(&["x", "x-head", "x-head-adam"])).expect("writable");
    let Some(tables) = tables(&sandbox, &file) else { return };
    let row = |arm: &str, outcome: &str| {
        let row = find(&tables["long"], &[("arm or contrast", arm), ("outcome", outcome)]);
        assert_eq!(row["algorithm"], "x");
        row
    };
    let check = |arm: &str, outcome: &str, values: [f64; SEEDS]| {
        let row = row(arm, outcome);
        close(number(row, "mean"), mean(&values));
        let half = QUANTILE * error(&values);
        assert!((number(row, "low") - (mean(&values) - half)).abs() < 1e-6, "{row:?}");
        assert!((number(row, "high") - (mean(&values) + half)).abs() < 1e-6, "{row:?}");
        assert_eq!(row["seeds"], "4");
    };
    // Positions 5 and 6 against 1 and 2.
    check("x", "loss, late minus early", by_seed(|seed| 4.0 * GROWTH[seed]));
    check("x", "slope of the loss", GROWTH);
    // The mean position is 3.5.
    let base = by_seed(|seed| 0.1 + 3.5 * GROWTH[seed]);
    check("x", "loss", base);
    assert_eq!(row("x", "loss, late minus early")["verdict"], "the loss grows");
    let head = by_seed(|seed| loss("x-head", seed, 1));
    check("x-head", "loss", head);
    close(number(row("x-head", "loss, late minus early"), "mean"), 0.0);
    assert_eq!(row("x-head", "loss, late minus early")["verdict"], "");

    let adam = by_seed(|seed| loss("x-head-adam", seed, 1));
    let less = |one: [f64; SEEDS], other: [f64; SEEDS]| by_seed(|seed| other[seed] - one[seed]);
    let contrasts = [
        ("x-head - x", less(head, base)),
        ("x-head - from scratch", less(head, [0.0; SEEDS])),
        ("x-head-adam - x", less(adam, base)),
        ("x-head-adam - x-head", less(adam, head)),
        ("x-head-adam - from scratch", less(adam, [0.0; SEEDS])),
    ];
    let mut ordered: Vec<(f64, &str)> = contrasts.iter().map(|(name, values)| (p(values), *name)).collect();
    ordered.sort_by(|a, b| a.0.total_cmp(&b.0));
    let mut largest = 0.0_f64;
    for (place, (p, name)) in ordered.into_iter().enumerate() {
        largest = largest.max((5 - place) as f64 * p).min(1.0);
        let row = row(name, "area");
        assert!((number(row, "adjusted p") - largest).abs() < 1e-9, "{row:?}, {largest}");
        let word = if number(row, "mean") > 0.0 { "more area" } else { "less area" };
        assert_eq!(row["verdict"], if largest < 0.05 { word } else { "undecided" });
    }
    for (name, values) in contrasts {
        check(name, "area", values);
    }
    assert_eq!(row("x-head - x", "area")["verdict"], "more area");
    assert_eq!(row("x-head - from scratch", "area")["verdict"], "less area");
    assert_eq!(row("x-head-adam - from scratch", "area")["verdict"], "undecided");
    assert_eq!(tables["long"].len(), 3 * 3 + 5 + 1);

    // Seed 0 and 1: surer from stage to stage. Seed 2 has a tie in six. Seed 3 was always as sure, and tells nothing.
    let row = row("x", "rank correlation of the loss with how long it was sure");
    close(number(row, "mean"), (2.0 + (17.0_f64 / 17.5).sqrt()) / 3.0);
    assert_eq!((row["seeds"].as_str(), row["verdict"].as_str()), ("3", "the loss follows it"));

    let at =
        |arm: &str, outcome: &str| find(&tables["positions"], &[("arm", arm), ("position", "3"), ("outcome", outcome)]);
    close(number(at("x", "loss"), "mean"), 0.16);
    // Levels 3 to 6.
    close(number(at("x (from scratch)", "area"), "mean"), 0.885);
    close(number(at("x", "area"), "mean"), 0.725);
    assert_eq!(tables["positions"].len(), LEVELS * (3 * 2 + 1));
    assert!(!tables.contains_key("measures"), "none was measured");
    let figure = fs::read_to_string(sandbox.path("answers").join("long.svg")).expect("a figure");
    assert!(figure.starts_with("<svg") && figure.matches("<polyline").count() == 3 && figure.contains("<polygon"));
}

#[test]
fn a_loss_that_shrinks_is_told_from_one_that_does_not_grow() {
    let sandbox = Sandbox::new();
    let text = seeds_csv(&["x"]);
    let turned = |line: &str, by: f64| {
        let (place, value) = line.rsplit_once(',').expect("a value");
        format!("{place},{}\n", value.parse::<f64>().expect("a number") + by)
    };
    // Twice the growth off makes it a shrinking; so done to every other seed, it leaves a mean growth of 0.
    for (factors, verdict) in [([2.0; SEEDS], "the loss shrinks"), ([2.0, 0.0, 2.0, 0.0], "no growth shown")] {
        let mut changed = String::new();
        for line in text.lines() {
            let cells: Vec<&str> = line.rsplit(',').collect();
            let of_base = cells[1] == "area" && line.starts_with('"');
            changed += &if of_base {
                let seed: usize = cells[4].parse().expect("a seed");
                turned(line, factors[seed] * GROWTH[seed] * cells[3].parse::<f64>().expect("a stage"))
            } else {
                format!("{line}\n")
            };
        }
        let file = sandbox.path("seeds.csv");
        fs::write(&file, changed).expect("writable");
        let Some(tables) = tables(&sandbox, &file) else { return };
        assert_eq!(find(&tables["long"], &[("outcome", "loss, late minus early")])["verdict"], verdict);
    }
}

/// What the script says of a seeds.csv without the lines that have this.
fn refused(sandbox: &Sandbox, text: &str, without: &str) -> String {
    let kept: String = text.lines().filter(|line| !line.contains(without)).map(|line| format!("{line}\n")).collect();
    let file = sandbox.path("refused.csv");
    fs::write(&file, kept).expect("writable");
    let script = Path::new(ROOT).join("scripts").join(SCRIPT);
    let output = Command::new("python3").arg(script).arg(&file).output().expect("python3");
    assert_eq!(output.status.code(), Some(2));
    String::from_utf8_lossy(&output.stderr).into_owned()
}

#[test]
fn studies_of_many_levels_that_are_not_whole_are_refused() {
    let sandbox = Sandbox::new();
    let text = seeds_csv(&["x", "x-head"]);
    if Command::new("python3").arg("--version").output().is_err() {
        return;
    }
    let says = |without: &str, words: &str| {
        let message = refused(&sandbox, &text, without);
        assert!(message.contains(words), "{message}");
    };
    says("level-g-3,,2", "x, seed 2 has no run from scratch on g-3");
    says(",,3,6,", "seeds 3 have fewer than 7 stages");
    says("from scratch", "has no base that is also trained from scratch");
    says("time_to_0.9", "lacks time_to_0.9");
    // No seed has the last stage: then nothing but the levels from scratch tells.
    let unfinished: String =
        text.lines().filter(|line| !line.contains(",6,g-")).map(|line| format!("{line}\n")).collect();
    assert!(refused(&sandbox, &unfinished, "nothing").contains("x has 6 of 7 stages"));
}

/// Ranks from 1; there are no ties here.
fn ranks(values: &[f64]) -> Vec<f64> {
    values.iter().map(|value| values.iter().filter(|other| *other <= value).count() as f64).collect()
}

#[test]
fn measures_go_with_areas_beyond_what_levels_have() {
    let sandbox = Sandbox::new();
    let (mut text, mut stages) = (HEAD.to_owned(), Vec::new());
    let orders = ["abc", "acb", "bac", "bca", "cab", "cba"];
    for (seed, order) in orders.iter().enumerate() {
        for (at, level) in order.chars().enumerate() {
            // In no order. Of roots no two differ alike, so that nothing ties without the mean of its level.
            let own = (((seed * 37 + at * 61 + 11) % 101) as f64).sqrt();
            let other = (((seed * 53 + at * 29 + 7) % 97) as f64).sqrt();
            // Level a has the least area, and the most of every measure.
            let offset = f64::from(u32::from(level) - u32::from('a'));
            let area = 10.0 * offset + own;
            if at > 0 {
                stages.push((level, area, other));
            }
            let place = format!("\"x, order-{order}\",order-{order},,{seed},{at},{level}");
            let column = |name: &str, value: f64| format!("{place},before/plasticity/{name},{value}\n");
            text += &format!("{place},timesteps,9\n{place},area,{area}\n");
            text += &column("policy_entropy/visited", 3.0 * own - 50.0 * offset);
            text += &column("policy.1/effective_rank/visited", 7.0 - own - 50.0 * offset);
            text += &column("value.1/effective_rank/visited", other - 50.0 * offset);
            text += &column("policy.1/saturated_units/visited", 0.3 - 0.1 * offset);
        }
    }
    let file = sandbox.path("seeds.csv");
    fs::write(&file, text).expect("writable");
    let Some(tables) = tables(&sandbox, &file) else { return };
    let of = |measure: &str| {
        let row = find(&tables["measures"], &[("arm", "x"), ("measure before a stage", measure)]);
        assert_eq!((row["stages"].as_str(), row["seeds"].as_str()), ("12", "6"));
        ["rank correlation with the area", "low", "high"].map(|column| row[column].parse::<f64>().ok())
    };
    let all_close = |found: [Option<f64>; 3], expected: f64| {
        found.into_iter().for_each(|found| close(found.expect("a number"), expected));
    };
    all_close(of("policy_entropy/visited"), 1.0);
    all_close(of("policy.1/effective_rank/visited"), -1.0);
    // The level alone says what it is.
    assert_eq!(of("policy.1/saturated_units/visited"), [None; 3]);
    let level_mean = |level: char, of: fn(&(char, f64, f64)) -> f64| {
        mean(&stages.iter().filter(|stage| stage.0 == level).map(of).collect::<Vec<_>>())
    };
    let areas: Vec<f64> = stages.iter().map(|stage| stage.1 - level_mean(stage.0, |s| s.1)).collect();
    let others: Vec<f64> = stages.iter().map(|stage| stage.2 - level_mean(stage.0, |s| s.2)).collect();
    // Spearman's formula, which holds where nothing ties.
    let squares: f64 = ranks(&areas).iter().zip(ranks(&others)).map(|(a, b)| (a - b).powi(2)).sum();
    let [found, low, high] = of("value.1/effective_rank/visited").map(|value| value.expect("a number"));
    close(found, 1.0 - 6.0 * squares / (12.0 * (12.0 * 12.0 - 1.0)));
    assert!(-1.0 <= low && low < found && found < high && high <= 1.0, "{low} {found} {high}");
}

/// Of two seeds a resample has one twice, the other twice or both. A seed that is there twice has the correlation of its own
/// stages; so the bounds are the least and the most of three numbers.
#[test]
fn resamples_draw_whole_seeds_and_keep_ties() {
    let sandbox = Sandbox::new();
    let mut text = HEAD.to_owned();
    for (seed, entropies) in [[9, 1, 2, 3, 4], [9, 8, 7, 6, 5]].iter().enumerate() {
        for (at, (entropy, rank)) in entropies.iter().zip([9, 1, 1, 2, 2]).enumerate() {
            let place = format!("\"x, order-{seed}\",order-{seed},,{seed},{at},a");
            writeln!(text, "{place},timesteps,9\n{place},area,{}", 4 * seed + at).expect("a string");
            for (measure, value) in [("policy_entropy/visited", entropy), ("policy.1/effective_rank/visited", &rank)] {
                writeln!(text, "{place},before/plasticity/{measure},{value}").expect("a string");
            }
        }
    }
    let file = sandbox.path("seeds.csv");
    fs::write(&file, text).expect("writable");
    let Some(tables) = tables(&sandbox, &file) else { return };
    let check = |measure: &str, expected: [f64; 3]| {
        let row = find(&tables["measures"], &[("measure before a stage", measure)]);
        for (column, expected) in ["rank correlation with the area", "low", "high"].into_iter().zip(expected) {
            close(number(row, column), expected);
        }
    };
    // Of both: areas 1 to 8, and squares of differences of ranks that add up to 20.
    check("policy_entropy/visited", [1.0 - 6.0 * 20.0 / (8.0 * 63.0), -1.0, 1.0]);
    // Ranks 1.5 and 3.5 of one seed, 2.5 and 6.5 of both.
    let (one, both) = (4.0 / 20.0_f64.sqrt(), 16.0 / (32.0 * 42.0_f64).sqrt());
    check("policy.1/effective_rank/visited", [both, both, one]);
}

/// The whole way, with what the program makes at this moment.
#[test]
fn many_levels_are_trained_reported_and_compared() {
    let sandbox = Sandbox::new();
    sandbox.write(
        "s.yaml",
        "name: s\nlevels:\n  generate: {height: 4, width: 4, wall_density: 0.1, targets: 1, count: 5, seed: 0}\n\
         sequence: {shift: by-seed, timesteps: 256}\narms:\n\
         - {config: ppo.yaml, trains: [curriculum, from scratch]}\n\
         - {config: ppo.yaml, set: [name=ppo-head, 'mitigations=[head-rescale]'], trains: [curriculum]}\n\
         - {config: dqn.yaml, trains: [curriculum, from scratch]}\n",
    );
    sandbox.succeeds("study s.yaml --seeds 0,3,4 --plasticity-interval 64 --jobs 2");
    sandbox.succeeds("compare runs/s --out report");
    let Some(tables) = tables(&sandbox, &sandbox.path("report/seeds.csv")) else { return };
    let of = |algorithm: &str| tables["long"].iter().filter(|row| row["algorithm"] == algorithm).count();
    assert_eq!((of("ppo"), of("dqn")), (3 + 3 + 2 + 1, 3 + 1));
    assert!(tables["positions"].iter().all(|row| row["seeds"] == "3"), "{tables:?}");
    // What is trained first is trained as from scratch, with the same random numbers.
    for arm in ["ppo", "ppo-head", "dqn"] {
        let first = find(&tables["positions"], &[("arm", arm), ("position", "0"), ("outcome", "loss")]);
        assert_eq!((number(first, "mean"), number(first, "high")), (0.0, 0.0));
    }
    for (arm, measure) in [("ppo", "policy_entropy"), ("ppo-head", "policy_entropy"), ("dqn", "action_gap")] {
        let measure = format!("{measure}/visited");
        let row = find(&tables["measures"], &[("arm", arm), ("measure before a stage", measure.as_str())]);
        assert_eq!((row["stages"].as_str(), row["seeds"].as_str()), ("12", "3"));
    }
}

/// The whole way, with what the program makes at this moment.
#[test]
fn a_long_study_is_trained_reported_and_judged() {
    let sandbox = Sandbox::new();
    sandbox.write(
        "small.yaml",
        "name: small\n\
         levels: {generate: {height: 3, width: 4, wall_density: 0.1, targets: 2, count: 7, seed: 0}}\n\
         sequence: {shift: by-seed, timesteps: 256}\n\
         arms:\n\
         - {config: ppo.yaml, set: [name=base], trains: [curriculum, from scratch]}\n\
         - {config: ppo.yaml, set: [name=base-head, \"mitigations=[head-rescale]\"], trains: [curriculum]}\n",
    );
    sandbox.succeeds("study small.yaml --num-seeds 3 --plasticity-interval 128 --jobs 2");
    sandbox.succeeds("compare runs/small --out report");
    let Some(tables) = tables(&sandbox, &sandbox.path("report/seeds.csv")) else { return };
    let of = |arm: &str| tables["positions"].iter().filter(|row| row["arm"] == arm).count();
    // Area and loss at each of seven positions; new agents have the area alone.
    assert_eq!((of("base"), of("base-head"), of("base (from scratch)")), (14, 14, 7));
    let contrasts = ["base-head - base", "base-head - from scratch"];
    assert!(contrasts.iter().all(|name| tables["long"].iter().any(|row| row["arm or contrast"] == *name)));
    assert!(tables["measures"].iter().any(|row| row["arm"] == "base-head" && row["stages"] == "18"));
}
