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

/// The layers of one tower for all seeds.
pub struct TowerViews {
    layers: Vec<LayerViews>,
    activation: Activation,
}

/// One layer for all seeds.
struct LayerViews {
    /// `[S, in, out]`.
    weight: Tensor,
    /// `[S, 1, out]`.
    bias: Tensor,
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

    /// The layers of every tower as views into `parameters`, `[S, P]`.
    pub fn towers(&self, parameters: &Tensor) -> Vec<TowerViews> {
        TowerViews::all(&self.network, parameters)
    }

    /// Outputs `[S, B, out]` of a tower on `inputs` `[S, B, in]`.
    pub fn forward(&self, tower: &TowerViews, inputs: &Tensor) -> Tensor {
        let Some(outputs) = tower.activations(inputs).pop() else { unreachable!("a tower has an output layer") };
        outputs
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
        let correction = |beta: f64| 1.0 - beta.powf(self.step as f64);
        if o.l2 == L2::AdamW {
            // PyTorch multiplies by the factor rounded to f32, in which 1 − 10⁻⁸ is 1.
            let _ = self.parameters.g_mul_(&(&self.covered * f64::from(o.decoupled_factor() - 1.0) + 1.0));
        }
        let _ = self.exp_avg.lerp_(&gradient, 1.0 - beta1);
        let _ = self.exp_avg_sq.g_mul_scalar_(beta2).addcmul_(&gradient, &(&gradient * (1.0 - beta2)));
        let denominator = self.exp_avg_sq.sqrt() / correction(beta2).sqrt() + o.adam_eps;
        let step = &self.exp_avg * (-o.learning_rate / correction(beta1));
        let _ = self.parameters.addcdiv_(&step, &denominator);
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
        dense(self.network.num_inputs(), batches).to_device(self.device)
    }
}

impl TowerViews {
    /// The towers of `network` as views into `parameters`, `[S, P]`.
    ///
    /// One split for all of them: its gradient is one concatenation, where a slice each would give a full `[S, P]`
    /// tensor each.
    pub fn all(network: &Network, parameters: &Tensor) -> Vec<Self> {
        let places = network.tensors();
        let sizes: Vec<i64> = places.iter().map(|place| place.range.len() as i64).collect();
        let mut parts = parameters.split_with_sizes(sizes, 1).into_iter();
        let mut view = |inputs: i64, outputs: usize| {
            let Some(part) = parts.next() else { unreachable!("there are as many parts as tensors") };
            part.view([-1, inputs, outputs as i64])
        };
        let mut layer = |layer: bit_mlp::Layer| LayerViews {
            weight: view(layer.inputs as i64, layer.outputs),
            bias: view(1, layer.outputs),
        };
        let activation = network.activation();
        let tower = |tower: &Tower| Self { layers: tower.mlp.layers().map(&mut layer).collect(), activation };
        network.towers().iter().map(tower).collect()
    }

    /// What leaves each layer on `inputs` `[S, B, in]`, `[S, B, out]` each: activated in all but the last.
    pub fn activations(&self, inputs: &Tensor) -> Vec<Tensor> {
        let mut activations: Vec<Tensor> = Vec::with_capacity(self.layers.len());
        for (i, layer) in self.layers.iter().enumerate() {
            let sums = layer.bias.baddbmm(activations.last().unwrap_or(inputs), &layer.weight, 1.0, 1.0);
            activations.push(match self.activation {
                _ if i + 1 == self.layers.len() => sums,
                Activation::Tanh => sums.tanh(),
                Activation::Relu => sums.relu(),
            });
        }
        activations
    }
}

/// Binary samples as floats `[S, B, inputs]`; rows with fewer samples than others are padded with zeros.
pub fn dense(inputs: usize, batches: &[Batch<'_>]) -> Tensor {
    let samples = batches.iter().map(Batch::len).max().unwrap_or(0);
    let mut floats = vec![0.0f32; batches.len() * samples * inputs];
    for (s, batch) in batches.iter().enumerate() {
        for b in 0..batch.len() {
            let out = &mut floats[(s * samples + b) * inputs..][..inputs];
            batch.constant().iter().chain(batch.sample(b)).for_each(|&i| out[usize::from(i)] = 1.0);
        }
    }
    Tensor::from_slice(&floats).view([batches.len() as i64, samples as i64, inputs as i64])
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
