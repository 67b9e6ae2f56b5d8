//! What can befall a run: signals, damaged files, a full disk, a clock that errs. docs/reliability.md lists these tests.

use std::fs;
use std::path::Path;
use std::process::Command;
use std::time::{Duration, SystemTime};

use rustix::process::Signal;
use serde_json::json;

use crate::arbitrary::with_header;
use crate::sandbox::{PROGRAM, Reproducible, RunFiles, Sandbox, engines};
use crate::stops::{Training, command, command_of, runs, snapshots, stop_within, undisturbed};

/// A run that was stopped in its second stage, the command that goes on with it, and what it must end with.
fn stopped(sandbox: &Sandbox, algo: &str) -> (RunFiles, String) {
    let command = format!("{} --seeds 0", command(algo, "stopped"));
    let [run, _] = runs(sandbox, algo, "stopped");
    stop_within(sandbox, &command, &run, Signal::TERM);
    (run, format!("{command} --resume"))
}

/// A training of one level that was stopped, the command that goes on with it, and what it must end with.
fn stopped_train(sandbox: &Sandbox) -> (RunFiles, String, Reproducible) {
    let command = |out: &str| {
        let options = "--level a.yaml --timesteps 60000 --checkpoint-updates 1";
        (
            format!("train --config dqn.yaml {options} --out {out}"),
            RunFiles(sandbox.path(out).join("dqn/level-a/seed-0")),
        )
    };
    let (whole, run) = command("whole");
    sandbox.succeeds(&whole);
    let expected = run.reproducible();
    let (command, run) = command("stopped");
    stop_within(sandbox, &command, &run, Signal::TERM);
    (run, format!("{command} --resume"), expected)
}

#[test]
fn a_signal_saves_and_says_how_to_go_on() {
    let sandbox = Sandbox::new();
    let expected = undisturbed(&sandbox, "ppo");
    for (signal, out) in [(Signal::INT, "int"), (Signal::TERM, "term"), (Signal::USR1, "usr1")] {
        let runs = runs(&sandbox, "ppo", out);
        let command = format!("{} --seeds 0..2 --jobs 1", command("ppo", out));
        let output = stop_within(&sandbox, &command, &runs[0], signal);
        let stderr = String::from_utf8_lossy(&output.stderr);
        assert!(stderr.contains("1 seed saved in") && stderr.contains("1 not begun"), "{stderr}");
        assert_eq!(runs[0].manifest()["status"], json!({ "state": "interrupted" }));
        assert!(!runs[1].0.exists(), "a seed that waits is not begun");

        let (_, line) = stderr.split_once("go on with\n").expect("the command line");
        let again = Command::new("sh").args(["-c", line.trim()]).current_dir(sandbox.path(".")).output();
        assert!(again.expect("there is a shell").status.success(), "{line}");
        runs.iter().zip(&expected).for_each(|(run, expected)| run.reproducible().assert_same(expected));
    }
}

#[test]
fn a_second_signal_ends_at_once() {
    let sandbox = Sandbox::new();
    let train = |out: &str| {
        // Its few updates are long: the first signal alone would save at the end of one.
        let options = "--timesteps 1280 --set n_epochs=1000 --checkpoint-updates 1";
        format!("train --config ppo.yaml --level a.yaml {options} --out {out}")
    };
    let run = |out: &str| RunFiles(sandbox.path(out).join("ppo/level-a/seed-0"));
    sandbox.succeeds(&train("whole"));
    let mut training = Training::begin(&sandbox, &format!("{} --verbose", train("stopped")));
    (0..2).for_each(|_| _ = training.next_save(&run("stopped")));
    // Of different kinds, since two of one kind can be delivered as one.
    training.send_at_once(&[Signal::TERM, Signal::INT]);
    let output = training.output();
    let stderr = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(130), "{stderr}");
    // One signal alone ends with the same code, but first it saves.
    assert!(!stderr.contains("saved in"), "{stderr}");
    assert_eq!(run("stopped").manifest()["status"], json!({ "state": "running" }));
    sandbox.succeeds(&format!("{} --resume", train("stopped")));
    run("stopped").reproducible().assert_same(&run("whole").reproducible());
}

/// Flips a bit in the midst of a file.
fn flip(path: &Path) {
    let mut bytes = fs::read(path).expect("a file");
    let at = bytes.len() / 2;
    bytes[at] ^= 4;
    fs::write(path, bytes).expect("writable");
}

/// Cuts a file to half its length.
fn cut(path: &Path) {
    let bytes = fs::read(path).expect("a file");
    fs::write(path, &bytes[..bytes.len() / 2]).expect("writable");
}

fn empty(path: &Path) {
    fs::write(path, "").expect("writable");
}

fn remove(path: &Path) {
    fs::remove_file(path).expect("writable");
}

#[test]
fn a_damaged_snapshot_is_passed_over_for_the_one_before() {
    let sandbox = Sandbox::new();
    let [expected, _] = undisturbed(&sandbox, "dqn");
    let (run, resume) = stopped(&sandbox, "dqn");
    let latest = run.0.join("checkpoints/latest");
    let [before, last] = <[String; 2]>::try_from(snapshots(&run)).expect("two are kept");
    flip(&latest.join(&last));
    let printed = sandbox.succeeds(&resume);
    assert!(printed.stderr.contains(&format!("latest/{last}: its checksum does not fit")), "{}", printed.stderr);
    let from = before.trim_end_matches(".safetensors");
    assert!(printed.stderr.contains(&format!("goes on after {from} timesteps")), "{}", printed.stderr);
    run.reproducible().assert_same(&expected);

    // With both damaged, the stage begins again.
    fs::remove_dir_all(sandbox.path("stopped")).expect("writable");
    let (run, resume) = stopped(&sandbox, "dqn");
    snapshots(&run).iter().for_each(|name| cut(&run.0.join("checkpoints/latest").join(name)));
    let printed = sandbox.succeeds(&resume);
    assert!(printed.stderr.contains("goes on after 30000 timesteps"), "{}", printed.stderr);
    run.reproducible().assert_same(&expected);
}

/// Where nothing but the beginning was saved before them, damaged snapshots are kept all the same.
#[test]
fn a_run_whose_snapshots_are_all_damaged_begins_anew() {
    let sandbox = Sandbox::new();
    let (run, resume, expected) = stopped_train(&sandbox);
    let names = snapshots(&run);
    names.iter().for_each(|name| cut(&run.0.join("checkpoints/latest").join(name)));
    let printed = sandbox.succeeds(&resume);
    for name in names {
        let kept = format!("checkpoints/latest/{name}.damaged");
        let says =
            format!("the run starts from its beginning, and the file is kept as stopped/dqn/level-a/seed-0/{kept}");
        assert!(printed.stderr.contains(&says), "{}", printed.stderr);
        assert!(run.0.join(kept).exists());
    }
    run.reproducible().assert_same(&expected);
}

/// To go on from an older state, or from the beginning, would be to throw a good snapshot away.
#[test]
fn a_snapshot_that_may_be_good_is_never_passed_over() {
    let sandbox = Sandbox::new();
    let (run, resume, expected) = stopped_train(&sandbox);
    let copy = sandbox.path("copy");
    duplicate(&run.0, &copy);
    let latest = run.0.join("checkpoints/latest");
    let last = snapshots(&run).pop().expect("two are kept");
    let hindrances: [(&str, &dyn Fn()); 4] = [
        ("progress.csv was damaged or edited; put it back as it was, or move", &|| {
            let path = run.0.join("progress.csv");
            fs::write(path, run.text("progress.csv").replace('\n', "\r\n")).expect("writable");
        }),
        ("it is not a file; make it readable, or move", &|| {
            remove(&latest.join(&last));
            fs::create_dir(latest.join(&last)).expect("writable");
        }),
        ("checkpoint format 2; this version of cpp-rl reads format 1; continue it with the version", &|| {
            let path = latest.join(&last);
            fs::write(&path, with_header(&fs::read(&path).expect("a file"), "format", 2)).expect("writable");
        }),
        ("999999999.safetensors: not a snapshot that this run wrote", &|| {
            fs::rename(latest.join(&last), latest.join("999999999.safetensors")).expect("writable");
        }),
    ];
    for (says, hinder) in hindrances {
        hinder();
        let before = contents(&run);
        let error = sandbox.fails(2, &resume);
        assert!(error.contains(says), "{error}");
        assert!(contents(&run) == before, "{says}: nothing changes");
        fs::remove_dir_all(&run.0).expect("writable");
        duplicate(&copy, &run.0);
    }
    sandbox.succeeds(&resume);
    run.reproducible().assert_same(&expected);
}

/// The files of a run, by name.
fn contents(run: &RunFiles) -> Vec<(String, Vec<u8>)> {
    run.files().into_iter().map(|name| (name.clone(), run.bytes(&name))).collect()
}

/// Whatever file is damaged, however: the run ends as it should, or the file is named and nothing is lost.
#[test]
fn damage_to_any_file_is_mended_or_named() {
    let sandbox = Sandbox::new();
    let [expected, _] = undisturbed(&sandbox, "dqn");
    let (run, resume) = stopped(&sandbox, "dqn");
    assert_eq!(run.files().len(), 9, "{:?}", run.files());
    damage_each_file(&sandbox, &run, &resume, &expected);
}

/// The first stage has no end of another to fall back on.
#[test]
fn damage_to_any_file_of_a_first_stage_is_mended_or_named() {
    let sandbox = Sandbox::new();
    let (run, resume, expected) = stopped_train(&sandbox);
    damage_each_file(&sandbox, &run, &resume, &expected);
}

fn damage_each_file(sandbox: &Sandbox, run: &RunFiles, resume: &str, expected: &Reproducible) {
    let copy = RunFiles(sandbox.path("copy"));
    duplicate(&run.0, &copy.0);
    let files = contents(run);
    for (name, content) in &files {
        for (how, damage) in [("flip", flip as fn(&Path)), ("cut", cut), ("empty", empty), ("remove", remove)] {
            fs::remove_dir_all(&run.0).expect("writable");
            duplicate(&copy.0, &run.0);
            damage(&run.0.join(name));
            let output = sandbox.command(resume).output().expect("it starts");
            let stderr = String::from_utf8_lossy(&output.stderr);
            assert!(!stderr.contains("panicked"), "{how} {name}: {stderr}");
            // The manifest cannot be replaced, nor what the logs and evaluations said.
            let needed = !name.starts_with("checkpoints/") && name != "config.yaml";
            assert_eq!(output.status.success(), !needed, "{how} {name}: {stderr}");
            if needed {
                let stem = name.rsplit('/').next().expect("a name");
                assert_eq!(output.status.code(), Some(2), "{how} {name}: {stderr}");
                assert!(stderr.contains(stem), "{how} {name}: {stderr}");
                for (other, content) in files.iter().filter(|(other, _)| other != name) {
                    assert!(run.bytes(other) == *content, "{how} {name}: {other} is lost");
                }
                continue;
            }
            if name == "checkpoints/stage-0.safetensors" {
                // A finished stage's file is not needed to go on; it is told of, and stays as it is.
                assert!(stderr.contains("stage-0.safetensors"), "{how}: {stderr}");
                fs::write(run.0.join(name), content).expect("writable");
            }
            run.reproducible().assert_same(expected);
        }
    }
}

fn duplicate(from: &Path, to: &Path) {
    fs::create_dir_all(to).expect("writable");
    for entry in fs::read_dir(from).expect("a folder") {
        let entry = entry.expect("an entry");
        let to = to.join(entry.file_name());
        if entry.path().is_dir() {
            duplicate(&entry.path(), &to);
        } else {
            fs::copy(entry.path(), to).expect("writable");
        }
    }
}

/// Files may grow to a limit and no further, as on a full disk; the largest log hits it in mid-stage.
#[cfg(target_os = "linux")]
#[test]
fn a_full_disk_ends_in_an_error_and_the_run_goes_on_later() {
    let sandbox = Sandbox::new();
    let [expected, _] = undisturbed(&sandbox, "ppo");
    let [run, _] = runs(&sandbox, "ppo", "full");
    let command = format!("{} --seeds 0", command("ppo", "full"));
    // 64 blocks of 512 bytes.
    let script = format!("ulimit -f 64; exec {} \"$@\"", PROGRAM);
    let mut limited = Command::new("sh");
    limited.args(["-c", &script, "sh"]).args(command.split(' ')).current_dir(sandbox.path("."));
    let output = limited.output().expect("there is a shell");
    let stderr = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(1), "{stderr}");
    assert!(stderr.contains("seed 0 failed: cannot write") && stderr.contains("tb/events"), "{stderr}");
    assert_eq!(run.manifest()["status"]["state"], "failed");
    sandbox.succeeds(&format!("{command} --resume"));
    run.reproducible().assert_same(&expected);
}

#[cfg(unix)]
#[test]
fn a_folder_without_permission_is_named() {
    use std::os::unix::fs::PermissionsExt;
    let sandbox = Sandbox::new();
    let allow = |folder: &Path, mode| fs::set_permissions(folder, fs::Permissions::from_mode(mode)).expect("ours");
    let closed = sandbox.path("closed");
    fs::create_dir(&closed).expect("writable");
    allow(&closed, 0o500);
    if fs::write(closed.join("probe"), "").is_ok() {
        eprintln!("skipped, nothing is tested: this user (root?) may write anywhere");
        return;
    }
    let (run, resume) = stopped(&sandbox, "ppo");
    let latest = run.0.join("checkpoints/latest");
    allow(&latest, 0o500);
    let error = sandbox.fails(1, &resume);
    assert!(error.contains("checkpoints/latest") && error.contains("ermission denied"), "{error}");
    allow(&latest, 0o700);
    sandbox.succeeds(&resume);
}

#[test]
fn a_clock_that_goes_backwards_changes_nothing() {
    let sandbox = Sandbox::new();
    let [expected, _] = undisturbed(&sandbox, "ppo");
    let (run, resume) = stopped(&sandbox, "ppo");
    // As if the clock had been centuries ahead.
    run.rewrite_manifest(|manifest| {
        for key in ["started", "updated"] {
            manifest[key] = "2999-01-01T00:00:00Z".into();
        }
        manifest["starts"][0]["time"] = "2999-01-01T00:00:00Z".into();
    });
    let later = SystemTime::now() + Duration::from_secs(30_000_000_000);
    for name in run.files() {
        let file = fs::File::options().append(true).open(run.0.join(name)).expect("a file");
        file.set_modified(later).expect("ours");
    }
    sandbox.succeeds(&resume);
    run.reproducible().assert_same(&expected);
}

#[test]
fn an_older_manifest_is_read_and_a_newer_one_refused() {
    let sandbox = Sandbox::new();
    let train = "train --config ppo.yaml --level a.yaml";
    sandbox.succeeds(train);
    let run = sandbox.run("train/ppo/level-a/seed-0");
    run.rewrite_manifest(|manifest| {
        for key in ["starts", "marks"] {
            manifest.as_object_mut().expect("an object").remove(key);
        }
    });
    sandbox.succeeds(&format!("{train} --resume"));
    sandbox.succeeds("eval runs/train/ppo/level-a/seed-0");
    run.rewrite_manifest(|manifest| manifest["format"] = 3.into());
    assert!(sandbox.fails(2, &format!("{train} --resume")).contains("manifest format 3"));
}

/// Format 1 has `kernel`, which is `fused` or `autograd`.
#[test]
fn a_run_with_a_manifest_of_format_1_goes_on() {
    let sandbox = Sandbox::new();
    for &engine in engines() {
        let kernel = if engine == "libtorch" { "autograd" } else { engine };
        let command = format!("{} --set kernel={kernel} --seeds 0", command_of("ppo", kernel, 256));
        sandbox.succeeds(&command);
        let [run, _] = runs(&sandbox, "ppo", kernel);
        let expected = run.reproducible();
        run.unfinish(1);
        run.rewrite_manifest(|manifest| {
            let fields = manifest.as_object_mut().expect("an object");
            assert_eq!(fields.remove("engine"), Some(json!(engine)));
            fields.insert("kernel".to_owned(), json!(kernel));
            fields.insert("format".to_owned(), json!(1));
        });
        sandbox.succeeds(&format!("{command} --resume"));
        run.reproducible().assert_same(&expected);
        let manifest = run.manifest();
        assert_eq!((&manifest["format"], &manifest["engine"]), (&json!(2), &json!(engine)));
        assert_eq!(manifest["kernel"], json!(null));
    }
}

#[test]
fn checkpoints_without_a_manifest_are_not_overwritten() {
    let sandbox = Sandbox::new();
    let (run, resume) = stopped(&sandbox, "ppo");
    let before = run.bytes("checkpoints/stage-0.safetensors");
    remove(&run.0.join("manifest.json"));
    assert!(sandbox.fails(2, &resume).contains("holds checkpoints but no manifest.json"));
    assert!(run.bytes("checkpoints/stage-0.safetensors") == before);
}

/// The longer form is for the shell: `scripts/torture`.
#[test]
fn the_torture_script_finds_no_difference() {
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("scripts/torture");
    let mut torture = Command::new("python3");
    torture.arg(script).args(["--cycles", "15", "--num-seeds", "2", "--timesteps", "4096", "--levels", "0..2"]);
    match torture.args(["--bin", PROGRAM]).output() {
        Err(error) => eprintln!("skipped: there is no python3 ({error})"),
        Ok(output) => {
            let stdout = String::from_utf8_lossy(&output.stdout);
            assert!(output.status.success(), "{stdout}{}", String::from_utf8_lossy(&output.stderr));
            assert!(stdout.contains(" 0 problems"), "{stdout}");
        }
    }
}
