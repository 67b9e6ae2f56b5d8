//! Level files: any bytes are a level or an error, and a level is written and read again as the same one.

#![no_main]

use coverage_env::Level;
use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| match Level::from_yaml("fuzz.yaml", bytes) {
    Ok(level) => {
        let again = Level::from_yaml("fuzz.yaml", level.to_yaml().as_bytes()).expect("what was written is read");
        assert_eq!(again, level);
    }
    Err(error) => assert!(error.to_string().starts_with("fuzz.yaml: ")),
});
