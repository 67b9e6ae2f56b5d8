//! From a network's outputs to actions.

use coverage_env::Action;
use coverage_env::random::{below, unit_f32, unit_f64};
use rand::Rng;

/// How an agent chooses its actions while it trains.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Behaviour {
    /// It samples from the softmax of its outputs.
    Sampled,
    /// It takes an action of the largest value, and with this probability ε any action.
    EpsilonGreedy(f64),
}

impl Behaviour {
    /// An action by these outputs, `[A]`.
    pub fn choose<R: Rng>(self, outputs: &[f32], rng: &mut R) -> Action {
        match self {
            Self::Sampled => sample(outputs, unit_f32(rng)),
            Self::EpsilonGreedy(epsilon) if unit_f64(rng) < epsilon => uniform(rng),
            Self::EpsilonGreedy(_) => greedy(outputs),
        }
    }
}

/// Any action, each with the same probability.
pub fn uniform<R: Rng>(rng: &mut R) -> Action {
    Action::ALL[below(rng, Action::COUNT as u32) as usize]
}

/// The action of the largest value, the lowest index among equals.
pub fn greedy(values: &[f32]) -> Action {
    let better = |best: usize, a: usize| if values[a] > values[best] { a } else { best };
    Action::ALL[(1..Action::COUNT).fold(0, better)]
}

/// The action whose cumulative softmax probability first exceeds `u` ∈ [0, 1).
pub fn sample(logits: &[f32], u: f32) -> Action {
    let largest = logits.iter().copied().fold(f32::NEG_INFINITY, f32::max);
    let weights: [f32; 4] = std::array::from_fn(|a| (logits[a] - largest).exp());
    let mut left = u * weights.iter().sum::<f32>();
    for (action, weight) in Action::ALL.into_iter().zip(weights) {
        if left < weight {
            return action;
        }
        left -= weight;
    }
    // Rounding can leave a remainder after the last action.
    Action::ALL[3]
}

/// ln softmax of four logits.
pub fn log_softmax(logits: &[f32]) -> [f32; Action::COUNT] {
    let largest = logits.iter().copied().fold(f32::NEG_INFINITY, f32::max);
    let sum: f32 = logits.iter().map(|z| (z - largest).exp()).sum();
    std::array::from_fn(|a| logits[a] - largest - sum.ln())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sampling_follows_the_softmax() {
        let logits = [0.0, f32::ln(2.0), f32::ln(4.0), f32::ln(1.0)];
        // Probabilities 1/8, 2/8, 4/8, 1/8.
        let expected =
            [(0.0, 0), (0.124, 0), (0.126, 1), (0.374, 1), (0.376, 2), (0.874, 2), (0.876, 3), (0.9999999, 3)];
        for (u, action) in expected {
            assert_eq!(sample(&logits, u).index(), action, "u = {u}");
        }
        assert_eq!(sample(&[1000.0, -1000.0, 999.0, -1000.0], 0.9).index(), 2);
    }
    #[test]
    fn ties_go_to_the_lowest_index() {
        assert_eq!(greedy(&[0.0, 1.0, 1.0, 0.5]).index(), 1);
        assert_eq!(greedy(&[-2.0, -2.0, -2.0, -2.0]).index(), 0);
    }
}
