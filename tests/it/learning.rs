//! `--evaluate-every`, `--keep-best`, and the returns of the sampled policy.

use std::fs;
use std::os::unix::process::ExitStatusExt;

use coverage_env::random::below;
use cpp_rl::random::{Purpose, Stream};
use cpp_rl::run::checkpoint::Checkpoint;
use rustix::process::Signal;
use serde_json::json;

use crate::sandbox::{RunFiles, Sandbox};
use crate::stops::{Training, command, runs, stop_within};

/// A row of `learning.csv`.
#[derive(Clone, Debug, PartialEq)]
struct Row {
    stage: u16,
    timesteps: u64,
    cumulative: u64,
    level: String,
    policy: String,
    mean: f64,
}

fn rows(run: &RunFiles) -> Vec<Row> {
    let text = run.text("learning.csv");
    let mut lines = text.lines();
    let header = "stage,timesteps,cumulative_timesteps,level,policy,return,return_std,solved_share,length";
    assert_eq!(lines.next(), Some(header));
    let row = |line: &str| {
        let cells: Vec<&str> = line.split(',').collect();
        let [stage, timesteps, cumulative, level, policy, mean, std, solved, length] = cells[..] else {
            panic!("{line}");
        };
        let number = |cell: &str| cell.parse::<f64>().expect("a number");
        assert!(number(std) >= 0.0 && (0.0..=1.0).contains(&number(solved)) && number(length) >= 1.0, "{line}");
        let whole = |cell: &str| cell.parse::<u64>().expect("a whole number");
        Row {
            stage: whole(stage) as u16,
            timesteps: whole(timesteps),
            cumulative: whole(cumulative),
            level: level.to_owned(),
            policy: policy.to_owned(),
            mean: number(mean),
        }
    };
    lines.map(row).collect()
}

/// The first of the rows of a stage with the highest greedy return on its level.
fn best_of<'a>(rows: &'a [Row], stage: u16, level: &str) -> &'a Row {
    let of_stage = rows.iter().filter(|row| row.stage == stage && row.level == level && row.policy == "greedy");
    of_stage.reduce(|best, row| if row.mean > best.mean { row } else { best }).expect("a row")
}

fn best(run: &RunFiles, stage: u16) -> Checkpoint {
    Checkpoint::read(&run.0.join(format!("checkpoints/best-{stage}.safetensors"))).expect("a whole checkpoint")
}

#[test]
fn evaluations_in_the_midst_of_stages_change_nothing_else() {
    let sandbox = Sandbox::new();
    for algo in ["ppo", "dqn"] {
        let command = format!("curriculum --config {algo}.yaml --levels a.yaml,b.yaml --timesteps 5000 --seeds 1");
        let train = |out: &str, options: &str| {
            sandbox.succeeds(&format!("{command} --out {out} {options}"));
            RunFiles(sandbox.path(out).join(algo).join("curriculum/seed-1"))
        };
        let without = train("without", "");
        let with =
            train("with", "--evaluate-every 1000 --evaluate-levels b,a.yaml --keep-best --plasticity-interval 0");
        without.reproducible().assert_same(&with.reproducible());
        assert_eq!(
            (&with.manifest()["evaluate_every"], &without.manifest()["evaluate_every"]),
            (&json!(1000), &json!(0))
        );
        assert!(!without.0.join("learning.csv").exists());

        // PPO's updates here have 64 timesteps, and DQN's 2,048; a stage of 5,000 ends at the first at or past it.
        let expected: &[u64] = if algo == "ppo" { &[1024, 2048, 3008, 4032, 5056] } else { &[2048, 4096, 5000] };
        let rows = rows(&with);
        let places: Vec<(u16, u64, &str, &str)> =
            rows.iter().map(|row| (row.stage, row.timesteps, row.level.as_str(), row.policy.as_str())).collect();
        let mut wanted = Vec::new();
        for stage in [0, 1] {
            for &timesteps in expected {
                for policy in ["greedy", "sampled"] {
                    wanted.extend(["b", "a"].map(|level| (stage, timesteps, level, policy)));
                }
            }
        }
        assert_eq!(places, wanted);
        let stage_ends = *expected.last().expect("some");
        assert!(rows.iter().all(|row| row.cumulative == u64::from(row.stage) * stage_ends + row.timesteps));
        // What is evaluated at the end of a stage is what is evaluated after it.
        for row in rows.iter().filter(|row| row.timesteps == stage_ends) {
            let text = with.text("evaluations.csv");
            let own = text.lines().filter(|line| {
                line.starts_with(&format!("after,{},{},", row.stage, row.level)) && line.ends_with(&row.policy)
            });
            let returns: Vec<f64> =
                own.map(|line| line.split(',').nth(4).and_then(|cell| cell.parse().ok()).expect("a return")).collect();
            assert!((returns.iter().sum::<f64>() / returns.len() as f64 - row.mean).abs() < 1e-9, "{row:?}");
        }
        // Sampled returns depend neither on the other levels nor on how often agents are evaluated.
        let alone = train("alone", "--evaluate-every 5000");
        let is_own = |row: &&Row| [(0, "a"), (1, "b")].contains(&(row.stage, row.level.as_str()));
        let ends = rows.iter().filter(is_own).filter(|row| row.timesteps == stage_ends).cloned();
        assert_eq!(self::rows(&alone), ends.collect::<Vec<_>>());

        for (stage, level) in [(0, "a"), (1, "b")] {
            let row = best_of(&rows, stage, level);
            let kept = best(&with, stage);
            assert_eq!(kept.agent.counters.timesteps, row.cumulative);
            assert_eq!((kept.origin.stage, kept.origin.level.as_deref()), (Some(stage), Some(level)));
            let file = format!("with/{algo}/curriculum/seed-1/checkpoints/best-{stage}.safetensors");
            let found = sandbox.json(&format!("eval {file} --levels {level}.yaml --max-steps 20"));
            assert_eq!(found["levels"][0]["mean"], json!(row.mean));
        }
    }
}

#[test]
fn levels_to_evaluate_on_are_checked() {
    let sandbox = Sandbox::new();
    let command = "curriculum --config ppo.yaml --levels a.yaml,b.yaml --evaluate-every 64";
    for (spec, says) in
        [("a,nowhere", "nowhere"), ("narrow.yaml", "narrow is 2×3"), ("a,,b", "drop a comma"), ("7", "7")]
    {
        let error = sandbox.fails(2, &format!("{command} --evaluate-levels {spec}"));
        assert!(error.contains("--evaluate-levels: ") && error.contains(says), "{error}");
    }
    let error = sandbox.fails(2, "train --config ppo.yaml --level a.yaml --keep-best");
    assert!(error.contains("--evaluate-every"), "{error}");
    // One that is not trained on is possible; the best agent is that on the level that is trained on.
    sandbox.succeeds("train --config ppo.yaml --level a.yaml --evaluate-every 64 --evaluate-levels c.yaml --keep-best");
    let run = sandbox.run("train/ppo/level-a/seed-0");
    let rows = rows(&run);
    let levels: Vec<&str> = rows.iter().take(4).map(|row| row.level.as_str()).collect();
    assert_eq!(levels, ["c", "a", "c", "a"]);
    assert_eq!(best(&run, 0).agent.counters.timesteps, best_of(&rows, 0, "a").cumulative);
}

/// The files that `--evaluate-every --keep-best` leaves.
fn kept(run: &RunFiles) -> Vec<(String, Vec<u8>)> {
    let names = run.files().into_iter().filter(|name| name.contains("best-") || name == "learning.csv");
    names.map(|name| (name.clone(), run.bytes(&name))).collect()
}

/// Whenever a kill comes: between an evaluation and a snapshot, before a stage's first one, after its best agent.
#[test]
fn killed_and_resumed_it_keeps_the_same_best_agents() {
    let mut random = Stream::new(2, 0, Purpose::EvaluationStarts);
    for (algo, at_most) in [("ppo", 10), ("dqn", 3)] {
        let sandbox = Sandbox::new();
        let command = |out| format!("{} --seeds 0..2 --evaluate-every 300 --keep-best", command(algo, out));
        sandbox.succeeds(&command("whole"));
        let whole = runs(&sandbox, algo, "whole");
        assert_eq!(kept(&whole[0]).len(), 4, "{:?}", whole[0].files());
        for _ in 0..8 {
            let options = format!("--resume --verbose --jobs {}", 1 + below(&mut random, 2));
            let mut training = Training::begin(&sandbox, &format!("{} {options}", command("killed")));
            for _ in 0..=below(&mut random, at_most) {
                training.next_save_of_any();
            }
            training.send(Signal::KILL);
            assert_eq!(training.output().status.signal(), Some(9), "it ended too early");
        }
        sandbox.succeeds(&format!("{} --resume", command("killed")));
        for (run, whole) in runs(&sandbox, algo, "killed").iter().zip(&whole) {
            run.reproducible().assert_same(&whole.reproducible());
            assert!(kept(run) == kept(whole), "{algo}: {:?}", run.files());
        }
    }
}

/// A kill may leave an agent that the log, once cut back, does not know; and somebody may damage or remove one.
#[test]
fn a_best_agent_that_the_log_does_not_know_is_made_again() {
    let sandbox = Sandbox::new();
    let command = |out: &str| format!("{} --seeds 0 --evaluate-every 300 --keep-best", command("ppo", out));
    sandbox.succeeds(&command("whole"));
    let [whole, _] = runs(&sandbox, "ppo", "whole");
    let damages: [&dyn Fn(&RunFiles); 3] = [
        // Of a state that is newer than the one that the run goes on from: that of the stage's end.
        &|run| {
            let newer = fs::read(whole.0.join("checkpoints/stage-1.safetensors")).expect("a checkpoint");
            fs::write(run.0.join("checkpoints/best-1.safetensors"), newer).expect("writable");
        },
        &|run| fs::write(run.0.join("checkpoints/best-1.safetensors"), "").expect("writable"),
        &|run| fs::remove_file(run.0.join("checkpoints/best-1.safetensors")).expect("it was kept"),
    ];
    for (i, damage) in damages.iter().enumerate() {
        let out = format!("stopped-{i}");
        let [run, _] = runs(&sandbox, "ppo", &out);
        stop_within(&sandbox, &command(&out), &run, Signal::TERM);
        damage(&run);
        sandbox.succeeds(&format!("{} --resume", command(&out)));
        run.reproducible().assert_same(&whole.reproducible());
        assert_eq!(run.text("learning.csv"), whole.text("learning.csv"));
        let best_of_stage = best_of(&rows(&run), 1, "b").clone();
        let found = best(&run, 1);
        let row = rows(&run)
            .into_iter()
            .find(|row| (row.cumulative, row.policy.as_str()) == (found.agent.counters.timesteps, "greedy"));
        let row = row.expect("the log knows it");
        assert!(row == best_of_stage || row.timesteps > best_of_stage.timesteps, "{row:?}, {best_of_stage:?}");
    }
}

/// Its file goes on with the columns that it has: a snapshot says how it begins.
#[test]
fn a_run_of_an_earlier_version_goes_on_with_greedy_evaluations() {
    let sandbox = Sandbox::new();
    let command = "curriculum --config ppo.yaml --levels a.yaml,b.yaml";
    sandbox.succeeds(command);
    let run = sandbox.run("curriculum/ppo/curriculum/seed-0");
    let text = run.text("evaluations.csv");
    let old = |text: &str| {
        let lines = text.lines().filter(|line| !line.ends_with(",sampled"));
        lines.map(|line| line.rsplit_once(',').expect("columns").0.to_owned() + "\n").collect::<String>()
    };
    let first = old(text.split("after,1,").next().expect("the beginning"));
    fs::write(run.0.join("evaluations.csv"), &first).expect("writable");
    let mark = json!({ "bytes": first.len(), "crc": crc32fast::hash(first.as_bytes()) });
    run.unfinish(1);
    run.rewrite_manifest(|manifest| manifest["marks"][0]["evaluations.csv"] = mark);
    sandbox.succeeds(&format!("{command} --resume"));
    assert_eq!(run.text("evaluations.csv"), old(&text));
}
