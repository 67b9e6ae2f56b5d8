//! Settings, as a file and as `--set`: anything is a config or an error, and a config is written and read again as the
//! same one.

#![no_main]

use std::path::PathBuf;
use std::sync::LazyLock;

use cpp_rl::agent::config::{Config, resolve};
use libfuzzer_sys::fuzz_target;
use tempfile::TempDir;

static FOLDER: LazyLock<TempDir> = LazyLock::new(|| TempDir::new().expect("a temporary folder"));

fn file(text: impl AsRef<[u8]>) -> PathBuf {
    let path = FOLDER.path().join("fuzz.yaml");
    std::fs::write(&path, text).expect("the folder is writable");
    path
}

fn is_read_again(config: &Config) {
    let again = resolve(None, Some(&file(config.to_yaml())), &[], None).expect("what was written is read");
    assert_eq!(again, *config);
}

fuzz_target!(|bytes: &[u8]| {
    for algo in [None, Some("ppo")] {
        match resolve(algo, Some(&file(bytes)), &[], None) {
            Ok(config) => is_read_again(&config),
            Err(error) => assert!(!error.to_string().is_empty()),
        }
    }
    if let Ok(text) = std::str::from_utf8(bytes)
        && let Ok(config) = resolve(Some("dqn"), None, &[text.to_owned()], None)
    {
        is_read_again(&config);
    }
});
