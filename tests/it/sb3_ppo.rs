//! PPO, update by update, against Stable-Baselines3's `train()`.

use cpp_rl::agent::engine::Engine;
use cpp_rl::agent::ppo::{PpoConfig, PpoLoss, PpoTerms, Rollout};

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

/// Makes the recorded updates with every engine and compares each with what was recorded.
fn follow(name: &str) {
    let case = Case::read(name);
    for make in crate::ENGINES {
        make_updates(&case, &mut *make(case.parts()));
    }
}

fn make_updates(case: &Case, engine: &mut dyn Engine) {
    let config = case.config.of::<PpoConfig>().expect("a case of PPO");
    let rollout = rollout(case);
    let minibatches = case.tensors.indices("minibatches");
    let mut agent = case.agent.clone();
    for (i, minibatch) in minibatches.chunks_exact(minibatches.len() / UPDATES).enumerate() {
        let mut loss = PpoLoss::new(config, &rollout, minibatch);
        let norm = engine.descend(&mut [&mut loss])[0];
        check_terms(case, i, loss.terms, norm);
        engine.save(0, &mut agent);
        case.check(i + 1, &agent);
    }
}

fn check_terms(case: &Case, update: usize, loss: PpoTerms, norm: f32) {
    let terms = [
        ("policy_gradient_loss", loss.policy),
        ("value_loss", loss.value),
        ("entropy_loss", loss.entropy),
        ("loss", loss.total),
        ("approx_kl", loss.approx_kl),
        ("clip_fraction", loss.clip_fraction),
        ("gradient_norm", norm),
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
    let mut rollout = Rollout::new(1, case.config.shared.sensor, &case.level);
    rollout.inputs = case.batch(&tensors.bytes("observations"));
    rollout.actions = tensors.indices("actions").iter().map(|&action| action as u8).collect();
    rollout.log_probs = tensors.floats("old_log_probs");
    rollout.values = tensors.floats("old_values");
    rollout.advantages = tensors.floats("advantages");
    rollout.returns = tensors.floats("returns");
    rollout
}
