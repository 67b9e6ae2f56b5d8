//! Mitigations with every engine: against what `scripts/mitigation-oracle` computed with PyTorch, and over kills.

use std::sync::Arc;

use bit_mlp::BitBatch;
use coverage_env::Level;
use cpp_rl::agent::config::{self, Config};
use cpp_rl::agent::dqn::{DqnLoss, Transitions};
use cpp_rl::agent::engine::{Engine, EngineKind};
use cpp_rl::agent::mitigation::{Mitigations, Patient};
use cpp_rl::agent::snapshot::Snapshot;
use cpp_rl::agent::state::{AdamState, AgentState};
use cpp_rl::agent::{self, Stage};
use cpp_rl::random::{Purpose, Stream};
use serde_json::Value;

use crate::numbers::assert_close;

/// The recorded numbers.
fn golden() -> Value {
    let path = format!("{}/tests/fixtures/mitigations.json", crate::ROOT);
    serde_json::from_str(&std::fs::read_to_string(path).expect("the fixture is there")).expect("JSON")
}

fn floats(value: &Value) -> Vec<f32> {
    value.as_array().expect("a list").iter().map(|v| v.as_f64().expect("a number") as f32).collect()
}

fn level() -> Arc<Level> {
    Arc::new(Level::from_map("map", "..T\n.#.").expect("a valid map"))
}

/// DQN with the fixture's network and Adam, and these settings beside.
fn dqn(golden: &Value, sets: &[String]) -> Config {
    let settings = golden["settings"].as_object().expect("settings");
    let mut all: Vec<String> = settings.iter().map(|(key, value)| format!("{key}={value}")).collect();
    all.push(format!("hidden={}", golden["hidden"]));
    all.extend_from_slice(sets);
    config::resolve(Some("dqn"), None, &all, None).expect("valid settings")
}

/// Samples given by their active inputs.
fn batch(samples: &Value) -> BitBatch {
    let mut batch = BitBatch::default();
    for sample in samples.as_array().expect("samples") {
        batch.push_sample(&floats(sample).iter().map(|&input| input as u16).collect::<Vec<u16>>());
    }
    batch
}

fn transitions(case: &Value) -> Transitions {
    Transitions {
        sensor: Default::default(),
        inputs: batch(&case["inputs"]),
        next: batch(&case["next"]),
        actions: floats(&case["actions"]).iter().map(|&action| action as u8).collect(),
        rewards: floats(&case["rewards"]),
        terminated: case["terminated"].as_array().expect("flags").iter().map(|t| t == &Value::Bool(true)).collect(),
    }
}

fn saved(engine: &dyn Engine, agent: &AgentState) -> AgentState {
    let mut agent = agent.clone();
    engine.save(0, &mut agent);
    agent
}

#[test]
fn l2_init_is_pytorchs() {
    let golden = golden();
    for case in golden["l2_init"].as_array().expect("cases") {
        let config =
            dqn(&golden, &["mitigations=[l2-init]".to_owned(), format!("l2_init_coef={}", case["coefficient"])]);
        let mut agent = config.agent(&level(), 0);
        agent.parameters = floats(&case["begin"]);
        agent.kept.copies.insert("target".to_owned(), floats(&case["target"]));
        agent.kept.copies.insert("l2_init".to_owned(), floats(&case["first"]));
        let transitions = transitions(case);
        for make in crate::ENGINES {
            let mut engine = make(config.parts(&level(), vec![agent.clone()]));
            for update in 1..=10 {
                let mut loss = DqnLoss::new(config.shared.gamma as f32, &transitions);
                let norm = engine.descend(&mut [&mut loss]);
                let expected = case["norms"][update - 1].as_f64().expect("a norm") as f32;
                assert_close(&format!("norm of update {update}"), &norm, &[expected], 1e-5);
                if let Some(after) = case["after"].get(update.to_string()) {
                    let parameters = saved(&*engine, &agent).parameters;
                    assert_close(&format!("parameters after {update}"), &parameters, &floats(after), 1e-5);
                }
            }
            assert_close("exp_avg", &saved(&*engine, &agent).adam.exp_avg, &floats(&case["exp_avg"]), 1e-5);
        }
    }
}

#[test]
fn redo_recycles_what_pytorch_finds_dormant() {
    let golden = golden();
    for case in golden["redo"].as_array().expect("cases") {
        let sets = [
            "mitigations=[redo]".to_owned(),
            format!("redo_threshold={}", case["threshold"]),
            "redo_interval=1".to_owned(),
            "learning_rate=1e-30".to_owned(),
        ];
        let config = dqn(&golden, &sets);
        let stage = Stage { index: 3, level: level(), timesteps: 1, horizon: 1 };
        let mut agent = config.agent(&level(), 5);
        agent.parameters = floats(&case["begin"]);
        let inputs = batch(&case["inputs"]);
        let samples = inputs.len();
        let transitions = Transitions {
            sensor: Default::default(),
            next: inputs.clone(),
            inputs,
            actions: vec![1; samples],
            rewards: vec![1.0; samples],
            terminated: vec![true; samples],
        };
        for make in crate::ENGINES {
            let mut engine = make(config.parts(&level(), vec![agent.clone()]));
            let mut regimen = config.regimen(&stage, [&agent].into_iter());
            let mut loss = DqnLoss::new(config.shared.gamma as f32, &transitions);
            engine.descend(&mut [&mut loss]);
            let before = saved(&*engine, &agent);
            regimen.after_step(&mut *engine);
            let after = saved(&*engine, &agent);

            let network = config.network(&level());
            let purpose = Purpose::Mitigation { number: 3, step: 1 };
            let new = network.init(&mut Stream::new(5, 3, purpose));
            let fates = case["fate"].as_array().expect("fates");
            assert!(["keep", "new", "zero"].iter().all(|fate| fates.iter().any(|f| f == fate)));
            for (at, fate) in fates.iter().enumerate() {
                let (parameter, moments) = match fate.as_str() {
                    Some("keep") => (before.parameters[at], (before.adam.exp_avg[at], before.adam.exp_avg_sq[at])),
                    Some("new") => (new[at], (0.0, 0.0)),
                    _ => (0.0, (0.0, 0.0)),
                };
                assert_eq!(after.parameters[at], parameter, "parameter {at}: {fate}");
                assert_eq!((after.adam.exp_avg[at], after.adam.exp_avg_sq[at]), moments, "moments {at}: {fate}");
            }
            assert_eq!(after.kept.copies, before.kept.copies, "the target network is left alone");
            assert_eq!(after.adam.step, before.adam.step);
        }
    }
}

#[test]
fn shrink_and_perturb_by_hand() {
    let sets = ["mitigations=[shrink-perturb]", "shrink_perturb_alpha=0.25", "shrink_perturb_beta=0.5", "hidden=[3]"]
        .map(str::to_owned);
    let config = config::resolve(Some("ppo"), None, &sets, None).expect("valid settings");
    let stage = |index| Stage { index, level: level(), timesteps: 1, horizon: 1 };
    let agent = config.agent(&level(), 9);
    assert_eq!(Snapshot::beginning(&config, &stage(0), agent.clone()).agent, agent, "the first stage is no switch");
    let switched = Snapshot::beginning(&config, &stage(2), agent.clone()).agent;
    let new = config.network(&level()).init(&mut Stream::new(9, 2, Purpose::Mitigation { number: 2, step: 0 }));
    for ((after, before), new) in switched.parameters.iter().zip(&agent.parameters).zip(new) {
        assert_eq!(*after, 0.25 * before + 0.5 * new);
    }
    assert_eq!(switched.adam, agent.adam, "Adam goes on");

    // What else is listed, and what it has counted, changes nothing of what is drawn.
    let mut counted = agent.clone();
    counted.kept.numbers.insert("mitigation/steps".to_owned(), 77);
    let both =
        ["mitigations=[shrink-perturb, redo]", "shrink_perturb_alpha=0.25", "shrink_perturb_beta=0.5", "hidden=[3]"];
    let config = config::resolve(Some("ppo"), None, &both.map(str::to_owned), None).expect("valid settings");
    assert_eq!(Snapshot::beginning(&config, &stage(2), counted).agent.parameters, switched.parameters);
}

/// An agent in which nothing is as in a new one, with and without a mitigation at a switch of levels.
fn switched(algo: &str, sets: &[&str]) -> (Config, AgentState, AgentState) {
    let sets: Vec<String> = sets.iter().map(|&set| set.to_owned()).collect();
    let config = config::resolve(Some(algo), None, &sets, None).expect("valid settings");
    let mut agent = config.agent(&level(), 9);
    agent.parameters.iter_mut().for_each(|p| *p += 1.0);
    agent.kept.copies.values_mut().for_each(|copy| copy.fill(3.0));
    agent.adam.exp_avg.fill(6.0);
    agent.adam.exp_avg_sq.fill(7.0);
    agent.adam.step = 8;
    let stage = |index| Stage { index, level: level(), timesteps: 1, horizon: 1 };
    let first = Snapshot::beginning(&config, &stage(0), agent.clone()).agent;
    assert_eq!(first, agent, "the first stage is no switch");
    let after = Snapshot::beginning(&config, &stage(2), agent.clone()).agent;
    (config, agent, after)
}

#[test]
fn a_head_is_rescaled_by_hand() {
    for algo in ["ppo", "dqn"] {
        let (config, before, after) = switched(algo, &["mitigations=[head-rescale]", "head_rescale_factor=0.5"]);
        let network = config.network(&level());
        let head = network.acting().blocks().last().expect("a layer").range();
        let halved = |values: &[f32]| -> Vec<f32> {
            values.iter().enumerate().map(|(at, v)| if head.contains(&at) { 0.5 * v } else { *v }).collect()
        };
        assert_eq!(after.parameters, halved(&before.parameters));
        assert_eq!(after.adam, before.adam);
        for (name, copy) in &before.kept.copies {
            assert_eq!(after.kept.copies[name], halved(copy), "{name} follows");
        }
    }
}

#[test]
fn adam_is_reset_whole_or_in_its_count_alone() {
    for algo in ["ppo", "dqn"] {
        let (_, before, after) = switched(algo, &["mitigations=[adam-reset]"]);
        assert_eq!((&after.parameters, &after.kept), (&before.parameters, &before.kept));
        assert_eq!(after.adam, AdamState::new(before.parameters.len()));
        let (_, before, after) = switched(algo, &["mitigations=[adam-rel]"]);
        assert_eq!(after, AgentState { adam: AdamState { step: 0, ..before.adam.clone() }, ..before });
    }
}

#[test]
fn layers_are_reset_from_the_last() {
    for (algo, layers) in [("ppo", 1), ("ppo", 9), ("dqn", 2), ("dqn", 3)] {
        let (config, before, after) = switched(algo, &["mitigations=[reset]", &format!("reset_layers={layers}")]);
        let network = config.network(&level());
        let new = network.init(&mut Stream::new(9, 2, Purpose::Mitigation { number: 4, step: 0 }));
        let resets = |at: usize| {
            let blocks = |tower: usize| network.towers()[tower].mlp.blocks();
            let last = |tower| &blocks(tower)[blocks(tower).len().saturating_sub(layers)..];
            (0..network.towers().len()).any(|tower| last(tower).iter().any(|block| block.range().contains(&at)))
        };
        for (at, new) in new.into_iter().enumerate() {
            let is_new = resets(at);
            assert_eq!(after.parameters[at], if is_new { new } else { before.parameters[at] });
            let moments = (after.adam.exp_avg[at], after.adam.exp_avg_sq[at]);
            assert_eq!(moments, if is_new { (0.0, 0.0) } else { (6.0, 7.0) });
            for copy in after.kept.copies.values() {
                assert_eq!(copy[at], if is_new { new } else { 3.0 });
            }
        }
        assert_eq!(after.adam.step, if layers >= 3 { 0 } else { 8 });
    }
}

/// A unit of CReLU or of Fourier features is reset as a whole: both values that leave it.
#[test]
fn a_unit_that_leaves_two_values_is_silenced_in_both() {
    for activation in ["crelu", "fourier"] {
        let sets = ["hidden=[3]".to_owned(), format!("activation={activation}"), "layer_norm=true".to_owned()];
        let config = config::resolve(Some("dqn"), None, &sets, None).expect("valid settings");
        let network = config.network(&level());
        let mut agent = config.agent(&level(), 0);
        agent.parameters.fill(7.0);
        let new = vec![2.0; agent.parameters.len()];
        let mut patient = Patient { network: &network, agent: &mut agent, copies: &[], stage: 0, step: 0 };
        patient.renew_incoming(0, 0, 1, &new);
        patient.silence_outgoing(0, 0, 1);
        let [first, last] = network.acting().blocks() else { panic!("two layers") };
        let column: Vec<f32> = agent.parameters[first.weight.clone()].iter().skip(1).step_by(3).copied().collect();
        assert!(column.iter().all(|&weight| weight == 2.0) && column.len() == 24);
        assert_eq!(agent.parameters[first.bias.clone()], [7.0, 0.0, 7.0]);
        let norm = first.norm.as_ref().expect("a norm");
        assert_eq!(agent.parameters[norm.scale.clone()], [7.0, 1.0, 7.0]);
        assert_eq!(agent.parameters[norm.shift.clone()], [7.0, 0.0, 7.0]);
        let rows: Vec<&[f32]> = agent.parameters[last.weight.clone()].chunks(4).collect();
        let silent: Vec<bool> = rows.iter().map(|row| row.iter().all(|&weight| weight == 0.0)).collect();
        assert_eq!(silent, [false, true, false, false, true, false]);
    }
}

/// Every mitigation with both algorithms: what is saved in the midst of a later stage goes on with the same bits, and
/// without mitigations nothing is different.
#[test]
fn a_mitigated_agent_goes_on_with_the_same_bits() {
    let small = ["hidden=[6]", "max_steps=10", "learning_rate=1e-2"];
    let ppo = ["n_steps=32", "batch_size=8", "n_epochs=2"];
    let dqn = ["batch_size=4", "buffer_size=200", "learning_starts=10", "target_update_interval=50"];
    for mitigation in ["l2-init", "shrink-perturb", "reset", "head-rescale", "adam-reset", "adam-rel", "redo"] {
        for (algo, own) in [("ppo", &ppo[..]), ("dqn", &dqn[..])] {
            let mut sets: Vec<String> = small.iter().chain(own).map(|&set| set.to_owned()).collect();
            let plain = config::resolve(Some(algo), None, &sets, None).expect("valid settings");
            sets.push(format!("mitigations=[{mitigation}]"));
            if mitigation == "redo" {
                sets.extend(["redo_interval=7".to_owned(), "redo_threshold=0.8".to_owned()]);
            }
            let config = config::resolve(Some(algo), None, &sets, None).expect("valid settings");
            let whole = train(&config, None);
            assert_eq!(train(&config, Some(1)), whole, "{algo}, {mitigation}");
            assert_ne!(train(&plain, None).agent.parameters, whole.agent.parameters, "{algo}, {mitigation} acts");
        }
    }
}

/// Two stages of one seed; the second one is stopped and resumed after so many rows, if any.
fn train(config: &Config, stop: Option<usize>) -> Snapshot {
    let stage = |index| Stage { index, level: level(), timesteps: 5000, horizon: 5000 };
    let mut learner = agent::learner(config, &stage(0), vec![config.agent(&level(), 1)], EngineKind::Fused);
    learner.advance();
    let agents = learner.agents().into_iter().cloned().collect();
    let mut learner = agent::learner(config, &stage(1), agents, EngineKind::Fused);
    for row in 0..2 {
        if stop == Some(row) {
            let snapshot = learner.snapshot(0);
            learner = agent::resume(config, &stage(1), vec![snapshot], EngineKind::Fused).expect("its own snapshot");
        }
        learner.advance();
    }
    learner.snapshot(0)
}

#[test]
fn every_mitigation_has_a_row_in_its_document() {
    let document = std::fs::read_to_string(format!("{}/docs/mitigations.md", crate::ROOT)).expect("a document");
    for name in Mitigations::known() {
        assert!(document.contains(&format!("\n| `{name}` | ")), "{name} is not in docs/mitigations.md");
    }
}

#[test]
fn settings_of_mitigations_are_explained() {
    let refused = |set: &str| config::resolve(Some("ppo"), None, &[set.to_owned()], None).unwrap_err().to_string();
    let error = refused("redo_threshold=0.1");
    assert!(error.contains("list it with mitigations=[redo]"), "{error}");
    let error = refused("mitigations=[redoo]");
    assert!(
        error.contains(
            "a list of different names out of l2-init, shrink-perturb, reset, head-rescale, adam-reset, adam-rel, redo"
        ),
        "{error}"
    );
    for factor in ["1e-50", "1e39"] {
        let sets = ["mitigations=[head-rescale]".to_owned(), format!("head_rescale_factor={factor}")];
        let error = config::resolve(Some("ppo"), None, &sets, None).unwrap_err().to_string();
        assert!(error.contains("head_rescale_factor") && error.contains("at most 1e6"), "{error}");
    }
    let both = ["mitigations=[l2-init]", "l2=adam", "l2_coef=0.1"].map(str::to_owned);
    let error = config::resolve(Some("ppo"), None, &both, None).unwrap_err().to_string();
    assert!(error.contains("l2 and l2-init cannot pull at once"), "{error}");
}
