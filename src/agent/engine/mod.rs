//! The only arithmetic that an algorithm or a mitigation sees.
//!
//! An [`Engine`] holds the weights and the optimiser state of S agents. It makes forward passes, descends a [`Loss`], and
//! lets a mitigation edit an agent. There are two: `fused`, here, with gradients derived by hand on one core of a CPU; and
//! `libtorch`, in a crate of its own, which states each loss a second time and leaves the derivative to autograd.

mod choice;
mod contract;
mod fused;
mod loss;

pub use choice::{Device, EngineChoice, EngineKind, Libtorch, NoEngine, install, libtorch};
pub use contract::{Engine, Entry, GradientNorms, LayerUnits, Parts, Penalty, Pull, Toward, Units};
pub use fused::FusedEngine;
pub use loss::{Column, Loss, Pass, Statement, Weights};

/// Makes the engine of this kind.
///
/// # Panics
/// For `libtorch` where it is not [installed](install); [`EngineKind::choose`] refuses that before.
pub fn new(kind: EngineKind, parts: Parts) -> Box<dyn Engine> {
    match kind {
        EngineKind::Fused => Box::new(FusedEngine::new(parts)),
        EngineKind::Libtorch(device) => {
            libtorch().expect("libtorch is installed where it is chosen").engine(parts, device)
        }
    }
}
