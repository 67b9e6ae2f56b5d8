//! What Stable-Baselines3 computed, as `tests/fixtures/sb3` holds it.

use std::path::PathBuf;
use std::sync::Arc;

use bit_mlp::BitBatch;
use coverage_env::Level;
use cpp_rl::agent::config::{self, Config};
use cpp_rl::agent::engine::Parts;
use cpp_rl::agent::mitigation::{L2, L2Penalty};
use cpp_rl::agent::network::Network;
use cpp_rl::agent::state::{AdamState, AgentState, Counters, Kept};
use cpp_rl::run::checkpoint::Checkpoint;
use safetensors::SafeTensors;
use serde_json::Value;

use crate::numbers::assert_close;

/// Recorded updates of a case.
pub const UPDATES: usize = 10;

/// A file of the fixtures.
pub fn path(name: &str) -> PathBuf {
    [crate::ROOT, "tests/fixtures/sb3", name].iter().collect()
}

/// The JSON file of a fixture.
pub fn json(name: &str) -> Value {
    let text = std::fs::read_to_string(path(&format!("{name}.json"))).expect("the fixture is there");
    serde_json::from_str(&text).expect("the fixture is JSON")
}

/// The tensors of a fixture.
pub struct Tensors(Vec<u8>);

impl Tensors {
    /// Those of `<name>.safetensors`.
    pub fn read(name: &str) -> Self {
        Self(std::fs::read(path(&format!("{name}.safetensors"))).expect("the fixture is there"))
    }

    /// The bytes of a tensor.
    pub fn bytes(&self, name: &str) -> Vec<u8> {
        self.find(name).unwrap_or_else(|| panic!("tensor {name} is in the fixture"))
    }

    fn find(&self, name: &str) -> Option<Vec<u8>> {
        let tensors = SafeTensors::deserialize(&self.0).expect("the fixture is a safetensors file");
        tensors.tensor(name).ok().map(|tensor| tensor.data().to_vec())
    }

    /// A tensor of F32.
    pub fn floats(&self, name: &str) -> Vec<f32> {
        self.bytes(name).as_chunks().0.iter().map(|&b| f32::from_le_bytes(b)).collect()
    }

    /// A tensor of I32 that holds no negative number.
    pub fn indices(&self, name: &str) -> Vec<u32> {
        self.bytes(name).as_chunks().0.iter().map(|&b| u32::from_le_bytes(b)).collect()
    }

    /// A tensor of U8 that holds flags.
    pub fn flags(&self, name: &str) -> Vec<bool> {
        self.bytes(name).iter().map(|&b| b != 0).collect()
    }

    /// `<prefix>/NAME` for every NAME of the network, in the order of its flat slice; nothing where there is none.
    pub fn flat(&self, prefix: &str, network: &Network) -> Option<Vec<f32>> {
        let tensors = network.tensors();
        self.find(&format!("{prefix}/{}", tensors[0].name))?;
        Some(tensors.iter().flat_map(|tensor| self.floats(&format!("{prefix}/{}", tensor.name))).collect())
    }
}

/// Ten recorded updates of one learner.
pub struct Case {
    /// Hyper-parameters, and the loss terms of each update.
    pub json: Value,
    /// Batches, weights, gradients and moments.
    pub tensors: Tensors,
    /// The map.
    pub level: Arc<Level>,
    /// The hyper-parameters as our settings.
    pub config: Config,
    /// The network.
    pub network: Network,
    /// The agent before update 1.
    pub agent: AgentState,
}

impl Case {
    /// Reads `<name>.json` and `<name>.safetensors`.
    pub fn read(name: &str) -> Self {
        let (json, tensors) = (json(name), Tensors::read(name));
        let rows: Vec<&str> = json["map"].as_array().expect("a map").iter().filter_map(Value::as_str).collect();
        let level = Arc::new(Level::from_map("map", &rows.join("\n")).expect("a valid map"));
        let config = settings(&json);
        let network = config.network(&level);
        let agent = match json["starts_from"].as_str() {
            Some(checkpoint) => Checkpoint::read(&path(checkpoint)).expect("a checkpoint of ours").agent,
            None => {
                let parameters = tensors.flat("initial", &network).expect("initial weights");
                let adam = AdamState::new(parameters.len());
                let target = tensors.flat("initial/target", &network);
                let copies = target.into_iter().map(|target| ("target".to_owned(), target)).collect();
                let kept = Kept { copies, ..Kept::default() };
                AgentState { seed: 0, parameters, adam, kept, counters: Counters::default() }
            }
        };
        assert_eq!(json["adam_step"].as_u64(), Some(agent.adam.step));
        Self { json, tensors, level, config, network, agent }
    }

    /// What an engine is made of, with the agent before update 1.
    pub fn parts(&self) -> Parts {
        self.config.parts(&self.level, vec![self.agent.clone()])
    }

    /// A recorded loss term of update `update`, from 0.
    pub fn term(&self, update: usize, name: &str) -> f32 {
        self.json["updates"][update][name].as_f64().expect("a loss term") as f32
    }

    /// Samples `[B, 4, H, W]` of the map, as a batch.
    pub fn batch(&self, observations: &[u8]) -> BitBatch {
        let constant = self.config.shared.sensor.constant_inputs(&self.level);
        let mut batch = BitBatch::default();
        batch.set_constant(&constant);
        for observation in observations.chunks_exact(self.network.num_inputs()) {
            let active = (0..).zip(observation).filter(|(input, bit)| **bit == 1 && !constant.contains(input));
            batch.push_sample(&active.map(|(input, _)| input).collect::<Vec<u16>>());
            // What is not listed as active must be what every observation of the level has.
            assert!(constant.iter().all(|&input| observation[usize::from(input)] == 1));
        }
        batch
    }

    /// Compares an agent after update `update`, from 1, with everything that was recorded of it.
    pub fn check(&self, update: usize, agent: &AgentState) {
        assert_eq!(agent.adam.step, self.agent.adam.step + update as u64);
        if update == 1 {
            self.compare("clipped", &self.clipped_gradient(agent));
            self.compare("after_1", &agent.parameters);
        }
        if update == UPDATES {
            self.compare("after_10", &agent.parameters);
            self.compare("exp_avg", &agent.adam.exp_avg);
            self.compare("exp_avg_sq", &agent.adam.exp_avg_sq);
        }
    }

    /// The clipped gradient of update 1, from Adam's first moment: m = (1 − β₁)·(g + λθ), λ being coupled decay's.
    fn clipped_gradient(&self, after: &AgentState) -> Vec<f32> {
        let penalty = self.config.mitigations.find::<L2Penalty>().expect("always there");
        let coupled = if penalty.kind == L2::Adam { penalty.coefficient as f32 } else { 0.0 };
        let moments = after.adam.exp_avg.iter().zip(&self.agent.parameters);
        moments.map(|(m, theta)| m / 0.1 - coupled * theta).collect()
    }

    /// Compares each tensor of a flat slice with the recorded one, where there is a record.
    ///
    /// Tensor by tensor, so that a small one does not hide behind a large one, and all to 1e-5, some hundred roundings
    /// to 24 bits. For parameters that is stricter than it looks: Adam's step is about ±1e-4 however small a gradient
    /// is, so that an entry with the wrong sign, or a missing one, shows.
    fn compare(&self, prefix: &str, actual: &[f32]) {
        let Some(expected) = self.tensors.flat(prefix, &self.network) else {
            assert!(self.json["starts_from"].is_string(), "only the study's cases leave {prefix} out");
            return;
        };
        for tensor in self.network.tensors() {
            let what = format!("{prefix}/{}", tensor.name);
            assert_close(&what, &actual[tensor.range.clone()], &expected[tensor.range], 1e-5);
        }
    }
}

/// The settings that mean what the fixture's hyper-parameters do.
fn settings(json: &Value) -> Config {
    let algorithm = json["algorithm"].as_str().expect("an algorithm");
    let optimizer = &json["optimizer"];
    let mut sets = vec![
        format!("adam_beta1={}", optimizer["betas"][0]),
        format!("adam_beta2={}", optimizer["betas"][1]),
        format!("adam_eps={}", optimizer["eps"]),
        format!("max_steps={}", json["max_steps"]),
    ];
    if json["starts_from"].is_null() {
        sets.push("hidden=[16, 12]".to_owned());
    }
    let decay = &optimizer["weight_decay"];
    if decay.as_f64() != Some(0.0) {
        let l2 = if optimizer["class"] == "AdamW" { "adamw" } else { "adam" };
        sets.extend([format!("l2={l2}"), format!("l2_coef={decay}")]);
    }
    let arguments = json["arguments"].as_object().expect("arguments");
    sets.extend(arguments.iter().map(|(key, value)| format!("{key}={value}")));
    config::resolve(Some(algorithm), None, &sets, None).expect("our settings have Stable-Baselines3's names")
}
