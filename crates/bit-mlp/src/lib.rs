//! Small multilayer perceptrons on binary inputs: forward, backward and Adam on one CPU core.
//!
//! The observation of the coverage grid world is a vector of bits of which few are set, and most of
//! those never change while the map stays the same. A general tensor library multiplies the zeros
//! anyway, and spends more time between its kernels than in them when a minibatch is 64 samples.
//! Here the first layer is a sum of rows of its weight, every buffer is allocated once, and the
//! whole gradient step of a network of 42,000 parameters takes some tens of microseconds.
//!
//! # Parameters
//! The parameters of all networks of one agent lie in **one flat slice** of `f32` that the caller
//! owns; an [`Mlp`] says where its own are. Layer by layer: weight `[inputs, width]` row-major, so
//! that the weights leaving one input are contiguous, then bias `[width]` ([`Block`]). Gradients and
//! Adam's moments are flat slices of the same length.
//!
//! # A gradient step
//! ```
//! use bit_mlp::{Activation, AdamConfig, BitBatch, Decayed, Mlp, Moments, Workspace, clip_and_adam};
//!
//! let policy = Mlp::new(&[256, 64, 64, 4], Activation::Tanh, 0);
//! let mut params = vec![0.01; policy.num_parameters()];
//! let mut grads = vec![0.0; params.len()];
//! let (mut exp_avg, mut exp_avg_sq) = (vec![0.0; params.len()], vec![0.0; params.len()]);
//!
//! let mut batch = BitBatch::default();
//! batch.set_constant(&[0, 1, 2]); // the map, the same for every sample
//! batch.push_sample(&[70, 200]); // the agent and the visited cells
//! batch.push_sample(&[71, 200, 201]);
//!
//! let mut workspace = Workspace::default();
//! let outputs = policy.forward(&params, batch.all(), &mut workspace); // [2, 4]
//! let d_outputs: Vec<f32> = outputs.iter().map(|logit| 2.0 * logit).collect(); // of the loss Σ logit²
//! policy.backward(&params, batch.all(), &d_outputs, &mut workspace, &mut grads);
//!
//! let moments = Moments { exp_avg: &mut exp_avg, exp_avg_sq: &mut exp_avg_sq, step: 1 };
//! let norm = clip_and_adam(&mut params, &grads, moments, 0.5, Decayed::All, &AdamConfig::default());
//! assert!(norm.is_finite());
//! ```
//!
//! # Numbers
//! Everything is `f32`, and tanh is accurate to 3 units in the last place. The instruction set is
//! found at run time (AVX-512, AVX2 with FMA, NEON, or plain code), so one binary serves all
//! machines; on one machine results depend on the inputs alone, bit for bit. Between instruction
//! sets they differ by rounding.

// The kernels are written against `pulp::Simd`, and every function that takes a `simd` is
// `#[inline(always)]`: what is not inlined into its `dispatch` is compiled for the oldest
// processor. That goes for closures too, so there are none.

mod activation;
mod adam;
mod backward;
mod batch;
mod block;
mod buffer;
mod first_layer;
mod forward;
mod matmul;
mod mlp;
mod norm;
mod pull;
mod workspace;

pub use activation::tanh_in_place;
pub use adam::{AdamConfig, Decay, Decayed, Moments, clip_and_adam};
pub use batch::{Batch, BitBatch};
pub use block::{Activation, Block, Norm, Place, Shape};
pub use forward::Prepared;
pub use mlp::Mlp;
pub use pull::{GradientNorms, Pull, gradient_norms};
pub use workspace::{Activations, Workspace};

/// The instruction set that the kernels use on this machine: `avx512`, `avx2`, `neon` or `plain`.
pub fn instruction_set() -> &'static str {
    match pulp::Arch::new() {
        #[cfg(any(target_arch = "x86", target_arch = "x86_64"))]
        pulp::Arch::V4(_) => "avx512",
        #[cfg(any(target_arch = "x86", target_arch = "x86_64"))]
        pulp::Arch::V3(_) => "avx2",
        #[cfg(target_arch = "aarch64")]
        pulp::Arch::Neon(_) => "neon",
        _ => "plain",
    }
}
