//! What went wrong, as far as the exit code cares.

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

/// Another process writes the same run: exit code 75, by which schedulers know that they may try again later.
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
pub struct Held(pub String);
