//! `scripts/recompute-controls`, which says what age and orders do, on numbers that are made here.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::fs;
use std::path::Path;
use std::process::Command;

use crate::ROOT;
use crate::sandbox::Sandbox;

/// Rows of a table of the script, by column.
type Rows = Vec<BTreeMap<String, String>>;

/// A table that the script makes of a seeds.csv; none where there is no Python.
fn table(sandbox: &Sandbox, seeds: &Path, name: &str) -> Option<Rows> {
    let out = sandbox.path("controls");
    let script = Path::new(ROOT).join("scripts/recompute-controls");
    let output = Command::new("python3").arg(script).arg(seeds).arg("--out").arg(&out).output().ok()?;
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let mut reader = csv::Reader::from_path(out.join(format!("{name}.csv"))).expect("a table");
    Some(reader.deserialize().map(|row| row.expect("a row")).collect())
}

fn number(row: &BTreeMap<String, String>, column: &str) -> f64 {
    row[column].parse().unwrap_or_else(|_| panic!("{column}: {:?}", row[column]))
}

fn find<'a>(rows: &'a Rows, keys: &[(&str, &str)]) -> &'a BTreeMap<String, String> {
    let found = rows.iter().find(|row| keys.iter().all(|(column, value)| row[*column] == *value));
    found.unwrap_or_else(|| panic!("{keys:?} in {rows:?}"))
}

fn close(found: f64, expected: f64) {
    assert!((found - expected).abs() < 1e-9, "{found} is not {expected}");
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

/// Level a has 0.3 more than b, and b more than c; each position takes 0.1; with seed 3 it takes 0.2.
#[test]
fn slopes_over_positions_are_without_levels() {
    let sandbox = Sandbox::new();
    let orders = ["abc", "acb", "bac", "bca", "cab", "cba"];
    let of_level = |level: char| match level {
        'a' => ("a", 0.9),
        'b' => ("b", 0.6),
        _ => ("c", 0.3),
    };
    let lives = orders.iter().enumerate().map(|(seed, order)| {
        let step = if seed == 3 { 0.2 } else { 0.1 };
        let stages =
            order.chars().map(of_level).enumerate().map(|(at, (level, area))| (level, area - step * at as f64));
        (format!("order-{order}"), seed as u64, stages.collect())
    });
    let file = sandbox.path("seeds.csv");
    fs::write(&file, seeds_csv(&lives.collect::<Vec<_>>())).expect("writable");
    let Some(orders) = table(&sandbox, &file, "orders") else {
        println!("skipped: no python3");
        return;
    };
    // Each level stands at positions 1 and 2 four times, of which seed 3 (b, c, a) has one in c and one in a. Their means are
    // lower by (0.1 + 0.2) / 4 and so on, which moves slopes between seeds, but not their mean.
    let slope = find(&orders, &[("outcome", "slope over positions 1 to the last")]);
    close(number(slope, "mean"), -(5.0 * 0.1 + 0.2) / 6.0);
    assert_eq!(slope["seeds"], "6");
    let loss = find(&orders, &[("outcome", "area with a past minus at position 0")]);
    close(number(loss, "mean"), -(5.0 * 0.15 + 0.3) / 6.0);
    let positions = table(&sandbox, &file, "positions").expect("python3");
    close(number(find(&positions, &[("position", "0"), ("level", "b")]), "mean"), 0.6);
    close(number(find(&positions, &[("position", "1"), ("level", "b")]), "mean"), 0.5);
    let predecessors = table(&sandbox, &file, "predecessors").expect("python3");
    let rest: f64 = predecessors.iter().map(|row| number(row, "mean") * number(row, "seeds")).sum();
    assert_eq!(predecessors.len(), 6);
    close(rest, 0.0);
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
        add("curriculum-012", &["0", "1", "2"], common + 0.4 + noise);
        add("young-2", &["1", "2"], common + 0.8);
        add("old-2", &["1", "1", "2"], common + 0.6 - noise);
    }
    let file = sandbox.path("seeds.csv");
    fs::write(&file, seeds_csv(&lives)).expect("writable");
    let Some(contrasts) = table(&sandbox, &file, "age-contrasts") else {
        println!("skipped: no python3");
        return;
    };
    let mean = noise.iter().sum::<f64>() / 5.0;
    let age = find(&contrasts, &[("stage", "all"), ("contrast of areas", "old - young")]);
    close(number(age, "mean"), -0.2 - mean);
    assert_eq!(age["verdict"], "age matters");
    let levels = find(&contrasts, &[("stage", "2"), ("contrast of areas", "curriculum - old")]);
    close(number(levels, "mean"), -0.2 + 2.0 * mean);
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
        let Some(rows) = table(&sandbox, &sandbox.path(&format!("{name}/seeds.csv")), expected) else {
            println!("skipped: no python3");
            return;
        };
        assert!(rows.len() > 5 && rows.iter().all(|row| row["seeds"] == "2"), "{rows:?}");
    }
    assert!(sandbox.path("runs/why-orders/ppo-eps-head/order-43210/seed-119").is_dir(), "the last order");
}
