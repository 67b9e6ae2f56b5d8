//! What stands beside runs: what the paper printed, and learning curves of other programs.

use std::fs;

use cpp_rl::report::{Format, exhibits, export};
use cpp_rl::run::manifest::Manifest;
use serde_json::json;
use tempfile::TempDir;

use crate::fakes::{CURRICULUM, FROM_SCRATCH_B, Fake, analysis, map, read, table, tables};
use crate::sandbox::Sandbox;

#[test]
fn what_the_paper_printed_stands_beside_its_sequence() {
    let paper = Fake { levels: &["0", "1", "2", "3"], stages_done: 4, ..CURRICULUM };
    let analysis = analysis(&[paper]);
    let table = |name: &str, format: Format| table(&analysis, name, format);
    let right_after = table("right-after-training", Format::Csv);
    assert!(
        right_after.contains("ppo (published),1,42.723,1.48,36.783,44.46,29.739,46.56,40.316,2.13"),
        "{right_after}"
    );
    let after = table("after-level-3", Format::Csv);
    assert!(after.contains("ppo (published),1,-194.45,2.38,-196.1,6.23,-199.55,1.96,40.55,2.2"), "{after}");
    let after = table("after-level-3", Format::Markdown);
    assert!(
        after.contains("(the paper's Tables 2 to 4)") && after.contains("Published: what the paper printed"),
        "{after}"
    );
    assert!(after.contains("Trained for another time here: ppo (1000 timesteps on a level, not 500000)."), "{after}");
    let planners = table("planners", Format::Csv);
    assert!(
        planners.contains("0,A* (published),20,42.25,,40,45,") && planners.contains("\n0,random,55,-"),
        "{planners}"
    );
    let other = table("after-level-0", Format::Markdown);
    assert!(!other.contains("ublished") && !other.contains("the paper"), "{other}");
}

#[test]
fn published_figures_stand_beside_nothing_that_they_do_not_describe() {
    assert!(analysis(&[CURRICULUM]).published.is_none());
    // The paper's models knew levels 1 and 2 when they were trained on level 3.
    let skipping = analysis(&[Fake { levels: &["0", "3"], ..CURRICULUM }]);
    let right_after = table(&skipping, "right-after-training", Format::Csv);
    assert!(!right_after.contains("ppo (published)"), "{right_after}");
    assert!(!table(&skipping, "after-level-3", Format::Markdown).contains("ublished"));
    let backwards = analysis(&[Fake { levels: &["3", "0"], ..CURRICULUM }]);
    let right_after = table(&backwards, "right-after-training", Format::Csv);
    assert!(!right_after.contains("ppo (published)") && right_after.contains("A* (published)"), "{right_after}");
    // Level 3 in name alone.
    let root = TempDir::new().expect("a folder");
    let path = Fake { levels: &["0", "3"], ..CURRICULUM }.write(root.path());
    let mut manifest = Manifest::read(&path).expect("a manifest");
    manifest.stages[1].map = map("a");
    manifest.write(&path).expect("the folder is writable");
    let planners = table(&read(&root), "planners", Format::Csv);
    assert!(planners.contains("\n0,A* (published)") && !planners.contains("\n3,A* (published)"), "{planners}");
    // Another step limit makes other returns.
    manifest.stages[1].map = map("3");
    manifest.config.insert("max_steps".to_owned(), json!(100));
    manifest.write(&path).expect("the folder is writable");
    assert!(read(&root).published.is_none());
}

/// As in a study of all orders, a fifth of which begin with level 0.
#[test]
fn of_several_orders_the_papers_own_alone_has_published_rows() {
    let order = |sequence, levels| Fake { sequence, levels, stages_done: 5, ..CURRICULUM };
    let orders = [
        order("order-01234", &["0", "1", "2", "3", "4"]),
        order("order-01243", &["0", "1", "2", "4", "3"]),
        order("order-04321", &["0", "4", "3", "2", "1"]),
        order("order-10234", &["1", "0", "2", "3", "4"]),
    ];
    let analysis = analysis(&orders);
    let own: Vec<usize> = analysis.arms.iter().map(|arm| analysis.stages_of_paper(arm)).collect();
    assert_eq!(own, [5, 0, 0, 0]);
    for name in ["right-after-training", "after-level-3"] {
        let csv = table(&analysis, name, Format::Csv);
        let rows: Vec<&str> = csv.lines().filter_map(|line| line.split(",1,").next()).collect();
        let place = rows.iter().position(|row| *row == "ppo (published)").expect("a row");
        assert!(rows[place - 1].contains("order-01234"), "{csv}");
        assert_eq!(csv.matches("ppo (published)").count(), 1, "{csv}");
    }
    let csv = table(&analysis, "published-runs", Format::Csv);
    assert!(csv.lines().skip(1).all(|line| line.contains("order-01234")) && csv.lines().count() > 5, "{csv}");
}

#[test]
fn a_published_run_is_inside_or_outside_of_where_one_more_would_fall() {
    let paper = Fake { levels: &["0", "1", "2", "3"], stages_done: 4, ..CURRICULUM };
    let lost = Fake { skill: |_, _| crate::fakes::Skill::Lost, ..paper };
    let runs: Vec<Fake> = (0..3).map(|seed| Fake { seed, ..if seed == 0 { lost } else { paper } }).collect();
    let analysis = analysis(&runs);
    let markdown = table(&analysis, "published-runs", Format::Markdown);
    let row = |begin: &str| markdown.lines().find(|line| line.starts_with(begin)).expect("a row").to_owned();
    // The paper's 42.72 is near two of three, and the third tells how far seeds may fall.
    assert!(row("| ppo | right after training | 0 | 3 |").ends_with("| 42.72 | inside |"), "{markdown}");
    // All of ours are at the worst return there, without any spread.
    let worst = "| ppo | after level 3 | 0 | 3 | -200.00 [-200.00, -200.00] | -194.45 | outside |";
    assert_eq!(row("| ppo | after level 3 | 0 |"), worst);
    assert!(markdown.contains("prediction interval"), "{markdown}");
}

/// Whether a figure of a new report of `runs` shows a name.
fn shows(sandbox: &Sandbox, runs: &str, option: &str, figure: &str, name: &str) -> bool {
    sandbox.succeeds(&format!("compare {runs} --out report {option}"));
    let svg = fs::read_to_string(sandbox.path(&format!("report/figures/{figure}.svg"))).expect("the drawing");
    svg.contains(name)
}

#[test]
fn the_papers_curves_lie_beside_its_sequence_alone() {
    let sandbox = Sandbox::new();
    Fake { levels: &["0", "1"], timesteps: 500_000, ..CURRICULUM }.write(&sandbox.path("runs"));
    Fake { levels: &["0", "1"], ..CURRICULUM }.write(&sandbox.path("short"));
    CURRICULUM.write(&sandbox.path("own"));
    let curves = "run,level,repeat,timesteps,ep_rew_mean\nppo-curriculum,0,1,4096,-150\nppo-curriculum,0,1,400000,-10\n\
                  ppo-curriculum,1,1,4096,-190\nppo-curriculum,1,1,400000,20\ndqn-curriculum,1,1,4096,-190\n";
    sandbox.write("curves.csv", curves);
    let drawn = |runs: &str, option: &str, name: &str| shows(&sandbox, runs, option, "learning-curve-ppo", name);
    assert!(drawn("runs", "--curves paper=curves.csv", "paper"));
    // As it was called before, and by the file's name.
    assert!(drawn("runs", "--published-curves curves.csv", "curves"));
    let without = drawn("runs", "", "curves");
    assert!(!without && !drawn("short", "--curves curves.csv", "curves"));
    assert!(!drawn("own", "--curves curves.csv", "curves"));
    sandbox.write("curves.csv", "run,level\nppo-curriculum,0\n");
    let error = sandbox.fails(2, "compare runs --curves curves.csv");
    assert!(error.contains("curves.csv: no column seed"), "{error}");
}

#[test]
fn other_programs_curves_are_drawn_and_tabled() {
    let sandbox = Sandbox::new();
    for seed in 0..2 {
        Fake { seed, ..FROM_SCRATCH_B }.write(&sandbox.path("runs"));
    }
    // Of level b the worst return is -20; the first seed is at the optimum from its second row on, the other never.
    let best = crate::fakes::optimum("b").mean;
    sandbox.write(
        "curves.csv",
        format!(
            "algo,level,seed,timesteps,ep_rew_mean\nppo,b,1,100,-20\nppo,b,1,300,{best}\nppo,b,1,500,{best}\n\
             ppo,b,2,100,-20\nppo,b,2,500,-20\nppo,a,1,100,-20\ndqn,b,1,100,-20\n"
        ),
    );
    assert!(shows(&sandbox, "runs", "--curves SB3=curves.csv", "learning-curves-from-scratch", "SB3: ppo"));
    let csv = fs::read_to_string(sandbox.path("report/tables/other-curves.csv")).expect("the table");
    let lines: Vec<&str> = csv.lines().collect();
    assert_eq!(lines.len(), 3, "{csv}");
    assert!(lines[1].starts_with("ppo (from scratch),b,ours,2,1000,250,0,250,0,1,"), "{csv}");
    // The area of the one is 0.75, of the other 0.
    assert!(lines[2].starts_with("ppo (from scratch),b,SB3,2,500,never,1,never,1,0.375,"), "{csv}");
    let json = sandbox.json("compare runs --curves SB3=curves.csv");
    assert_eq!(json["exhibits"]["learning"][0]["seeds"], json!(2));
}

#[test]
fn a_report_of_own_levels_does_not_speak_of_the_paper() {
    let own = analysis(&[CURRICULUM, FROM_SCRATCH_B]);
    let text: String = tables(&own).iter().map(|named| named.table.render(Format::Markdown)).collect();
    assert!(!text.contains("the paper") && !text.contains("Exploratory Study"), "{text}");
    let root = TempDir::new().expect("a folder");
    export::write(&own, &exhibits::all(&own), root.path(), "cpp-rl compare").expect("the folder is writable");
    let html = fs::read_to_string(root.path().join("report.html")).expect("the page");
    assert!(!html.contains("the paper") && !html.contains("Exploratory Study"));
    let papers = analysis(&[Fake { levels: &["0", "1"], ..CURRICULUM }]);
    let text: String = tables(&papers).iter().map(|named| named.table.render(Format::Markdown)).collect();
    assert_eq!(text.matches("Exploratory Study").count(), 1, "{text}");
}
