//! Models that Stable-Baselines3 trained, converted, earn from every start what Stable-Baselines3 measured.

use serde_json::Value;

use crate::fixtures;
use crate::sandbox::Sandbox;

#[test]
fn a_policy_earns_what_it_earned_there() {
    earns_the_same("ppo_level0");
}

#[test]
fn a_q_network_earns_what_it_earned_there() {
    earns_the_same("dqn_level0");
}

fn earns_the_same(name: &str) {
    let sandbox = Sandbox::new();
    let file = format!("{name}.safetensors");
    sandbox.write(&file, std::fs::read(fixtures::path(&file)).expect("the fixture is there"));
    let evaluation = sandbox.json(&format!("eval {file} --levels 0"));
    let earned = |episode: &Value| (episode["start"].clone(), episode["return"].as_f64());
    let episodes = |list: &Value| list.as_array().expect("episodes").iter().map(earned).collect::<Vec<_>>();
    let expected = episodes(&fixtures::json("returns")[name]);
    assert_eq!(expected.len(), 55);
    assert_eq!(episodes(&evaluation["levels"][0]["episodes"]), expected);
}
