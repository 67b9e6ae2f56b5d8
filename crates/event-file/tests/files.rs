//! Whole files, byte by byte. `python/tests/test_tensorboard.py` reads the same ones with TensorBoard's own reader.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use event_file::{EventWriter, HParam, HParams, SessionStatus, record};

/// The events that the fixture holds.
fn write_all(events: &mut EventWriter) -> io::Result<()> {
    let values = [
        ("algorithm", HParam::Text("ppo".to_owned())),
        ("gamma", HParam::Number(0.99)),
        ("normalize_advantage", HParam::Bool(true)),
    ];
    let hparams = HParams { group: "ppo", values: &values, metrics: &["rollout/ep_rew_mean", "train/loss"] };
    events.hparams(1_700_000_000.25, &hparams)?;
    for row in 1..=3_u64 {
        let (step, wall_time) = (2048 * row, 1_700_000_000.5 + row as f64);
        let scalars = [("rollout/ep_rew_mean", -200.0 + row as f64), ("train/loss", 0.5_f64.powi(row as i32))];
        events.scalars(step, wall_time, &scalars)?;
    }
    let weights: Vec<f32> = (0..1000).map(|i| (i - 300) as f32 / 256.0).collect();
    let ruined = [f32::NAN, 2.0, f32::INFINITY, f32::NEG_INFINITY, 2.0];
    let histograms = [("weights/policy.0", &weights[..]), ("weights/ruined", &ruined), ("weights/none", &[])];
    events.histograms(6144, 1_700_000_004.0, &histograms)?;
    events.scalars(8192, 1_700_000_005.0, &[("train/loss", f64::NAN), ("train/grad_norm", f64::INFINITY)])?;
    events.session_end(1_700_000_006.0, SessionStatus::Success)
}

fn fixture() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fixtures/events.out.tfevents.1700000000.all")
}

/// `EVENT_FILE_FIXTURES=write` writes the fixture anew; TensorBoard must then read it.
#[test]
fn everything_is_written_as_in_the_fixture() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("events");
    let mut events = EventWriter::create(&path, 1_700_000_000.0).unwrap();
    write_all(&mut events).unwrap();
    let written = fs::read(&path).unwrap();
    assert_eq!(events.position(), written.len() as u64);
    if std::env::var_os("EVENT_FILE_FIXTURES").is_some_and(|value| value == "write") {
        fs::write(fixture(), &written).unwrap();
    }
    assert!(written == fs::read(fixture()).unwrap(), "the file differs from {}", fixture().display());
}

/// As TensorBoard 2.21's `RecordWriter` writes the event that its `event_pb2` serialises.
#[test]
fn records_are_tensorboards() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("events");
    let mut events = EventWriter::create(&path, 1.5).unwrap();
    events.scalars(2048, 1.5, &[("train/loss", 0.25), ("time/fps", -1.0)]).unwrap();
    let version = "1800000000000000a37f4b2209000000000000f83f1a0d627261696e2e4576656e743a322a28646c";
    let scalars = "3200000000000000241956ec09000000000000f83f1080102a240a110a0a747261696e2f6c6f7373150000803e\
                   0a0f0a0874696d652f66707315000080bfb9e33cb0";
    let hex: String = fs::read(&path).unwrap().iter().map(|byte| format!("{byte:02x}")).collect();
    assert_eq!(hex, format!("{version}{scalars}"));
}

/// A file that is cut back and continued is the file that was never cut.
#[test]
fn a_file_goes_on_where_it_was_cut() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("events");
    let mut events = EventWriter::create(&path, 1_700_000_000.0).unwrap();
    let start = events.position();
    write_all(&mut events).unwrap();
    let whole = fs::read(&path).unwrap();
    drop(events);
    for tail in [&b""[..], b"half a record"] {
        fs::write(&path, [&whole, tail].concat()).unwrap();
        let mut events = EventWriter::resume(&path, start).unwrap();
        assert_eq!(events.position(), start);
        write_all(&mut events).unwrap();
        assert!(fs::read(&path).unwrap() == whole);
    }
    let error = EventWriter::resume(&path, whole.len() as u64 + 1).unwrap_err();
    assert_eq!(error.kind(), io::ErrorKind::InvalidData);
    assert!(fs::read(&path).unwrap() == whole, "a refused file stays as it was");
}

#[test]
fn every_position_ends_a_record() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("events");
    let mut events = EventWriter::create(&path, 0.0).unwrap();
    let mut ends = vec![events.position()];
    for step in 0..3 {
        events.scalars(step, 0.0, &[("a", 1.0)]).unwrap();
        ends.push(events.position());
    }
    let bytes = fs::read(&path).unwrap();
    let mut at = 0;
    for end in ends {
        let length = u64::from_le_bytes(bytes[at..at + 8].try_into().unwrap()) as usize;
        let message = &bytes[at + 12..at + 12 + length];
        assert_eq!(bytes[at..at + 16 + length], record::frame(message));
        at += 16 + length;
        assert_eq!(at as u64, end);
    }
}
