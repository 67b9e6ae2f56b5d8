//! Messages on stderr: `tracing` events, written as lines that no progress bar overwrites.

use std::cell::Cell;
use std::fmt::{self, Display};
use std::io::{self, Write};
use std::sync::{Mutex, PoisonError};

use indicatif::MultiProgress;
use tracing::{Event, Level, Subscriber};
use tracing_subscriber::filter::LevelFilter;
use tracing_subscriber::fmt::format::Writer;
use tracing_subscriber::fmt::{FmtContext, FormatEvent, FormatFields};
use tracing_subscriber::registry::LookupSpan;

/// How much is shown on stderr.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Verbosity {
    /// Warnings and failures only.
    Quiet,
    /// Progress.
    Normal,
    /// The resolved settings and every stage's end too.
    Verbose,
}

/// The bars that are on the screen.
static BARS: Mutex<Option<MultiProgress>> = Mutex::new(None);

thread_local! {
    /// Whether this thread has taken the bars away already.
    static PAST_BARS: Cell<bool> = const { Cell::new(false) };
}

/// Shows messages from now on; a second call changes nothing.
pub fn show(verbosity: Verbosity) {
    let most = match verbosity {
        Verbosity::Quiet => LevelFilter::WARN,
        Verbosity::Normal => LevelFilter::INFO,
        Verbosity::Verbose => LevelFilter::DEBUG,
    };
    let messages = tracing_subscriber::fmt().log_internal_errors(false).with_max_level(most);
    // An error here says that messages are shown already.
    let _ = messages.event_format(Terse).with_writer(|| Stderr).try_init();
}

/// Prints a message, unless only warnings are shown.
pub fn tell(line: impl Display) {
    tracing::info!("{line}");
}

/// Says which bars are on the screen from now on.
pub fn set_bars(bars: Option<MultiProgress>) {
    *BARS.lock().unwrap_or_else(PoisonError::into_inner) = bars;
}

/// Runs `print` with the bars out of its way.
pub fn past_bars<T>(print: impl FnOnce() -> T) -> T {
    let bars = BARS.lock().unwrap_or_else(PoisonError::into_inner).clone();
    match bars {
        Some(bars) if !PAST_BARS.get() => bars.suspend(|| {
            PAST_BARS.set(true);
            let result = print();
            PAST_BARS.set(false);
            result
        }),
        _ => print(),
    }
}

/// `error: …`, `warning: …`, and other messages as they are.
struct Terse;

impl<S, F> FormatEvent<S, F> for Terse
where
    S: Subscriber + for<'a> LookupSpan<'a>,
    F: for<'a> FormatFields<'a> + 'static,
{
    fn format_event(&self, context: &FmtContext<'_, S, F>, mut out: Writer<'_>, event: &Event<'_>) -> fmt::Result {
        out.write_str(match *event.metadata().level() {
            Level::ERROR => "error: ",
            Level::WARN => "warning: ",
            _ => "",
        })?;
        context.field_format().format_fields(out.by_ref(), event)?;
        writeln!(out)
    }
}

/// Takes one message per write.
struct Stderr;

impl Write for Stderr {
    fn write(&mut self, message: &[u8]) -> io::Result<usize> {
        // A message that cannot be written (to a full disk, or a closed terminal) must not end a training.
        let _ = past_bars(|| io::stderr().write_all(message));
        Ok(message.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}
