//! PPO's loss (Schulman et al. 2017, equations 7 and 9), with its derivative.

use coverage_env::Action;

use super::rollout::Rollout;
use super::settings::PpoConfig;
use crate::agent::choice::log_softmax;
use crate::agent::engine::{Column, Loss, Pass, Statement, Weights};

/// Where the towers stand in the network.
pub(super) const POLICY: usize = 0;
/// See [`POLICY`].
pub(super) const VALUE: usize = 1;

/// The terms of one minibatch's loss, as Stable-Baselines3 logs them.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PpoTerms {
    /// Clipped surrogate, negated (Schulman et al. 2017, equation 7).
    pub policy: f32,
    /// Mean squared error of the values.
    pub value: f32,
    /// Negated mean entropy.
    pub entropy: f32,
    /// What is descended: policy + ent_coef · entropy + vf_coef · value, the pulls of mitigations aside.
    pub total: f32,
    /// Schulman's estimate, the mean of (r − 1) − ln r, of the KL divergence from the old policy.
    pub approx_kl: f32,
    /// Share of samples whose ratio r left the clip range.
    pub clip_fraction: f32,
}

/// The loss of one seed on a minibatch of its rollout.
pub struct PpoLoss<'a> {
    config: &'a PpoConfig,
    rollout: &'a Rollout,
    /// Which of the rollout's samples, `[B]`.
    indices: &'a [u32],
    /// What [`derive`](Loss::derive) found.
    pub terms: PpoTerms,
}

impl<'a> PpoLoss<'a> {
    /// The loss on the samples with these indices.
    pub fn new(config: &'a PpoConfig, rollout: &'a Rollout, indices: &'a [u32]) -> Self {
        Self { config, rollout, indices, terms: PpoTerms::default() }
    }

    /// The minibatch's advantages: mean 0 and unbiased standard deviation 1, if the config says so.
    fn advantages(&self) -> Vec<f32> {
        let mut advantages: Vec<f32> = self.indices.iter().map(|&i| self.rollout.advantages[i as usize]).collect();
        if !self.config.normalize_advantage || advantages.len() < 2 {
            return advantages;
        }
        let count = advantages.len() as f64;
        let mean = advantages.iter().map(|&a| f64::from(a)).sum::<f64>() / count;
        let squares: f64 = advantages.iter().map(|&a| (f64::from(a) - mean).powi(2)).sum();
        let scale = 1.0 / ((squares / (count - 1.0)).sqrt() as f32 + 1e-8);
        advantages.iter_mut().for_each(|a| *a = (*a - mean as f32) * scale);
        advantages
    }
}

impl<'a> Loss<'a> for PpoLoss<'a> {
    fn passes(&self) -> Vec<Pass<'a>> {
        let inputs = self.rollout.inputs.select(self.indices);
        [POLICY, VALUE].map(|tower| Pass { weights: Weights::Own, tower, inputs }).to_vec()
    }

    fn derive(&mut self, outputs: &[&[f32]], gradients: &mut [Vec<f32>]) {
        let (c, rollout) = (self.config, self.rollout);
        let mut terms = PpoTerms::default();
        let share = 1.0 / self.indices.len() as f32;
        let logits = outputs[POLICY].chunks_exact(Action::COUNT);
        for ((logits, advantage), &i) in logits.zip(self.advantages()).zip(self.indices) {
            let (action, old) = (usize::from(rollout.actions[i as usize]), rollout.log_probs[i as usize]);
            let sample = PolicySample::new(logits, action, old, advantage, c);
            terms.policy -= share * sample.surrogate;
            terms.entropy -= share * sample.entropy;
            terms.approx_kl += share * ((sample.ratio - 1.0) - sample.log_ratio);
            terms.clip_fraction += share * f32::from((sample.ratio - 1.0).abs() > c.clip_range as f32);
            gradients[POLICY].extend(sample.gradient(action, c).map(|d| share * d));
        }
        for (value, &i) in outputs[VALUE].iter().zip(self.indices) {
            let error = value - rollout.returns[i as usize];
            terms.value += share * error * error;
            gradients[VALUE].push(share * c.vf_coef as f32 * 2.0 * error);
        }
        terms.total = terms.policy + c.ent_coef as f32 * terms.entropy + c.vf_coef as f32 * terms.value;
        self.terms = terms;
    }

    /// Constants: clip range, entropy and value coefficients, whether advantages are normalised. Columns: actions, old
    /// log-probabilities, advantages, returns.
    fn statement(&self) -> Statement<'a> {
        let (c, r, picked) = (self.config, self.rollout, Some(self.indices));
        Statement {
            name: "ppo",
            constants: vec![c.clip_range, c.ent_coef, c.vf_coef, f64::from(u8::from(c.normalize_advantage))],
            columns: vec![
                Column::Actions(&r.actions, picked),
                Column::Floats(&r.log_probs, picked),
                Column::Floats(&r.advantages, picked),
                Column::Floats(&r.returns, picked),
            ],
        }
    }

    fn of_acting(&self) -> f32 {
        self.terms.policy
    }

    /// In the order of [`PpoTerms`]' fields.
    fn set_terms(&mut self, terms: &[f32]) {
        let &[policy, value, entropy, total, approx_kl, clip_fraction] = terms else {
            unreachable!("PPO's loss has six terms")
        };
        self.terms = PpoTerms { policy, value, entropy, total, approx_kl, clip_fraction };
    }
}

/// The policy's part of the loss for one sample.
struct PolicySample {
    log_probs: [f32; Action::COUNT],
    probs: [f32; Action::COUNT],
    log_ratio: f32,
    ratio: f32,
    /// min(r·A, clip(r)·A).
    surrogate: f32,
    /// ∂surrogate/∂ln π(a|s).
    slope: f32,
    entropy: f32,
}

impl PolicySample {
    fn new(logits: &[f32], action: usize, old_log_prob: f32, advantage: f32, c: &PpoConfig) -> Self {
        let log_probs = log_softmax(logits);
        let probs = log_probs.map(f32::exp);
        let log_ratio = log_probs[action] - old_log_prob;
        let ratio = log_ratio.exp();
        let (low, high) = ((1.0 - c.clip_range) as f32, (1.0 + c.clip_range) as f32);
        let (plain, clipped) = (advantage * ratio, advantage * ratio.clamp(low, high));
        // Where the clipped branch is the smaller one, the ratio lies outside and nothing depends on it. A NaN ratio
        // must stay visible: it belongs to neither case, so that `min`, which would hide it, cannot be used.
        let (surrogate, slope) = if clipped < plain { (clipped, 0.0) } else { (plain, plain) };
        let entropy = -probs.iter().zip(&log_probs).map(|(p, l)| p * l).sum::<f32>();
        Self { log_probs, probs, log_ratio, ratio, surrogate, slope, entropy }
    }

    /// ∂(−surrogate − ent_coef·H)/∂zⱼ = −slope·(δₐⱼ − pⱼ) + ent_coef·pⱼ·(ln pⱼ + H).
    fn gradient(&self, action: usize, c: &PpoConfig) -> [f32; Action::COUNT] {
        std::array::from_fn(|j| {
            let taken = if j == action { 1.0 } else { 0.0 };
            let bonus = c.ent_coef as f32 * self.probs[j] * (self.log_probs[j] + self.entropy);
            bonus - self.slope * (taken - self.probs[j])
        })
    }
}
