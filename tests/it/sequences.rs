//! What a report says of many sequences, of long ones and of sweeps, on runs that are written here.

use cpp_rl::report::Format;
use cpp_rl::report::analysis::Analysis;
use cpp_rl::report::exhibits::{self, Exhibit, doses::Doses, positions::Positions};
use cpp_rl::report::export;
use tempfile::TempDir;

use crate::fakes::{CURRICULUM, FROM_SCRATCH_B, Fake, analysis, table};

const FROM_SCRATCH_A: Fake = Fake { levels: &["a"], ..FROM_SCRATCH_B };
/// Learns level a to the end at once, and half of level b.
const AB: Fake = Fake { sequence: "order-01", curve: |level, _| if level == "a" { 1.0 } else { 0.5 }, ..CURRICULUM };
/// The other order: all of level b, and half of level a.
const BA: Fake = Fake {
    sequence: "order-10",
    levels: &["b", "a"],
    curve: |level, _| if level == "b" { 1.0 } else { 0.5 },
    ..CURRICULUM
};

fn figures(analysis: &Analysis) -> Vec<String> {
    let sections = exhibits::sections(analysis, &exhibits::all(analysis));
    sections.into_iter().flat_map(|section| section.figures).map(|figure| figure.name).collect()
}

/// By hand: 1 at the first position and 0.5 at the second, in both orders; 1 from scratch.
#[test]
fn orders_are_averaged_position_by_position() {
    let analysis = analysis(&[AB, BA, FROM_SCRATCH_A, FROM_SCRATCH_B]);
    let [family] = &Positions::new(&analysis).families[..] else { panic!("one family") };
    assert_eq!((family.name.as_str(), family.arms.len()), ("ppo", 2));
    let near = |value: f64, expected: f64| assert!((value - expected).abs() < 1e-12, "{value} is not {expected}");
    for (position, expected) in family.positions.iter().zip([1.0, 0.5]) {
        near(position.means["area"].value, expected);
        near(position.means["area - from scratch"].value, expected - 1.0);
        near(position.relative_area.expect("areas from scratch").value, expected);
        assert_eq!(position.means["area"].runs, 2, "a sequence counts once");
    }
    near(family.slopes["area"].value, -0.5);
    let csv = table(&analysis, "slopes", Format::Csv);
    assert!(csv.contains("ppo,2 sequences,-0.5"), "{csv}");
    let figures = figures(&analysis);
    assert!(["positions", "positions-ppo"].iter().all(|name| figures.iter().any(|f| f == name)), "{figures:?}");
}

#[test]
fn one_short_sequence_has_no_positions() {
    let analysis = analysis(&[CURRICULUM, FROM_SCRATCH_B]);
    assert!(exhibits::all(&analysis).iter().all(|exhibit| !["positions", "doses"].contains(&exhibit.key())));
}

#[test]
fn a_long_sequence_is_averaged_over_its_seeds() {
    const LONG: Fake = Fake {
        levels: &["a", "b", "a", "b", "a", "b", "a", "b", "a", "b", "a", "b"],
        stages_done: 12,
        curve: |_, share| share,
        ..CURRICULUM
    };
    let analysis = analysis(&[LONG, Fake { seed: 1, ..LONG }]);
    let [family] = &Positions::new(&analysis).families[..] else { panic!("one family") };
    assert_eq!(family.positions.len(), 12);
    assert!(family.positions.iter().all(|position| position.means["area"].runs == 2), "seeds");
    assert!(figures(&analysis).contains(&"positions-of-arms".to_owned()));
}

#[test]
fn many_arms_have_heat_maps_in_place_of_panels() {
    let sequences: Vec<&'static str> =
        (0..exhibits::MOST_ARMS).map(|order| &*Box::leak(format!("order-{order}").into_boxed_str())).collect();
    let runs: Vec<Fake> = sequences.iter().map(|&sequence| Fake { sequence, ..AB }).collect();
    let analysis = analysis(&[&runs[..], &[FROM_SCRATCH_A, FROM_SCRATCH_B]].concat());
    assert_eq!(figures(&analysis), ["levels", "positions", "positions-ppo"]);
    let root = TempDir::new().expect("a folder");
    let all: Vec<Box<dyn Exhibit>> = exhibits::all(&analysis);
    export::write(&analysis, &all, root.path(), "cpp-rl compare").expect("the folder is writable");
    let page = std::fs::read_to_string(root.path().join("report.html")).expect("the page");
    assert!(page.contains("30 tables of one arm each can be found in the folder tables"), "the matrices");
    assert!(root.path().join("tables/matrix-ppo__order-7.csv").is_file());
    let json = std::fs::read_to_string(root.path().join("report.json")).expect("the numbers");
    let json: serde_json::Value = serde_json::from_str(&json).expect("JSON");
    assert_eq!(json["exhibits"]["positions"][0]["arms"].as_array().map(Vec::len), Some(30));
}

/// By hand: the area of both levels is 1, 0.5 and 0.25 at the three doses, and 0 without any.
#[test]
fn sweeps_are_drawn_over_the_dose() {
    let dose = |arm, curve| Fake { arm, curve, ..CURRICULUM };
    let runs = [
        dose("ppo+l2_coef-0", |_, _| 0.0),
        dose("ppo+l2_coef-1e-4", |_, _| 1.0),
        dose("ppo+l2_coef-0.001", |_, _| 0.5),
        dose("ppo+l2_coef-0.01", |_, _| 0.25),
    ];
    let runs: Vec<Fake> = runs.iter().flat_map(|&run| [run, Fake { seed: 1, ..run }]).collect();
    let analysis = analysis(&runs);
    let [sweep] = &Doses::new(&analysis).sweeps[..] else { panic!("one sweep") };
    assert_eq!((sweep.arm.as_str(), sweep.setting.as_str()), ("ppo", "l2_coef"));
    let [line] = &sweep.lines[..] else { panic!("one line") };
    let doses: Vec<(f64, f64)> = line.doses.iter().map(|dose| (dose.value, dose.means["mean area"].value)).collect();
    let expected = [(0.0, 0.0), (1e-4, 1.0), (1e-3, 0.5), (1e-2, 0.25)];
    assert!(doses.iter().zip(expected).all(|(a, b)| a.0 == b.0 && (a.1 - b.1).abs() < 1e-12), "{doses:?}");
    let sections = exhibits::sections(&analysis, &exhibits::all(&analysis));
    let all = sections.iter().flat_map(|section| &section.figures);
    let figure = all.into_iter().find(|figure| figure.name == "dose-ppo-l2_coef").expect("the figure");
    let svg = figure.drawing.to_svg();
    assert!(svg.contains("10⁻⁴") && svg.contains("10⁻²") && svg.contains("l2_coef = 0"), "the axis");
}

#[test]
fn a_report_of_ppo_on_own_levels_speaks_neither_of_dqn_nor_of_the_paper() {
    let analysis = analysis(&[CURRICULUM, FROM_SCRATCH_A, FROM_SCRATCH_B]);
    let root = TempDir::new().expect("a folder");
    export::write(&analysis, &exhibits::all(&analysis), root.path(), "cpp-rl compare").expect("a writable folder");
    let page = std::fs::read_to_string(root.path().join("report.html")).expect("the page");
    let tables = std::fs::read_to_string(root.path().join("tables.md")).expect("the tables");
    for text in [page, tables] {
        for word in ["DQN", "the paper", "(published)"] {
            assert!(
                !text.contains(word),
                "{word}: {:?}",
                text.find(word).map(|at| text[at.saturating_sub(200)..].chars().take(300).collect::<String>())
            );
        }
    }
}
