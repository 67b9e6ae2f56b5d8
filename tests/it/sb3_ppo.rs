//! PPO, update by update, against Stable-Baselines3's `train()`.

use cpp_rl::agent::ppo::{AutogradPpo, FusedPpo, PpoLoss, PpoUpdater, Rollout};
use cpp_rl::config::Algorithm;
use tch::Device;

use crate::fixtures::{Case, UPDATES};
use crate::numbers::assert_within;

#[test]
fn plain_ppo() {
    follow("ppo");
}

#[test]
fn the_published_adamw_decays_nothing() {
    follow("ppo_l2_study");
}

#[test]
fn decoupled_decay() {
    follow("ppo_adamw");
}

#[test]
fn coupled_decay() {
    follow("ppo_l2_coupled");
}

#[test]
fn a_trained_agent_goes_on() {
    follow("ppo_study");
}

/// Makes the recorded updates with both implementations and compares each with what was recorded.
fn follow(name: &str) {
    let case = Case::read(name);
    let Algorithm::Ppo(ppo) = &case.config.algorithm else { panic!("{name} is a case of PPO") };
    let (optimizer, agents) = (&case.config.optimizer, std::slice::from_ref(&case.agent));
    make_updates(&case, &mut FusedPpo::new(&case.network, ppo, optimizer, agents));
    make_updates(&case, &mut AutogradPpo::new(case.network.clone(), Device::Cpu, ppo, optimizer, agents));
}

fn make_updates(case: &Case, updater: &mut dyn PpoUpdater) {
    let rollout = rollout(case);
    let minibatches = case.tensors.indices("minibatches");
    let mut agent = case.agent.clone();
    updater.load(&[&rollout]);
    for (i, minibatch) in minibatches.chunks_exact(minibatches.len() / UPDATES).enumerate() {
        let losses = updater.minibatch(&[&rollout], &[minibatch]);
        check_terms(case, i, losses[0]);
        updater.save(0, &mut agent);
        case.check(i + 1, &agent);
    }
}

fn check_terms(case: &Case, update: usize, loss: PpoLoss) {
    let terms = [
        ("policy_gradient_loss", loss.policy),
        ("value_loss", loss.value),
        ("entropy_loss", loss.entropy),
        ("loss", loss.total),
        ("approx_kl", loss.approx_kl),
        ("clip_fraction", loss.clip_fraction),
        ("gradient_norm", loss.grad_norm),
    ];
    for (name, actual) in terms {
        let expected = case.term(update, name);
        // All but the value loss and the norm are means of numbers of magnitude 1 that may cancel: they have an
        // absolute error too.
        assert_within(
            &format!("{name} of update {}", update + 1),
            &[actual],
            &[expected],
            1e-5 * expected.abs() + 1e-6,
        );
    }
}

/// The recorded rollout, as collecting and estimating would have left it.
fn rollout(case: &Case) -> Rollout {
    let tensors = &case.tensors;
    let mut rollout = Rollout::new(1, &case.level);
    rollout.inputs = case.batch(&tensors.bytes("observations"));
    rollout.actions = tensors.indices("actions").iter().map(|&action| action as u8).collect();
    rollout.log_probs = tensors.floats("old_log_probs");
    rollout.values = tensors.floats("old_values");
    rollout.advantages = tensors.floats("advantages");
    rollout.returns = tensors.floats("returns");
    rollout
}
