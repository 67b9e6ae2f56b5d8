//! What went wrong, as far as the exit code cares, and how it is said.

use std::fmt::Display;

/// The user's input is wrong: exit code 2.
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
pub struct UserError(String);

impl UserError {
    /// An error that says what is wrong and how to mend it.
    pub fn new(message: impl Into<String>) -> Self {
        Self(message.into())
    }
}

/// A signal stopped the work, whose state is saved: exit code 130.
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
pub struct Interrupted(pub String);

/// Says something to whoever watches, unless less is to be shown; see [`messages`](crate::messages).
pub fn tell(line: impl Display) {
    tracing::info!("{line}");
}

/// The process's exit code for an error.
pub fn exit_code(error: &anyhow::Error) -> u8 {
    use crate::config::ConfigError;
    use crate::run::checkpoint::CheckpointError;
    use coverage_env::{LevelError, PlanError};
    let of_user = |e: &(dyn std::error::Error + 'static)| {
        e.is::<UserError>()
            || e.is::<ConfigError>()
            || e.is::<LevelError>()
            || e.is::<PlanError>()
            || e.is::<CheckpointError>()
    };
    if error.chain().any(|e| e.is::<Interrupted>()) {
        return 130;
    }
    if error.chain().any(of_user) { 2 } else { 1 }
}
