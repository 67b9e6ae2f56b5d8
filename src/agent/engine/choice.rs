//! Which engine computes, and on what.

use std::fmt;
use std::str::FromStr;
use std::sync::OnceLock;

use super::contract::{Engine, Parts};
use crate::config::Choice;

/// The setting `engine`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum EngineChoice {
    /// `fused` on a CPU, `libtorch` elsewhere.
    Auto,
    /// Gradients derived by hand, on the CPU.
    Fused,
    /// libtorch, which differentiates by itself, the seeds side by side in one tensor.
    Libtorch,
}

impl Choice for EngineChoice {
    const ALL: &'static [(&'static str, Self)] =
        &[("auto", Self::Auto), ("fused", Self::Fused), ("libtorch", Self::Libtorch)];
}

/// Where networks are computed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Device {
    /// The processor.
    Cpu,
    /// A GPU of NVIDIA's with this number.
    Cuda(usize),
}

impl FromStr for Device {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let index = match text.split_once(':') {
            None if text == "cpu" => return Ok(Self::Cpu),
            None if text == "cuda" => Some(0),
            Some(("cuda", index)) => index.parse().ok(),
            _ => None,
        };
        index.map(Self::Cuda).ok_or_else(|| format!("expected cpu, cuda or cuda:N, got {text:?}"))
    }
}

impl fmt::Display for Device {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Cpu => write!(f, "cpu"),
            Self::Cuda(index) => write!(f, "cuda:{index}"),
        }
    }
}

/// The engine that computes a run, and its device.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum EngineKind {
    /// Gradients derived by hand, on one core of the CPU.
    Fused,
    /// libtorch, which differentiates by itself, on this device.
    Libtorch(Device),
}

impl EngineKind {
    /// What the setting means on `device`.
    ///
    /// # Errors
    /// Where the engine does not know the device, or is not there.
    pub fn choose(choice: EngineChoice, device: Device) -> Result<Self, NoEngine> {
        match (choice, device) {
            (EngineChoice::Auto | EngineChoice::Fused, Device::Cpu) => return Ok(Self::Fused),
            (EngineChoice::Fused, _) => {
                let problem = "engine=fused runs on the CPU only: drop --device or engine=fused";
                return Err(NoEngine::Unfit(problem.to_owned()));
            }
            (EngineChoice::Auto | EngineChoice::Libtorch, _) => {}
        }
        let Some(libtorch) = libtorch() else {
            let wanted = if choice == EngineChoice::Libtorch {
                "engine=libtorch".to_owned()
            } else {
                format!("--device {device}")
            };
            return Err(NoEngine::NotLinked(format!(
                "{wanted} needs the program cpp-rl-libtorch beside this one: build it with `CPP_RL_LIBTORCH=1 \
                 ./scripts/cpp-rl`, or with `scripts/libtorch` and `cargo build --release -p torch-engine` \
                 (docs/install.md)"
            )));
        };
        libtorch.check(device).map_err(NoEngine::Unfit)?;
        Ok(Self::Libtorch(device))
    }

    /// The device that manifests record.
    pub fn device(self) -> Device {
        match self {
            Self::Fused => Device::Cpu,
            Self::Libtorch(device) => device,
        }
    }

    /// Whether seeds share one computation: then they train side by side, and differ by rounding from seeds that do not.
    pub fn joins_seeds(self) -> bool {
        matches!(self, Self::Libtorch(_))
    }
}

/// Why there is no engine for what was asked.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum NoEngine {
    /// The engine and the device do not fit.
    #[error("{0}")]
    Unfit(String),
    /// It needs libtorch, which this program does not have.
    #[error("{0}")]
    NotLinked(String),
}

/// What the crate that links libtorch offers to the program.
pub trait Libtorch: Sync {
    /// The version of libtorch.
    fn version(&self) -> &'static str;
    /// Refuses a device that is not there.
    ///
    /// # Errors
    /// In words, with the remedy.
    fn check(&self, device: Device) -> Result<(), String>;
    /// Makes the engine.
    fn engine(&self, parts: Parts, device: Device) -> Box<dyn Engine>;
}

/// Set once, before anything else, by a program that links libtorch.
static LIBTORCH: OnceLock<&'static dyn Libtorch> = OnceLock::new();

/// Makes `engine=libtorch` known to this process.
pub fn install(libtorch: &'static dyn Libtorch) {
    // A second one would be the same: there is one crate that links libtorch.
    let _ = LIBTORCH.set(libtorch);
}

/// What was installed.
pub fn libtorch() -> Option<&'static dyn Libtorch> {
    LIBTORCH.get().copied()
}
