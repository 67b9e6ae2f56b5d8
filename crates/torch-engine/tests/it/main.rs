//! libtorch's engine against Stable-Baselines3's records, and the fused engine against libtorch's.

mod engines;
#[allow(dead_code, reason = "cpp-rl's tests use the rest")]
#[path = "../../../../tests/it/fixtures.rs"]
mod fixtures;
#[path = "../../../../tests/it/mitigations.rs"]
mod mitigations;
#[allow(dead_code, reason = "cpp-rl's tests use the rest")]
#[path = "../../../../tests/it/numbers.rs"]
mod numbers;
#[path = "../../../../tests/it/sb3_dqn.rs"]
mod sb3_dqn;
#[path = "../../../../tests/it/sb3_ppo.rs"]
mod sb3_ppo;

use cpp_rl::agent::engine::{self, Device, Engine, EngineKind, Parts};
use torch_engine::TorchEngine;

/// The repository.
const ROOT: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../..");
/// The engines that recorded updates are followed with; the tests of cpp-rl have the fused one here.
const ENGINES: [fn(Parts) -> Box<dyn Engine>; 1] = [|parts| Box::new(TorchEngine::new(parts, Device::Cpu))];
/// The engine that agents are trained with; the tests of cpp-rl have the fused one here.
const KIND: fn() -> EngineKind = || {
    engine::install(&torch_engine::LIBTORCH);
    EngineKind::Libtorch(Device::Cpu)
};
