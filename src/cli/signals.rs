//! Signals that ask a training to save and stop.

use std::io;
use std::sync::Arc;

use anyhow::{Context, Result};
use signal_hook::consts::{SIGINT, SIGTERM, SIGUSR1, SIGXFSZ};
use signal_hook::flag;

use crate::training::saving::Stop;

/// The exit code of an interrupted training.
const EXIT_CODE: i32 = 130;

/// A stop that is requested by the first SIGINT, SIGTERM or SIGUSR1; schedulers send these before they kill. A second
/// one ends the process at once.
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
        // A file that may not grow further is then an error of the write, which says more than this signal's death.
        flag::register(SIGXFSZ, Arc::default()).map(|_| ())
    };
    register().context("cannot handle signals")?;
    Ok(stop)
}
