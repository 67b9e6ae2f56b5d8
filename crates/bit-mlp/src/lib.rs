//! Small multilayer perceptrons on binary inputs: forward, backward and Adam on one CPU core.
//!
//! The inputs are bits. Few of them are set, and most of those are the same in every sample: the
//! map, where the inputs describe a grid. A general tensor library multiplies the zeros as well.
//! With a minibatch of 64 samples it also spends most of its time between its operations. Here the
//! first layer is a sum of rows of its weight, and every buffer is allocated once. The whole
//! gradient step of a network of 42,000 parameters takes some tens of microseconds.
//!
//! # Parameters
//! The caller owns the parameters: **one flat slice** of `f32` for all networks of one agent. An
//! [`Mlp`] says where its own lie, one [`Block`] per layer. A block has a weight `[inputs, width]`,
//! row-major, so that the weights leaving one input are contiguous. Its bias `[width]` follows, and
//! with layer normalisation a scale `[width]` and a shift `[width]`. Gradients and Adam's moments
//! are flat slices of the same length.
//!
//! # Networks
//! A [`Shape`] says what a network looks like: its sizes, its [`Activation`] (tanh, ReLU, CReLU or
//! Fourier features), and whether hidden layers are normalised. It counts the parameters before
//! anything is made. [`Workspace::activations`] shows what left each layer in the last forward pass.
//! A [`Pull`] adds a penalty towards zeros or an anchor to the gradient.
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
//! Everything is `f32`; tanh, sin and cos are accurate to 3 units in the last place. The instruction
//! set is found at run time (AVX-512, AVX2 with FMA, NEON, or plain code), so one binary serves all
//! machines; on one machine results depend on the inputs alone, bit for bit. Between instruction
//! sets they differ by rounding.

// The inner loops are written against `pulp::Simd`, and every function that takes a `simd` is
// `#[inline(always)]`: what is not inlined into its `dispatch` is compiled for the oldest
// processor. That goes for closures too, so these functions have none.

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
mod packed;
mod pull;
mod vectors;
mod workspace;

pub use activation::tanh_in_place;
pub use adam::{AdamConfig, Decay, Decayed, Moments, clip_and_adam};
pub use batch::{Batch, BitBatch};
pub use block::{Activation, Block, Norm, Place, Shape};
pub use forward::Prepared;
pub use mlp::Mlp;
pub use pull::{GradientNorms, Pull, gradient_norms};
pub use vectors::{add, add_outer, norm, there_and_back};
pub use workspace::{Activations, Workspace};

/// The instruction set used on this machine: `avx512`, `avx2`, `neon` or `plain`.
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
