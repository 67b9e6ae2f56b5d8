//! The reference implementation's common ground: S agents as one `[S, P]` tensor, differentiated by libtorch.
//!
//! The stacked layers are views into the flat tensor, so that clipping and Adam are each one expression over all of it.
//! Gradients never mix: every row depends on its own seed's loss alone.

use bit_mlp::{Activation, Batch, GradientNorms};
use tch::{Device, IndexOp, Kind, Tensor};

use super::network::{Network, Tower};
use super::state::{AdamState, AgentState};
use crate::config::{L2, L2Covers, OptimizerConfig};

/// β₁ and β₂, which no preset changes (Kingma & Ba 2015).
pub const BETAS: (f64, f64) = (0.9, 0.999);
/// What PyTorch's `clip_grad_norm_` adds to the norm.
const CLIP_EPS: f64 = 1e-6;

/// S agents of one architecture with their Adam.
pub struct Stacked {
    network: Network,
    device: Device,
    /// θ, `[S, P]`, a leaf that records gradients.
    parameters: Tensor,
    /// m and v, `[S, P]`.
    exp_avg: Tensor,
    exp_avg_sq: Tensor,
    step: u64,
    optimizer: OptimizerConfig,
    /// 1 where the L2 penalty acts, `[P]`.
    covered: Tensor,
    /// Norms of the last gradient, the L2 penalty left out, `[S]`.
    loss_norms: Vec<f32>,
}

impl Stacked {
    /// Puts agents side by side; they have taken equally many Adam steps.
    pub fn new(network: Network, device: Device, optimizer: OptimizerConfig, states: &[AgentState]) -> Self {
        let rows = |of: fn(&AgentState) -> &[f32]| stack(states.iter().map(of), device);
        let mut covered = vec![0.0f32; network.num_parameters()];
        match optimizer.l2_covers {
            L2Covers::All => covered.fill(1.0),
            L2Covers::Weights => network.weights().into_iter().for_each(|weight| covered[weight].fill(1.0)),
        }
        Self {
            device,
            parameters: rows(|m| &m.parameters).set_requires_grad(true),
            exp_avg: rows(|m| &m.adam.exp_avg),
            exp_avg_sq: rows(|m| &m.adam.exp_avg_sq),
            step: states[0].adam.step,
            covered: Tensor::from_slice(&covered).to_device(device),
            loss_norms: vec![0.0; states.len()],
            network,
            optimizer,
        }
    }

    /// The flat parameters `[S, P]`.
    pub fn parameters(&self) -> &Tensor {
        &self.parameters
    }

    /// Where the tensors live.
    pub fn device(&self) -> Device {
        self.device
    }

    /// The architecture all rows share.
    pub fn network(&self) -> &Network {
        &self.network
    }

    /// Outputs `[S, B, out]` of a tower with `parameters` `[S, P]` on `inputs` `[S, B, in]`.
    pub fn forward(&self, parameters: &Tensor, tower: &Tower, inputs: &Tensor) -> Tensor {
        let seeds = parameters.size()[0];
        let last = tower.sizes.len() - 2;
        let mut hidden = inputs.shallow_clone();
        for (i, layer) in tower.mlp.layers().enumerate() {
            let view = |range: std::ops::Range<usize>, shape: [i64; 3]| {
                parameters.narrow(1, range.start as i64, range.len() as i64).view(shape)
            };
            let weight = view(layer.weight, [seeds, layer.inputs as i64, layer.outputs as i64]);
            let bias = view(layer.bias, [seeds, 1, layer.outputs as i64]);
            hidden = bias.baddbmm(&hidden, &weight, 1.0, 1.0);
            if i < last {
                hidden = match self.network.activation() {
                    Activation::Tanh => hidden.tanh(),
                    Activation::Relu => hidden.relu(),
                };
            }
        }
        hidden
    }

    /// One step of clipped Adam down the gradient of each seed's `loss`, `[S]`.
    ///
    /// Returns the norms of the gradients before clipping, `[S]`.
    /// As PyTorch's `clip_grad_norm_` followed by `Adam` or `AdamW`: see [`L2`] for where a penalty enters.
    pub fn descend(&mut self, loss: &Tensor) -> Vec<f32> {
        let gradients = Tensor::run_backward(&[loss.sum(Kind::Float)], &[&self.parameters], false, false);
        let _guard = tch::no_grad_guard();
        let o = &self.optimizer;
        let theta = self.parameters.detach();
        let mut gradient = gradients[0].shallow_clone();
        self.loss_norms = to_vec(&norms(&gradient));
        if o.l2 == L2::Loss {
            gradient += o.l2_coef * &theta * &self.covered;
        }
        let norm = norms(&gradient);
        let scale: Tensor = o.max_grad_norm * (&norm + CLIP_EPS).reciprocal();
        gradient *= scale.clamp_max(1.0);
        if o.l2 == L2::Adam {
            gradient += o.l2_coef * &theta * &self.covered;
        }

        self.step += 1;
        let (beta1, beta2) = BETAS;
        self.exp_avg = &self.exp_avg * beta1 + &gradient * (1.0 - beta1);
        self.exp_avg_sq = &self.exp_avg_sq * beta2 + gradient.square() * (1.0 - beta2);
        let correction = |beta: f64| 1.0 - beta.powf(self.step as f64);
        let denominator = self.exp_avg_sq.sqrt() / correction(beta2).sqrt() + o.adam_eps;
        let mut next = theta;
        if o.l2 == L2::AdamW {
            // PyTorch multiplies by the factor rounded to f32, in which 1 − 10⁻⁸ is 1.
            let factor = o.decoupled_factor();
            next = &next * (&self.covered * f64::from(factor - 1.0) + 1.0);
        }
        let step = (o.learning_rate / correction(beta1)) * &self.exp_avg / denominator;
        self.parameters = (next - step).set_requires_grad(true);
        to_vec(&norm)
    }

    /// Norms of the last gradient of row `seed`, the loss's and the L2 penalty's.
    pub fn norms(&self, seed: usize) -> GradientNorms {
        let penalty = self.optimizer.l2_coef * (self.parameters.detach().get(seed as i64) * &self.covered).norm();
        GradientNorms { loss: self.loss_norms[seed], penalty: to_vec(&penalty)[0] }
    }

    /// Writes the weights and optimiser state of row `seed` into `state`.
    pub fn save(&self, seed: usize, state: &mut AgentState) {
        let row = |tensor: &Tensor| to_vec(&tensor.i(seed as i64).detach());
        state.parameters = row(&self.parameters);
        state.adam = AdamState { exp_avg: row(&self.exp_avg), exp_avg_sq: row(&self.exp_avg_sq), step: self.step };
    }

    /// Inputs as floats `[S, B, in]`; seeds with fewer samples than others are padded with zeros.
    pub fn dense(&self, batches: &[Batch<'_>]) -> Tensor {
        let inputs = self.network.num_inputs();
        let samples = batches.iter().map(Batch::len).max().unwrap_or(0);
        let mut floats = vec![0.0f32; batches.len() * samples * inputs];
        for (s, batch) in batches.iter().enumerate() {
            for b in 0..batch.len() {
                let out = &mut floats[(s * samples + b) * inputs..][..inputs];
                batch.constant().iter().chain(batch.sample(b)).for_each(|&i| out[usize::from(i)] = 1.0);
            }
        }
        let shape = [batches.len() as i64, samples as i64, inputs as i64];
        Tensor::from_slice(&floats).view(shape).to_device(self.device)
    }
}

/// The Euclidean norm of each row, `[S, 1]`.
fn norms(rows: &Tensor) -> Tensor {
    rows.norm_scalaropt_dim(2, 1, true)
}

/// Equally long rows as one `[S, n]` tensor.
pub fn stack<'a, T: tch::kind::Element + Copy + 'a>(rows: impl Iterator<Item = &'a [T]>, device: Device) -> Tensor {
    let rows: Vec<&[T]> = rows.collect();
    Tensor::from_slice(&rows.concat()).view([rows.len() as i64, -1]).to_device(device)
}

/// All values in row-major order.
pub fn to_vec(tensor: &Tensor) -> Vec<f32> {
    let flat = tensor.to_device(Device::Cpu).contiguous();
    let mut values = vec![0.0; flat.numel()];
    flat.copy_data(&mut values, flat.numel());
    values
}
