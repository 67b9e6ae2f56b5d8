//! The fast engine: one agent after another in plain memory, gradients derived by hand.
//!
//! The arithmetic is `bit-mlp`'s; tests hold it equal to libtorch's.

use std::ops::Range;
use std::sync::Arc;

use bit_mlp::{AdamConfig, BitBatch, Decay, Decayed, GradientNorms, Mlp, Moments, Prepared, Workspace};
use bit_mlp::{clip_and_adam, gradient_norms};

use super::contract::{Engine, Entry, LayerUnits, Parts, Penalty, Pull, Toward, Units};
use super::loss::{Loss, Pass, Weights};
use crate::agent::state::{AdamState, AgentState};

/// Samples of one forward pass; keeps its working memory in the cache.
const FORWARD_BATCH: usize = 256;

/// A pull that draws nothing.
const NO_PULL: bit_mlp::Pull<'static> = bit_mlp::Pull { coefficient: 0.0, anchor: None, covered: Decayed::All };

/// S agents, one after another.
pub struct FusedEngine {
    towers: Vec<Mlp>,
    adam: AdamConfig,
    max_grad_norm: f32,
    pull: Option<FusedPull>,
    penalties: Vec<Arc<dyn Penalty>>,
    seeds: Vec<Seed>,
}

/// A pull, with the parameters that it covers where those are not all.
struct FusedPull {
    pull: Pull,
    covered: Option<Vec<Range<usize>>>,
}

struct Seed {
    agent: AgentState,
    /// ∂loss/∂θ, `[P]`.
    gradient: Vec<f32>,
    /// The part of it that a further pass of a tower has, `[P]`; empty until there is one.
    further: Vec<f32>,
    /// The acting tower, made ready for single observations; stale after a step.
    acting: Prepared,
    is_stale: bool,
    /// One for each pass of a loss.
    workspaces: Vec<Workspace>,
    /// ∂loss/∂outputs of each pass, `[B, outputs]`.
    output_gradients: Vec<Vec<f32>>,
    /// By tower: the pass of the last step that went through it, where its units are.
    units_in: Vec<Option<usize>>,
}

impl FusedEngine {
    /// Agents as they come out of the stage before.
    pub fn new(parts: Parts) -> Self {
        let Parts { network, optimizer, pull, penalties, agents } = parts;
        let towers: Vec<Mlp> = network.towers().iter().map(|tower| tower.mlp.clone()).collect();
        let covered = |pull: &Pull| (!pull.covers_all).then(|| network.weights());
        let pull = pull.map(|pull| FusedPull { covered: covered(&pull), pull });
        let adam = AdamConfig {
            lr: optimizer.learning_rate,
            beta1: optimizer.adam_beta1,
            beta2: optimizer.adam_beta2,
            eps: optimizer.adam_eps,
            decay: pull.as_ref().map_or(Decay::None, FusedPull::decay),
        };
        let seed = |agent: AgentState| Seed {
            gradient: vec![0.0; agent.parameters.len()],
            further: Vec::new(),
            acting: Prepared::new(&towers[0], &agent.parameters, &[]),
            is_stale: true,
            workspaces: Vec::new(),
            output_gradients: Vec::new(),
            units_in: vec![None; towers.len()],
            agent,
        };
        Self {
            adam,
            max_grad_norm: optimizer.max_grad_norm as f32,
            pull,
            penalties,
            seeds: agents.into_iter().map(seed).collect(),
            towers,
        }
    }
}

impl FusedPull {
    /// What Adam's step does of it: all, unless it draws to a copy.
    fn decay(&self) -> Decay {
        let coefficient = self.pull.coefficient;
        match self.pull.toward {
            Toward::Zero(Entry::Decoupled) => Decay::Decoupled(coefficient),
            Toward::Zero(Entry::InAdam) => Decay::Coupled(coefficient),
            Toward::Zero(Entry::InLoss) => Decay::InLoss(coefficient),
            Toward::Copy { .. } => Decay::None,
        }
    }

    fn covered(&self) -> Decayed<'_> {
        self.covered.as_deref().map_or(Decayed::All, Decayed::Only)
    }

    /// The penalty for this agent, by the quadratic one that has the same gradient at its parameters.
    fn of<'a>(&'a self, agent: &'a AgentState) -> bit_mlp::Pull<'a> {
        let quadratic = |coefficient, anchor| bit_mlp::Pull { coefficient, anchor, covered: self.covered() };
        let lambda = self.pull.coefficient;
        let Toward::Copy { name, is_squared } = self.pull.toward else { return quadratic(lambda, None) };
        let anchor = Some(agent.kept.copies[name].as_slice());
        let distance = if is_squared { 1.0 } else { quadratic(1.0, anchor).norm(&agent.parameters) };
        // Where there is no distance, there is no gradient.
        quadratic(if distance > 0.0 { lambda / f64::from(distance) } else { 0.0 }, anchor)
    }
}

impl Engine for FusedEngine {
    fn act(&mut self, inputs: &[BitBatch], outputs: &mut [f32]) {
        let per_seed = outputs.len() / self.seeds.len();
        let width = self.towers[0].outputs();
        for ((seed, inputs), outputs) in self.seeds.iter_mut().zip(inputs).zip(outputs.chunks_exact_mut(per_seed)) {
            let parameters = &seed.agent.parameters;
            if std::mem::take(&mut seed.is_stale) {
                seed.acting.refresh(parameters, inputs.constant());
            }
            for (i, out) in outputs.chunks_exact_mut(width).enumerate() {
                out.copy_from_slice(seed.acting.forward_one(parameters, inputs.sample(i)));
            }
        }
    }

    fn forward(&mut self, tower: usize, inputs: &[&BitBatch]) -> Vec<Vec<f32>> {
        let mlp = &self.towers[tower];
        let indices: Vec<u32> = (0..inputs.iter().map(|batch| batch.len()).max().unwrap_or(0) as u32).collect();
        let of_seed = |(seed, inputs): (&mut Seed, &&BitBatch)| {
            seed.make_room(1);
            let mut outputs = Vec::with_capacity(inputs.len() * mlp.outputs());
            for part in indices[..inputs.len()].chunks(FORWARD_BATCH) {
                let batch = inputs.select(part);
                outputs.extend_from_slice(mlp.forward(&seed.agent.parameters, batch, &mut seed.workspaces[0]));
            }
            outputs
        };
        self.seeds.iter_mut().zip(inputs).map(of_seed).collect()
    }

    fn descend<'a>(&mut self, losses: &mut [&mut dyn Loss<'a>]) -> Vec<f32> {
        let Self { towers, adam, max_grad_norm, pull, penalties, seeds } = self;
        let step = |(seed, loss): (&mut Seed, &mut &mut dyn Loss<'a>)| {
            seed.differentiate(towers, *loss);
            seed.penalise(pull.as_ref(), penalties);
            seed.step(*max_grad_norm, pull.as_ref(), adam)
        };
        seeds.iter_mut().zip(losses).map(step).collect()
    }

    fn norms(&self, seed: usize) -> GradientNorms {
        let Seed { agent, gradient, .. } = &self.seeds[seed];
        let pull = self.pull.as_ref().filter(|pull| matches!(pull.pull.toward, Toward::Zero(_)));
        gradient_norms(&agent.parameters, gradient, pull.map_or(NO_PULL, |pull| pull.of(agent)))
    }

    fn units(&self, seed: usize) -> Units {
        let Seed { workspaces, units_in, .. } = &self.seeds[seed];
        let of_tower = |(mlp, pass): (&Mlp, &Option<usize>)| {
            let hidden = &mlp.blocks()[..mlp.blocks().len() - 1];
            let layers = pass.iter().flat_map(|&pass| {
                hidden.iter().enumerate().map(move |(i, block)| (block, workspaces[pass].activations(i)))
            });
            let units = layers.map(|(block, values)| {
                let mut activations = Vec::with_capacity(values.len() * values.width());
                values.rows().for_each(|row| activations.extend_from_slice(row));
                LayerUnits { units: block.width, values: values.width(), activations }
            });
            units.collect()
        };
        Units { towers: self.towers.iter().zip(units_in).map(of_tower).collect() }
    }

    fn copy(&mut self, name: &str) {
        for Seed { agent, .. } in &mut self.seeds {
            match agent.kept.copies.get_mut(name) {
                Some(copy) => copy.copy_from_slice(&agent.parameters),
                None => drop(agent.kept.copies.insert(name.to_owned(), agent.parameters.clone())),
            }
        }
    }

    fn edit(&mut self, seed: usize, change: &mut dyn FnMut(&mut AgentState)) {
        let seed = &mut self.seeds[seed];
        change(&mut seed.agent);
        seed.is_stale = true;
    }

    fn save(&self, seed: usize, agent: &mut AgentState) {
        let Seed { agent: own, .. } = &self.seeds[seed];
        agent.parameters.clone_from(&own.parameters);
        agent.adam.clone_from(&own.adam);
        agent.kept.clone_from(&own.kept);
    }
}

impl Seed {
    /// Working memory for this many passes.
    fn make_room(&mut self, passes: usize) {
        if self.workspaces.len() < passes {
            self.workspaces.resize_with(passes, Workspace::default);
            self.output_gradients.resize_with(passes, Vec::new);
        }
    }

    /// The gradient of a loss with respect to θ.
    fn differentiate<'a>(&mut self, towers: &[Mlp], loss: &mut dyn Loss<'a>) {
        let passes = loss.passes();
        self.make_room(passes.len());
        let Self { agent, gradient, further, workspaces, output_gradients, units_in, .. } = self;
        let parameters = |weights| match weights {
            Weights::Own => &agent.parameters,
            Weights::Copy(name) => &agent.kept.copies[name],
        };
        let gradients = &mut output_gradients[..passes.len()];
        gradients.iter_mut().for_each(Vec::clear);
        let forward = |(pass, workspace): (&Pass<'a>, _)| {
            towers[pass.tower].forward(parameters(pass.weights), pass.inputs, workspace)
        };
        let outputs: Vec<&[f32]> = passes.iter().zip(workspaces.iter_mut()).map(forward).collect();
        loss.derive(&outputs, gradients);
        units_in.fill(None);
        let own = passes.iter().enumerate().filter(|(_, pass)| pass.weights == Weights::Own);
        for (i, &Pass { tower, inputs, .. }) in own {
            let (mlp, d_outputs, workspace) = (&towers[tower], &gradients[i], &mut workspaces[i]);
            if units_in[tower].is_none() {
                mlp.backward(&agent.parameters, inputs, d_outputs, workspace, gradient);
                units_in[tower] = Some(i);
                continue;
            }
            further.resize(gradient.len(), 0.0);
            mlp.backward(&agent.parameters, inputs, d_outputs, workspace, further);
            let range = mlp.range();
            bit_mlp::add(&mut gradient[range.clone()], &further[range]);
        }
    }

    /// Adds to the gradient what Adam's step does not.
    fn penalise(&mut self, pull: Option<&FusedPull>, penalties: &[Arc<dyn Penalty>]) {
        let Self { agent, gradient, .. } = self;
        if let Some(pull) = pull.filter(|pull| matches!(pull.pull.toward, Toward::Copy { .. })) {
            pull.of(agent).add_to(gradient, &agent.parameters);
        }
        penalties.iter().for_each(|penalty| penalty.add_to(gradient, agent));
    }

    /// One step of clipped Adam; returns the gradient's norm before clipping. One that is not finite changes nothing.
    fn step(&mut self, max_grad_norm: f32, pull: Option<&FusedPull>, adam: &AdamConfig) -> f32 {
        let decayed = pull.map_or(Decayed::All, FusedPull::covered);
        let AgentState { parameters, adam: AdamState { exp_avg, exp_avg_sq, step }, .. } = &mut self.agent;
        let moments = Moments { exp_avg, exp_avg_sq, step: *step + 1 };
        let norm = clip_and_adam(parameters, &self.gradient, moments, max_grad_norm, decayed, adam);
        *step += u64::from(norm.is_finite());
        self.is_stale = true;
        norm
    }
}
