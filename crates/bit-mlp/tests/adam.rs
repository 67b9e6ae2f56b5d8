//! Pulls, clipping, decay and Adam against PyTorch's formulas, written out in `f64`.

use std::ops::Range;

use bit_mlp::{AdamConfig, Decay, Decayed, Moments, Pull, clip_and_adam, gradient_norms};
use chacha20::ChaCha8Rng;
use rand::{RngExt, SeedableRng};

const LEN: usize = 1_003;
const WEIGHTS: [Range<usize>; 2] = [3..500, 640..1_000];

struct Optimiser {
    params: Vec<f64>,
    exp_avg: Vec<f64>,
    exp_avg_sq: Vec<f64>,
}

impl Optimiser {
    /// A step as torch.optim.Adam, torch.optim.AdamW and clip_grad_norm_ write it. Returns the
    /// norm.
    fn step(
        &mut self,
        grads: &[f64],
        step: i32,
        max_norm: f64,
        decays: impl Fn(usize) -> bool,
        config: &AdamConfig,
    ) -> f64 {
        let AdamConfig { lr, beta1, beta2, eps, decay } = *config;
        let mut grads = grads.to_vec();
        if let Decay::InLoss(lambda) = decay {
            (0..LEN).filter(|&i| decays(i)).for_each(|i| grads[i] += lambda * self.params[i]);
        }
        let norm = grads.iter().map(|g| g * g).sum::<f64>().sqrt();
        let coefficient = (max_norm / (norm + 1e-6)).min(1.0);
        for (i, grad) in grads.iter().enumerate() {
            let mut grad = grad * coefficient;
            match decay {
                Decay::Coupled(lambda) if decays(i) => grad += lambda * self.params[i],
                Decay::Decoupled(lambda) if decays(i) => self.params[i] *= 1.0 - lr * lambda,
                _ => {}
            }
            self.exp_avg[i] = beta1 * self.exp_avg[i] + (1.0 - beta1) * grad;
            self.exp_avg_sq[i] = beta2 * self.exp_avg_sq[i] + (1.0 - beta2) * grad * grad;
            let denominator = self.exp_avg_sq[i].sqrt() / (1.0 - beta2.powi(step)).sqrt() + eps;
            self.params[i] -= lr / (1.0 - beta1.powi(step)) * self.exp_avg[i] / denominator;
        }
        norm
    }
}

fn widen(values: &[f32]) -> Vec<f64> {
    values.iter().map(|&value| f64::from(value)).collect()
}

/// Steps with the usual betas.
fn check(decay: Decay, pull: f64, decayed: Decayed<'_>, max_grad_norm: f32) {
    let config = AdamConfig { lr: 3e-3, eps: 1e-5, decay, ..AdamConfig::default() };
    check_config(&config, pull, decayed, max_grad_norm);
}

/// Steps of this Adam, its decay and a pull towards a random anchor both of the `decayed` parameters.
fn check_config(config: &AdamConfig, pull: f64, decayed: Decayed<'_>, max_grad_norm: f32) {
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let mut params: Vec<f32> = (0..LEN).map(|_| rng.random_range(-1.0..1.0)).collect();
    let anchor: Vec<f32> = (0..LEN).map(|_| rng.random_range(-1.0..1.0)).collect();
    let (mut exp_avg, mut exp_avg_sq) = (vec![0.0; LEN], vec![0.0; LEN]);
    let mut reference = Optimiser { params: widen(&params), exp_avg: vec![0.0; LEN], exp_avg_sq: vec![0.0; LEN] };
    let decays = |index: usize| match decayed {
        Decayed::All => true,
        Decayed::Only(ranges) => ranges.iter().any(|range| range.contains(&index)),
    };
    for step in 1..=30 {
        // Some gradients are 0 in most steps, as those of inputs that are seldom active.
        let scale = if step % 7 == 0 { 0.01 } else { 1.0 };
        let mut grads: Vec<f32> = (0..LEN)
            .map(|i| if i % 3 == 0 && step % 5 != 0 { 0.0 } else { scale * rng.random_range(-1.0..1.0) })
            .collect();
        let mut expected = widen(&grads);
        (0..LEN)
            .filter(|&i| decays(i))
            .for_each(|i| expected[i] += pull * (reference.params[i] - f64::from(anchor[i])));
        if pull != 0.0 {
            let pull = Pull { coefficient: pull, anchor: Some(&anchor), covered: decayed };
            pull.add_to(&mut grads, &params);
        }
        let moments = Moments { exp_avg: &mut exp_avg, exp_avg_sq: &mut exp_avg_sq, step };
        let norm = clip_and_adam(&mut params, &grads, moments, max_grad_norm, decayed, config);
        let expected = reference.step(&expected, step as i32, f64::from(max_grad_norm), decays, config);
        assert!((f64::from(norm) - expected).abs() < 1e-5 * expected, "norm {norm} instead of {expected}");
        let all = [(&params, &reference.params), (&exp_avg, &reference.exp_avg), (&exp_avg_sq, &reference.exp_avg_sq)];
        for (ours, reference) in all {
            for (&ours, &reference) in ours.iter().zip(reference) {
                let error = (f64::from(ours) - reference).abs();
                assert!(
                    error < 2e-6 * (1e-2 + reference.abs()) * f64::from(step as u32),
                    "{ours} instead of {reference}"
                );
            }
        }
    }
}

#[test]
fn steps_equal_pytorch_for_every_decay() {
    for decay in [Decay::None, Decay::Decoupled(0.1), Decay::Coupled(0.02), Decay::InLoss(0.02)] {
        for decayed in [Decayed::All, Decayed::Only(&WEIGHTS)] {
            for max_grad_norm in [0.5, f32::INFINITY] {
                check(decay, 0.0, decayed, max_grad_norm);
            }
        }
    }
}

#[test]
fn steps_equal_pytorch_for_other_betas() {
    for (beta1, beta2) in [(0.99, 0.99), (0.9, 0.9), (0.0, 0.999), (0.0, 0.0)] {
        let config = AdamConfig { lr: 3e-3, beta1, beta2, eps: 1e-3, decay: Decay::None };
        check_config(&config, 0.0, Decayed::All, 0.5);
    }
}

#[test]
fn pulled_steps_equal_pytorch() {
    for decayed in [Decayed::All, Decayed::Only(&WEIGHTS)] {
        for decay in [Decay::None, Decay::InLoss(0.02)] {
            check(decay, 0.3, decayed, 0.5);
        }
    }
}

#[test]
fn a_pull_to_zeros_needs_no_anchor() {
    let params: Vec<f32> = (0..LEN).map(|i| (i as f32).sin()).collect();
    let zeros = vec![0.0; LEN];
    for covered in [Decayed::All, Decayed::Only(&WEIGHTS)] {
        let [with, without] = [Some(zeros.as_slice()), None].map(|anchor| {
            let pull = Pull { coefficient: 0.1, anchor, covered };
            let mut grads = vec![1.0; LEN];
            pull.add_to(&mut grads, &params);
            (grads, pull.norm(&params))
        });
        assert_eq!(with.0, without.0);
        assert!((with.1 / without.1 - 1.0).abs() < 1e-6, "{} and {}", with.1, without.1);
    }
}

#[test]
fn a_norm_that_is_not_finite_is_returned_and_changes_nothing() {
    for bad in [f32::NAN, f32::INFINITY] {
        let (mut params, mut exp_avg, mut exp_avg_sq) = (vec![1.0; 40], vec![0.1; 40], vec![0.2; 40]);
        let mut grads = vec![1.0; 40];
        grads[37] = bad;
        let moments = Moments { exp_avg: &mut exp_avg, exp_avg_sq: &mut exp_avg_sq, step: 3 };
        let config = AdamConfig { decay: Decay::Decoupled(0.1), ..AdamConfig::default() };
        assert!(!clip_and_adam(&mut params, &grads, moments, 0.5, Decayed::All, &config).is_finite());
        assert_eq!((params, exp_avg, exp_avg_sq), (vec![1.0; 40], vec![0.1; 40], vec![0.2; 40]));
    }
}

#[test]
fn untouched_parameters_stay_and_faded_moments_vanish() {
    let (mut params, mut exp_avg, mut exp_avg_sq) = (vec![1.0; 20], vec![0.0; 20], vec![0.0; 20]);
    exp_avg[3] = 1.05e-36;
    exp_avg_sq[3] = 1e-30;
    let moments = Moments { exp_avg: &mut exp_avg, exp_avg_sq: &mut exp_avg_sq, step: 50_000 };
    clip_and_adam(&mut params, &[0.0; 20], moments, 0.5, Decayed::All, &AdamConfig::default());
    assert_eq!(params, vec![1.0; 20]);
    assert_eq!(exp_avg[3], 0.0);
    assert!(exp_avg_sq[3] > 0.0);
}

#[test]
fn norms_of_loss_and_penalty() {
    let params = [3.0, 4.0, 100.0];
    let anchor = [0.0, 1.0, 7.0];
    for (anchor, expected) in [(None, 0.5), (Some(&anchor[..]), 0.1 * 18.0_f32.sqrt())] {
        let pull = Pull { coefficient: 0.1, anchor, covered: Decayed::Only(&[0..2, 2..2]) };
        let norms = gradient_norms(&params, &[1.0, 2.0, 2.0], pull);
        assert!((norms.loss - 3.0).abs() < 1e-6 && (norms.penalty - expected).abs() < 1e-6, "{norms:?}");
    }
}
