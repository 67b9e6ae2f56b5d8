//! Signals that ask a training to save and stop.

use std::io;
use std::sync::Arc;

use anyhow::{Context, Result};
use signal_hook::consts::{SIGINT, SIGTERM, SIGUSR1, SIGXFSZ};
use signal_hook::flag;

use crate::training::saving::Stop;

/// The exit code of an interrupted training.
const EXIT_CODE: i32 = 130;

/// A stop that the first SIGINT, SIGTERM or SIGUSR1 requests. Schedulers send these before they kill. A second signal
/// ends the process at once.
///
/// # Errors
/// Those of the operating system.
pub(super) fn stop() -> Result<Stop> {
    let stop = Stop::default();
    let register = || -> io::Result<()> {
        for signal in [SIGINT, SIGTERM, SIGUSR1] {
            // In this order: the first signal finds the stop unrequested, and so does not end the process.
            flag::register_conditional_shutdown(signal, EXIT_CODE, stop.0.clone())?;
            flag::register(signal, stop.0.clone())?;
        }
        // Without this the signal would end the process. Now the write fails, and its error names the file.
        flag::register(SIGXFSZ, Arc::default()).map(|_| ())
    };
    register().context("cannot handle signals")?;
    Ok(stop)
}
