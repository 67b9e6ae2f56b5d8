//! The random streams of a seed. Each purpose has a stream of its own, so that drawing more for one never shifts another.

use chacha20::ChaCha8Rng;
use rand::{Rng, SeedableRng, TryRng};
use serde::{Deserialize, Serialize};
use std::convert::Infallible;

/// What a stream is drawn for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Purpose {
    /// Initial weights.
    Weights,
    /// Start cells of the training environment with this index.
    Environment(u32),
    /// Training actions, exploration included.
    Actions,
    /// Order of minibatches, or transitions drawn from the replay buffer.
    Minibatches,
    /// Start cells of an evaluation with `--episodes`.
    EvaluationStarts,
    /// Actions of an evaluation with `--stochastic`, and of the random planner.
    EvaluationActions,
    /// Starts and actions that gather the reference batch of a level, on which plasticity is measured.
    ReferenceStates,
    /// Starts and actions that gather the states that an agent visits, on which plasticity is measured, too.
    VisitedStates {
        /// Timesteps of the stage before the measurement; modulo 2³².
        timesteps: u32,
    },
    /// Actions of the sampled policy where a training is evaluated.
    SampledEvaluation {
        /// The CRC-32 of when and where.
        place: u32,
    },
    /// What a mitigation draws after a gradient step or, at step 0, at the beginning of a stage.
    Mitigation {
        /// The mitigation's; at most 1,000.
        number: u16,
        /// Gradient steps of the agent's life; modulo 2³².
        step: u32,
    },
}

impl Purpose {
    /// ChaCha's stream number for a stage. Never renumber: it is part of what a seed means.
    fn number(self, stage: u16) -> u64 {
        let (purpose, index) = match self {
            Self::Weights => (0, 0),
            Self::Actions => (1, 0),
            Self::Minibatches => (2, 0),
            Self::EvaluationStarts => (3, 0),
            Self::EvaluationActions => (4, 0),
            Self::Environment(index) => (5, index),
            Self::ReferenceStates => (6, 0),
            Self::VisitedStates { timesteps } => (7, timesteps),
            Self::SampledEvaluation { place } => (8, place),
            Self::Mitigation { number, step } => (64 + u64::from(number), step),
        };
        u64::from(stage) << 48 | purpose << 32 | u64::from(index)
    }
}

/// A random stream that depends on a seed's number, the stage and a purpose alone.
///
/// ChaCha with 8 rounds, keyed by the seed; the purpose selects one of its 2⁶⁴ independent streams, and a position in
/// it is one number, so that a checkpoint holds three integers.
#[derive(Debug)]
pub struct Stream {
    seed: u64,
    rng: ChaCha8Rng,
}

/// A [`Stream`]'s place, as checkpoints keep it.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct StreamState {
    /// The seed's number.
    pub seed: u64,
    /// ChaCha's stream number.
    pub stream: u64,
    /// 32-bit words drawn so far.
    pub words: u64,
}

impl Stream {
    /// The beginning of the stream that `seed` has for `purpose` in stage number `stage`.
    pub fn new(seed: u64, stage: u16, purpose: Purpose) -> Self {
        Self::at(&StreamState { seed, stream: purpose.number(stage), words: 0 })
    }

    /// The stream at a place taken before with [`Stream::state`].
    pub fn at(state: &StreamState) -> Self {
        let mut key = [0; 32];
        key[..8].copy_from_slice(&state.seed.to_le_bytes());
        let mut rng = ChaCha8Rng::from_seed(key);
        rng.set_stream(state.stream);
        rng.set_word_pos(state.words.into());
        Self { seed: state.seed, rng }
    }

    /// The present place.
    pub fn state(&self) -> StreamState {
        // 2⁶⁴ words would take centuries to draw.
        let words = self.rng.get_word_pos() as u64;
        StreamState { seed: self.seed, stream: self.rng.get_stream(), words }
    }

    /// Two independent draws from the standard normal distribution (Box & Muller 1958).
    pub fn normal_pair(&mut self) -> (f64, f64) {
        // 1 − u lies in (0, 1], so that the logarithm is finite.
        let radius = (-2.0 * (1.0 - coverage_env::random::unit_f64(self)).ln()).sqrt();
        let (sin, cos) = (std::f64::consts::TAU * coverage_env::random::unit_f64(self)).sin_cos();
        (radius * cos, radius * sin)
    }
}

impl TryRng for Stream {
    type Error = Infallible;

    fn try_next_u32(&mut self) -> Result<u32, Infallible> {
        Ok(self.rng.next_u32())
    }

    fn try_next_u64(&mut self) -> Result<u64, Infallible> {
        Ok(self.rng.next_u64())
    }

    fn try_fill_bytes(&mut self, dst: &mut [u8]) -> Result<(), Infallible> {
        self.rng.fill_bytes(dst);
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_stream_goes_on_from_its_state() {
        for drawn in [0, 1, 5, 63, 64, 1000] {
            let mut stream = Stream::new(7, 2, Purpose::Environment(3));
            (0..drawn).for_each(|_| {
                stream.next_u32();
            });
            let mut again = Stream::at(&stream.state());
            let draws = |s: &mut Stream| (0..200).map(|_| s.next_u32()).collect::<Vec<_>>();
            assert_eq!(draws(&mut stream), draws(&mut again), "after {drawn} words");
        }
    }

    #[test]
    fn seeds_stages_and_purposes_have_streams_of_their_own() {
        let purposes = [
            Purpose::Weights,
            Purpose::Actions,
            Purpose::Minibatches,
            Purpose::EvaluationStarts,
            Purpose::EvaluationActions,
            Purpose::Environment(0),
            Purpose::Environment(1),
            Purpose::ReferenceStates,
            Purpose::VisitedStates { timesteps: 0 },
            Purpose::VisitedStates { timesteps: 7 },
            Purpose::SampledEvaluation { place: 0 },
            Purpose::SampledEvaluation { place: u32::MAX },
            Purpose::Mitigation { number: 0, step: 0 },
            Purpose::Mitigation { number: 1, step: 0 },
            Purpose::Mitigation { number: 1, step: 7 },
        ];
        let first = |seed, stage, purpose| Stream::new(seed, stage, purpose).next_u64();
        let of_seed = |seed| (0..3).flat_map(move |stage| purposes.map(|purpose| first(seed, stage, purpose)));
        let mut firsts: Vec<u64> = (0..4).flat_map(of_seed).collect();
        firsts.sort_unstable();
        firsts.dedup();
        assert_eq!(firsts.len(), 4 * 3 * purposes.len());
    }

    #[test]
    fn normal_draws_have_the_normal_moments() {
        let mut stream = Stream::new(0, 0, Purpose::Weights);
        let draws: Vec<f64> = (0..50_000).flat_map(|_| <[f64; 2]>::from(stream.normal_pair())).collect();
        let moment = |k: i32| draws.iter().map(|x| x.powi(k)).sum::<f64>() / draws.len() as f64;
        // Standard errors at 100,000 draws: 0.003, 0.0045, 0.012 and 0.031.
        assert!(moment(1).abs() < 0.02 && (moment(2) - 1.0).abs() < 0.03);
        assert!(moment(3).abs() < 0.06 && (moment(4) - 3.0).abs() < 0.15);
    }
}
