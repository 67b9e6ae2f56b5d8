//! `cpp-rl config`.

use serde_json::{Value, json};

use crate::sandbox::Sandbox;

#[test]
fn keys_are_listed_with_what_they_can_be() {
    let sandbox = Sandbox::new();
    let keys = sandbox.json("config keys");
    let key = |name: &str, by: &str| {
        let same = |key: &&Value| key["key"] == name && key["declared_by"] == by;
        keys.as_array().expect("a list").iter().find(same).unwrap_or_else(|| panic!("{name} of {by}")).clone()
    };
    let timesteps = key("timesteps", "common");
    assert_eq!(timesteps["defaults"], json!({ "ppo": 500_000, "dqn": 1_000_000 }));
    assert_eq!(timesteps["allowed"], "an integer from 1 to 1000000000000");
    assert_eq!(key("clip_range", "ppo")["allowed"], "a number above 0");
    let beta2 = key("adam_beta2", "common");
    assert_eq!(beta2["defaults"], json!({ "ppo": 0.999, "dqn": 0.999 }));
    assert_eq!(beta2["allowed"], "a number from 0 to 1, but not 1");
    assert_eq!(key("l2", "mitigation l2")["allowed"], "one of none, adamw, adam, loss");
    let table = sandbox.succeeds("config keys").stdout;
    assert!(table.contains("ppo: 500000, dqn: 1000000"), "{table}");
    // What is refused says the same.
    let error = sandbox.fails(2, "train --algo ppo --level 0 --set timesteps=0");
    assert!(error.contains("expected an integer from 1 to 1000000000000"), "{error}");
    let error = sandbox.fails(2, "train --algo ppo --level 0 --set adam_beta1=1");
    assert!(error.contains("adam_beta1: expected a number from 0 to 1, but not 1, got 1"), "{error}");
    assert!(sandbox.succeeds("config show --algo ppo --set adam_beta1=0").stdout.contains("adam_beta1: 0.0"));

    let of_preset = sandbox.json("config keys --algo ppo-l2");
    let of_preset = of_preset.as_array().expect("a list");
    assert!(of_preset.iter().all(|key| key["declared_by"] != "dqn"));
    let coefficient = of_preset.iter().find(|key| key["key"] == "l2_coef").expect("a key");
    assert_eq!(coefficient["defaults"], json!({ "ppo-l2": 1e-4 }));
    assert!(sandbox.fails(2, "config keys --algo pop").contains("did you mean \"ppo\"?"));
}

#[test]
fn what_is_shown_is_taken_back() {
    let sandbox = Sandbox::new();
    let shown = sandbox.succeeds("config show --config ppo.yaml --set gamma=0.5").stdout;
    assert!(shown.contains("name: \"ppo\"") && shown.contains("gamma: 0.5"), "{shown}");
    sandbox.write("again.yaml", &shown);
    assert_eq!(sandbox.succeeds("config show --config again.yaml").stdout, shown);
    assert!(sandbox.fails(2, "config show --algo ppo --set gama=1").contains("did you mean \"gamma\"?"));
}

#[test]
fn presets_files_and_runs_are_compared() {
    let sandbox = Sandbox::new();
    let keys = |difference: &Value| -> Vec<String> {
        let list = difference["differences"].as_array().expect("a list");
        list.iter().map(|entry| entry["key"].as_str().expect("a key").to_owned()).collect()
    };
    let presets = sandbox.json("config diff ppo ppo-l2");
    assert_eq!(keys(&presets), ["name", "adam_eps", "l2", "l2_coef"]);
    sandbox.succeeds("train --config ppo.yaml --level a.yaml --set gamma=0.5");
    let run = "runs/train/ppo/level-a/seed-0";
    let difference = sandbox.json(&format!("config diff ppo.yaml {run}"));
    assert_eq!(difference["differences"], json!([{ "key": "gamma", "a": 0.99, "b": 0.5 }]));
    let table = sandbox.succeeds(&format!("config diff ppo.yaml {run}")).stdout;
    assert!(table.contains("gamma") && table.contains("0.99") && !table.contains("num_envs"), "{table}");
    assert_eq!(sandbox.succeeds("config diff ppo ppo").stdout, "no setting differs\n");
    assert!(sandbox.fails(2, "config diff ppo nothing").contains("nothing: no preset, no file and no run's directory"));
}

#[test]
fn mitigations_are_listed_with_what_they_do() {
    let sandbox = Sandbox::new();
    let listed = sandbox.json("config mitigations");
    let listed = listed.as_array().expect("a list");
    let of = |name: &str| listed.iter().find(|m| m["name"] == name).unwrap_or_else(|| panic!("{name} is not listed"));
    assert_eq!(of("redo")["settings"], json!({ "redo_threshold": 0.1, "redo_interval": 1000 }));
    assert_eq!(of("entropy-bonus")["settings"], json!({ "ent_coef": 0.1 }));
    assert!(listed.iter().all(|m| m["summary"].as_str().is_some_and(|summary| summary.len() > 20)));
    let table = sandbox.succeeds("config mitigations").stdout;
    assert!(table.contains("dormant units begin anew (Sokar et al. 2023)") && table.contains("redo_interval=1000"));
}
