//! What `compare` reads in the logs of runs that are written here.

use std::fs;

use cpp_rl::report::Format;
use cpp_rl::report::exhibits::plasticity::Plasticity;
use rl_stats::Time;
use tempfile::TempDir;

use crate::fakes::{CURRICULUM, FROM_SCRATCH_B, Fake, read, table};
use crate::numbers::assert_near;

#[test]
fn rows_without_a_return_are_counted_and_stepped_over() {
    let root = TempDir::new().expect("a folder");
    let path = FROM_SCRATCH_B.write(root.path());
    let log = fs::read_to_string(path.join("progress.csv")).expect("a log");
    let mut lines: Vec<String> = log.lines().map(str::to_owned).collect();
    for line in [1, 3] {
        let start = lines[line].rfind(',').expect("columns");
        lines[line].replace_range(start + 1.., "NaN");
    }
    fs::write(path.join("progress.csv"), lines.join("\n") + "\n").expect("the folder is writable");
    let analysis = read(&root);
    assert_eq!((analysis.runs[0].log_rows, analysis.runs[0].rows_without_return), (4, 2));
    assert!(
        analysis.warnings[0].contains("2 of 4 rows of progress.csv have no mean return"),
        "{:?}",
        analysis.warnings
    );
    let seed = &analysis.arms[0].levels[0].as_ref().expect("a result").seeds[&0];
    assert_near(seed.area.expect("a curve"), 1.0, 1e-9);
    assert_eq!(seed.times[0], Time::At(500.0));
    let values = &analysis.arms[0].curves[0].seeds[&0];
    assert_eq!(values.iter().map(Option::is_some).collect::<Vec<_>>(), [false, true, false, true]);
}

#[test]
fn plasticity_is_read_where_it_was_logged() {
    let root = TempDir::new().expect("a folder");
    let first = CURRICULUM.write(root.path());
    Fake { seed: 1, ..CURRICULUM }.write(root.path());
    let head = "stage,level,timesteps,cumulative_timesteps,plasticity/policy.0/dormant_0.1,plasticity/weight_norm\n";
    fs::write(
        first.join("plasticity.csv"),
        format!("{head}0,a,500,500,0.25,NaN\n1,b,0,1000,0.5,NaN\n1,b,500,1500,0.75,3\n"),
    )
    .expect("writable");
    let analysis = read(&root);
    let dormant = |stage| {
        let series = analysis.arms[0].plasticity.iter().filter(|series| series.stage == stage);
        series.filter(|series| series.measure == "plasticity/policy.0/dormant_0.1").collect::<Vec<_>>()
    };
    let [second] = dormant(1)[..] else { panic!("one series per measure and stage") };
    assert_eq!(second.points[0].cumulative_timesteps, 1500.0);
    assert_eq!((second.seeds.len(), second.seeds[&0][0]), (1, Some(0.75)));
    assert_eq!(second.mean[0].map(|band| (band.value, band.low)), Some((0.75, None)));
    assert_eq!(analysis.arms[0].plasticity.len(), 4);
    // A value that is none is counted, by measure.
    assert_eq!(analysis.runs[0].plasticity_rows, 2);
    assert_eq!(analysis.runs[0].plasticity_without_value, [("plasticity/weight_norm".to_owned(), 1)].into());
    let warning = "without a value in some of the 2 rows of plasticity.csv: plasticity/weight_norm 1";
    assert!(analysis.warnings.iter().any(|other| other.contains(warning)), "{:?}", analysis.warnings);
    let csv = table(&analysis, "plasticity-ppo", Format::Csv);
    assert_eq!(
        csv,
        "measure,level a,level a low,level a high,level b,level b low,level b high\n\
         policy.0/dormant_0.1,0.25,,,0.75,,\nweight_norm,,,,3,,\n"
    );
    // What stands before the first update of a stage is no point of a curve, and no end.
    let csv = table(&analysis, "plasticity-before-ppo", Format::Csv);
    assert!(csv.ends_with("\npolicy.0/dormant_0.1,,0.5,,\n"), "{csv}");
    let before = analysis.seed_values.iter().find(|value| value.measure == "before/plasticity/policy.0/dormant_0.1");
    assert_eq!(before.map(|value| (value.stage, value.value)), Some((Some(1), 0.5)));
}

#[test]
fn plasticity_at_the_end_of_a_stage_is_compared_with_from_scratch() {
    let root = TempDir::new().expect("a folder");
    for seed in 0..3 {
        for run in [Fake { seed, ..CURRICULUM }, Fake { seed, ..FROM_SCRATCH_B }] {
            let path = run.write(root.path());
            let rows = |stage: usize| {
                // The last row counts, whatever stood before it.
                let end = if run.from_scratch { 1.0 } else { 3.0 + stage as f64 } + seed as f64;
                format!("{stage},{},500,500,99\n{stage},{},1000,1000,{end}\n", run.levels[stage], run.levels[stage])
            };
            let rows: String = (0..run.levels.len()).map(rows).collect();
            let head = "stage,level,timesteps,cumulative_timesteps,plasticity/grad_norm\n";
            fs::write(path.join("plasticity.csv"), format!("{head}{rows}")).expect("the folder is writable");
        }
    }
    // A stage that is not done has no end.
    Fake { seed: 2, stages_done: 1, ..CURRICULUM }.write(root.path());
    let analysis = read(&root);
    let markdown = table(&analysis, "plasticity-ppo", Format::Markdown);
    // Student's t of two degrees of freedom is 4.3027, of one 12.706.
    assert!(markdown.contains("| grad_norm | 4.000 [1.516, 6.484] | 4.500 [-1.853, 10.853] (n = 2) |"), "{markdown}");
    assert!(markdown.contains("95% interval of the mean over seeds, Student's t."), "{markdown}");
    let markdown = table(&analysis, "plasticity-differences-ppo", Format::Markdown);
    assert!(markdown.contains("| grad_norm | – | 3.000 [3.000, 3.000] |"), "{markdown}");
    assert_eq!(Plasticity::new(&analysis).differences[0].ends[0].value.seeds, [(0, 3.0), (1, 3.0)].into());
}
