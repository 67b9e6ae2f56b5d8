//! Killed and resumed, a run ends with the same bytes.

use std::fs::{self, File};
use std::process::{Child, Stdio};
use std::thread::sleep;
use std::time::{Duration, Instant};

use crate::sandbox::{Reproducible, RunFiles, Sandbox};

/// Three stages of two seeds.
fn command(algo: &str, out: &str, timesteps: u32) -> String {
    let levels = "--levels a.yaml,b.yaml,c.yaml --seeds 0..2";
    format!("curriculum --config {algo}.yaml {levels} --timesteps {timesteps} --out {out}")
}

/// Timesteps of a stage that is long enough to be killed in its midst.
const LONG: u32 = 30_000;

/// The runs of both seeds.
fn runs(sandbox: &Sandbox, algo: &str, out: &str) -> [RunFiles; 2] {
    [0, 1].map(|seed| RunFiles(sandbox.path(out).join(algo).join("curriculum").join(format!("seed-{seed}"))))
}

fn undisturbed(sandbox: &Sandbox, algo: &str) -> [Reproducible; 2] {
    sandbox.succeeds(&command(algo, "undisturbed", LONG));
    runs(sandbox, algo, "undisturbed").map(|run| run.reproducible())
}

/// Starts training and kills it as soon as `when` holds; says whether it was still running.
fn kill_when(sandbox: &Sandbox, command: &str, mut when: impl FnMut() -> bool) -> bool {
    let mut child = sandbox.command(command).stderr(Stdio::null()).stdout(Stdio::null()).spawn().expect("it starts");
    let deadline = Instant::now() + Duration::from_secs(60);
    while is_running(&mut child) && !when() {
        assert!(Instant::now() < deadline, "what is waited for comes within a minute");
        sleep(Duration::from_millis(1));
    }
    let running = is_running(&mut child);
    // SIGKILL, which no process can put off.
    child.kill().and_then(|()| child.wait()).expect("a child can be killed");
    running
}

fn is_running(child: &mut Child) -> bool {
    child.try_wait().expect("a child can be asked").is_none()
}

#[test]
fn killed_at_several_instants_and_resumed_it_ends_the_same() {
    for algo in ["ppo", "dqn"] {
        let sandbox = Sandbox::new();
        let expected = undisturbed(&sandbox, algo);
        let run = || runs(&sandbox, algo, "killed");
        let resume = format!("{} --resume --jobs 2", command(algo, "killed", LONG));
        let exists = |name: &str| run().iter().any(|run| run.0.join(name).exists());
        let length =
            || run().iter().map(|run| fs::metadata(run.0.join("progress.csv")).map_or(0, |m| m.len())).sum::<u64>();

        // Just begun; in the first stage; between the stages of one seed or the other; in later stages.
        let mut kills = 0;
        kills += u32::from(kill_when(&sandbox, &resume, || exists("manifest.json")));
        kills += u32::from(kill_when(&sandbox, &resume, || length() > 600));
        kills += u32::from(kill_when(&sandbox, &resume, || {
            exists("checkpoints/stage-0.safetensors.partial") || exists("checkpoints/stage-0.safetensors")
        }));
        let before = length();
        kills += u32::from(kill_when(&sandbox, &resume, || length() > before + 900));
        kills += u32::from(kill_when(&sandbox, &resume, || exists("checkpoints/stage-1.safetensors")));
        // A machine that stalls may miss the last ones.
        assert!(kills >= 3, "{algo}: only {kills} kills hit a running training");

        sandbox.succeeds(&resume);
        for (run, expected) in run().iter().zip(&expected) {
            run.reproducible().assert_same(expected);
            assert!(!run.files().iter().any(|file| file.ends_with(".partial")), "{:?}", run.files());
        }
    }
}

#[test]
fn seeds_at_different_stages_go_on_together() {
    let sandbox = Sandbox::new();
    for kernel in ["fused", "autograd"] {
        let command = format!("{} --set kernel={kernel} --jobs 1", command("ppo", kernel, 256));
        sandbox.succeeds(&command);
        let runs = runs(&sandbox, "ppo", kernel);
        let expected = [runs[0].reproducible(), runs[1].reproducible()];
        runs[0].unfinish(1);
        runs[1].unfinish(2);
        sandbox.succeeds(&format!("{command} --resume"));
        // Stacked seeds advance alone here: their numbers differ by rounding, as with any other company.
        if kernel == "fused" {
            runs.iter().zip(&expected).for_each(|(run, expected)| run.reproducible().assert_same(expected));
        }
        assert!(runs.iter().all(|run| run.manifest()["stages_done"] == 3));
    }
}

const SHORT: &str = "curriculum --config ppo.yaml --levels a.yaml,b.yaml";
const RUN: &str = "curriculum/ppo/curriculum/seed-0";

#[test]
fn a_finished_run_stays_as_it_is() {
    let sandbox = Sandbox::new();
    let first = sandbox.succeeds(SHORT);
    let (run, manifest) = (sandbox.run(RUN), sandbox.run(RUN).text("manifest.json"));
    let before = run.reproducible();
    let again = sandbox.succeeds(&format!("{SHORT} --resume"));
    assert_eq!(again.stdout, first.stdout);
    assert!(again.stderr.contains("1 of 1 seeds finished"), "{}", again.stderr);
    run.reproducible().assert_same(&before);
    assert_eq!(run.text("manifest.json"), manifest);
}

#[test]
fn other_settings_are_refused_by_name() {
    let sandbox = Sandbox::new();
    sandbox.succeeds(SHORT);
    let before = sandbox.run(RUN).reproducible();
    let refusals = [
        ("--set gamma=0.5 --set clip_range=0.3", vec!["gamma: 0.99 → 0.5", "clip_range: 0.2 → 0.3"]),
        ("--timesteps 512", vec!["timesteps: 256 → 512", "stages: a × 256, b × 256 → a × 512, b × 512"]),
        ("--levels b.yaml,a.yaml", vec!["stages: a × 256, b × 256 → b × 256, a × 256"]),
        ("--set kernel=autograd", vec!["kernel: fused → autograd"]),
    ];
    for (options, differences) in refusals {
        let levels = if options.contains("--levels") { "" } else { "--levels a.yaml,b.yaml" };
        let error = sandbox.fails(2, &format!("curriculum --config ppo.yaml {levels} --resume {options}"));
        assert!(differences.iter().all(|difference| error.contains(difference)), "{error}");
        assert!(error.contains("--out") && error.contains("seed-0"), "{error}");
    }
    let map = fs::read_to_string(sandbox.path("b.yaml")).expect("text").replace("..#T", "...T");
    sandbox.write("b.yaml", map);
    assert!(sandbox.fails(2, &format!("{SHORT} --resume")).contains("a map has changed"));
    sandbox.run(RUN).reproducible().assert_same(&before);
}

#[test]
fn a_damaged_run_is_refused_in_words() {
    let sandbox = Sandbox::new();
    sandbox.succeeds(SHORT);
    let run = sandbox.run(RUN);
    run.unfinish(1);
    let resume = format!("{SHORT} --resume");
    let path = run.0.join("checkpoints/stage-0.safetensors");
    let whole = fs::read(&path).expect("a checkpoint");

    let mut changed = whole.clone();
    *changed.last_mut().expect("not empty") ^= 1;
    fs::write(&path, &changed).expect("writable");
    let error = sandbox.fails(1, &resume);
    assert!(error.contains("stage-0.safetensors") && error.contains("checksum"), "{error}");

    fs::write(&path, &whole[..whole.len() / 2]).expect("writable");
    let error = sandbox.fails(1, &resume);
    assert!(error.contains("stage-0.safetensors") && error.contains("cut short"), "{error}");

    fs::remove_file(&path).expect("writable");
    let error = sandbox.fails(1, &resume);
    assert!(error.contains("stage-0.safetensors") && error.contains("cannot read the checkpoint"), "{error}");

    fs::write(&path, &whole).expect("writable");
    fs::write(run.0.join("manifest.json"), "{").expect("writable");
    let error = sandbox.fails(2, &resume);
    assert!(error.contains("manifest.json is not a manifest"), "{error}");
}

#[test]
fn a_run_that_another_process_writes_is_refused() {
    let sandbox = Sandbox::new();
    sandbox.succeeds(SHORT);
    let run = sandbox.run(RUN);
    run.unfinish(1);
    let lock = File::options().write(true).open(run.0.join(".lock")).expect("a run has a lock");
    lock.lock().expect("nobody holds it");
    let error = sandbox.fails(2, &format!("{SHORT} --resume"));
    assert!(error.contains("seed-0 is being written by another process") && error.contains("--out"), "{error}");
    drop(lock);
    sandbox.succeeds(&format!("{SHORT} --resume"));
}
