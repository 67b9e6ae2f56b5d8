//! Signals that ask a training to save and stop.

use std::io;
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::thread;

use anyhow::{Context, Result};
use signal_hook::consts::{SIGINT, SIGTERM, SIGUSR1, SIGXFSZ};
use signal_hook::iterator::Signals;
use signal_hook::{flag, low_level};

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
    let requested = stop.0.clone();
    let register = || -> io::Result<()> {
        let mut signals = Signals::new([SIGINT, SIGTERM, SIGUSR1])?;
        // One thread counts them all: handlers of two signals can run at once, and each would take its own for the first.
        thread::Builder::new().name("signals".to_owned()).spawn(move || {
            for _ in signals.forever() {
                if requested.swap(true, Ordering::Relaxed) {
                    low_level::exit(EXIT_CODE);
                }
            }
        })?;
        // Without this the signal would end the process. Now the write fails, and its error names the file.
        flag::register(SIGXFSZ, Arc::default()).map(|_| ())
    };
    register().context("cannot handle signals")?;
    Ok(stop)
}
