//! A stage as a learner sees it.

use std::sync::Arc;

use coverage_env::Level;

/// One stage as a learner sees it.
#[derive(Clone, Debug)]
pub struct Stage {
    /// Its place in the curriculum, from 0.
    pub index: u16,
    /// The map that all environments have.
    pub level: Arc<Level>,
    /// Timesteps to train for.
    pub timesteps: u64,
    /// Timesteps that schedules span: `timesteps`, unless the run was extended.
    pub horizon: u64,
}
