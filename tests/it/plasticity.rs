//! Measures of plasticity: the numbers that NumPy and PyTorch give (scripts/plasticity-oracle), and the log of a run.

use bit_mlp::BitBatch;
use coverage_env::Level;
use cpp_rl::agent::config;
use cpp_rl::measure::probe::{Change, Probe};
use cpp_rl::measure::{self, Acting, Column, Head, Hidden, Layer, Sample, States, Units};
use serde_json::Value;

use crate::sandbox::{RunFiles, Sandbox, engines};

fn fixture() -> Value {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/fixtures/plasticity.json");
    serde_json::from_str(&std::fs::read_to_string(path).expect("the fixture is there")).expect("the fixture is JSON")
}

fn list(value: &Value) -> &[Value] {
    value.as_array().expect("a list")
}

fn floats(value: &Value) -> Vec<f64> {
    list(value).iter().map(|number| number.as_f64().expect("a number")).collect()
}

/// Asserts that all measures that are recorded have the recorded values, each within `tolerance` of its size. Measures
/// that NumPy did not compute are tested by hand, in their own files.
#[track_caller]
fn assert_recorded(what: &str, actual: &[(String, f64)], expected: &Value, tolerance: f64) {
    for (name, recorded) in expected.as_object().expect("measures") {
        let recorded = recorded.as_f64().expect("a number");
        let found = actual.iter().find(|(other, _)| other == name);
        let (_, value) = found.unwrap_or_else(|| panic!("{what}: {name} is measured"));
        // A comparison that NaN fails.
        let close = (value - recorded).abs() <= tolerance * recorded.abs();
        assert!(close, "{what}: {name} is {value}, not {recorded}");
    }
}

#[test]
fn layers_measure_what_numpy_computes() {
    for layer in list(&fixture()["layers"]) {
        let rows: Vec<Vec<f64>> = list(&layer["activations"]).iter().map(floats).collect();
        let units = if layer["activation"] == "tanh" { Units::Tanh } else { Units::Relu };
        let hidden = Some(Hidden::new(rows.concat(), rows[0].len(), units));
        let acting = Acting { outputs: vec![], actions: 4, head: Head::Logits };
        let layers = vec![Layer { name: "tower.0".to_owned(), weights: &[], hidden }];
        let measured = measure::columns(&Sample { states: States::Reference, update: None, acting, layers });
        let name = |column: &str| column.strip_prefix("plasticity/tower.0/").map(str::to_owned);
        let measured = measured.into_iter().filter_map(|(column, value)| Some((name(&column)?, value)));
        let measured: Vec<_> = measured.collect();
        assert_recorded(layer["name"].as_str().expect("a name"), &measured, &layer["measures"], 1e-12);
    }
}

#[test]
fn networks_measure_what_pytorch_computes() {
    for network in list(&fixture()["networks"]) {
        let text = |key: &str| network[key].as_str().expect("text");
        let sets = [format!("activation={}", text("activation")), format!("hidden={}", network["hidden"])];
        let config = config::resolve(Some(text("algorithm")), None, &sets, None).expect("valid settings");
        let size = |key: &str| network[key].as_u64().expect("a number") as usize;
        let map = vec![format!("T{}", ".".repeat(size("width") - 1)); size("height")].join("\n");
        let level = Level::from_map("any of this size", &map).expect("a valid map");

        let mut states = BitBatch::default();
        for state in list(&network["states"]) {
            states.push_sample(&floats(state).iter().map(|&input| input as u16).collect::<Vec<_>>());
        }
        let [before, after] = ["before", "after"]
            .map(|key| floats(&network[key]).iter().map(|&parameter| parameter as f32).collect::<Vec<_>>());
        let probe = Probe::new(config.network(&level), config.algorithm.outputs());
        let change = Change { before: &before, steps: 512, grad_norm: 0.25 };
        let measure = |of| measure::columns(&probe.sample(&after, Some(change), of, &states));
        let mut measured = measure(States::Reference);
        let value = |name: &str| measured.iter().find(|(column, _)| column == name).expect("a column").1;
        assert_eq!(value("plasticity/policy_churn_per_step"), value("plasticity/policy_churn") / 512.0);
        // On the same states the same numbers, under names of their own.
        for (column, value) in measure(States::Visited) {
            let same = column.strip_suffix("/visited").expect("a suffix");
            assert!(measured.iter().any(|(column, other)| column == same && *other == value), "{column}");
        }
        assert_eq!(measured.remove(0), ("plasticity/grad_norm".to_owned(), 0.25));
        // The forward pass has 24 bits, theirs 53; what is counted is counted the same.
        assert_recorded(text("algorithm"), &measured, &network["measures"], 1e-6);
    }
}

/// Two stages of PPO, four rollouts of 64 timesteps each.
const CURRICULUM: &str = "curriculum --levels a.yaml,b.yaml --config";

fn run(sandbox: &Sandbox, algo: &str, out: &str) -> RunFiles {
    RunFiles(sandbox.path(out).join(algo).join("curriculum/seed-0"))
}

/// The columns of a `plasticity.csv` and its rows.
fn read(run: &RunFiles) -> (Vec<String>, Vec<csv::StringRecord>) {
    let text = run.text("plasticity.csv");
    let mut reader = csv::Reader::from_reader(text.as_bytes());
    let columns = reader.headers().expect("a header").iter().map(str::to_owned).collect();
    (columns, reader.records().map(|row| row.expect("a row as long as the header")).collect())
}

#[test]
fn each_stage_is_measured_at_its_begin_its_end_and_between() {
    let sandbox = Sandbox::new();
    let measured = |algo: &str, interval: u32, options: &str| {
        let out = format!("{algo}-{interval}");
        sandbox.succeeds(&format!("{CURRICULUM} {algo}.yaml --plasticity-interval {interval} --out {out} {options}"));
        let run = run(&sandbox, algo, &out);
        assert_eq!(run.manifest()["plasticity_interval"], interval);
        let (columns, rows) = read(&run);
        assert_eq!(columns[..4], ["stage", "level", "timesteps", "cumulative_timesteps"]);
        rows.iter().map(|row| row.iter().take(4).collect::<Vec<_>>().join(" ")).collect::<Vec<_>>()
    };
    let all = ["0 a 0 0", "0 a 64 64", "0 a 128 128", "0 a 192 192", "0 a 256 256"];
    let all = [all, ["1 b 0 256", "1 b 64 320", "1 b 128 384", "1 b 192 448", "1 b 256 512"]].concat();
    assert_eq!(measured("ppo", 1, ""), all);
    let pick = |indices: &[usize]| indices.iter().map(|&i| all[i]).collect::<Vec<_>>();
    assert_eq!(measured("ppo", 128, ""), pick(&[0, 1, 2, 4, 5, 6, 7, 9]));
    assert_eq!(measured("ppo", 65_536, ""), pick(&[0, 1, 4, 5, 6, 9]));
    // DQN has a row every 2,048 timesteps, and one at the end of a stage, on a whole block of four steps.
    let rows = ["0 a 0 0", "0 a 2048 2048", "0 a 4096 4096", "0 a 5004 5004"];
    let rows = [rows, ["1 b 0 5004", "1 b 2048 7052", "1 b 4096 9100", "1 b 5004 10008"]].concat();
    assert_eq!(measured("dqn", 2048, "--timesteps 5002"), rows);
    let rows = [0, 1, 3, 4, 5, 7].map(|i| rows[i]);
    assert_eq!(measured("dqn", 10_000, "--timesteps 5002"), rows);
}

#[test]
fn columns_name_towers_and_layers() {
    let sandbox = Sandbox::new();
    for (algo, activation, towers, of_units, later, num_rows) in [
        (
            "ppo",
            "tanh",
            &["policy", "value"][..],
            &["saturated_units", "saturated_activations"][..],
            &["constant_units", "centred_rank"][..],
            6,
        ),
        // The one update of a short stage is its first and its last.
        ("dqn", "relu", &["q"], &["dead_units"], &["centred_rank"], 4),
        ("dqn", "fourier", &["q"], &[], &["centred_rank"], 4),
    ] {
        let sets = format!("--set hidden=[8,6] --set activation={activation}");
        sandbox.succeeds(&format!("{CURRICULUM} {algo}.yaml {sets} --out {activation}"));
        let (columns, rows) = read(&run(&sandbox, algo, activation));
        let of_agent = ["grad_norm", "update_norm", "policy_churn", "policy_churn_per_step"];
        let mut expected = of_agent.map(|name| format!("plasticity/{name}")).to_vec();
        let of_outputs = if algo == "ppo" { &["policy_entropy", "logit_scale"][..] } else { &["action_gap"] };
        expected.extend(of_outputs.iter().map(|name| format!("plasticity/{name}")));
        for tower in towers {
            for layer in 0..2 {
                let hidden = ["weight_magnitude", "dormant_0.1", "dormant_0.025"].iter().chain(of_units);
                let hidden = hidden.chain(&["effective_rank", "stable_rank", "rank_99"]).chain(later);
                expected.extend(hidden.map(|name| format!("plasticity/{tower}.{layer}/{name}")));
            }
            expected.push(format!("plasticity/{tower}.2/weight_magnitude"));
        }
        let fixed =
            |column: &&String| ["grad_norm", "update_norm", "weight_magnitude"].iter().any(|n| column.ends_with(n));
        let visited = expected.iter().filter(|column| !fixed(column)).map(|column| format!("{column}/visited"));
        expected.extend(visited.collect::<Vec<_>>());
        assert_eq!(columns[4..], expected);
        assert_eq!(rows.len(), num_rows);
        for (place, name) in columns.iter().enumerate().skip(4) {
            let column = Column::parse(name);
            let (least, most) = column.measure().expect("a measure that is registered").range;
            let of_update = column.layer.is_none() && of_agent.contains(&column.name);
            for row in &rows {
                let value: f64 = row[place].parse().expect("a number");
                // Before the first update of a stage nothing is known of updates, and all of the agent.
                let is_known = row[2] != *"0" || !of_update;
                let as_known =
                    if is_known { value.is_finite() && (least..=most).contains(&value) } else { value.is_nan() };
                assert!(as_known, "{name} is {value} after {} timesteps", &row[2]);
            }
        }
    }
}

#[test]
fn update_and_gradient_norms_are_those_of_the_row() {
    let sandbox = Sandbox::new();
    // Without a step size nothing changes.
    sandbox.succeeds(&format!("{CURRICULUM} ppo.yaml --set learning_rate=1e-30 --out still --plasticity-interval 1"));
    sandbox.succeeds(&format!("{CURRICULUM} ppo.yaml --out out --plasticity-interval 1"));
    let column = |out: &str, name: &str| {
        let (columns, rows) = read(&run(&sandbox, "ppo", out));
        let at = columns.iter().position(|column| column == name).expect("a column");
        let updates = rows.iter().filter(|row| row[2] != *"0");
        updates.map(|row| row[at].parse::<f64>().expect("a number")).collect::<Vec<_>>()
    };
    let still = |name| column("still", name).iter().all(|&value| value == 0.0);
    assert!(still("plasticity/policy_churn") && still("plasticity/policy_churn_per_step/visited"));
    // Two epochs of two minibatches.
    let [churn, per_step] =
        ["policy_churn", "policy_churn_per_step"].map(|name| column("out", &format!("plasticity/{name}")));
    assert!(churn.iter().any(|&churn| churn > 0.0));
    assert!(churn.iter().zip(&per_step).all(|(churn, per_step)| churn / 4.0 == *per_step), "{churn:?} {per_step:?}");
    assert!(column("still", "plasticity/update_norm").iter().all(|&norm| norm < 1e-20));
    assert!(column("out", "plasticity/update_norm").iter().all(|&norm| norm > 1e-3));
    let logged = run(&sandbox, "ppo", "out").progress();
    let logged = logged.iter().map(|row| row.iter().find(|(name, _)| name == "train/grad_norm").expect("a column"));
    let logged: Vec<f64> = logged.map(|(_, value)| value.parse().expect("a number")).collect();
    assert_eq!(column("out", "plasticity/grad_norm"), logged);
}

/// The row at timestep 0 is of the agent that begins: as the stage before has left it, or as a mitigation has made it.
#[test]
fn a_stage_begins_with_a_row_of_the_agent_that_begins_it() {
    let sandbox = Sandbox::new();
    let values = |mitigations: &str, name: &str| {
        let out = format!("out-{mitigations}");
        let mitigated = format!("--set mitigations=[{mitigations}] --out {out}");
        if !sandbox.path(&out).exists() {
            sandbox.succeeds(&format!("{CURRICULUM} ppo.yaml {mitigated}"));
        }
        let (columns, rows) = read(&run(&sandbox, "ppo", &out));
        let at = columns.iter().position(|column| column == name).expect("a column");
        let of = |place: [&str; 2]| rows.iter().find(|row| [&row[0], &row[2]] == place).expect("a row")[at].to_owned();
        [of(["0", "256"]), of(["1", "0"])].map(|value| value.parse::<f64>().expect("a number"))
    };
    let weights = "plasticity/value.0/weight_magnitude";
    let [end, begin] = values("", weights);
    assert_eq!(end, begin);
    let [end, begin] = values("shrink-perturb", weights);
    assert!(begin < 0.9 * end, "{begin} after {end}");
    // The same network, on other states.
    let [end, begin] = values("", "plasticity/policy_entropy");
    assert!(end != begin && (end - begin).abs() < 0.5, "{begin} after {end}");
}

/// With ε = 1 an agent visits what a random policy does, with ε = 0 it walks against a wall.
#[test]
fn visited_states_are_those_of_the_agent() {
    let sandbox = Sandbox::new();
    let ranks = |epsilon: &str| {
        let sets = format!("--set exploration_initial_eps={epsilon} --set exploration_final_eps={epsilon}");
        sandbox.succeeds(&format!("{CURRICULUM} dqn.yaml {sets} --out eps-{epsilon}"));
        let (columns, rows) = read(&run(&sandbox, "dqn", &format!("eps-{epsilon}")));
        let rank = |end: &str| {
            let at = columns.iter().position(|column| *column == format!("plasticity/q.0/effective_rank{end}"));
            rows[0][at.expect("a column")].parse::<f64>().expect("a number")
        };
        (rank("/visited"), rank(""))
    };
    let ((random, reference), (greedy, same)) = (ranks("1"), ranks("0"));
    assert_eq!(reference, same);
    assert!((random / reference - 1.0).abs() < 0.02 && greedy < 0.95 * reference, "{random}, {greedy}, {reference}");
}

#[test]
fn a_run_is_the_same_with_and_without_measures() {
    let sandbox = Sandbox::new();
    for (algo, engine) in engines().iter().flat_map(|engine| [("ppo", engine), ("dqn", engine)]) {
        let train = |interval: u32| {
            let out = format!("{engine}-{interval}");
            let options = format!("--set engine={engine} --timesteps 600 --out {out}");
            sandbox.succeeds(&format!("{CURRICULUM} {algo}.yaml {options} --plasticity-interval {interval}"));
            run(&sandbox, algo, &out)
        };
        let (with, without) = (train(1), train(0));
        with.reproducible().assert_same(&without.reproducible());
        assert!(with.0.join("plasticity.csv").exists() && !without.0.join("plasticity.csv").exists());
    }
}

#[test]
fn resuming_leaves_the_same_rows() {
    let sandbox = Sandbox::new();
    for algo in ["ppo", "dqn"] {
        let command = format!("{CURRICULUM} {algo}.yaml --plasticity-interval 100 --out out");
        sandbox.succeeds(&command);
        let run = run(&sandbox, algo, "out");
        let whole = run.bytes("plasticity.csv");
        for stages in [1, 0] {
            run.unfinish(stages);
            sandbox.succeeds(&format!("{command} --resume"));
            assert_eq!(run.bytes("plasticity.csv"), whole, "{algo} from stage {stages} on");
        }
        // The interval is no setting of the run: another one goes on with it.
        run.unfinish(1);
        sandbox.succeeds(&format!("{CURRICULUM} {algo}.yaml --plasticity-interval 0 --out out --resume"));
        assert!(whole.starts_with(&run.bytes("plasticity.csv")) && run.bytes("plasticity.csv").len() < whole.len());
        assert_eq!(run.manifest()["plasticity_interval"], 0);
    }
}

/// A run that an earlier version began, before there was some measure, and with one that is gone since.
#[test]
fn a_resumed_log_keeps_the_columns_that_it_has() {
    let sandbox = Sandbox::new();
    let command = format!("{CURRICULUM} ppo.yaml --plasticity-interval 1 --out out");
    sandbox.succeeds(&command);
    let run = run(&sandbox, "ppo", "out");
    let (columns, rows) = read(&run);
    let new = columns.iter().position(|column| column.ends_with("stable_rank")).expect("a column");
    let old = |cells: &mut dyn Iterator<Item = &str>, gone: &str| {
        let mut cells: Vec<&str> = cells.collect();
        cells[new] = gone;
        cells.join(",") + "\n"
    };
    let header = old(&mut columns.iter().map(String::as_str), "plasticity/gone");
    let [first, second] = [0, 1].map(|stage| {
        let of_stage = rows.iter().filter(|row| row[0] == *["0", "1"][stage]);
        of_stage.map(|row| old(&mut row.iter(), ["0.5", "NaN"][stage])).collect::<String>()
    });
    let log = header + &first;
    std::fs::write(run.0.join("plasticity.csv"), &log).expect("the run is writable");
    run.unfinish(1);
    run.rewrite_manifest(|manifest| {
        let mark = serde_json::json!({ "bytes": log.len(), "crc": crc32fast::hash(log.as_bytes()) });
        manifest["marks"][0]["plasticity.csv"] = mark;
    });
    sandbox.succeeds(&format!("{command} --resume"));
    assert_eq!(run.text("plasticity.csv"), log + &second);
}
