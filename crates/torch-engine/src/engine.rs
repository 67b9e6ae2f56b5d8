//! The engine: parameters, Adam and clipping of S agents at once.
//!
//! The layers are views into the flat tensor, so that clipping and Adam are each one expression over all of it. Gradients
//! never mix: every row depends on its own seed's loss alone.

use std::collections::BTreeMap;
use std::sync::Arc;

use bit_mlp::{Batch, BitBatch, Block};
use cpp_rl::agent::engine::{
    Device, Engine, Entry, GradientNorms, LayerUnits, Loss, Parts, Pass, Penalty, Pull, Statement, Toward, Units,
    Weights,
};
use cpp_rl::agent::network::{Network, Tower};
use cpp_rl::agent::optimizer::OptimizerConfig;
use cpp_rl::agent::state::{AdamState, AgentState};
use tch::{IndexOp, Kind, Tensor};

use crate::dense::{dense, stack, to_vec};
use crate::losses;
use crate::towers::TowerViews;

/// What PyTorch's `clip_grad_norm_` adds to the norm.
const CLIP_EPS: f64 = 1e-6;

/// S agents of one architecture with their Adam.
pub struct TorchEngine {
    network: Network,
    device: tch::Device,
    optimizer: OptimizerConfig,
    pull: Option<Pull>,
    penalties: Vec<Arc<dyn Penalty>>,
    /// 1 where the pull acts, `[P]`.
    covered: Tensor,
    /// θ, `[S, P]`, a leaf that records gradients.
    parameters: Tensor,
    /// m and v, `[S, P]`.
    exp_avg: Tensor,
    exp_avg_sq: Tensor,
    step: u64,
    /// Copies of the parameters by name, `[S, P]`.
    copies: BTreeMap<String, Tensor>,
    /// What else the agents keep; their parameters, moments and copies are those of the last edit.
    agents: Vec<AgentState>,
    /// Norms of the last gradient, a pull to 0 left out, `[S]`.
    loss_norms: Vec<f32>,
    /// By tower: the activations of its hidden layers in the last step, `[S, B, K]`.
    hidden: Vec<Vec<Tensor>>,
}

impl TorchEngine {
    /// Puts agents side by side.
    pub fn new(parts: Parts, device: Device) -> Self {
        let Parts { network, optimizer, pull, penalties, agents } = parts;
        let device = crate::torch_device(device);
        let rows = |of: &dyn Fn(&AgentState) -> &[f32]| stack(agents.iter().map(of), device);
        let mut covered = vec![0.0f32; network.num_parameters()];
        match &pull {
            Some(pull) if !pull.covers_all => network.weights().into_iter().for_each(|w| covered[w].fill(1.0)),
            _ => covered.fill(1.0),
        }
        let copy = |name: &String| (name.clone(), rows(&|agent: &AgentState| &agent.kept.copies[name]));
        Self {
            device,
            pull,
            penalties,
            covered: Tensor::from_slice(&covered).to_device(device),
            parameters: rows(&|agent| &agent.parameters).set_requires_grad(true),
            exp_avg: rows(&|agent| &agent.adam.exp_avg),
            exp_avg_sq: rows(&|agent| &agent.adam.exp_avg_sq),
            step: agents[0].adam.step,
            copies: agents[0].kept.copies.keys().map(copy).collect(),
            loss_norms: vec![0.0; agents.len()],
            hidden: network.towers().iter().map(|_| Vec::new()).collect(),
            agents,
            network,
            optimizer,
        }
    }

    /// What leaves each layer of a tower for all seeds, `[S, B, K]` each.
    fn activations(&self, weights: Weights, tower: usize, batches: &[Batch<'_>]) -> Vec<Tensor> {
        let inputs = dense(self.network.num_inputs(), batches).to_device(self.device);
        let of = |parameters: &Tensor| TowerViews::all(&self.network, parameters)[tower].activations(&inputs);
        match weights {
            Weights::Own => of(&self.parameters),
            Weights::Copy(name) => tch::no_grad(|| of(&self.copies[name])),
        }
    }

    /// λ(θ − anchor) of the covered parameters, divided by its norm where the distance is not squared, `[S, P]`.
    fn pull_gradient(&self, pull: &Pull) -> Tensor {
        let theta = self.parameters.detach();
        let away = match pull.toward {
            Toward::Zero(_) => theta * &self.covered,
            Toward::Copy { name, .. } => (theta - &self.copies[name]) * &self.covered,
        };
        match pull.toward {
            // Where there is no distance, there is no gradient.
            Toward::Copy { is_squared: false, .. } => {
                pull.coefficient * &away / norms(&away).clamp_min(f64::from(f32::MIN_POSITIVE))
            }
            _ => pull.coefficient * away,
        }
    }

    /// One step of clipped Adam down the gradient of each seed's `loss`, `[S]`; returns the norms before clipping.
    /// As PyTorch's `clip_grad_norm_` followed by `Adam` or `AdamW`.
    fn step(&mut self, loss: &Tensor) -> Vec<f32> {
        let gradients = Tensor::run_backward(&[loss.sum(Kind::Float)], &[&self.parameters], false, false);
        let _guard = tch::no_grad_guard();
        let mut gradient = gradients[0].shallow_clone();
        let pull = self.pull.clone();
        let toward = |wanted: &dyn Fn(Toward) -> bool| pull.as_ref().filter(|pull| wanted(pull.toward));
        if let Some(pull) = toward(&|toward| matches!(toward, Toward::Copy { .. })) {
            gradient += self.pull_gradient(pull);
        }
        self.penalise(&mut gradient);
        self.loss_norms = to_vec(&norms(&gradient));
        let pulled = |entry| toward(&|toward| toward == Toward::Zero(entry));
        if let Some(pull) = pulled(Entry::InLoss) {
            gradient += self.pull_gradient(pull);
        }
        let o = &self.optimizer;
        let norm = norms(&gradient);
        let scale: Tensor = o.max_grad_norm * (&norm + CLIP_EPS).reciprocal();
        gradient *= scale.clamp_max(1.0);
        if let Some(pull) = pulled(Entry::InAdam) {
            gradient += self.pull_gradient(pull);
        }

        let decoupled = pulled(Entry::Decoupled).map(|pull| pull.coefficient);
        self.step += 1;
        let (beta1, beta2) = (o.adam_beta1, o.adam_beta2);
        let correction = |beta: f64| 1.0 - beta.powf(self.step as f64);
        if let Some(coefficient) = decoupled {
            // PyTorch multiplies by the factor rounded to f32, in which 1 − 10⁻⁸ is 1.
            let factor = (1.0 - o.learning_rate * coefficient) as f32;
            let _ = self.parameters.g_mul_(&(&self.covered * f64::from(factor - 1.0) + 1.0));
        }
        let _ = self.exp_avg.lerp_(&gradient, 1.0 - beta1);
        let _ = self.exp_avg_sq.g_mul_scalar_(beta2).addcmul_(&gradient, &(&gradient * (1.0 - beta2)));
        let denominator = self.exp_avg_sq.sqrt() / correction(beta2).sqrt() + o.adam_eps;
        let step = &self.exp_avg * (-o.learning_rate / correction(beta1));
        let _ = self.parameters.addcdiv_(&step, &denominator);
        to_vec(&norm)
    }

    /// Adds the gradients of penalties to `gradient`, `[S, P]`. They are computed on the CPU.
    fn penalise(&mut self, gradient: &mut Tensor) {
        if self.penalties.is_empty() {
            return;
        }
        for seed in 0..self.agents.len() {
            let mut row = gradient.i(seed as i64);
            let (mut added, mut agent) = (to_vec(&row), self.agent(seed));
            self.penalties.iter().for_each(|penalty| penalty.add_to(&mut added, &mut agent));
            row.copy_(&Tensor::from_slice(&added));
            self.keep(seed, agent);
        }
    }

    /// Takes over what an agent keeps.
    fn keep(&mut self, seed: usize, agent: AgentState) {
        for (name, values) in &agent.kept.copies {
            let copy = self.copies.entry(name.clone()).or_insert_with(|| self.parameters.detach().copy());
            copy.i(seed as i64).copy_(&Tensor::from_slice(values));
        }
        self.agents[seed] = agent;
    }

    /// The agent of row `seed` as it is now.
    fn agent(&self, seed: usize) -> AgentState {
        let row = |tensor: &Tensor| to_vec(&tensor.i(seed as i64));
        let mut agent = self.agents[seed].clone();
        agent.parameters = row(&self.parameters);
        agent.adam = AdamState { exp_avg: row(&self.exp_avg), exp_avg_sq: row(&self.exp_avg_sq), step: self.step };
        agent.kept.copies = self.copies.iter().map(|(name, copy)| (name.clone(), row(copy))).collect();
        agent
    }

    /// The terms and the losses where there is a formula of this name; else the algorithm's own derivative.
    fn loss(&self, outputs: &[Tensor], losses: &mut [&mut dyn Loss<'_>]) -> Tensor {
        let statements: Vec<Statement<'_>> = losses.iter().map(|loss| loss.statement()).collect();
        let Some(formula) = losses::by_name(statements[0].name) else { return derived(outputs, losses, self.device) };
        let stated = formula(outputs, &losses::columns(&statements, self.device), &statements[0].constants);
        let terms = to_vec(&Tensor::stack(&stated.terms, 1));
        for (loss, terms) in losses.iter_mut().zip(terms.chunks_exact(stated.terms.len())) {
            loss.set_terms(terms);
        }
        stated.loss
    }
}

/// A tensor `[S]` whose gradient with respect to `outputs` is what the losses derive themselves.
fn derived(outputs: &[Tensor], losses: &mut [&mut dyn Loss<'_>], device: tch::Device) -> Tensor {
    let values: Vec<Vec<f32>> = outputs.iter().map(to_vec).collect();
    let mut rows: Vec<Vec<f32>> = vec![Vec::new(); outputs.len()];
    let seeds = losses.len();
    for (s, loss) in losses.iter_mut().enumerate() {
        let of_seed = |values: &Vec<f32>| values[s * (values.len() / seeds)..][..values.len() / seeds].to_vec();
        let own: Vec<Vec<f32>> = values.iter().map(of_seed).collect();
        let mut gradients = vec![Vec::new(); outputs.len()];
        loss.derive(&own.iter().map(Vec::as_slice).collect::<Vec<_>>(), &mut gradients);
        for ((all, gradient), own) in rows.iter_mut().zip(gradients).zip(&own) {
            // A pass of other weights has no gradient.
            all.extend(if gradient.is_empty() { vec![0.0; own.len()] } else { gradient });
        }
    }
    let product = |(output, rows): (&Tensor, &Vec<f32>)| {
        let gradient = Tensor::from_slice(rows).view(output.size().as_slice()).to_device(device);
        (output * gradient).flatten(1, -1).sum_dim_intlist(1, false, Kind::Float)
    };
    outputs.iter().zip(&rows).map(product).sum()
}

impl Engine for TorchEngine {
    fn act(&mut self, inputs: &[BitBatch], outputs: &mut [f32]) {
        let _guard = tch::no_grad_guard();
        let batches: Vec<_> = inputs.iter().map(BitBatch::all).collect();
        outputs.copy_from_slice(&to_vec(&last(self.activations(Weights::Own, 0, &batches))));
    }

    fn forward(&mut self, tower: usize, inputs: &[&BitBatch]) -> Vec<Vec<f32>> {
        let _guard = tch::no_grad_guard();
        let batches: Vec<_> = inputs.iter().map(|batch| batch.all()).collect();
        let outputs = last(self.activations(Weights::Own, tower, &batches));
        let of_seed = |(s, batch): (usize, &Batch<'_>)| {
            to_vec(&outputs.i(s as i64).narrow(0, 0, batch.len() as i64)) // the rest is padding
        };
        batches.iter().enumerate().map(of_seed).collect()
    }

    fn descend<'a>(&mut self, losses: &mut [&mut dyn Loss<'a>]) -> Vec<f32> {
        let passes: Vec<Vec<Pass<'a>>> = losses.iter().map(|loss| loss.passes()).collect();
        let mut outputs = Vec::new();
        self.hidden.iter_mut().for_each(Vec::clear);
        for (i, &Pass { weights, tower, .. }) in passes[0].iter().enumerate() {
            let batches: Vec<Batch<'_>> = passes.iter().map(|passes| passes[i].inputs).collect();
            let mut activations = self.activations(weights, tower, &batches);
            outputs.extend(activations.pop());
            if weights == Weights::Own && self.hidden[tower].is_empty() {
                self.hidden[tower] = activations.iter().map(Tensor::detach).collect();
            }
        }
        let loss = self.loss(&outputs, losses);
        self.step(&loss)
    }

    fn norms(&self, seed: usize) -> GradientNorms {
        let penalty = match &self.pull {
            Some(pull) if matches!(pull.toward, Toward::Zero(_)) => {
                to_vec(&self.pull_gradient(pull).i(seed as i64).norm())[0]
            }
            _ => 0.0,
        };
        GradientNorms { loss: self.loss_norms[seed], penalty }
    }

    fn units(&self, seed: usize) -> Units {
        let layer = |(block, tensor): (&Block, &Tensor)| LayerUnits {
            units: block.width,
            values: tensor.size()[2] as usize,
            activations: to_vec(&tensor.i(seed as i64)),
        };
        let of_tower =
            |(tower, layers): (&Tower, &Vec<Tensor>)| tower.mlp.blocks().iter().zip(layers).map(layer).collect();
        Units { towers: self.network.towers().iter().zip(&self.hidden).map(of_tower).collect() }
    }

    fn copy(&mut self, name: &str) {
        self.copies.insert(name.to_owned(), self.parameters.detach().copy());
    }

    fn edit(&mut self, seed: usize, change: &mut dyn FnMut(&mut AgentState)) {
        let mut agent = self.agent(seed);
        change(&mut agent);
        let _guard = tch::no_grad_guard();
        let write = |tensor: &Tensor, values: &[f32]| tensor.i(seed as i64).copy_(&Tensor::from_slice(values));
        write(&self.parameters, &agent.parameters);
        write(&self.exp_avg, &agent.adam.exp_avg);
        write(&self.exp_avg_sq, &agent.adam.exp_avg_sq);
        // Mitigations act on every seed after the same step, so that all have the same count again.
        self.step = agent.adam.step;
        self.keep(seed, agent);
    }

    fn save(&self, seed: usize, agent: &mut AgentState) {
        let own = self.agent(seed);
        agent.parameters = own.parameters;
        agent.adam = own.adam;
        agent.kept = own.kept;
    }
}

/// What leaves the last layer.
fn last(mut activations: Vec<Tensor>) -> Tensor {
    let Some(outputs) = activations.pop() else { unreachable!("a tower has an output layer") };
    outputs
}

/// The Euclidean norm of each row, `[S, 1]`.
fn norms(rows: &Tensor) -> Tensor {
    rows.norm_scalaropt_dim(2, 1, true)
}
