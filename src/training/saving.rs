//! When runs are saved within a stage, and when they are to stop.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// How often a running stage is saved. What a run computes does not depend on it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Saving {
    /// After this many rows of the log: rollouts of PPO, some 2,048 timesteps of DQN.
    pub updates: Option<u64>,
    /// After this much time.
    pub interval: Option<Duration>,
}

/// What has passed since runs were last saved.
pub(super) struct SinceSaved {
    time: Instant,
    updates: u64,
}

impl SinceSaved {
    /// Nothing.
    pub(super) fn new() -> Self {
        Self { time: Instant::now(), updates: 0 }
    }

    /// Counts one more update. Says whether it is time to save, and if so starts to count from 0.
    pub(super) fn is_due(&mut self, saving: Saving) -> bool {
        self.updates += 1;
        let due = saving.updates.is_some_and(|updates| self.updates >= updates)
            || saving.interval.is_some_and(|interval| self.time.elapsed() >= interval);
        if due {
            *self = Self::new();
        }
        due
    }
}

/// A request to save everything and stop; whoever holds a clone can make it.
#[derive(Clone, Debug, Default)]
pub struct Stop(pub Arc<AtomicBool>);

impl Stop {
    /// Whether it has been made.
    pub fn is_requested(&self) -> bool {
        self.0.load(Ordering::Relaxed)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn runs_are_saved_after_so_many_updates_or_so_much_time() {
        let due = |saving| {
            let mut since = SinceSaved::new();
            (0..7).map(|_| since.is_due(saving)).collect::<Vec<_>>()
        };
        let f = false;
        assert_eq!(due(Saving { updates: Some(3), interval: None }), [f, f, true, f, f, true, f]);
        assert_eq!(due(Saving { updates: None, interval: Some(Duration::ZERO) }), [true; 7]);
        assert_eq!(due(Saving { updates: Some(9), interval: Some(Duration::from_secs(3600)) }), [f; 7]);
        assert_eq!(due(Saving::default()), [f; 7]);
    }
}
