//! The language of study files: what its document shows, and the files in `configs/studies`.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

use cpp_rl::experiment::Study;
use serde_json::{Value, json};

use crate::ROOT;
use crate::sandbox::Sandbox;

/// The studies beside the paper's, with their runs for one seed.
const STUDIES: [(&str, usize); 14] = [
    ("a-b-a-b", 3 * (1 + 2)),
    ("dose", 6 * (1 + 5)),
    ("generated-60", 2),
    ("orders", 120 + 5),
    ("why", 2 * (1 + 5) + 4 * (7 + 4 + 7)),
    ("why-dqn", 1 + 5 + 4 * (7 + 3)),
    ("why-dqn-replay", 1 + 4 * 2),
    ("why-dose", 1 + 4 * (6 + 3)),
    ("why-500k", 1 + 4),
    ("why-age", 7 + 5),
    ("helps-base", 5),
    ("long", 3 + 40),
    ("long-dqn", 2 + 20),
    // Each seed goes through one order.
    ("why-orders", 2),
];

fn studies() -> PathBuf {
    Path::new(ROOT).join("configs/studies")
}

#[test]
fn every_example_of_the_document_is_a_study() {
    let document = fs::read_to_string(Path::new(ROOT).join("docs/studies.md")).expect("a document");
    let examples: Vec<&str> =
        document.split("```yaml\n").skip(1).map(|rest| rest.split("```").next().expect("text")).collect();
    assert!(examples.len() > 8, "only {} examples are found", examples.len());
    for example in examples {
        let study = Study::parse(example, Path::new("docs/studies.md"), None);
        let study = study.unwrap_or_else(|error| panic!("{error:#} in\n{example}"));
        assert!(!study.experiments(&[0, 1]).expect("experiments").is_empty());
    }
    for (name, _) in STUDIES {
        assert!(document.contains(&format!("configs/studies/{name}.yaml")), "{name} is not in the document");
    }
}

#[test]
fn every_study_is_known_here() {
    let files = fs::read_dir(studies()).expect("a folder").map(|entry| entry.expect("an entry").file_name());
    let names: BTreeSet<String> = files.map(|name| name.to_string_lossy().into_owned()).collect();
    assert_eq!(names, STUDIES.iter().map(|(name, _)| format!("{name}.yaml")).collect());
}

#[test]
fn an_estimate_lists_every_run() {
    let sandbox = Sandbox::new();
    for (name, runs) in STUDIES {
        let file = studies().join(format!("{name}.yaml"));
        let estimate = sandbox.json(&format!("study {} --estimate --num-seeds 2 --jobs 4", file.display()));
        assert_eq!(estimate["study"], name);
        let list = estimate["runs"].as_array().expect("runs");
        assert_eq!(list.len(), 2 * runs, "{name}");
        let paths: BTreeSet<&str> = list.iter().map(|run| run["path"].as_str().expect("a path")).collect();
        assert_eq!(paths.len(), list.len(), "{name}: runs of different sequences have different folders");
        let of_stages = |run: &Value| {
            let stages = run["stages"].as_array().expect("stages").iter();
            stages.map(|stage| stage["timesteps"].as_u64().expect("a number")).sum::<u64>()
        };
        assert!(list.iter().all(|run| run["timesteps"] == of_stages(run)), "{name}");
        let total: u64 = list.iter().map(of_stages).sum();
        assert_eq!((&estimate["timesteps"], &estimate["timesteps_left"]), (&json!(total), &json!(total)));
        assert!(estimate["seconds"].as_f64().is_some_and(|seconds| seconds > 0.0));
    }
    assert!(!sandbox.path("runs").exists());
}

#[test]
fn an_estimate_is_a_table_for_people_and_a_list_for_programs() {
    let sandbox = Sandbox::new();
    sandbox.write(
        "s.yaml",
        "name: s\nsequence: {levels: [a.yaml, b.yaml], repeat: 5, timesteps: 256}\n\
         arms: [{config: ppo.yaml, trains: [curriculum, from scratch]}]\n",
    );
    let table = sandbox.succeeds("study s.yaml --estimate --num-seeds 1").stdout;
    assert!(table.contains("a, b, a, b, a, b, a, b, … 10 stages × 256"), "{table}");
    assert!(table.contains("3072") && table.contains("s: 3 runs of 3 experiments, 3072 timesteps to go"), "{table}");
    let csv = sandbox.succeeds("study s.yaml --estimate --num-seeds 1 --format csv").stdout;
    assert!(csv.contains("\"a, b, a, b, a, b, a, b, a, b × 256\",2560"), "{csv}");
    assert_eq!(csv.lines().count(), 1 + 3, "{csv}");
    assert!(sandbox.fails(2, "study s.yaml --format csv").contains("--estimate"));
}

/// A study of this repository at toy length.
fn trained(name: &str, options: &str) -> Sandbox {
    let sandbox = Sandbox::new();
    let file = studies().join(format!("{name}.yaml"));
    sandbox.succeeds(&format!("study {} --seeds 0 --jobs 2 --plasticity-interval 0 {options}", file.display()));
    sandbox
}

#[test]
fn levels_that_take_turns_are_trained_reported_and_resumed() {
    let sandbox = trained("a-b-a-b", "--timesteps 128");
    let run = sandbox.run("a-b-a-b/ppo/curriculum/seed-0");
    let manifest = run.manifest();
    let levels: Vec<&str> = manifest["stages"]
        .as_array()
        .expect("stages")
        .iter()
        .map(|stage| stage["level"].as_str().expect("a name"))
        .collect();
    assert_eq!(levels, ["0", "1", "0", "1"]);
    assert_eq!(manifest["levels"], json!(["0", "1"]), "each level is evaluated once");
    assert!(manifest["stages"][2]["map"].as_str().is_some_and(|map| map.contains('T')));
    sandbox.succeeds("compare runs/a-b-a-b --out report");
    let report: Value =
        serde_json::from_slice(&fs::read(sandbox.path("report/report.json")).expect("a report")).expect("JSON");
    let arms = report["arms"].as_array().expect("arms");
    let ppo = arms.iter().find(|arm| arm["name"] == "ppo").expect("the arm");
    assert_eq!(ppo["stages"].as_array().map(Vec::len), Some(4));
    assert_eq!(ppo["matrix"]["levels"], json!([0, 1]));
    assert_eq!(ppo["matrix"]["rows"].as_array().map(Vec::len), Some(5));
    assert_eq!(ppo["curves"].as_array().map(Vec::len), Some(4));
}

#[test]
fn every_fork_of_the_question_why_is_trained() {
    for (name, parent) in [("why", "ppo-eps"), ("why-dqn", "dqn-constant-eps")] {
        let sandbox = trained(name, "--timesteps 64");
        let forks = fs::read_dir(sandbox.path(&format!("runs/{name}/{parent}"))).expect("a folder");
        let forks = forks.map(|entry| entry.expect("an entry").file_name().to_string_lossy().into_owned());
        let forks: Vec<String> = forks.filter(|folder| folder.contains("+after-3+")).collect();
        assert_eq!(forks.len(), if name == "why" { 11 } else { 10 }, "{forks:?}");
        for folder in forks {
            let manifest = sandbox.run(&format!("{name}/{parent}/{folder}/seed-0")).manifest();
            assert_eq!(manifest["status"]["state"], "finished");
            assert_eq!(manifest["fork"]["parent"], format!("runs/{name}/{parent}/curriculum/seed-0"));
        }
    }
}

#[test]
fn a_dose_curve_is_trained() {
    let sandbox = trained("dose", "--timesteps 64");
    for arm in ["l2+l2_coef-0", "l2+l2_coef-1e-6", "l2+l2_coef-0.01"] {
        let manifest = sandbox.run(&format!("dose/{arm}/curriculum/seed-0")).manifest();
        assert_eq!((&manifest["arm"], &manifest["config"]["name"]), (&json!(arm), &json!(arm)));
        assert_eq!(manifest["config"]["timesteps"], 64);
    }
}

#[test]
fn sixty_generated_levels_are_trained_and_kept() {
    let sandbox = trained("generated-60", "--timesteps 64");
    let manifest = sandbox.run("generated-60/ppo/curriculum/seed-0").manifest();
    let stages = manifest["stages"].as_array().expect("stages");
    assert_eq!(stages.len(), 60);
    let last = &stages[59];
    assert_eq!(last["level"], "generated-8x8-w13-t8-s59");
    // The run has the map itself; the generator still makes the same one.
    let made = sandbox.succeeds("levels generate --seed 59").stdout;
    let map = last["map"].as_str().expect("a map");
    assert!(map.lines().all(|row| made.contains(row)) && map.lines().count() == 8, "{map}\n{made}");
}

#[test]
fn seeds_begin_at_places_of_their_own() {
    let sandbox = Sandbox::new();
    sandbox.write(
        "s.yaml",
        "name: s\nlevels: [a.yaml, b.yaml]\nsequence: {shift: by-seed, timesteps: 64}\n\
         arms: [{config: ppo.yaml, trains: [curriculum]}]\n",
    );
    sandbox.succeeds("study s.yaml --num-seeds 3");
    for (run, first) in [("order-ab/seed-0", "a"), ("order-ba/seed-1", "b"), ("order-ab/seed-2", "a")] {
        assert_eq!(sandbox.run(&format!("s/ppo/{run}")).manifest()["stages"][0]["level"], first);
    }
    sandbox.succeeds("compare runs/s --out report");
}

#[test]
fn orders_lie_in_folders_of_their_own_and_resume() {
    let sandbox = Sandbox::new();
    sandbox.write(
        "s.yaml",
        "name: s\nlevels: [a.yaml, b.yaml]\nsequence: {order: all, timesteps: [64, 128]}\n\
         arms: [{config: ppo.yaml, trains: [curriculum, from scratch]}]\n",
    );
    sandbox.succeeds("study s.yaml --seeds 0,1");
    let stages = |name: &str| -> Vec<(String, u64)> {
        let manifest = sandbox.run(&format!("s/ppo/{name}/seed-1")).manifest();
        let stages = manifest["stages"].as_array().expect("stages").clone();
        let stage =
            |s: &Value| (s["level"].as_str().expect("a name").to_owned(), s["timesteps"].as_u64().expect("a number"));
        stages.iter().map(stage).collect()
    };
    assert_eq!(stages("order-ab"), [("a".to_owned(), 64), ("b".to_owned(), 128)]);
    assert_eq!(stages("order-ba"), [("b".to_owned(), 64), ("a".to_owned(), 128)]);
    // As long as the longest stage.
    assert_eq!(stages("level-a"), [("a".to_owned(), 128)]);
    let again = sandbox.succeeds("study s.yaml --seeds 0,1 --resume").stderr;
    assert!(again.contains("0 timesteps to go"), "{again}");
    sandbox.succeeds("compare runs/s --out report");
    // The first order is that of `curriculum`, and the same bytes.
    sandbox.succeeds("curriculum --config ppo.yaml --levels a.yaml,b.yaml --timesteps 64,128 --seeds 1 --out alone");
    let [one, other] =
        [sandbox.run("s/ppo/order-ab/seed-1"), crate::sandbox::RunFiles(sandbox.path("alone/ppo/curriculum/seed-1"))];
    for stage in ["checkpoints/stage-0.safetensors", "checkpoints/stage-1.safetensors"] {
        let bytes = |run: &crate::sandbox::RunFiles| fs::read(run.0.join(stage)).expect("a checkpoint");
        assert!(bytes(&one) == bytes(&other), "{stage}");
    }
    // What a longer study asks for is done by runs from scratch, as before.
    let longer = fs::read_to_string(sandbox.path("s.yaml"))
        .expect("a file")
        .replace("128]", "256]")
        .replace("[curriculum, ", "[");
    sandbox.write("s.yaml", longer);
    for _ in 0..2 {
        sandbox.succeeds("study s.yaml --seeds 0,1 --resume");
        assert_eq!(stages("level-a"), [("a".to_owned(), 256)]);
    }
}

#[test]
fn a_curriculum_may_come_back_to_a_level() {
    let sandbox = Sandbox::new();
    let options = "--config ppo.yaml --levels a.yaml,b.yaml,a.yaml";
    let printed = sandbox.succeeds(&format!("curriculum {options} --timesteps 128"));
    assert!(printed.stdout.contains("last trained on"), "{}", printed.stdout);
    let rows: Vec<&str> =
        printed.stdout.lines().filter(|line| line.starts_with("level a") || line.starts_with("level b")).collect();
    assert_eq!(rows.len(), 3, "{}", printed.stdout);
    let run = sandbox.run("curriculum/ppo/curriculum/seed-0");
    assert_eq!(run.manifest()["levels"], json!(["a", "b"]));
    // The same level twice at once is two stages, too.
    sandbox.succeeds("curriculum --config ppo.yaml --levels a.yaml,a.yaml --out twice");
}

#[test]
fn many_runs_want_a_word() {
    let sandbox = Sandbox::new();
    let file = studies().join("orders.yaml");
    let error = sandbox.fails(2, &format!("study {} --num-seeds 81", file.display()));
    assert!(error.contains("10125 runs are more than 10000: see them with --estimate"), "{error}");
    assert!(!sandbox.path("runs").exists());
}
