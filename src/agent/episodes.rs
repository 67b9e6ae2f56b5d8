//! The moving window of finished episodes.

use std::collections::VecDeque;

use coverage_env::VecStep;
use serde::{Deserialize, Serialize};

/// Episodes in the window, as in Stable-Baselines3's `stats_window_size`.
const WINDOW: usize = 100;

/// The last 100 episodes of a stage; `rollout/ep_rew_mean` and `rollout/ep_len_mean` are its means.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct EpisodeWindow {
    /// `(return, length)`, the oldest first.
    episodes: VecDeque<(i64, u32)>,
    /// Episodes of the stage so far.
    pub count: u64,
}

impl EpisodeWindow {
    /// Adds the episodes that ended with these steps.
    pub fn extend(&mut self, steps: &[VecStep]) {
        for episode in steps.iter().filter_map(|step| step.episode) {
            if self.episodes.len() == WINDOW {
                self.episodes.pop_front();
            }
            self.episodes.push_back((episode.return_, episode.length));
            self.count += 1;
        }
    }

    /// Mean return; NaN before the first episode ends.
    pub fn mean_return(&self) -> f64 {
        self.mean(|&(return_, _)| return_ as f64)
    }

    /// Mean length in timesteps; NaN before the first episode ends.
    pub fn mean_length(&self) -> f64 {
        self.mean(|&(_, length)| f64::from(length))
    }

    /// Whether episodes of at most `max_steps` steps can have left this.
    pub(super) fn is_possible(&self, max_steps: u32) -> bool {
        let lengths = self.episodes.iter().map(|&(_, length)| length);
        self.episodes.len() as u64 == self.count.min(WINDOW as u64) && lengths.into_iter().all(|n| n <= max_steps)
    }

    fn mean(&self, of: impl Fn(&(i64, u32)) -> f64) -> f64 {
        self.episodes.iter().map(of).sum::<f64>() / self.episodes.len() as f64
    }
}
