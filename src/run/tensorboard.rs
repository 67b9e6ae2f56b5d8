//! What TensorBoard shows of a run: the columns of the other logs, distributions, evaluations and the settings.
//!
//! Steps are the timesteps of all stages, so that the stages of a curriculum stand one after another.

use event_file::{HParam, HParams, SessionStatus};
use serde_json::Value;

use super::manifest::Manifest;
use crate::measure::probe::Measurement;
use crate::results::{LevelResult, Policy, mean_std};

/// The metrics of the HParams tab, which every run has.
const METRICS: [&str; 2] = ["rollout/ep_rew_mean", "evaluation/mean_return"];

/// The beginning of the file: the settings, the seed and the stages.
pub(super) fn beginning(manifest: &Manifest) -> Vec<u8> {
    let stages: Vec<&str> = manifest.stages.iter().map(|stage| stage.level.as_str()).collect();
    let own = [
        ("seed", HParam::Number(manifest.seed as f64)),
        ("arm", HParam::Text(manifest.arm.clone())),
        ("curriculum", HParam::Text(manifest.curriculum.clone())),
        ("stages", HParam::Text(stages.join(", "))),
    ];
    let settings = manifest.config.iter().map(|(key, value)| (key.as_str(), hparam(value)));
    let values: Vec<(&str, HParam)> = own.into_iter().chain(settings).collect();
    // Runs of one group are shown as one row.
    let group = format!("{}/{}", manifest.arm, manifest.curriculum);
    let now = wall_time();
    let hparams = HParams { group: &group, values: &values, metrics: &METRICS };
    [event_file::file_version(now), event_file::hparams(now, &hparams)].concat()
}

fn hparam(value: &Value) -> HParam {
    match value {
        Value::Bool(truth) => HParam::Bool(*truth),
        Value::Number(number) => number.as_f64().map_or_else(|| HParam::Text(number.to_string()), HParam::Number),
        Value::String(text) => HParam::Text(text.clone()),
        other => HParam::Text(other.to_string()),
    }
}

/// A row of `progress.csv`. What the clock says is a record of its own: all others are the same in every repetition of
/// the run, their times aside.
pub(super) fn progress<'a>(cumulative: u64, fps: f64, metrics: impl Iterator<Item = (&'a str, f64)>) -> Vec<u8> {
    let now = wall_time();
    let metrics: Vec<(&str, f64)> = metrics.collect();
    let clock = event_file::scalars(cumulative, now, &[("time/fps", fps)]);
    [event_file::scalars(cumulative, now, &metrics), clock].concat()
}

/// A row of `plasticity.csv`, and distributions.
pub(super) fn plasticity(cumulative: u64, measurement: &Measurement) -> Vec<u8> {
    let now = wall_time();
    let measures: Vec<(&str, f64)> = measurement.measures.iter().map(|(name, value)| (name.as_str(), *value)).collect();
    let distributions: Vec<(&str, &[f32])> =
        measurement.distributions.iter().map(|(name, values)| (name.as_str(), values.as_slice())).collect();
    let scalars = event_file::scalars(cumulative, now, &measures);
    [scalars, event_file::histograms(cumulative, now, &distributions)].concat()
}

/// Evaluations after a stage, of all levels: of each one's mean return, the share of start cells solved, and the mean over the
/// levels; those of the sampled policy likewise.
pub(super) fn evaluation(cumulative: u64, results: &[(Policy, LevelResult)]) -> Vec<u8> {
    let over_levels = |policy: Policy| {
        let means: Vec<f64> = results.iter().filter(|(of, _)| *of == policy).map(|(_, result)| result.mean).collect();
        (format!("evaluation/{}mean_return", prefix(policy)), mean_std(&means).0)
    };
    let mut values = Policy::ALL.map(over_levels).to_vec();
    values.extend(of_levels("evaluation", results));
    scalars(cumulative, &values)
}

/// Evaluations in the midst of a stage.
pub(super) fn learning(cumulative: u64, results: &[(Policy, LevelResult)]) -> Vec<u8> {
    scalars(cumulative, &of_levels("learning", results))
}

/// Mean return and share of start cells solved of each level, below this tag.
fn of_levels(below: &str, results: &[(Policy, LevelResult)]) -> Vec<(String, f64)> {
    let of_level = |(policy, result): &(Policy, LevelResult)| {
        let tag = |what: &str| format!("{below}/level-{}/{}{what}", result.level, prefix(*policy));
        [(tag("mean_return"), result.mean), (tag("solved_share"), result.solved_share)]
    };
    results.iter().flat_map(of_level).collect()
}

/// What stands before a number's name.
fn prefix(policy: Policy) -> &'static str {
    match policy {
        Policy::Greedy => "",
        Policy::Sampled => "sampled_",
    }
}

fn scalars(cumulative: u64, values: &[(String, f64)]) -> Vec<u8> {
    let values: Vec<(&str, f64)> = values.iter().map(|(name, value)| (name.as_str(), *value)).collect();
    event_file::scalars(cumulative, wall_time(), &values)
}

/// How the run ended.
pub(super) fn end(status: SessionStatus) -> Vec<u8> {
    event_file::session_end(wall_time(), status)
}

/// Seconds since 1970, UTC.
fn wall_time() -> f64 {
    jiff::Timestamp::now().as_microsecond() as f64 / 1e6
}
