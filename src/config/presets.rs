//! The presets in `configs/`, built into the binary so that no file is needed.

/// Every preset: its name and the text of its file.
pub const PRESETS: &[(&str, &str)] = &[
    ("dqn", include_str!("../../configs/dqn.yaml")),
    ("ppo", include_str!("../../configs/ppo.yaml")),
    ("ppo-eps", include_str!("../../configs/ppo-eps.yaml")),
    ("ppo-l2", include_str!("../../configs/ppo-l2.yaml")),
    ("ppo-l2-dohare", include_str!("../../configs/ppo-l2-dohare.yaml")),
    ("ppo-l2-dohare-1e-4", include_str!("../../configs/ppo-l2-dohare-1e-4.yaml")),
    ("ppo-l2-dohare-1e-5", include_str!("../../configs/ppo-l2-dohare-1e-5.yaml")),
    ("ppo-l2-dohare-1e-6", include_str!("../../configs/ppo-l2-dohare-1e-6.yaml")),
];

/// The names of all presets.
pub fn preset_names() -> impl Iterator<Item = &'static str> {
    PRESETS.iter().map(|(name, _)| *name)
}

/// The text of a preset's file.
pub(super) fn preset(name: &str) -> Option<&'static str> {
    PRESETS.iter().find(|(preset, _)| *preset == name).map(|(_, text)| *text)
}
