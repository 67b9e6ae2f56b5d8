//! The lock that keeps two processes out of one run's directory.

use std::fs::{File, TryLockError};
use std::path::Path;
use std::thread;
use std::time::Duration;

use anyhow::{Context, Result};

use crate::error::Held;

/// Its name within the run.
pub const NAME: &str = ".lock";
/// How often the lock is tried, since who only [asks](is_held) holds it for an instant.
const ATTEMPTS: usize = 4;
const PAUSE: Duration = Duration::from_millis(25);

/// Held for as long as it lives; the operating system lets go of it when the process ends, however it ends.
pub(super) struct Lock(#[expect(dead_code, reason = "it is held, not used")] File);

/// Whether a process is known to hold the run's lock, wherever it runs; looks without creating anything. A lock that
/// cannot be asked, as where the file system has none, counts as one that nobody holds.
///
/// The lock is held for an instant where nobody has it: ask only of runs that are said to be running.
pub fn is_held(run: &Path) -> bool {
    File::open(run.join(NAME)).is_ok_and(|lock| matches!(lock.try_lock_shared(), Err(TryLockError::WouldBlock)))
}

impl Lock {
    /// Takes the lock of a run.
    ///
    /// # Errors
    /// That another process has it; and those of the file system.
    pub(super) fn take(run: &Path) -> Result<Self> {
        let path = run.join(NAME);
        let file = File::create(&path).with_context(|| format!("cannot create {}", path.display()))?;
        Self::of(file, run)
    }

    /// Says whether the lock could be taken, without making anything.
    ///
    /// # Errors
    /// As [`Lock::take`].
    pub(super) fn try_out(run: &Path) -> Result<()> {
        // NFS locks a file for one alone only where it is open for writing.
        match File::options().write(true).open(run.join(NAME)) {
            Ok(file) => Self::of(file, run).map(|_| ()),
            // No lock, or none that may be written: taking it will tell.
            Err(_) => Ok(()),
        }
    }

    fn of(file: File, run: &Path) -> Result<Self> {
        let mut locked = file.try_lock();
        for _ in 1..ATTEMPTS {
            if !matches!(locked, Err(TryLockError::WouldBlock)) {
                break;
            }
            thread::sleep(PAUSE);
            locked = file.try_lock();
        }
        match locked {
            Ok(()) => Ok(Self(file)),
            Err(TryLockError::WouldBlock) => Err(Held(format!(
                "{} is being written by another process: wait for it, or choose another folder with --out",
                run.display()
            ))
            .into()),
            Err(TryLockError::Error(error)) => Err(error).with_context(|| format!("cannot lock {}", run.display())),
        }
    }
}
