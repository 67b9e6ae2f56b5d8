//! The losses once more, as formulas over tensors: what autograd differentiates, and what the fused engine's derivatives
//! are held against. Nothing here is shared with them.

use cpp_rl::agent::engine::Statement;
use tch::{Kind, Reduction, Tensor};

/// A loss of each seed, `[S]`, and its terms, `[S]` each, in the order in which the algorithm documents them.
pub struct Stated {
    /// What is descended.
    pub loss: Tensor,
    /// What is logged.
    pub terms: Vec<Tensor>,
}

/// A loss as a function of the outputs of its passes, `[S, B, outputs]` each, its columns, `[S, B]` each, and constants.
pub type Formula = fn(&[Tensor], &[Tensor], &[f64]) -> Stated;

/// The formula of this name. An algorithm without one works too: its own derivative is used then.
pub fn by_name(name: &str) -> Option<Formula> {
    match name {
        "ppo" => Some(ppo),
        "dqn" => Some(dqn),
        _ => None,
    }
}

/// The columns of all seeds, `[S, B]` each.
pub fn columns(statements: &[Statement<'_>], device: tch::Device) -> Vec<Tensor> {
    let column = |i: usize| {
        let rows: Vec<Vec<f32>> = statements.iter().map(|statement| statement.columns[i].to_floats()).collect();
        crate::dense::stack(rows.iter().map(Vec::as_slice), device)
    };
    (0..statements[0].columns.len()).map(column).collect()
}

fn mean(tensor: Tensor) -> Tensor {
    tensor.mean_dim(1, false, Kind::Float)
}

/// Of `[S, B, 4]`, what belongs to the actions `[S, B]`.
fn of_actions(outputs: &Tensor, actions: &Tensor) -> Tensor {
    outputs.gather(2, &actions.to_kind(Kind::Int64).unsqueeze(2), false).squeeze_dim(2)
}

/// PPO's clipped surrogate, value loss and entropy bonus (Schulman et al. 2017, equations 7 and 9), as
/// Stable-Baselines3 has them.
fn ppo(outputs: &[Tensor], columns: &[Tensor], constants: &[f64]) -> Stated {
    let [logits, values] = outputs else { unreachable!("PPO has two passes") };
    let [actions, old_log_probs, advantages, returns] = columns else { unreachable!("PPO has four columns") };
    let &[clip_range, ent_coef, vf_coef, normalize] = constants else { unreachable!("PPO has four constants") };
    let mut advantages = advantages.shallow_clone();
    if normalize != 0.0 && advantages.size()[1] > 1 {
        let center = advantages.mean_dim(1, true, Kind::Float);
        advantages = (&advantages - center) / (advantages.std_dim(1, true, true) + 1e-8);
    }
    let log_probs_all = logits.log_softmax(-1, Kind::Float);
    let log_ratio = of_actions(&log_probs_all, actions) - old_log_probs;
    let ratio = log_ratio.exp();
    let clipped = ratio.clamp(1.0 - clip_range, 1.0 + clip_range);
    let policy = -mean((&advantages * &ratio).minimum(&(&advantages * clipped)));
    let value = mean((values.squeeze_dim(2) - returns).square());
    let entropy = mean((log_probs_all.exp() * &log_probs_all).sum_dim_intlist(-1, false, Kind::Float));
    let loss = &policy + ent_coef * &entropy + vf_coef * &value;
    let (ratio, log_ratio) = (ratio.detach(), log_ratio.detach());
    let approx_kl = mean(&ratio - 1.0 - log_ratio);
    let clip_fraction = mean((ratio - 1.0).abs().gt(clip_range).to_kind(Kind::Float));
    Stated { terms: vec![policy, value, entropy, loss.shallow_clone(), approx_kl, clip_fraction], loss }
}

/// DQN's smooth L1 loss of the temporal-difference errors (Mnih et al. 2015), as Stable-Baselines3 has it.
fn dqn(outputs: &[Tensor], columns: &[Tensor], constants: &[f64]) -> Stated {
    let [values, next] = outputs else { unreachable!("DQN has two passes") };
    let [actions, rewards, terminated] = columns else { unreachable!("DQN has three columns") };
    let (best, _) = next.max_dim(2, false);
    let alive: Tensor = 1.0 - terminated;
    let targets = rewards + alive * constants[0] * best;
    let loss = mean(of_actions(values, actions).smooth_l1_loss(&targets, Reduction::None, 1.0));
    Stated { terms: vec![loss.shallow_clone()], loss }
}
