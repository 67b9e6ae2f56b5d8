//! The reference engine: S agents as one `[S, P]` tensor, differentiated by libtorch.
//!
//! It is independent of the fused engine where errors hide: losses are stated a second time ([`losses`]) and autograd
//! derives them; layers, clipping and Adam are libtorch's or written out once more. It is also the GPU's engine. This crate
//! alone links libtorch: cpp-rl does not know it, and gets it from the program `cpp-rl-libtorch`.

mod dense;
mod engine;
pub mod losses;
mod towers;

use cpp_rl::agent::engine::{Device, Engine, Libtorch, Parts};

pub use engine::TorchEngine;

/// What `cpp-rl-libtorch` installs.
pub static LIBTORCH: LinkedLibtorch = LinkedLibtorch;

/// The libtorch that this crate was built against.
pub struct LinkedLibtorch;

impl Libtorch for LinkedLibtorch {
    fn version(&self) -> &'static str {
        env!("TORCH_ENGINE_LIBTORCH")
    }

    fn check(&self, device: Device) -> Result<(), String> {
        let Device::Cuda(index) = device else { return Ok(()) };
        let count = usize::try_from(tch::Cuda::device_count()).unwrap_or(0);
        if index < count {
            return Ok(());
        }
        Err(format!(
            "--device {device}: libtorch sees {count} CUDA devices; build against a CUDA libtorch by setting LIBTORCH to \
             it (see docs/install.md)"
        ))
    }

    fn engine(&self, parts: Parts, device: Device) -> Box<dyn Engine> {
        // The seeds of a study share the cores; libtorch's own threads would only be in one another's way.
        tch::set_num_threads(1);
        Box::new(TorchEngine::new(parts, device))
    }
}

/// The device as libtorch names it.
fn torch_device(device: Device) -> tch::Device {
    match device {
        Device::Cpu => tch::Device::Cpu,
        Device::Cuda(index) => tch::Device::Cuda(index),
    }
}
