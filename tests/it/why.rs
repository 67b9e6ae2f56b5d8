//! `scripts/recompute-why`, which says what treatments give back, on numbers that are made here.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

use crate::ROOT;
use crate::recomputed::{Row, assert_same_figures, assert_same_tables, compute, number, rows};
use crate::sandbox::Sandbox;

/// Areas of five seeds: in the curriculum, under a treatment, and of a new agent.
const AREAS: [[f64; 3]; 5] =
    [[0.30, 0.52, 0.61], [0.25, 0.47, 0.55], [0.35, 0.50, 0.60], [0.28, 0.55, 0.62], [0.33, 0.49, 0.57]];
/// The 97.5% quantile of Student's t with four degrees of freedom, from a printed table.
const QUANTILE: f64 = 2.776_445;

/// What the script writes.
const TABLES: [&str; 7] = ["verdicts", "switches", "effects", "measures", "correlations", "times", "fresh-and-scratch"];
/// What it writes where a study has new agents under a treatment.
const NEW_AGENTS: &str = "new-agents";

/// What the script says of a seeds.csv; none where there is no Python.
fn verdicts(sandbox: &Sandbox, seeds: &Path) -> Option<BTreeMap<&'static str, Vec<Row>>> {
    let out = sandbox.path("verdicts");
    if !compute("recompute-why", &[seeds], &out) {
        return None;
    }
    let tables = TABLES.into_iter().map(|name| (name, rows(&out.join(format!("{name}.csv"))))).collect();
    let figure = fs::read_to_string(out.join("recovered.svg")).expect("a figure");
    assert!(figure.starts_with("<svg") && figure.trim_end().ends_with("</svg>"));
    Some(tables)
}

/// Student's t of d(r) = (treated − warm) − r (fresh − warm).
fn t(share: f64) -> f64 {
    let d = AREAS.map(|[warm, treated, fresh]| (treated - warm) - share * (fresh - warm));
    let n = d.len() as f64;
    let mean = d.iter().sum::<f64>() / n;
    let variance = d.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / (n - 1.0);
    mean / (variance / n).sqrt()
}

#[test]
fn shares_and_intervals_are_what_their_definition_says() {
    let sandbox = Sandbox::new();
    let mut seeds = "arm,sequence,treatment,seed,stage,level,measure,value\n".to_owned();
    for (seed, [warm, treated, fresh]) in AREAS.into_iter().enumerate() {
        let fork = |name: &str, area: f64| {
            let row = |measure: &str, value: f64| {
                format!("\"x, after 0: {name}\",curriculum,after-0:{name},{seed},1,b,{measure},{value}\n")
            };
            row("area", area) + &row("timesteps", 9.0)
        };
        seeds += &format!("x,curriculum,,{seed},1,b,area,{warm}\nx,curriculum,,{seed},1,b,timesteps,9\n");
        seeds += &fork("policy.2-0.02", treated);
        seeds += &fork("weights-fresh+optimizer-fresh", fresh);
        // A treatment beside a new agent under it, which is no candidate.
        seeds += &fork("bonus", treated + 0.02);
        seeds += &fork("fresh-bonus", fresh - 0.01);
        let scratch = format!("x (from scratch),level-b,,{seed},0,b");
        seeds += &format!("{scratch},area,{}\n{scratch},timesteps,9\n", fresh + 0.01);
    }
    let file = sandbox.path("seeds.csv");
    fs::write(&file, seeds).expect("writable");
    let Some(tables) = verdicts(&sandbox, &file) else { return };
    let [_, row] = &tables["verdicts"][..] else { panic!("{tables:?}") };
    assert_eq!(
        (row["algorithm"].as_str(), row["treatment"].as_str(), row["seeds"].as_str()),
        ("x", "policy.2-0.02", "5")
    );
    let mean = |of: fn(&[f64; 3]) -> f64| AREAS.iter().map(of).sum::<f64>() / 5.0;
    let share = mean(|[w, t, _]| t - w) / mean(|[w, _, f]| f - w);
    assert!((number(row, "recovered share") - share).abs() < 1e-12);
    // Fieller's bounds are where d(r) is just significant.
    assert!((t(number(row, "low")) - QUANTILE).abs() < 1e-4, "{row:?}");
    assert!((t(number(row, "high")) + QUANTILE).abs() < 1e-4, "{row:?}");
    // One switch: the pooled table and that of switches say the same.
    assert_eq!(tables["switches"].len(), 2);
    assert_eq!(tables["switches"][1]["recovered share"], row["recovered share"]);
    let beside = rows(&sandbox.path("verdicts").join(format!("{NEW_AGENTS}.csv")));
    assert_eq!((beside[0]["treatment"].as_str(), beside[0]["seeds"].as_str()), ("bonus", "5"));
    assert!((number(&beside[0], "difference") - mean(|[_, t, f]| t - f + 0.03)).abs() < 1e-12);
    // 0.2 is far below the bounds, and 0.8 and 1 are not both below them.
    assert!(t(0.2) > QUANTILE && t(1.0) < -QUANTILE, "{} {}", t(0.2), t(1.0));
    assert!(number(row, "p excluded") > 0.9 && number(row, "p helps") > 0.9);
    let verdict = if number(row, "p sufficient") < 0.025 { "sufficient" } else { "undecided" };
    assert_eq!(row["verdict"], verdict);
    let [check] = &tables["fresh-and-scratch"][..] else { panic!("one level") };
    assert!((number(check, "difference") + 0.01).abs() < 1e-12);
}

/// The whole way, with what the program makes at this moment.
#[test]
fn a_study_of_forks_is_trained_reported_and_judged() {
    let sandbox = Sandbox::new();
    let file = Path::new(ROOT).join("configs/studies/why-dqn.yaml");
    // As long as DQN needs for a learning curve of two points.
    let options = "--timesteps 4096 --num-seeds 2 --plasticity-interval 0 --jobs 2";
    sandbox.succeeds(&format!("study {} {options}", file.display()));
    sandbox.succeeds("compare runs/why-dqn --out report");
    let Some(tables) = verdicts(&sandbox, &sandbox.path("report/seeds.csv")) else { return };
    assert!(tables.values().flatten().all(|row| row["algorithm"] == "dqn-constant-eps"));
    let of = |table: &str| tables[table].len();
    // The new agent is what the nine other treatments are compared with.
    assert_eq!((of("verdicts"), of("switches")), (9, 4 * 9));
    assert_eq!((of("effects"), of("fresh-and-scratch"), of("times")), (7, 4, 4 * 11));
}

/// The tables of docs/results/why follow from the numbers of single seeds beside them.
#[test]
fn the_published_tables_follow_from_the_published_seeds() {
    let sandbox = Sandbox::new();
    let (folder, out) = (Path::new(ROOT).join("docs/results/why"), sandbox.path("verdicts"));
    let [seeds, before] = ["seeds.csv.gz", "before.csv.gz"].map(|name| folder.join(name));
    if compute("recompute-why", &[&seeds, Path::new("--before"), &before], &out) {
        assert_same_tables(&out, &folder.join("tables"));
        assert_same_figures(&out, &folder);
    }
}
