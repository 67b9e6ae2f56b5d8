//! Whole files, byte by byte. `python/tests/test_tensorboard.py` reads the same ones with TensorBoard's own reader.

use std::fs;
use std::path::{Path, PathBuf};

use event_file::{HParam, HParams, SessionStatus};

/// The file that the fixture holds.
fn everything() -> Vec<u8> {
    let mut file = event_file::file_version(1_700_000_000.0);
    let values = [
        ("algorithm", HParam::Text("ppo".to_owned())),
        ("gamma", HParam::Number(0.99)),
        ("normalize_advantage", HParam::Bool(true)),
    ];
    let hparams = HParams { group: "ppo", values: &values, metrics: &["rollout/ep_rew_mean", "train/loss"] };
    file.extend(event_file::hparams(1_700_000_000.25, &hparams));
    for row in 1..=3_u64 {
        let (step, wall_time) = (2048 * row, 1_700_000_000.5 + row as f64);
        let scalars = [("rollout/ep_rew_mean", -200.0 + row as f64), ("train/loss", 0.5_f64.powi(row as i32))];
        file.extend(event_file::scalars(step, wall_time, &scalars));
    }
    let weights: Vec<f32> = (0..1000).map(|i| (i - 300) as f32 / 256.0).collect();
    let ruined = [f32::NAN, 2.0, f32::INFINITY, f32::NEG_INFINITY, 2.0];
    let histograms = [("weights/policy.0", &weights[..]), ("weights/ruined", &ruined), ("weights/none", &[])];
    file.extend(event_file::histograms(6144, 1_700_000_004.0, &histograms));
    let ruined = [("train/loss", f64::NAN), ("train/grad_norm", f64::INFINITY)];
    file.extend(event_file::scalars(8192, 1_700_000_005.0, &ruined));
    file.extend(event_file::session_end(1_700_000_006.0, SessionStatus::Success));
    file
}

fn fixture() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fixtures/events.out.tfevents.1700000000.all")
}

/// `EVENT_FILE_FIXTURES=write` writes the fixture anew; TensorBoard must then read it.
#[test]
fn everything_is_written_as_in_the_fixture() {
    let written = everything();
    if std::env::var_os("EVENT_FILE_FIXTURES").is_some_and(|value| value == "write") {
        fs::write(fixture(), &written).unwrap();
    }
    assert!(written == fs::read(fixture()).unwrap(), "the file differs from {}", fixture().display());
}

/// As TensorBoard 2.21's `RecordWriter` writes the event that its `event_pb2` serialises.
#[test]
fn records_are_tensorboards() {
    let version = "1800000000000000a37f4b2209000000000000f83f1a0d627261696e2e4576656e743a322a28646c";
    let scalars = "3200000000000000241956ec09000000000000f83f1080102a240a110a0a747261696e2f6c6f7373150000803e\
                   0a0f0a0874696d652f66707315000080bfb9e33cb0";
    let mut file = event_file::file_version(1.5);
    file.extend(event_file::scalars(2048, 1.5, &[("train/loss", 0.25), ("time/fps", -1.0)]));
    let hex: String = file.iter().map(|byte| format!("{byte:02x}")).collect();
    assert_eq!(hex, format!("{version}{scalars}"));
}
