//! Mitigations with every engine: against what `scripts/mitigation-oracle` computed with PyTorch, and over kills.

use std::sync::Arc;

use bit_mlp::BitBatch;
use coverage_env::Level;
use cpp_rl::agent::config::{self, Config};
use cpp_rl::agent::dqn::{DqnLoss, Transitions};
use cpp_rl::agent::engine::{Engine, LayerUnits, Loss, Pass, Statement, Units};
use cpp_rl::agent::mitigation::{Churn, ChurnRecords, Mitigations, Patient, Place, WithChurn};
use cpp_rl::agent::network::Outputs;
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
        let threshold = format!("redo_threshold={}", case["threshold"]);
        recycles(&golden, case, 3, &["mitigations=[redo]", "redo_interval=1", &threshold]);
    }
    for case in golden["redo_saturation"].as_array().expect("cases") {
        let (level, share) = (&case["level"], &case["share"]);
        let own = [format!("redo_saturation_level={level}"), format!("redo_saturation_share={share}")];
        let sets = ["mitigations=[redo-saturation]", "activation=tanh", "redo_saturation_interval=1", &own[0], &own[1]];
        recycles(&golden, case, 9, &sets);
    }
}

/// One gradient step that is too small to change anything, and what the mitigation of this number does after it.
fn recycles(golden: &Value, case: &Value, number: u16, sets: &[&str]) {
    let sets: Vec<String> = sets.iter().chain(&["learning_rate=1e-30"]).map(|&set| set.to_owned()).collect();
    let config = dqn(golden, &sets);
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
        let mut regimen = config.regimen(&stage(), [&agent].into_iter());
        let mut loss = DqnLoss::new(config.shared.gamma as f32, &transitions);
        engine.descend(&mut [&mut loss]);
        let before = saved(&*engine, &agent);
        regimen.after_step(&mut *engine);
        let after = saved(&*engine, &agent);

        let fates = Fates::of(&case["fate"]);
        assert!(["keep", "new", "zero"].iter().all(|fate| fates.0.iter().any(|f| f == fate)));
        fates.check(&config, (number, 1), &before, &after, &[]);
        assert_eq!(after.kept.copies, before.kept.copies, "the target network is left alone");
        assert_eq!(after.adam.step, before.adam.step);
    }
}

/// The stage of the tests with recorded numbers.
fn stage() -> Stage {
    Stage { index: 3, level: level(), timesteps: 1, horizon: 1 }
}

/// What becomes of each parameter: `keep`, `new`, `zero` or `value`.
struct Fates(Vec<String>);

impl Fates {
    fn of(list: &Value) -> Self {
        let fate = |fate: &Value| fate.as_str().expect("a fate").to_owned();
        Self(list.as_array().expect("fates").iter().map(fate).collect())
    }

    /// Compares two states of an agent of seed 5; the mitigation's stream has this number and step.
    fn check(
        &self,
        config: &Config,
        (number, step): (u16, u32),
        before: &AgentState,
        after: &AgentState,
        values: &[f32],
    ) {
        let stream = Stream::new(5, 3, Purpose::Mitigation { number, step });
        let new = new_weights(config, stream, &|at| self.0[at] == "new");
        for (at, fate) in self.0.iter().enumerate() {
            let kept = (before.adam.exp_avg[at], before.adam.exp_avg_sq[at]);
            let (parameter, moments) = match fate.as_str() {
                "keep" => (before.parameters[at], kept),
                "value" => (values[at], kept),
                "new" => (new[at], (0.0, 0.0)),
                _ => (0.0, (0.0, 0.0)),
            };
            let is = after.parameters[at];
            let tolerance = if fate == "value" { 1e-5 } else { 0.0 };
            assert!((is - parameter).abs() <= tolerance, "parameter {at}: {fate}, {is} for {parameter}");
            assert_eq!((after.adam.exp_avg[at], after.adam.exp_avg_sq[at]), moments, "moments {at}: {fate}");
        }
    }
}

/// The weights that a mitigation gives to the units whose incoming weights are new, `[P]`; 0 elsewhere.
fn new_weights(config: &Config, mut stream: Stream, is_new: &dyn Fn(usize) -> bool) -> Vec<f32> {
    let network = config.network(&level());
    let mut new = vec![0.0; network.num_parameters()];
    for tower in network.towers() {
        for (layer, block) in tower.mlp.blocks().iter().enumerate() {
            for unit in (0..block.width).filter(|unit| is_new(block.weight.start + unit)) {
                for (input, weight) in tower.new_unit(layer, &mut stream).into_iter().enumerate() {
                    new[block.weight.start + input * block.width + unit] = weight;
                }
            }
        }
    }
    new
}

/// Ten updates on one minibatch, with what PyTorch recorded of them. `agent` is where they begin but for its parameters.
fn ten_updates(golden: &Value, case: &Value, config: &Config, keep: &dyn Fn(&mut AgentState)) -> Vec<AgentState> {
    let start = &golden["start"];
    let mut agent = config.agent(&level(), 0);
    agent.parameters = floats(&start["begin"]);
    agent.kept.copies.insert("target".to_owned(), floats(&start["target"]));
    keep(&mut agent);
    let transitions = transitions(start);
    let mut ends = Vec::new();
    for make in crate::ENGINES {
        let mut engine = make(config.parts(&level(), vec![agent.clone()]));
        let mut regimen = config.regimen(&stage(), [&agent].into_iter());
        for (update, norm) in floats(&case["norms"]).into_iter().enumerate() {
            let mut loss = DqnLoss::new(config.shared.gamma as f32, &transitions);
            let is = engine.descend(&mut [&mut loss]);
            assert_close(&format!("norm of update {}", update + 1), &is, &[norm], 1e-5);
            regimen.after_step(&mut *engine);
            if let Some(after) = case["after"].get((update + 1).to_string()) {
                let is = saved(&*engine, &agent);
                assert_close(&format!("parameters after {}", update + 1), &is.parameters, &floats(after), 1e-5);
                ends.push(is);
            }
        }
        let end = saved(&*engine, &agent);
        assert_close("exp_avg", &end.adam.exp_avg, &floats(&case["exp_avg"]), 1e-5);
    }
    ends
}

#[test]
fn penalties_and_clipping_are_pytorchs() {
    let golden = golden();
    let cases = |name: &str| golden[name].as_array().expect("cases").clone();
    let config = |sets: &[String]| dqn(&golden, sets);
    let nothing = |_: &mut AgentState| {};
    for case in cases("l2_init_unsquared") {
        let coefficient = format!("l2_init_coef={}", case["coefficient"]);
        let sets = ["mitigations=[l2-init]".to_owned(), "l2_init_squared=false".to_owned(), coefficient];
        let keep = |agent: &mut AgentState| {
            agent.kept.copies.insert("l2_init".to_owned(), floats(&case["first"]));
        };
        ten_updates(&golden, &case, &config(&sets), &keep);
    }
    for case in cases("parseval") {
        let (coefficient, scale, every) = (&case["coefficient"], &case["scale"], &case["every"]);
        let sets = [
            "mitigations=[parseval]".to_owned(),
            format!("parseval_coef={coefficient}"),
            format!("parseval_scale={scale}"),
            format!("parseval_interval={every}"),
        ];
        ten_updates(&golden, &case, &config(&sets), &nothing);
    }
    for case in cases("spectral") {
        let (coefficient, power) = (&case["coefficient"], &case["exponent"]);
        let sets = [
            "mitigations=[spectral]".to_owned(),
            format!("spectral_coef={coefficient}"),
            format!("spectral_power={power}"),
        ];
        let joined = |lists: &Value| lists.as_array().expect("lists").iter().flat_map(floats).collect::<Vec<f32>>();
        let keep = |agent: &mut AgentState| {
            agent.kept.lists.insert("spectral".to_owned(), joined(&case["u"]));
        };
        let ends = ten_updates(&golden, &case, &config(&sets), &keep);
        for (end, update) in ends.iter().zip(["1", "10"].into_iter().cycle()) {
            assert_close("u", &end.kept.lists["spectral"], &joined(&case["u_after"][update]), 1e-5);
        }
    }
    for case in cases("equal_betas") {
        let sets = [
            "mitigations=[equal-betas]".to_owned(),
            format!("adam_beta1={}", case["beta"]),
            format!("adam_beta2={}", case["beta"]),
        ];
        ten_updates(&golden, &case, &config(&sets), &nothing);
    }
    for case in cases("weight_clipping") {
        let sets = ["mitigations=[weight-clipping]".to_owned(), format!("weight_clipping_kappa={}", case["factor"])];
        ten_updates(&golden, &case, &config(&sets), &nothing);
    }
}

#[test]
fn continual_backprop_is_the_oracles() {
    let golden = golden();
    for case in golden["continual_backprop"].as_array().expect("cases") {
        let config = dqn(
            &golden,
            &[
                "mitigations=[continual-backprop]".to_owned(),
                format!("continual_backprop_rate={}", case["rate"]),
                format!("continual_backprop_maturity={}", case["maturity"]),
                format!("continual_backprop_decay={}", case["decay"]),
            ],
        );
        let mut agent = config.agent(&level(), 5);
        agent.parameters = floats(&golden["start"]["begin"]);
        agent.kept.copies.insert("target".to_owned(), floats(&golden["start"]["target"]));
        for make in crate::ENGINES {
            let mut engine = make(config.parts(&level(), vec![agent.clone()]));
            let mut regimen = config.regimen(&stage(), [&agent].into_iter());
            let mut before = agent.clone();
            for (update, state) in case["states"].as_array().expect("states").iter().enumerate() {
                let transitions = transitions(&golden["minibatches"][update]);
                let mut loss = DqnLoss::new(config.shared.gamma as f32, &transitions);
                let norm = engine.descend(&mut [&mut loss]);
                assert_close("norm", &norm, &[floats(&case["norms"])[update]], 1e-5);
                before = saved(&*engine, &agent);
                regimen.after_step(&mut *engine);
                let lists = saved(&*engine, &agent).kept.lists;
                for (own, recorded) in
                    [("utility", "utility"), ("mean", "activation"), ("age", "age"), ("due", "accumulated")]
                {
                    let layers = state[recorded].as_array().expect("layers");
                    let recorded: Vec<f32> =
                        if own == "due" { floats(&state[recorded]) } else { layers.iter().flat_map(floats).collect() };
                    let is = &lists[&format!("continual-backprop/{own}")];
                    assert_close(&format!("{own} after {}", update + 1), is, &recorded, 1e-5);
                }
            }
            assert_close("parameters", &before.parameters, &floats(&case["parameters"]), 1e-5);
            let after = saved(&*engine, &agent);
            let values = case["values_with_transfer"].as_array().expect("values").iter();
            let values: Vec<f32> = values.map(|value| value.as_f64().unwrap_or(f64::NAN) as f32).collect();
            let fates = Fates::of(&case["fate_with_transfer"]);
            assert!(["keep", "new", "zero", "value"].iter().all(|fate| fates.0.iter().any(|f| f == fate)));
            fates.check(&config, (10, 10), &before, &after, &values);
        }
    }
}

/// A loss that is 0.
struct Nothing;

impl<'a> Loss<'a> for Nothing {
    fn passes(&self) -> Vec<Pass<'a>> {
        Vec::new()
    }

    fn derive(&mut self, _: &[&[f32]], _: &mut [Vec<f32>]) {}

    fn statement(&self) -> Statement<'a> {
        Statement { name: "nothing", constants: Vec::new(), columns: Vec::new() }
    }

    fn of_acting(&self) -> f32 {
        0.0
    }

    fn set_terms(&mut self, _: &[f32]) {}
}

#[test]
fn churn_and_its_gradient_are_pytorchs() {
    let golden = golden();
    let cases = [
        ("churn_policy", "activation=tanh", Outputs::Logits, "cross_entropy"),
        ("churn_values", "activation=relu", Outputs::Values, "loss"),
    ];
    for (name, activation, outputs, distance) in cases {
        for case in golden[name].as_array().expect("cases") {
            // The mean of the gradients is then the gradient itself.
            let sets = [activation, "adam_beta1=0", "max_grad_norm=1e9"].map(str::to_owned);
            let config = dqn(&golden, &sets);
            let agent = |parameters: &Value| {
                let mut agent = config.agent(&level(), 0);
                agent.parameters = floats(parameters);
                agent
            };
            let states = batch(&case["inputs"]);
            for make in crate::ENGINES {
                let mut before = make(config.parts(&level(), vec![agent(&case["previous"])]));
                let before = before.forward(0, &[&states]).remove(0);
                let now = agent(&case["begin"]);
                let mut engine = make(config.parts(&level(), vec![now.clone()]));
                let mut nothing = Nothing;
                let mut loss = WithChurn {
                    inner: &mut nothing,
                    states: &states,
                    before: &before,
                    outputs,
                    coefficient: 2.0,
                    distance: 0.0,
                };
                engine.descend(&mut [&mut loss]);
                let expected = case[distance].as_f64().expect("a number") as f32;
                assert_close(distance, &[loss.distance], &[expected], 1e-5);
                let twice: Vec<f32> = floats(&case["gradient"]).into_iter().map(|g| 2.0 * g).collect();
                assert_close("gradient", &saved(&*engine, &now).adam.exp_avg, &twice, 1e-5);
            }
        }
    }
}

#[test]
fn the_coefficient_of_churn_is_the_oracles() {
    let golden = golden();
    for (case, (outputs, kind)) in golden["churn_coefficients"]
        .as_array()
        .expect("cases")
        .iter()
        .zip([(Outputs::Values, "value"), (Outputs::Logits, "policy")])
    {
        assert_eq!(case["least"].is_null(), outputs == Outputs::Values);
        let sets = [
            "mitigations=[churn]".to_owned(),
            format!("churn_{kind}_coef={}", case["first"]),
            format!("churn_{kind}_scale={}", case["scale"]),
            format!("churn_warm_up={}", case["warm_up"]),
            format!("churn_window={}", case["window"]),
        ];
        let config = dqn(&golden, &sets);
        let churn = config.mitigations.find::<Churn>().expect("it is listed");
        let mut records = ChurnRecords::default();
        let numbers = ["losses", "churns", "coefficients"].map(|name| floats(&case[name]));
        let [losses, churns, coefficients] = &numbers;
        for ((loss, distance), coefficient) in losses.iter().zip(churns).zip(coefficients) {
            churn.note(&mut records, f64::from(*loss), f64::from(*distance));
            assert_close("c", &[churn.coefficient(outputs, &records) as f32], &[*coefficient], 1e-5);
        }
    }
}

/// Lets every listed mitigation act once on an agent.
fn act(config: &Config, agent: &mut AgentState, step: u64, units: &Units) {
    let network = config.network(&level());
    let mut patient = Patient { network: &network, agent, copies: &["target"], stage: 3, step };
    for mitigation in config.mitigations.iter() {
        mitigation.at_switch(&mut patient);
        mitigation.after_step(&mut patient, units);
    }
}

#[test]
fn units_are_reset_when_they_are_silent_for_longer_than_usual() {
    let golden = golden();
    for case in golden["self_normalised_resets"].as_array().expect("cases") {
        // The record counts samples, and we count gradient steps.
        let samples = case["samples"].as_f64().expect("a number");
        let steps = |key: &str| case[key].as_f64().expect("a number") / samples;
        let config = dqn(
            &golden,
            &[
                "mitigations=[self-normalised-resets]".to_owned(),
                format!("self_normalised_resets_percentile={}", case["percentile"]),
                format!("self_normalised_resets_interval={}", case["interval"]),
                format!("self_normalised_resets_threshold={}", steps("first_threshold")),
                format!("self_normalised_resets_longest={}", steps("largest")),
            ],
        );
        let (longest, mut agent) = (steps("largest") as usize, config.agent(&level(), 5));
        let mut resets = 0;
        for (step, state) in case["states"].as_array().expect("states").iter().enumerate() {
            let rows = case["activations"][step].as_array().expect("samples").iter();
            let layer = LayerUnits { units: 5, values: 5, activations: rows.flat_map(floats).collect() };
            let before = agent.clone();
            act(&config, &mut agent, step as u64 + 1, &Units { towers: vec![vec![layer]] });
            let list = |name: &str| agent.kept.lists[&format!("self-normalised-resets/{name}")].clone();
            let in_samples = |list: Vec<f32>| list.into_iter().map(|v| v * samples as f32).collect::<Vec<f32>>();
            assert_eq!(in_samples(list("age")), floats(&state["age"]), "age after {}", step + 1);
            assert_eq!(in_samples(list("threshold")), floats(&state["threshold"]), "threshold after {}", step + 1);
            let mut noted = vec![0.0; 5 * longest];
            for (unit, counts) in state["noted"].as_array().expect("units").iter().enumerate() {
                for count in counts.as_array().expect("counts") {
                    let [age, count] = floats(count)[..] else { panic!("an age and a count") };
                    // Silences of 0 take part in nothing.
                    if age > 0.0 {
                        noted[unit * longest + (age / samples as f32) as usize - 1] = count;
                    }
                }
            }
            assert_eq!(list("gaps"), noted, "silences after {}", step + 1);
            let reset: Vec<usize> = floats(&state["reset"]).into_iter().map(|unit| unit as usize).collect();
            resets += reset.len();
            let first = &config.network(&level()).acting().blocks()[0].clone();
            let is_changed = |unit: usize| {
                let of = |agent: &AgentState| agent.parameters[first.weight.start + unit];
                of(&agent) != of(&before)
            };
            assert_eq!((0..5).filter(|&unit| is_changed(unit)).collect::<Vec<_>>(), reset, "after {}", step + 1);
        }
        assert!(resets > 1);
    }
}

#[test]
fn weights_are_projected_and_made_orthogonal() {
    let golden = golden();
    for case in golden["normalise_and_project"].as_array().expect("cases") {
        let config = dqn(&golden, &["mitigations=[normalise-project]".to_owned()]);
        let mut agent = config.agent(&level(), 5);
        agent.parameters = floats(&case["begin"]);
        agent.kept.lists.insert("normalise-project".to_owned(), floats(&case["first_norms"])[..2].to_vec());
        act(&config, &mut agent, 1000, &Units::default());
        // The other case projects the last layer, too, and we do not.
        let network = config.network(&level());
        let last = network.acting().blocks().last().expect("a layer").weight.clone();
        let mut expected = floats(&case["after"]);
        if case["covers_output"] == true {
            let begin = floats(&case["begin"]);
            assert_ne!(expected[last.clone()], begin[last.clone()]);
            expected[last.clone()].copy_from_slice(&begin[last]);
        }
        assert_close("projected", &agent.parameters, &expected, 1e-6);
    }
    for (i, case) in golden["fire"].as_array().expect("cases").iter().enumerate() {
        let fire = |iterations: u32| {
            let sets = ["mitigations=[fire]".to_owned(), format!("fire_iterations={iterations}")];
            let config = dqn(&golden, &sets);
            let mut agent = config.agent(&level(), 5);
            agent.parameters = floats(&case["begin"]);
            act(&config, &mut agent, 1, &Units::default());
            assert_eq!(agent.kept.copies["target"], agent.parameters);
            agent.parameters
        };
        assert_eq!(case["iterations"], 10);
        assert_close("ten iterations", &fire(10), &floats(&case["after"]), 1e-5);
        assert_close("the limit", &fire(40), &floats(&case["polar"]), 1e-5);
        let is_at_limit = floats(&case["after"]).iter().zip(floats(&case["polar"])).all(|(a, b)| (a - b).abs() < 1e-4);
        assert_eq!(is_at_limit, i == 0, "the second case needs more");
    }
}

/// The record's θ′ is not ours; what is left of the parameters, and the share of θ′, are.
#[test]
fn soft_shrink_and_perturb_is_pytorchs() {
    let golden = golden();
    for case in golden["soft_shrink_perturb"].as_array().expect("cases") {
        let (alpha, beta) = (&case["shrink"], &case["perturb"]);
        let config = dqn(
            &golden,
            &[
                "mitigations=[soft-shrink-perturb]".to_owned(),
                format!("soft_shrink_perturb_alpha={alpha}"),
                format!("soft_shrink_perturb_beta={beta}"),
                "soft_shrink_perturb_interval=1".to_owned(),
            ],
        );
        let mut agent = config.agent(&level(), 5);
        agent.parameters = floats(&golden["start"]["begin"]);
        act(&config, &mut agent, 1, &Units::default());
        let stream = &mut Stream::new(5, 3, Purpose::Mitigation { number: 8, step: 1 });
        let (ours, theirs) = (config.network(&level()).init(stream), floats(&case["new"]));
        let beta = beta.as_f64().expect("a number") as f32;
        let moved = |((after, ours), theirs): ((f32, f32), f32)| after + beta * (ours - theirs);
        let expected: Vec<f32> = floats(&case["after"]).into_iter().zip(ours).zip(theirs).map(moved).collect();
        assert_close("parameters", &agent.parameters, &expected, 1e-6);
    }
}

/// Many single steps and one of all of them: where θ′ is always the same, the same; else with noise of the same variance.
#[test]
fn soft_shrink_and_perturb_by_hand() {
    let (alpha, beta) = (0.995_f64, 0.25);
    let agent_after = |interval: u64, applications: u64| {
        let config = dqn(
            &golden(),
            &[
                "mitigations=[soft-shrink-perturb]".to_owned(),
                "layer_norm=true".to_owned(),
                format!("soft_shrink_perturb_alpha={alpha}"),
                format!("soft_shrink_perturb_beta={beta}"),
                format!("soft_shrink_perturb_interval={interval}"),
            ],
        );
        let before = config.agent(&level(), 5);
        let mut after = before.clone();
        (1..=applications).for_each(|step| act(&config, &mut after, step, &Units::default()));
        (config.network(&level()), before.parameters, after.parameters)
    };
    let (network, before, single) = agent_after(1, 2);
    let (_, _, at_once) = agent_after(2, 1);
    let new = |step| network.init(&mut Stream::new(5, 3, Purpose::Mitigation { number: 8, step }));
    let (first, second) = (new(1), new(2));
    let scales: Vec<usize> = network.hidden_blocks().flat_map(|b| b.norm.clone().expect("a norm").scale).collect();
    assert_eq!(scales.len(), 9);
    for at in 0..before.len() {
        let step = |p: f32, new: f32| alpha as f32 * p + beta as f32 * new;
        assert!((single[at] - step(step(before[at], first[at]), second[at])).abs() < 1e-6);
        let noise = beta as f32 * (1.0 + alpha * alpha).sqrt() as f32;
        let kept = (alpha * alpha) as f32 * before[at];
        let expected = if scales.contains(&at) { single[at] } else { kept + noise * first[at] };
        assert!((at_once[at] - expected).abs() < 1e-6, "{at}");
    }
    let refused = config::resolve(
        Some("ppo"),
        None,
        &["mitigations=[soft-shrink-perturb]", "soft_shrink_perturb_alpha=0.9999"].map(str::to_owned),
        None,
    );
    let error = refused.expect_err("1,000 steps are too many").to_string();
    assert!(error.contains("at most 100 gradient steps can be made at once, and not 1000"), "{error}");
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
        let mut patient = Patient { network: &network, agent: &mut agent, copies: &[], stage: 0, step: 0 };
        let unit = Place { tower: 0, layer: 0, unit: 1 };
        patient.renew_incoming(unit, &mut Stream::new(0, 0, Purpose::Weights));
        patient.silence_outgoing(unit);
        let [first, last] = network.acting().blocks() else { panic!("two layers") };
        let column: Vec<f32> = agent.parameters[first.weight.clone()].iter().skip(1).step_by(3).copied().collect();
        assert_eq!(column, network.towers()[0].new_unit(0, &mut Stream::new(0, 0, Purpose::Weights)));
        assert_eq!(agent.parameters[first.bias.clone()], [7.0, 0.0, 7.0]);
        let norm = first.norm.as_ref().expect("a norm");
        assert_eq!(agent.parameters[norm.scale.clone()], [7.0, 1.0, 7.0]);
        assert_eq!(agent.parameters[norm.shift.clone()], [7.0, 0.0, 7.0]);
        let rows: Vec<&[f32]> = agent.parameters[last.weight.clone()].chunks(4).collect();
        let silent: Vec<bool> = rows.iter().map(|row| row.iter().all(|&weight| weight == 0.0)).collect();
        assert_eq!(silent, [false, true, false, false, true, false]);
    }
}

/// Every mitigation, with settings with which it acts within a few steps. For DQN, `activation` is ReLU where it is not said.
const ACTING: [(&str, &[&str]); 26] = [
    ("l2-init", &[]),
    ("l2-init", &["l2_init_squared=false", "l2_init_coef=0.1"]),
    ("shrink-perturb", &[]),
    ("reset", &[]),
    ("head-rescale", &[]),
    ("adam-reset", &[]),
    ("adam-rel", &[]),
    ("fire", &[]),
    ("parseval", &["parseval_coef=0.1", "parseval_interval=5"]),
    ("spectral", &["spectral_coef=0.1"]),
    ("churn", &["churn_warm_up=1"]),
    ("redo", &["redo_interval=7", "redo_threshold=0.8"]),
    ("redo-saturation", &["redo_saturation_level=0.2", "redo_saturation_share=0.5", "redo_saturation_interval=7"]),
    ("continual-backprop", &["continual_backprop_rate=0.05", "continual_backprop_maturity=10"]),
    ("self-normalised-resets", &["self_normalised_resets_threshold=2", "self_normalised_resets_interval=20"]),
    ("soft-shrink-perturb", &["soft_shrink_perturb_alpha=0.999", "soft_shrink_perturb_interval=7"]),
    ("weight-clipping", &["weight_clipping_kappa=0.5"]),
    ("normalise-project", &["normalise_project_interval=7"]),
    ("entropy-bonus", &[]),
    ("equal-betas", &[]),
    ("l2-adam", &[]),
    ("adamw", &[]),
    ("layer-norm", &[]),
    ("crelu", &[]),
    ("crelu", &["layer_norm=true"]),
    ("fourier", &[]),
];

/// Every mitigation with both algorithms: what is saved in the midst of a later stage goes on with the same bits, and
/// without mitigations nothing is different. Where an algorithm cannot have one, the reason names it.
#[test]
fn a_mitigated_agent_goes_on_with_the_same_bits() {
    let small = ["hidden=[6]", "max_steps=10", "learning_rate=1e-2"];
    let ppo = ["n_steps=32", "batch_size=8", "n_epochs=2"];
    let dqn = ["train_freq=16", "batch_size=4", "buffer_size=200", "learning_starts=10", "target_update_interval=50"];
    let mut trained = Vec::new();
    for (mitigation, acting) in ACTING {
        for (algo, own) in [("ppo", &ppo[..]), ("dqn", &dqn[..])] {
            let mut sets: Vec<String> = small.iter().chain(own).map(|&set| set.to_owned()).collect();
            let plain = config::resolve(Some(algo), None, &sets, None).expect("valid settings");
            sets.push(format!("mitigations=[{mitigation}]"));
            sets.extend(acting.iter().map(|&set| set.to_owned()));
            let config = match config::resolve(Some(algo), None, &sets, None) {
                Ok(config) => config,
                Err(error) => {
                    assert!(error.to_string().contains(mitigation), "{error}");
                    continue;
                }
            };
            let whole = train(&config, None);
            assert_eq!(train(&config, Some(1)), whole, "{algo}, {mitigation}");
            assert_ne!(train(&plain, None).agent.parameters, whole.agent.parameters, "{algo}, {mitigation} acts");
            trained.push((mitigation, algo));
        }
    }
    let refused = [("redo-saturation", "dqn"), ("self-normalised-resets", "ppo"), ("entropy-bonus", "dqn")];
    for name in Mitigations::known() {
        for algo in ["ppo", "dqn"] {
            let is_trained = trained.contains(&(name, algo));
            assert_ne!(is_trained, refused.contains(&(name, algo)), "{name} with {algo}");
        }
    }
}

/// A dose of nothing: none of them takes random numbers from what a plain arm draws, or changes an agent on its way.
#[test]
fn a_mitigation_that_does_nothing_changes_nothing() {
    let nothing: [(&str, &str, &[&str]); 8] = [
        ("ppo", "redo", &["redo_interval=1", "redo_threshold=0"]),
        ("dqn", "continual-backprop", &["continual_backprop_rate=0"]),
        ("ppo", "continual-backprop", &["continual_backprop_rate=0"]),
        ("ppo", "redo-saturation", &["redo_saturation_level=1", "redo_saturation_interval=1"]),
        (
            "dqn",
            "self-normalised-resets",
            &[
                "self_normalised_resets_threshold=1000",
                "self_normalised_resets_longest=1000",
                "self_normalised_resets_interval=1000000",
            ],
        ),
        ("ppo", "weight-clipping", &["weight_clipping_kappa=1e9"]),
        ("ppo", "shrink-perturb", &["shrink_perturb_alpha=1", "shrink_perturb_beta=0"]),
        (
            "dqn",
            "soft-shrink-perturb",
            &["soft_shrink_perturb_alpha=1", "soft_shrink_perturb_beta=0", "soft_shrink_perturb_interval=1"],
        ),
    ];
    for (algo, name, acting) in nothing {
        let mut sets = vec!["hidden=[6]".to_owned(), "max_steps=10".to_owned()];
        sets.extend(
            if algo == "ppo" {
                ["n_steps=32", "batch_size=8", "n_epochs=2"]
            } else {
                ["batch_size=4", "learning_starts=10", "train_freq=16"]
            }
            .map(str::to_owned),
        );
        let plain = config::resolve(Some(algo), None, &sets, None).expect("valid settings");
        sets.push(format!("mitigations=[{name}]"));
        sets.extend(acting.iter().map(|&set| set.to_owned()));
        let config = config::resolve(Some(algo), None, &sets, None).expect("valid settings");
        let (mut plain, mut with) = (train(&plain, None), train(&config, None));
        plain.agent.kept.lists.clear();
        with.agent.kept.lists.clear();
        with.agent.kept.numbers.clear();
        assert_eq!(plain, with, "{algo}, {name}");
    }
}

#[test]
fn a_mitigation_of_settings_brings_them() {
    let resolve = |algo, sets: &[&str]| {
        let sets: Vec<String> = sets.iter().map(|&set| set.to_owned()).collect();
        config::resolve(Some(algo), None, &sets, None)
    };
    let config = resolve("ppo", &["mitigations=[layer-norm, entropy-bonus]"]).expect("valid settings");
    let settings = config.to_json();
    assert_eq!((&settings["layer_norm"], &settings["ent_coef"]), (&Value::from(true), &Value::from(0.1)));
    // A dose of one's own, on the command line, and when what was recorded is read again.
    let config = resolve("ppo", &["mitigations=[entropy-bonus]", "ent_coef=0.3"]).expect("valid settings");
    assert_eq!(config.to_json()["ent_coef"], 0.3);
    assert_eq!(Config::recorded(&config.to_json()).expect("its own"), config);
    let more = config.with_sets(&["mitigations=[entropy-bonus, crelu]".to_owned()]).expect("valid settings");
    let more = more.to_json();
    assert_eq!((&more["ent_coef"], &more["activation"]), (&Value::from(0.3), &Value::from("crelu")));
    let plain = resolve("ppo", &[]).expect("valid settings");
    let with = plain.with_sets(&["mitigations=[entropy-bonus]".to_owned()]).expect("valid settings");
    assert_eq!(with.to_json()["ent_coef"], 0.1);

    // What a listed method brought does not stay unseen when it is listed no more.
    let error = with.with_sets(&["mitigations=[]".to_owned()]).expect_err("a refusal").to_string();
    assert!(error.contains("entropy-bonus brought ent_coef, and is listed no more: set ent_coef, too"), "{error}");
    let without = with.with_sets(&["mitigations=[]", "ent_coef=0.01"].map(str::to_owned)).expect("valid settings");
    assert_eq!(without, plain);

    let refused = |algo, sets: &[&str]| resolve(algo, sets).expect_err("a refusal").to_string();
    let error = refused("ppo", &["mitigations=[equal-betas]", "adam_beta1=0.9"]);
    assert!(error.contains("adam_beta1=0.9 and adam_beta2=0.99 differ"), "{error}");
    let error = refused("ppo", &["mitigations=[redo, continual-backprop]"]);
    assert!(error.contains("redo and continual-backprop cannot replace units at once"), "{error}");
    let error = refused("dqn", &["mitigations=[self-normalised-resets]", "self_normalised_resets_threshold=101"]);
    assert!(error.contains("self_normalised_resets_longest=100"), "{error}");
    let error = refused("dqn", &["mitigations=[entropy-bonus]"]);
    assert!(error.contains("mitigation entropy-bonus") && error.contains("it is one of ppo"), "{error}");
    let error = refused("ppo", &["mitigations=[crelu]", "activation=tanh"]);
    assert!(error.contains("crelu is activation=crelu, and cannot be listed with activation=\"tanh\""), "{error}");
    let error = refused("ppo", &["mitigations=[adamw]", "l2=adam"]);
    assert!(error.contains("adamw is l2=adamw"), "{error}");
    let error = refused("dqn", &["mitigations=[redo-saturation]"]);
    assert!(error.contains("use redo there"), "{error}");
    let error = refused("ppo", &["mitigations=[self-normalised-resets]"]);
    assert!(error.contains("activation=relu"), "{error}");
}

/// Two stages of one seed; the second one is stopped and resumed after so many rows, if any.
fn train(config: &Config, stop: Option<usize>) -> Snapshot {
    let stage = |index| Stage { index, level: level(), timesteps: 5000, horizon: 5000 };
    let mut learner = agent::learner(config, &stage(0), vec![config.agent(&level(), 1)], crate::KIND());
    learner.advance();
    let agents = learner.agents().into_iter().cloned().collect();
    let mut learner = agent::learner(config, &stage(1), agents, crate::KIND());
    for row in 0..2 {
        if stop == Some(row) {
            let snapshot = learner.snapshot(0);
            learner = agent::resume(config, &stage(1), vec![snapshot], crate::KIND()).expect("its own snapshot");
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
            "a list of different names, such as [l2-init], out of l2-init, shrink-perturb, reset, head-rescale, adam-reset, adam-rel, fire"
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
