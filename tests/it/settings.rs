//! Settings from presets, files and flags.

use cpp_rl::agent::config;
use cpp_rl::config::preset_names;
use proptest::prelude::*;

use crate::sandbox::Sandbox;

#[test]
fn what_a_config_writes_it_reads() {
    let sandbox = Sandbox::new();
    let changed = ["num_envs=3".to_owned(), "hidden=[7, 5]".to_owned(), "learning_rate=1.25e-7".to_owned()];
    for preset in preset_names() {
        for sets in [&[][..], &changed] {
            let config = config::resolve(Some(preset), None, sets, None).expect("a preset is valid");
            sandbox.write("config.yaml", config.to_yaml());
            let read = config::resolve(None, Some(&sandbox.path("config.yaml")), &[], None).expect("what we wrote");
            assert_eq!(read, config, "{preset}");
            let sets: Vec<String> = config.to_json().iter().map(|(key, value)| format!("{key}={value}")).collect();
            assert_eq!(config::resolve(None, None, &sets, None).expect("what we wrote"), config, "{preset}");
        }
    }
}

#[test]
fn later_layers_win() {
    let sandbox = Sandbox::new();
    sandbox.write("file.yaml", "extends: ppo-eps\ngamma: 0.5\nclip_range: 0.1\n");
    let sets = ["gamma=0.25".to_owned(), "gamma=0.75".to_owned()];
    let config = config::resolve(None, Some(&sandbox.path("file.yaml")), &sets, None).expect("valid");
    let json = config.to_json();
    assert_eq!((json["gamma"].as_f64(), json["clip_range"].as_f64()), (Some(0.75), Some(0.1)));
    assert_eq!((json["adam_eps"].as_f64(), json["gae_lambda"].as_f64()), (Some(1e-8), Some(0.95)));
    assert_eq!(config.name, "ppo-eps");
}

#[test]
fn whole_numbers_may_be_written_as_floats() {
    for text in ["timesteps=5e5", "timesteps=500000.0", "timesteps=500000"] {
        let config = config::resolve(Some("ppo"), None, &[text.to_owned()], None).expect("valid");
        assert_eq!(config.shared.timesteps, 500_000, "{text}");
    }
    assert!(config::resolve(Some("ppo"), None, &["timesteps=0.5".to_owned()], None).is_err());
}

#[test]
fn deep_nesting_is_refused() {
    let sandbox = Sandbox::new();
    let nested = |depth| format!("gamma: {}{}\n", "[".repeat(depth), "]".repeat(depth));
    for depth in [100, 100_000] {
        sandbox.write("nested.yaml", nested(depth));
        assert!(config::resolve(Some("ppo"), Some(&sandbox.path("nested.yaml")), &[], None).is_err());
        assert!(config::resolve(Some("ppo"), None, &[format!("gamma={}", "[".repeat(depth))], None).is_err());
    }
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

    /// Whatever a file holds, resolving ends, and with words about that file where it does not succeed.
    #[test]
    fn any_file_is_taken_or_refused(bytes in prop_oneof![
        prop::collection::vec(any::<u8>(), 0..200),
        "[a-z_:\\[\\]{}&*!|>'\"#%@,.0-9 \n-]{0,200}".prop_map(String::into_bytes),
        "(extends: ppo\n)?(gamma|hidden|l2|name|timesteps): [-a-z0-9.e\\[\\], ]{0,12}\n".prop_map(String::into_bytes),
    ]) {
        let sandbox = tempfile::tempdir().expect("a temporary folder");
        let path = sandbox.path().join("config.yaml");
        std::fs::write(&path, bytes).expect("writable");
        match config::resolve(Some("ppo"), Some(&path), &[], None) {
            Ok(config) => prop_assert!(["ppo", "dqn"].contains(&config.algorithm.name())),
            Err(error) => prop_assert!(error.to_string().contains("config.yaml")),
        }
    }

    /// As above, for `--set`; what is taken is written and read again as the same settings.
    #[test]
    fn any_flag_is_taken_or_refused(text in prop_oneof![
        any::<String>(),
        "(gamma|hidden|l2|l2_coef|name|timesteps|clip_range|kernel|engine)=[-a-z0-9.e\\[\\], ]{0,12}",
        (r"timesteps=|hidden=\[|gamma=0\.", any::<u64>()).prop_map(|(key, n)| format!("{key}{n}")),
    ]) {
        match config::resolve(Some("ppo"), None, std::slice::from_ref(&text), None) {
            Err(error) => prop_assert!(!error.to_string().is_empty()),
            Ok(config) => {
                let sets: Vec<String> =
                    config.to_json().iter().map(|(key, value)| format!("{key}={value}")).collect();
                prop_assert_eq!(config::resolve(None, None, &sets, None).expect("what we wrote"), config);
            }
        }
    }
}

/// A method that the command line lists brings its settings above a complete file; but not above those of its own file.
#[test]
fn a_listed_mitigation_stands_above_a_file() {
    let sandbox = Sandbox::new();
    let plain = sandbox.succeeds("config show --algo ppo").stdout;
    sandbox.write("plain.yaml", &plain);
    let above =
        sandbox.succeeds("config show --config plain.yaml --set mitigations=[equal-betas,entropy-bonus]").stdout;
    assert!(above.contains("adam_beta2: 0.99 ") && above.contains("ent_coef: 0.1 "), "{above}");
    let own = above.replace("ent_coef: 0.1 ", "ent_coef: 0.3 ");
    sandbox.write("own.yaml", &own);
    assert_eq!(sandbox.succeeds("config show --config own.yaml").stdout, own);
}
