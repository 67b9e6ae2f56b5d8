//! Whatever is given as a SPEC or as a checkpoint is taken or refused, and never ends in a panic.

use std::sync::LazyLock;

use cpp_rl::cli::{parse_levels, parse_numbers};
use cpp_rl::run::checkpoint::Checkpoint;
use proptest::prelude::*;

/// A small valid checkpoint.
static CHECKPOINT: LazyLock<Vec<u8>> = LazyLock::new(|| {
    let sandbox = crate::sandbox::Sandbox::new();
    sandbox.succeeds("train --config ppo.yaml --level a.yaml --set hidden=[2]");
    sandbox.run("train/ppo/level-a/seed-0").bytes("checkpoints/stage-0.safetensors")
});

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn any_spec_of_numbers(spec in prop_oneof![any::<String>(), "[0-9., -]{0,30}", "[0-9]{1,20}\\.\\.[0-9]{1,20}"]) {
        if let Ok(numbers) = parse_numbers(&spec) {
            prop_assert!(!numbers.is_empty() && numbers.len() <= 10_000);
            prop_assert!(numbers.is_sorted_by(|a, b| a < b));
        }
    }

    #[test]
    fn any_spec_of_levels(spec in prop_oneof!["[0-9., ]{0,20}", "\\PC{0,20}"]) {
        match parse_levels(&spec) {
            Ok(levels) => prop_assert!(!levels.is_empty()),
            Err(error) => prop_assert!(!error.to_string().is_empty()),
        }
    }

    #[test]
    fn any_bytes_as_a_checkpoint(bytes in prop::collection::vec(any::<u8>(), 0..300), length in 0_u64..300) {
        prop_assert!(Checkpoint::from_bytes(&bytes).is_err());
        let framed = [&length.to_le_bytes(), &bytes[..]].concat();
        prop_assert!(Checkpoint::from_bytes(&framed).is_err());
    }

    /// One bit more or less anywhere, or bytes cut off, is noticed.
    #[test]
    fn a_damaged_checkpoint(at in any::<prop::sample::Index>(), bit in 0..8_u8, cut in any::<bool>()) {
        let mut bytes = CHECKPOINT.clone();
        let at = at.index(bytes.len());
        if cut { bytes.truncate(at) } else { bytes[at] ^= 1 << bit }
        prop_assert!(Checkpoint::from_bytes(&bytes).is_err());
    }

    /// A header with other values, and a checksum that fits it: what is claimed is checked, not believed.
    #[test]
    fn a_checkpoint_that_lies(
        key in prop::sample::select(vec!["height", "width", "adam_step", "num_timesteps", "seed", "stage", "format"]),
        value in prop_oneof![Just(0), Just(u64::MAX), Just(1 << 32), any::<u64>(), 0..100_u64],
    ) {
        if let Ok(read) = Checkpoint::from_bytes(&with_header(&CHECKPOINT, key, value)) {
            prop_assert_eq!(read.agent.parameters.len(), read.network.num_parameters());
            // The weights' shapes tell the map's size; all else that can be true is believed.
            let only = [("height", 3), ("width", 4), ("format", 1)].into_iter().find(|(name, _)| *name == key);
            prop_assert!(only.is_none_or(|(_, own)| value == own), "{key} {value}");
        }
    }
}

/// A checkpoint or snapshot with another number in its header.
pub fn with_header(bytes: &[u8], key: &str, value: u64) -> Vec<u8> {
    let length = u64::from_le_bytes(bytes[..8].try_into().expect("a length")) as usize;
    let mut header: serde_json::Value = serde_json::from_slice(&bytes[8..8 + length]).expect("JSON");
    let own = header["__metadata__"]["cpp-rl"].as_str().expect("a text");
    let mut own: serde_json::Value = serde_json::from_str(own).expect("JSON");
    own[key] = value.into();
    own["crc32"] = "00000000".into();
    header["__metadata__"]["cpp-rl"] = own.to_string().into();
    let mut header = header.to_string().into_bytes();
    header.resize(header.len().next_multiple_of(8), b' ');
    let mut file = [&(header.len() as u64).to_le_bytes(), &header[..], &bytes[8 + length..]].concat();
    let crc = format!("{:08x}", crc32fast::hash(&file));
    let field = br#"\"crc32\":\""#;
    let at = file.windows(field.len()).position(|window| window == field).expect("a checksum") + field.len();
    file[at..at + 8].copy_from_slice(crc.as_bytes());
    file
}

#[test]
fn an_unchanged_header_is_still_believed() {
    assert!(Checkpoint::from_bytes(&CHECKPOINT).is_ok());
    assert!(Checkpoint::from_bytes(&with_header(&CHECKPOINT, "num_timesteps", 7)).is_ok());
    let error = Checkpoint::from_bytes(&with_header(&CHECKPOINT, "format", 99)).expect_err("another format");
    assert!(error.to_string().contains("checkpoint format 99"), "{error}");
}
