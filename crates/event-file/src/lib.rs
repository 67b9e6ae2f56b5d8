//! TensorBoard event files: scalars, histograms and hyper-parameters.
//!
//! An event file is a series of [records](record), each a serialised `Event` of TensorFlow's `event.proto`. TensorBoard
//! reads a file while it grows, and waits where the last record is not whole yet. Files only grow here as well, by whole
//! records; [`EventWriter::position`] is a length to which a file can be cut back later, and continued from there.
//!
//! ```
//! # fn main() -> std::io::Result<()> {
//! # let folder = tempfile::tempdir()?;
//! # let path = folder.path().join("events.out.tfevents.0.host");
//! use event_file::EventWriter;
//!
//! let mut events = EventWriter::create(&path, 1_700_000_000.0)?;
//! events.scalars(2048, 1_700_000_001.5, &[("rollout/ep_rew_mean", -180.5), ("train/loss", 0.25)])?;
//! let kept = events.position();
//! events.scalars(4096, 1_700_000_003.0, &[("rollout/ep_rew_mean", -150.0)])?;
//!
//! let mut events = EventWriter::resume(&path, kept)?; // the second row is gone
//! events.histograms(2048, 1_700_000_009.0, &[("weights/policy.0", &[0.5, -0.25])])?;
//! # Ok(())
//! # }
//! ```
//!
//! TensorBoard takes a file for an event file if its name contains `tfevents`.

mod histogram;
mod hparams;
mod message;
pub mod record;

use std::fs::{File, OpenOptions};
use std::io::{self, Seek, SeekFrom, Write};
use std::path::Path;

pub use hparams::{HParam, HParams, SessionStatus};
use message::Message;

/// What the first record of every file says.
const FILE_VERSION: &str = "brain.Event:2";

/// Writes one event file. Every call makes one record, in one write.
///
/// `step` is the x axis of TensorBoard's charts; `wall_time` is in seconds since 1970, UTC.
#[derive(Debug)]
pub struct EventWriter {
    file: File,
    position: u64,
}

impl EventWriter {
    /// Begins a file, in place of any that is there.
    ///
    /// # Errors
    /// Those of the file system.
    pub fn create(path: &Path, wall_time: f64) -> io::Result<Self> {
        let mut events = Self { file: File::create(path)?, position: 0 };
        events.append(&Message::new().double(1, wall_time).text(3, FILE_VERSION))?;
        Ok(events)
    }

    /// Continues a file after its first `length` bytes, a former [`position`](Self::position); what follows is cut off.
    ///
    /// # Errors
    /// Those of the file system, and `InvalidData` for a file that is shorter.
    pub fn resume(path: &Path, length: u64) -> io::Result<Self> {
        let mut file = OpenOptions::new().write(true).open(path)?;
        let found = file.metadata()?.len();
        if found < length {
            let message = format!("the event file has {found} bytes, and {length} had been written");
            return Err(io::Error::new(io::ErrorKind::InvalidData, message));
        }
        file.set_len(length)?;
        file.seek(SeekFrom::Start(length))?;
        Ok(Self { file, position: length })
    }

    /// The length of the file, always the end of a record.
    pub fn position(&self) -> u64 {
        self.position
    }

    /// Makes everything so far durable.
    ///
    /// # Errors
    /// Those of the file system.
    pub fn sync(&self) -> io::Result<()> {
        self.file.sync_data()
    }

    /// Writes values by tag; they are stored as `f32`. TensorBoard marks NaN and infinities in its charts.
    ///
    /// # Errors
    /// Those of the file system; the file then ends as before.
    pub fn scalars(&mut self, step: u64, wall_time: f64, values: &[(&str, f64)]) -> io::Result<()> {
        let value = |(tag, value): &(&str, f64)| Message::new().text(1, tag).float(2, *value as f32);
        self.summary(step, wall_time, values.iter().map(value))
    }

    /// Writes the distributions of values by tag; values that are NaN or infinite are left out.
    ///
    /// # Errors
    /// Those of the file system; the file then ends as before.
    pub fn histograms(&mut self, step: u64, wall_time: f64, values: &[(&str, &[f32])]) -> io::Result<()> {
        let value = |(tag, values): &(&str, &[f32])| Message::new().text(1, tag).message(5, &histogram::encode(values));
        self.summary(step, wall_time, values.iter().map(value))
    }

    /// Writes the run's hyper-parameters, for TensorBoard's HParams tab; once, at the beginning of a run.
    ///
    /// # Errors
    /// Those of the file system; the file then ends as before.
    pub fn hparams(&mut self, wall_time: f64, hparams: &HParams<'_>) -> io::Result<()> {
        self.summary(0, wall_time, [hparams.experiment(), hparams.session_start(wall_time)])
    }

    /// Writes how the run stands, for the HParams tab; the first such record of a file counts.
    ///
    /// # Errors
    /// Those of the file system; the file then ends as before.
    pub fn session_end(&mut self, wall_time: f64, status: SessionStatus) -> io::Result<()> {
        self.summary(0, wall_time, [hparams::session_end(wall_time, status)])
    }

    /// Writes one `Event` with a `Summary` of these `Summary.Value`s.
    fn summary(&mut self, step: u64, wall_time: f64, values: impl IntoIterator<Item = Message>) -> io::Result<()> {
        let summary = values.into_iter().fold(Message::new(), |summary, value| summary.message(1, &value));
        self.append(&Message::new().double(1, wall_time).int(2, step).message(5, &summary))
    }

    fn append(&mut self, event: &Message) -> io::Result<()> {
        let record = record::frame(event.bytes());
        if let Err(error) = self.file.write_all(&record) {
            // Part of the record may stand there, and would hide from readers what follows it. Where it cannot be cut
            // off either (the disk is gone), the first error is still the one to report.
            let _ = self.file.set_len(self.position).and_then(|()| self.file.seek(SeekFrom::Start(self.position)));
            return Err(error);
        }
        self.position += record.len() as u64;
        Ok(())
    }
}
