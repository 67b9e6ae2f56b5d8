//! DQN, update by update, against Stable-Baselines3's `train()`.

use coverage_env::Action;
use cpp_rl::agent::dqn::{DqnLoss, Transitions};
use cpp_rl::agent::engine::Engine;

use crate::fixtures::{Case, UPDATES};
use crate::numbers::assert_close;

#[test]
fn plain_dqn() {
    follow("dqn");
}

#[test]
fn every_gradient_is_clipped() {
    follow("dqn_clipped");
}

#[test]
fn a_trained_agent_goes_on() {
    follow("dqn_study");
}

/// Makes the recorded updates with every engine and compares each with what was recorded.
fn follow(name: &str) {
    let case = Case::read(name);
    for make in crate::ENGINES {
        make_updates(&case, &mut *make(case.parts()));
    }
}

fn make_updates(case: &Case, engine: &mut dyn Engine) {
    let copy_after = case.json["copy_after_update"].as_u64();
    let mut agent = case.agent.clone();
    for (i, transitions) in batches(case).iter().enumerate() {
        let update = i + 1;
        check_values(case, i, transitions, engine);
        let mut loss = DqnLoss::new(case.config.shared.gamma as f32, transitions);
        let norm = engine.descend(&mut [&mut loss])[0];
        assert_close(&format!("loss of update {update}"), &[loss.value], &[case.term(i, "loss")], 1e-5);
        assert_close(&format!("norm of update {update}"), &[norm], &[case.term(i, "gradient_norm")], 1e-5);
        let target = agent.kept.copies["target"].clone();
        engine.save(0, &mut agent);
        assert_eq!(agent.kept.copies["target"], target, "update {update} leaves the target network alone");
        if Some(update as u64) == copy_after {
            engine.copy("target");
            engine.save(0, &mut agent);
            assert_eq!(agent.kept.copies["target"], agent.parameters);
        }
        case.check(update, &agent);
    }
}

/// Compares Q(s, a) of a batch with what was recorded.
fn check_values(case: &Case, update: usize, batch: &Transitions, engine: &mut dyn Engine) {
    let mut values = vec![0.0; batch.actions.len() * Action::COUNT];
    engine.act(std::slice::from_ref(&batch.inputs), &mut values);
    let actions = batch.actions.iter().map(|&action| usize::from(action));
    let taken: Vec<f32> = values.chunks_exact(Action::COUNT).zip(actions).map(|(q, action)| q[action]).collect();
    let recorded = case.tensors.floats("current_q_values");
    assert_close("Q(s, a)", &taken, &recorded[update * taken.len()..][..taken.len()], 1e-5);
}

/// The recorded minibatches.
fn batches(case: &Case) -> Vec<Transitions> {
    let tensors = &case.tensors;
    let (inputs, next) = (tensors.bytes("observations"), tensors.bytes("next_observations"));
    let (actions, rewards) = (tensors.indices("actions"), tensors.floats("rewards"));
    let dones = tensors.floats("dones");
    fn part<T>(of: &[T], i: usize) -> &[T] {
        &of[of.len() / UPDATES * i..][..of.len() / UPDATES]
    }
    let batch = |i| Transitions {
        sensor: case.config.shared.sensor,
        inputs: case.batch(part(&inputs, i)),
        next: case.batch(part(&next, i)),
        actions: part(&actions, i).iter().map(|&action| action as u8).collect(),
        rewards: part(&rewards, i).to_vec(),
        terminated: part(&dones, i).iter().map(|&done| done == 1.0).collect(),
    };
    (0..UPDATES).map(batch).collect()
}
