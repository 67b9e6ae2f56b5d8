//! The files of a report, on runs that are written here: every figure drawn, nothing cut off, nothing silently left
//! out.

use std::collections::BTreeMap;
use std::fmt::Write;
use std::fs::{self, File};
use std::io::BufReader;
use std::path::{Path, PathBuf};
use std::process::Command;

use cpp_rl::report::analysis::Analysis;
use cpp_rl::report::exhibits::{self, NamedFigure};
use cpp_rl::report::export;
use cpp_rl::run::manifest::Status;
use scraper::{Html, Selector};
use tempfile::TempDir;

use crate::fakes::{CURRICULUM, FROM_SCRATCH_B, Fake, Skill};
use crate::sandbox::Sandbox;

const FROM_SCRATCH_A: Fake = Fake { levels: &["a"], ..FROM_SCRATCH_B };
/// Columns of `plasticity.csv`: of all parameters, of a hidden layer of each network, and of an output layer.
const MEASURES: [&str; 7] = [
    "grad_norm",
    "policy.0/dormant_0.1",
    "policy.0/dormant_0.1/visited",
    "policy.0/effective_rank",
    "value.0/effective_rank",
    "value.1/weight_magnitude",
    "a_measure_to_come",
];

/// Runs, and the report made of them.
struct Report {
    root: TempDir,
    analysis: Analysis,
}

impl Report {
    fn new(runs: &[Fake]) -> Self {
        Self::altered(runs, |_, _| ())
    }

    /// Of runs whose directories were altered after they were written.
    fn altered(runs: &[Fake], alter: impl Fn(&Fake, &Path)) -> Self {
        let root = TempDir::new().expect("a folder");
        for run in runs {
            alter(run, &run.write(&root.path().join("runs")));
        }
        let analysis = Analysis::read(&[root.path().join("runs")]).expect("runs that can be read");
        let report = Self { root, analysis };
        export::write(&report.analysis, &exhibits::all(&report.analysis), &report.path(""), "cpp-rl compare runs")
            .expect("the folder is writable");
        report.check();
        report
    }

    fn path(&self, name: &str) -> PathBuf {
        self.root.path().join("report").join(name)
    }

    fn html(&self) -> String {
        fs::read_to_string(self.path("report.html")).expect("the page is there")
    }

    fn caption(&self, figure: &str) -> String {
        let all = self.figures();
        all.iter().find(|named| named.name == figure).unwrap_or_else(|| panic!("no figure {figure}")).caption.clone()
    }

    fn names(&self) -> Vec<String> {
        self.figures().into_iter().map(|figure| figure.name).collect()
    }

    fn figures(&self) -> Vec<NamedFigure> {
        let sections = exhibits::sections(&self.analysis, &exhibits::all(&self.analysis));
        sections.into_iter().flat_map(|section| section.figures).collect()
    }

    /// What holds of every report.
    fn check(&self) {
        let names = self.names();
        let files = files(&self.path("figures"));
        assert_eq!(files.len(), 2 * names.len(), "{files:?}");
        for name in &names {
            check_svg(&self.path(&format!("figures/{name}.svg")));
            check_png(&self.path(&format!("figures/{name}.png")));
        }
        let document = Html::parse_document(&self.html());
        assert!(document.errors.is_empty(), "{:?}", document.errors);
        let select = |selector: &str| {
            let selector = Selector::parse(selector).expect("a selector");
            let elements = document.select(&selector);
            elements
                .map(|element| (element.text().collect::<String>(), element.value().attr("href")))
                .collect::<Vec<_>>()
        };
        let headings: Vec<String> = select("h2").into_iter().map(|(text, _)| text).collect();
        let exhibits = exhibits::all(&self.analysis);
        let expected: Vec<&str> = exhibits.iter().map(|exhibit| exhibit.heading()).chain(["Definitions"]).collect();
        assert_eq!(headings, expected);
        assert_eq!(select("svg.chart").len(), names.len());
        assert_eq!(select("script, link, img, iframe").len(), 0, "nothing is loaded or run");
        for (text, href) in select("a") {
            let href = href.expect("a link leads somewhere");
            match href.strip_prefix('#') {
                Some(id) => assert_eq!(select(&format!("[id='{id}']")).len(), 1, "{text}: {href}"),
                None => {
                    let file = href.split('#').next().expect("a path");
                    assert!(self.path(file).is_file(), "{text}: {href}");
                }
            }
        }
    }
}

/// Every file below a folder with its bytes.
fn files(folder: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let mut all = BTreeMap::new();
    for entry in fs::read_dir(folder).expect("a folder") {
        let path = entry.expect("an entry").path();
        if path.is_dir() {
            all.extend(files(&path));
        } else {
            all.insert(path.clone(), fs::read(&path).expect("a file"));
        }
    }
    all
}

fn check_svg(path: &Path) {
    let text = fs::read_to_string(path).expect("the drawing is there");
    let document = roxmltree::Document::parse(&text).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
    assert_eq!(document.root_element().tag_name().name(), "svg");
    assert!(document.descendants().any(|node| node.has_tag_name("desc")));
    for node in document.descendants().flat_map(|node| node.attributes().collect::<Vec<_>>()) {
        assert!(!["NaN", "inf"].iter().any(|text| node.value().contains(text)), "{}: {node:?}", path.display());
    }
}

fn check_png(path: &Path) {
    let file = BufReader::new(File::open(path).expect("the image is there"));
    let mut reader = png::Decoder::new(file).read_info().expect("a PNG");
    let mut pixels = vec![0; reader.output_buffer_size().expect("an image that fits memory")];
    reader.next_frame(&mut pixels).expect("a whole image");
    assert!(reader.info().width > 900, "{}: {} pixels wide", path.display(), reader.info().width);
    assert!(pixels.chunks(4).any(|pixel| pixel != &pixels[..4]), "{} is empty", path.display());
}

/// Writes a log of every measure, a row for the beginning of each stage and for each quarter; the second quarter has NaN.
fn log_plasticity(run: &Fake, path: &Path) {
    let mut text = "stage,level,timesteps,cumulative_timesteps".to_owned();
    MEASURES.iter().for_each(|name| write!(text, ",plasticity/{name}").expect("memory"));
    for (stage, level) in run.levels.iter().enumerate() {
        for quarter in 0..=4 {
            let cumulative = 1000 * stage + 250 * quarter;
            write!(text, "\n{stage},{level},{},{cumulative}", 250 * quarter).expect("memory");
            for (measure, name) in MEASURES.iter().enumerate() {
                let value = (measure + quarter) as f64 + run.seed as f64 / 8.0;
                let is_known = quarter != 2 && (quarter > 0 || *name != "grad_norm");
                let value = if is_known { value } else { f64::NAN };
                write!(text, ",{value}").expect("memory");
            }
        }
    }
    fs::write(path.join("plasticity.csv"), text + "\n").expect("the folder is writable");
}

/// Each of these runs with so many seeds.
fn with_seeds(runs: &[Fake], seeds: u64) -> Vec<Fake> {
    runs.iter().flat_map(|&run| (0..seeds).map(move |seed| Fake { seed, ..run })).collect()
}

#[test]
fn thirty_seeds_of_two_arms_have_every_figure() {
    let dqn = Fake { arm: "dqn", skill: |_, _| Skill::Lost, curve: |_, share| share / 4.0, ..CURRICULUM };
    let report = Report::altered(&with_seeds(&[CURRICULUM, FROM_SCRATCH_A, FROM_SCRATCH_B, dqn], 30), log_plasticity);
    let expected = [
        "levels",
        "learning-curve-dqn",
        "learning-curve-ppo",
        "learning-curves",
        "learning-curves-from-scratch",
        "returns",
        "probability-of-improvement",
        "matrices",
        "continual-learning",
        "forgetting",
        "against-from-scratch-ppo",
        "plasticity-loss",
        "time-to-threshold",
        "plasticity",
        "plasticity-value.0",
        "plasticity-against-from-scratch-ppo",
        "plasticity-weights",
    ];
    assert_eq!(report.names(), expected);
    let caption = report.caption("learning-curves");
    let bands = "30 seeds per arm. Bands: 95% intervals of the mean over seeds, at each point by itself (percentile";
    assert!(caption.contains(bands), "{caption}");
    let svg = |name: &str| fs::read_to_string(report.path(&format!("figures/{name}.svg"))).expect("the drawing");
    for text in ["gradient norm before clipping", "a_measure_to_come", "dormant units", "visited states"] {
        assert!(svg("plasticity").contains(text), "{text}");
    }
    // One value of four is none in every run, for every measure.
    let warnings = &report.analysis.warnings;
    let is_whole = |warning: &&String| MEASURES.iter().all(|name| warning.contains(&format!("plasticity/{name} ")));
    assert_eq!(warnings.iter().filter(is_whole).count(), 120, "{:?}", &warnings[..2]);
    // Thin lines, one per seed and stage, of one arm and of both.
    for (figure, lines) in [("learning-curve-ppo", 60), ("learning-curves", 120), ("learning-curves-from-scratch", 60)]
    {
        assert!(svg(figure).matches("opacity=\"0.35\"").count() >= lines, "{figure}");
    }
    let html = report.html();
    assert!(html.contains("120 runs in 3 arms on 2 levels: a, b."), "the summary");
    assert!(html.contains("Nothing is missing.") && html.contains("<code>cpp-rl compare runs</code>"));
}

#[test]
fn one_seed_has_no_band_and_says_so() {
    let report = Report::new(&[CURRICULUM, FROM_SCRATCH_B]);
    for figure in ["learning-curve-ppo", "against-from-scratch-ppo"] {
        assert!(report.caption(figure).contains("One seed has no band."), "{}", report.caption(figure));
        let svg = fs::read_to_string(report.path(&format!("figures/{figure}.svg"))).expect("the drawing");
        assert!(!svg.contains("opacity=\"0.2\""), "{figure} has a band");
    }
    assert!(report.caption("plasticity-loss").contains("One seed has no interval."));
    assert!(report.html().contains("No run has logged plasticity."));
}

#[test]
fn what_is_missing_is_said() {
    // Level a was trained from scratch with one seed of two, and one curriculum is cut off.
    let cut = Fake { seed: 1, stages_done: 1, ..CURRICULUM };
    let runs = [CURRICULUM, cut, FROM_SCRATCH_A, FROM_SCRATCH_B, Fake { seed: 1, ..FROM_SCRATCH_B }];
    let report = Report::new(&runs);
    let caption = report.caption("learning-curve-ppo");
    assert!(caption.contains("Missing: ppo seed 1, level b (unfinished)."), "{caption}");
    let caption = report.caption("learning-curves-from-scratch");
    assert!(caption.contains("Missing: ppo (from scratch) seed 1, level a (no such run)."), "{caption}");
    let caption = report.caption("plasticity-loss");
    assert!(caption.contains("left out: 2."), "{caption}");
    let html = report.html();
    assert!(html.contains("2 runs lack results: see ") && html.contains("href=\"#missing-results\""));
    assert!(html.contains("1 of 2 stages are done (unfinished)"));
}

#[test]
fn every_run_is_counted_as_what_it_is() {
    let status = |seed, status| Fake { seed, stages_done: 1, status, ..CURRICULUM };
    let runs = [
        CURRICULUM,
        status(1, |_| Status::Running),
        status(2, |_| Status::Interrupted),
        status(3, |_| Status::Failed("no memory".to_owned())),
    ];
    let report = Report::new(&runs);
    let document = Html::parse_document(&report.html());
    let tables = Selector::parse("table").expect("a selector");
    let overview = document.select(&tables).next().expect("the arms");
    let texts = |cells: &str| -> Vec<String> {
        let cells = Selector::parse(cells).expect("a selector");
        overview.select(&cells).map(|cell| cell.text().collect()).collect()
    };
    assert_eq!(texts("thead th")[4..], ["runs", "finished", "unfinished", "failed"]);
    assert_eq!(texts("tbody td")[3..], ["4", "1", "2", "1"]);
    let html = report.html();
    assert!(html.contains("cpp-rl 1.0 (commit abc, libtorch 2.0): 4 runs"), "the runs' versions");
    for why in ["unfinished", "interrupted", "no memory"] {
        assert!(html.contains(&format!("1 of 2 stages are done ({why})")), "{why}");
    }
}

#[test]
fn many_gaps_are_counted_and_many_warnings_listed() {
    let unfinished: Vec<Fake> = (1..14).map(|seed| Fake { seed, stages_done: 1, ..CURRICULUM }).collect();
    let report = Report::new(&[&[CURRICULUM], &unfinished[..]].concat());
    let caption = report.caption("returns");
    assert!(caption.contains("and 9 more, which the table of missing results lists."), "{caption}");
    assert!(report.html().contains("13 runs lack results, and there are 13 warnings: see "));
}

#[test]
fn a_level_that_nobody_learns_is_counted_as_censored() {
    let lost = Fake { skill: |_, _| Skill::Lost, curve: |_, _| 0.0, ..CURRICULUM };
    let from_scratch = Fake { curve: |_, _| 0.0, skill: |_, _| Skill::Lost, ..FROM_SCRATCH_B };
    let report = Report::new(&with_seeds(&[lost, from_scratch], 3));
    let caption = report.caption("time-to-threshold");
    assert!(caption.contains("never reach 0.5: ppo 3 in the curriculum and 3 from scratch, of 3."), "{caption}");
}

#[test]
fn runs_without_anything_give_a_report_without_crashing() {
    // Nothing is done, logs are absent or have a header alone, and returns are NaN throughout.
    let nothing = Fake { stages_done: 0, ..CURRICULUM };
    let empty = |run: &Fake, path: &Path| {
        let log = path.join("progress.csv");
        match run.seed {
            0 => fs::remove_file(log).expect("the log is there"),
            1 => fs::write(log, "stage,level,time/total_timesteps,cumulative_timesteps,rollout/ep_rew_mean\n")
                .expect("the folder is writable"),
            _ => {
                let head = "stage,level,time/total_timesteps,cumulative_timesteps,rollout/ep_rew_mean\n";
                fs::write(log, format!("{head}0,a,250,250,NaN\n0,a,500,500,NaN\n")).expect("the folder is writable");
            }
        }
    };
    let report = Report::altered(&[nothing, Fake { seed: 1, ..nothing }], empty);
    assert_eq!(report.names(), ["levels", "matrices"]);
    let report = Report::altered(&[Fake { seed: 2, ..nothing }], empty);
    assert_eq!(report.names(), ["levels", "learning-curve-ppo", "matrices"]);
    let svg = fs::read_to_string(report.path("figures/learning-curve-ppo.svg")).expect("the drawing");
    assert!(svg.contains("no data"));
    assert!(report.html().contains("No run has finished its curriculum"));
}

#[test]
fn runs_from_scratch_alone_are_compared_too() {
    let dqn = Fake { arm: "dqn", ..FROM_SCRATCH_B };
    let report = Report::altered(&with_seeds(&[FROM_SCRATCH_A, FROM_SCRATCH_B, dqn], 2), log_plasticity);
    let expected =
        ["levels", "learning-curves-from-scratch", "returns", "probability-of-improvement", "plasticity-from-scratch"];
    assert_eq!(report.names(), expected);
}

#[test]
fn the_same_runs_give_the_same_bytes() {
    let report = Report::altered(&with_seeds(&[CURRICULUM, FROM_SCRATCH_B], 3), log_plasticity);
    let before = files(&report.path(""));
    let again = Analysis::read(&[report.root.path().join("runs")]).expect("runs that can be read");
    export::write(&again, &exhibits::all(&again), &report.path(""), "cpp-rl compare runs")
        .expect("the folder is writable");
    let after = files(&report.path(""));
    assert!(before.len() > 30, "{:?}", before.keys());
    assert_eq!(before.keys().collect::<Vec<_>>(), after.keys().collect::<Vec<_>>());
    for (path, bytes) in &before {
        assert!(after[path] == *bytes, "{} differs", path.display());
    }
}

/// Gives each seed results of its own: some of its episodes are lost, and its curve is lower.
fn vary(run: &Fake, path: &Path) {
    let each = |name: &str, alter: &dyn Fn(usize, &mut Vec<String>)| {
        let text = fs::read_to_string(path.join(name)).expect("the file is there");
        let line = |(place, line): (usize, &str)| {
            let mut fields: Vec<String> = line.split(',').map(str::to_owned).collect();
            if place > 0 {
                alter(place, &mut fields);
            }
            fields.join(",") + "\n"
        };
        fs::write(path.join(name), text.lines().enumerate().map(line).collect::<String>()).expect("it is writable");
    };
    let seed = run.seed as usize;
    let kind = run.levels.len() + 3 * usize::from(run.fork.is_some());
    each("evaluations.csv", &|place, fields| {
        if (3 * place + 5 * seed + run.arm.len()) % 11 < seed % 5 {
            fields.splice(4..7, ["-20", "20", "false"].map(str::to_owned));
        }
    });
    each("progress.csv", &|_, fields| {
        let value: f64 = fields[4].parse().expect("a return");
        fields[4] = (value - 3.0 * ((7 * seed + kind) % 5) as f64 / 4.0).to_string();
    });
    log_plasticity(run, path);
}

/// What `scripts/recompute-report` says of a report, and whether everything agrees; none without Python.
fn recomputed(report: &Report) -> Option<(bool, String)> {
    let script = concat!(env!("CARGO_MANIFEST_DIR"), "/scripts/recompute-report");
    let output =
        Command::new("python3").arg(script).arg(report.path("")).arg(report.root.path().join("runs")).output().ok()?;
    let text = format!("{}{}", String::from_utf8_lossy(&output.stdout), String::from_utf8_lossy(&output.stderr));
    Some((output.status.success(), text))
}

#[test]
fn an_independent_program_computes_the_main_tables_again() {
    let dqn = Fake { arm: "dqn", ..CURRICULUM };
    let learns_a = Fake { curve: |_, share| share / 2.0, ..FROM_SCRATCH_A };
    let mut runs = [with_seeds(&[CURRICULUM, FROM_SCRATCH_B], 6), with_seeds(&[learns_a], 3)].concat();
    runs.extend(with_seeds(&[dqn], 31));
    runs.push(Fake { seed: 6, stages_done: 1, ..CURRICULUM });
    // Of some seeds of an arm alone, as where a version that samples took it over.
    let noisy = Fake { arm: "noisy", sampled: Some(CURRICULUM.skill), ..CURRICULUM };
    runs.extend(with_seeds(&[noisy], 4));
    runs.push(Fake { seed: 4, sampled: None, ..noisy });
    // What forks give back differs from seed to seed, and so does what was lost.
    runs.extend(with_seeds(
        &[Fake { fork: Some((0, "head-0.02")), curve: |_, share| (1.0 + share) / 2.0, ..CURRICULUM }],
        6,
    ));
    let report = Report::altered(&runs, vary);
    let Some((agrees, text)) = recomputed(&report) else {
        eprintln!("skipped: python3 is not installed");
        return;
    };
    assert!(agrees, "{text}");
    let treatments = fs::read_to_string(report.path("tables/treatments.csv")).expect("the table is there");
    let cell = |head: &str| {
        let place = treatments.lines().next()?.split(',').position(|name| name == head)?;
        // The arm's name has a comma of its own.
        treatments.lines().nth(1)?.split(',').nth(place + 1)?.parse::<f64>().ok()
    };
    assert!(cell("recovered share low") < cell("recovered share high"), "{treatments}");
    // A number that is altered anywhere is told of, and so is one that is not there.
    let tables =
        ["right-after-training", "returns", "aggregates", "continual-learning", "against-from-scratch", "treatments"];
    let tables = tables.map(|name| format!("tables/{name}.csv"));
    for name in tables.iter().map(String::as_str).chain(["seeds.csv"]) {
        let whole = fs::read_to_string(report.path(name)).expect("the file is there");
        let mut lines: Vec<String> = whole.lines().map(str::to_owned).collect();
        let mut fields: Vec<String> = lines[1].split(',').map(str::to_owned).collect();
        // The last number of the row, a bound of an interval where the table has some.
        let place = fields.iter().rposition(|field| field.parse::<f64>().is_ok()).expect("a number");
        let number: f64 = fields[place].parse().expect("a number");
        fields[place] = (number + 0.001).to_string();
        lines[1] = fields.join(",");
        fs::write(report.path(name), lines.join("\n") + "\n").expect("it is writable");
        let (agrees, text) = recomputed(&report).expect("Python is there");
        let told = Path::new(name).file_stem().and_then(|stem| stem.to_str()).expect("a name");
        assert!(!agrees && text.contains(told), "{name}: {text}");
        lines.remove(1);
        fs::write(report.path(name), lines.join("\n") + "\n").expect("it is writable");
        assert!(!recomputed(&report).expect("Python is there").0, "{name} without a row");
        fs::write(report.path(name), whole).expect("it is writable");
    }
    assert!(recomputed(&report).expect("Python is there").0);
}

#[test]
fn levels_are_drawn_as_svg_or_png() {
    let sandbox = Sandbox::new();
    let printed = sandbox.succeeds("levels draw --levels 0..5").stdout;
    assert!(printed.starts_with("<svg") && printed.contains("level 4"));
    sandbox.succeeds("levels draw --levels a.yaml --out maps.svg");
    check_svg(&sandbox.path("maps.svg"));
    sandbox.succeeds("levels draw --levels 0,narrow.yaml --out maps.PNG");
    check_png(&sandbox.path("maps.PNG"));
}

#[test]
fn compare_writes_the_report_and_its_command() {
    let sandbox = Sandbox::new();
    for run in with_seeds(&[CURRICULUM], 2) {
        run.write(&sandbox.path("runs"));
    }
    sandbox.succeeds("compare runs --out report");
    let html = fs::read_to_string(sandbox.path("report/report.html")).expect("the page is there");
    assert!(html.contains("<code>cpp-rl compare runs --out report</code>"));
    assert!(html.contains(concat!("cpp-rl ", env!("CARGO_PKG_VERSION"))));
}
