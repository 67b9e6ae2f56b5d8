//! Waiting for what a process prints and for its end: for an event, and at most for as long as patience lasts.

use std::io::{BufRead, BufReader, Read};
use std::mem::take;
use std::process::{Child, Output};
use std::sync::mpsc::{Receiver, RecvTimeoutError, channel};
use std::thread;
use std::time::Duration;

/// How long something is waited for. It fails the test, and is long enough for the busiest machine.
const PATIENCE: Duration = Duration::from_secs(120);

/// The lines that a process prints, as they come.
pub struct Lines {
    coming: Receiver<String>,
    /// Those that have come.
    read: String,
}

impl Lines {
    /// Reads them from a pipe.
    pub fn of(pipe: impl Read + Send + 'static) -> Self {
        let (send, coming) = channel();
        thread::spawn(move || {
            let lines = BufReader::new(pipe).lines().map_while(Result::ok);
            // Nobody listens any more once the test has seen what it waited for; then the pipe closes.
            lines.map(|line| send.send(line)).find(Result::is_err)
        });
        Self { coming, read: String::new() }
    }

    /// Waits for a line of which `what` makes something.
    #[track_caller]
    pub fn wait_for<T>(&mut self, what: impl Fn(&str) -> Option<T>) -> T {
        loop {
            let Some(line) = self.next() else { panic!("it ended too early; it printed\n{}", self.read) };
            if let Some(found) = what(&line) {
                return found;
            }
        }
    }

    /// What it printed to its end, lines waited for included.
    #[track_caller]
    pub fn rest(&mut self) -> String {
        while self.next().is_some() {}
        take(&mut self.read)
    }

    /// The next line, or none where the process has closed the pipe.
    #[track_caller]
    fn next(&mut self) -> Option<String> {
        match self.coming.recv_timeout(PATIENCE) {
            Ok(line) => {
                self.read += &line;
                self.read.push('\n');
                Some(line)
            }
            Err(RecvTimeoutError::Disconnected) => None,
            Err(RecvTimeoutError::Timeout) => panic!("no line came in {PATIENCE:?}; it printed\n{}", self.read),
        }
    }
}

/// Waits for the end of a process; returns what it printed to the pipes that are left.
#[track_caller]
pub fn ended(child: Child) -> Output {
    let id = child.id();
    let (send, received) = channel();
    thread::spawn(move || send.send(child.wait_with_output()));
    let output = received.recv_timeout(PATIENCE);
    output.unwrap_or_else(|_| panic!("process {id} goes on after {PATIENCE:?}")).expect("a child can be waited for")
}
