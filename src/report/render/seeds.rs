//! `seeds.csv`: one number of one seed a row, so that every table can be computed again.

use crate::report::analysis::{Analysis, Arm, Treatment};

/// The head of the file. Treatments are those of forks; a run that is none has an empty one.
const COLUMNS: [&str; 8] = ["arm", "sequence", "treatment", "seed", "stage", "level", "measure", "value"];

/// All numbers, each in the fewest digits that give the same number when they are read.
pub fn seeds(analysis: &Analysis) -> String {
    let mut csv = csv::Writer::from_writer(Vec::new());
    csv.write_record(COLUMNS).expect("memory takes every record");
    let treatment = |arm: &Arm| arm.treatment.as_ref().map_or(String::new(), Treatment::to_string);
    let treatments: Vec<String> = analysis.arms.iter().map(treatment).collect();
    for value in &analysis.seed_values {
        let stage = value.stage.map_or(String::new(), |stage| stage.to_string());
        csv.write_record([
            analysis.arms[value.arm].name.as_str(),
            &value.sequence,
            &treatments[value.arm],
            &value.seed.to_string(),
            &stage,
            &analysis.levels[value.level].name,
            &value.measure,
            &value.value.to_string(),
        ])
        .expect("memory takes every record");
    }
    String::from_utf8(csv.into_inner().expect("memory takes every record")).expect("built from text")
}
