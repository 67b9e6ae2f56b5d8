//! Agents that do not see the whole map: they train, go on and are evaluated with their own sensor.

use coverage_env::Level;
use coverage_env::sensor::SENSORS;
use cpp_rl::run::checkpoint::Checkpoint;
use rustix::process::Signal;

use crate::sandbox::{RunFiles, Sandbox};
use crate::stops::{command, runs, stop_within};

/// Observations, rollouts, the replay buffer and measures: if one of them forgot the sensor, its bytes would differ.
#[test]
fn a_stopped_run_goes_on_with_its_sensor() {
    for algo in ["ppo", "dqn"] {
        for sensor in SENSORS.iter().skip(1).map(|sensor| sensor.name()) {
            let sandbox = Sandbox::new();
            let command =
                |out| format!("{} --seeds 0..2 --set sensor={sensor} --plasticity-interval 9000", command(algo, out));
            sandbox.succeeds(&command("whole"));
            let [stopped, whole] = ["stopped", "whole"].map(|out| runs(&sandbox, algo, out));
            stop_within(&sandbox, &command("stopped"), &stopped[0], Signal::TERM);
            let printed = sandbox.succeeds(&format!("{} --resume", command("stopped")));
            assert!(printed.stderr.contains("seed 0 goes on after"), "{}", printed.stderr);
            for (stopped, whole) in stopped.iter().zip(&whole) {
                stopped.reproducible().assert_same(&whole.reproducible());
                assert_eq!(stopped.text("plasticity.csv"), whole.text("plasticity.csv"));
            }
        }
    }
}

#[test]
fn an_extended_training_goes_on_with_its_sensor() {
    for sensor in SENSORS.iter().skip(1).map(|sensor| sensor.name()) {
        let sandbox = Sandbox::new();
        let train = |out: &str, timesteps: u32, options: &str| {
            let command = "train --config ppo.yaml --level c.yaml";
            sandbox.succeeds(&format!("{command} --set sensor={sensor} --timesteps {timesteps} --out {out} {options}"));
            RunFiles(sandbox.path(out).join("ppo/level-c/seed-0"))
        };
        train("extended", 256, "");
        let extended = train("extended", 640, "--resume");
        extended.reproducible().assert_same(&train("whole", 640, "").reproducible());
        let other = "train --config ppo.yaml --level c.yaml --timesteps 640 --out extended --resume";
        let error = sandbox.fails(2, other);
        assert!(error.contains(&format!("sensor: \"{sensor}\" → \"full\"")), "{error}");
    }
}

#[test]
fn a_checkpoint_is_evaluated_with_its_sensor() {
    let sandbox = Sandbox::new();
    for algo in ["ppo", "dqn"] {
        for sensor in SENSORS {
            let (name, out) = (sensor.name(), sensor.name());
            let command = format!("train --config {algo}.yaml --level c.yaml --timesteps 3000 --out {out}");
            sandbox.succeeds(&format!("{command} --set sensor={name}"));
            let run = RunFiles(sandbox.path(out).join(algo).join("level-c/seed-0"));
            let file = run.0.join("checkpoints/stage-0.safetensors");
            let checkpoint = Checkpoint::read(&file).expect("a checkpoint");
            let level = Level::resolve(&sandbox.path("c.yaml").display().to_string()).expect("a level");
            assert_eq!((checkpoint.sensor.name(), checkpoint.network.num_inputs()), (name, sensor.inputs(&level)));

            let found = sandbox.json(&format!("eval {} --levels c.yaml --max-steps 20", file.display()));
            let episodes = found["levels"][0]["episodes"].as_array().expect("episodes");
            let expected: Vec<String> = run.text("evaluations.csv").lines().map(str::to_owned).collect();
            let expected: Vec<&str> =
                expected.iter().filter_map(|row| row.strip_prefix("after,0,c,")?.strip_suffix(",greedy")).collect();
            let row = |episode: &serde_json::Value| {
                let [start, length] = [&episode["start"], &episode["length"]];
                format!("{} {},{},{length},{}", start[0], start[1], episode["return"], episode["solved"])
            };
            assert_eq!(episodes.iter().map(row).collect::<Vec<_>>(), expected);
        }
    }
    let agent = |sensor: &str| format!("{sensor}/ppo/level-c/seed-0/checkpoints/stage-0.safetensors");
    let error = sandbox.fails(2, &format!("eval {} --levels narrow.yaml", agent("full")));
    assert!(error.contains("was trained on 3×4 maps"), "{error}");
    // The cells around the agent are as many on every map.
    sandbox.succeeds(&format!("eval {} --levels narrow.yaml", agent("local")));
}

#[test]
fn an_unknown_sensor_is_refused_by_name() {
    let sandbox = Sandbox::new();
    let error = sandbox.fails(2, "train --config ppo.yaml --level c.yaml --set sensor=radar");
    let names: Vec<&str> = SENSORS.iter().map(|sensor| sensor.name()).collect();
    assert!(error.contains(&format!("sensor: expected one of {}, got \"radar\"", names.join(", "))), "{error}");
}
