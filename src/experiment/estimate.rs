//! How fast an arm trains on this machine.

use std::time::{Duration, Instant};

use coverage_env::Level;

use crate::agent::config::Config;
use crate::agent::engine::EngineKind;
use crate::agent::{self, Stage};

/// How long a trial of an arm's speed runs at least.
const TRIAL: Duration = Duration::from_millis(250);
/// How long all trials together are to run.
const ALL_TRIALS: Duration = Duration::from_secs(10);

/// How long a trial of each of so many arms runs at least.
pub fn trial_of_each(arms: usize) -> Duration {
    TRIAL.min(ALL_TRIALS / u32::try_from(arms.max(1)).unwrap_or(u32::MAX))
}

/// Timesteps per second of one seed of `config` on one thread of this machine, by a trial that runs at least so long.
pub fn measure_rate(config: &Config, level: &Level, engine: EngineKind, trial: Duration) -> f64 {
    // Nothing of the trial is kept, so that any seed will do.
    let agent = config.agent(level, 0);
    let stage = Stage { index: 0, level: level.clone().into(), timesteps: u64::MAX, horizon: u64::MAX };
    let mut learner = agent::learner(config, &stage, vec![agent], engine);
    learner.advance();
    let (start, before) = (Instant::now(), learner.timesteps());
    loop {
        learner.advance();
        if start.elapsed() >= trial {
            break;
        }
    }
    (learner.timesteps() - before) as f64 / start.elapsed().as_secs_f64()
}
