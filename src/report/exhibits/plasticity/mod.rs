//! Plasticity measures over training: all arms together, and each curriculum against learning from scratch.

mod ends;
pub mod layers;
mod panels;

use charts::About;
use serde::Serialize;

use super::exhibit::{Definition, Exhibit, NamedFigure, NamedTable};
use super::parts::caption;
use super::parts::curves::by_sequence;
use super::parts::style::{FROM_SCRATCH, arms_of, style};
use super::parts::timeline::{Timeline, levels_of};
use crate::report::analysis::{Analysis, Arm, Pair, Protocol};
use crate::report::names::file_name;
use crate::report::parallel;
pub use ends::Differences;
use panels::{Line, acting_layer, chart, layer_note, logged, of_seeds, panels};

/// Plasticity measures.
#[derive(Debug, Serialize)]
pub struct Plasticity {
    /// At the end of each stage, of every curriculum with runs from scratch.
    pub differences: Vec<Differences>,
}

impl Plasticity {
    /// Of every pair.
    pub fn new(analysis: &Analysis) -> Self {
        Self { differences: parallel::map(&analysis.pairs, |&pair| Differences::new(analysis, pair)) }
    }
}

impl Exhibit for Plasticity {
    fn key(&self) -> &'static str {
        "plasticity"
    }

    fn heading(&self) -> &'static str {
        "Plasticity during training"
    }

    fn lead(&self) -> &'static str {
        "Measured on fixed states of each level, and on those that the agent visits itself. Dormancy calls a tanh unit that is stuck at ±1 healthy: read dormant \
         and saturated units together."
    }

    fn absence(&self) -> &'static str {
        "No run has logged plasticity."
    }

    fn definitions(&self) -> Vec<Definition> {
        let one = |name, meaning: &str| Definition { name, meaning: meaning.to_owned(), place: "plasticity" };
        vec![
            one(
                "dormant, dead and saturated units",
                "mean |h| at most τ times the layer's average; 0 on every state; |h| > 0.99 on every state",
            ),
            one(
                "effective rank, stable rank, singular values for 99%",
                "exp of the entropy of the singular values; ‖h‖²_F / ‖h‖²₂; how many make up 99% of their sum",
            ),
        ]
    }

    fn numbers(&self) -> serde_json::Result<Option<String>> {
        serde_json::to_string(self).map(Some)
    }

    fn tables(&self, analysis: &Analysis) -> Vec<NamedTable> {
        let arms = analysis.arms.iter().enumerate();
        let own = arms.flat_map(|(index, arm)| {
            let end = NamedTable::of_one_arm(table_name(arm), ends::of_arm(analysis, index, arm));
            let beginning = ends::of_beginnings(analysis, index, arm);
            let beginning = NamedTable::of_one_arm(format!("plasticity-before-{}", file_name(&arm.name)), beginning);
            [Some(end), (!arm.plasticity_begins.is_empty()).then_some(beginning)].into_iter().flatten()
        });
        let differences = self.differences.iter().map(|differences| {
            let arm = &analysis.arms[differences.pair.curriculum];
            NamedTable::of_one_arm(differences_name(arm), differences.table(analysis))
        });
        own.chain(differences).collect()
    }

    fn figures(&self, analysis: &Analysis) -> Vec<NamedFigure> {
        let mut figures = Vec::new();
        for arms in by_sequence(&arms_of(analysis, Protocol::Curriculum)) {
            figures.extend(together(analysis, "plasticity", "Plasticity measures during the curriculum", &arms));
            figures.extend(layers::of_values(analysis, &arms));
        }
        let has_curriculum = |arm: usize| analysis.pairs.iter().any(|pair| pair.from_scratch == arm);
        let mut alone = arms_of(analysis, Protocol::FromScratch);
        alone.retain(|&(index, _)| !has_curriculum(index));
        let title = "Plasticity measures of new agents, level beside level";
        figures.extend(together(analysis, "plasticity-from-scratch", title, &alone));
        figures.extend(analysis.pairs.iter().filter_map(|&pair| of_pair(analysis, pair)));
        figures
    }
}

/// What the table of an arm's measures is called.
fn table_name(arm: &Arm) -> String {
    format!("plasticity-{}", file_name(&arm.name))
}

/// What the table of their differences is called.
fn differences_name(arm: &Arm) -> String {
    format!("plasticity-differences-{}", file_name(&arm.name))
}

/// All these arms in one figure, of the last hidden layers.
fn together(analysis: &Analysis, name: &str, title: &str, arms: &[(usize, &Arm)]) -> Option<NamedFigure> {
    let (indices, lines, not_logged) = logged(analysis, arms);
    let trained = |level: &usize| lines.iter().any(|line| levels_of(line.arm).contains(level));
    let levels = match lines.first()?.arm {
        arm if arm.protocol == Protocol::Curriculum => levels_of(arm),
        _ => (0..analysis.levels.len()).filter(trained).collect(),
    };
    let timeline = Timeline::new(&lines.iter().map(|line| line.arm).collect::<Vec<_>>(), &levels);
    Some(NamedFigure {
        name: name.to_owned(),
        caption: caption::join([
            format!("{title}. {}", layer_note(&lines)),
            of_seeds(analysis, &timeline, &indices),
            not_logged,
        ]),
        drawing: chart(&timeline, About::new(title, "A panel per measure."), panels(analysis, &timeline, &lines, true)),
        tables: indices.iter().map(|&arm| table_name(&analysis.arms[arm])).collect(),
    })
}

/// One arm in its curriculum and from scratch; the runs from scratch stand where the curriculum trains on their level.
fn of_pair(analysis: &Analysis, pair: Pair) -> Option<NamedFigure> {
    let both = [pair.curriculum, pair.from_scratch];
    let [arm, other] = both.map(|index| &analysis.arms[index]);
    if arm.plasticity.is_empty() || other.plasticity.is_empty() {
        return None;
    }
    let timeline = Timeline::new(&[arm, other], &levels_of(arm));
    let name = format!("{} in the curriculum", arm.name);
    let lines = [
        Line { arm, name, style: style(analysis, pair.curriculum), layer: acting_layer(arm) },
        Line { arm: other, name: "from scratch".to_owned(), style: FROM_SCRATCH, layer: acting_layer(other) },
    ];
    let title = format!("{}: plasticity in the curriculum and from scratch", arm.name);
    Some(NamedFigure {
        name: format!("plasticity-against-from-scratch-{}", file_name(&arm.name)),
        caption: caption::join([
            format!("{title}, each new agent where the curriculum trains on its level. {}", layer_note(&lines)),
            of_seeds(analysis, &timeline, &both),
        ]),
        drawing: chart(&timeline, About::new(title, "A panel per measure."), panels(analysis, &timeline, &lines, true)),
        tables: vec![differences_name(arm)],
    })
}
