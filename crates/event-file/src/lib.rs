//! TensorBoard event files: scalars, histograms and hyper-parameters.
//!
//! An event file is a series of [records](record), each a serialised `Event` of TensorFlow's `event.proto`. Each function
//! here makes one record; who appends them to a file, in one write each, can cut it back to the end of any of them and go
//! on from there. TensorBoard reads a file while it grows, and waits where the last record is not whole yet.
//!
//! ```
//! let mut file = Vec::new();
//! file.extend(event_file::file_version(1_700_000_000.0));
//! let values = [("rollout/ep_rew_mean", -180.5), ("train/loss", 0.25)];
//! file.extend(event_file::scalars(2048, 1_700_000_001.5, &values));
//! file.extend(event_file::histograms(2048, 1_700_000_009.0, &[("weights/policy.0", &[0.5, -0.25])]));
//! ```
//!
//! TensorBoard takes a file for an event file if its name contains `tfevents`. Everywhere `step` is the x axis of
//! TensorBoard's charts, and `wall_time` is in seconds since 1970, UTC.

mod histogram;
mod hparams;
mod message;
pub mod record;

pub use hparams::{HParam, HParams, SessionStatus};
use message::Message;

/// What the first record of every file says.
const FILE_VERSION: &str = "brain.Event:2";

/// The first record of a file.
pub fn file_version(wall_time: f64) -> Vec<u8> {
    record::frame(Message::new().double(1, wall_time).text(3, FILE_VERSION).bytes())
}

/// Values by tag; they are stored as `f32`. TensorBoard marks NaN and infinities in its charts.
pub fn scalars(step: u64, wall_time: f64, values: &[(&str, f64)]) -> Vec<u8> {
    let value = |(tag, value): &(&str, f64)| Message::new().text(1, tag).float(2, *value as f32);
    summary(step, wall_time, values.iter().map(value))
}

/// The distributions of values by tag; values that are NaN or infinite are left out.
pub fn histograms(step: u64, wall_time: f64, values: &[(&str, &[f32])]) -> Vec<u8> {
    let value = |(tag, values): &(&str, &[f32])| Message::new().text(1, tag).message(5, &histogram::encode(values));
    summary(step, wall_time, values.iter().map(value))
}

/// The run's hyper-parameters, for TensorBoard's HParams tab; once, at the beginning of a run.
pub fn hparams(wall_time: f64, hparams: &HParams<'_>) -> Vec<u8> {
    summary(0, wall_time, [hparams.experiment(), hparams.session_start(wall_time)])
}

/// How the run ended, for the HParams tab; the first such record of a file counts.
pub fn session_end(wall_time: f64, status: SessionStatus) -> Vec<u8> {
    summary(0, wall_time, [hparams::session_end(wall_time, status)])
}

/// One `Event` with a `Summary` of these `Summary.Value`s.
fn summary(step: u64, wall_time: f64, values: impl IntoIterator<Item = Message>) -> Vec<u8> {
    let summary = values.into_iter().fold(Message::new(), |summary, value| summary.message(1, &value));
    record::frame(Message::new().double(1, wall_time).int(2, step).message(5, &summary).bytes())
}
