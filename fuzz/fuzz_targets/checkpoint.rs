//! Checkpoints: any bytes are refused with words, or are a checkpoint whose parts fit together.

#![no_main]

use cpp_rl::run::checkpoint::Checkpoint;
use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| match Checkpoint::from_bytes(bytes) {
    Ok(read) => assert_eq!(read.agent.parameters.len(), read.network.num_parameters()),
    Err(error) => assert!(!error.to_string().is_empty()),
});
