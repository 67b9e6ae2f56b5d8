//! Plasticity measures of every layer.

use std::collections::BTreeSet;

use charts::{About, CurvePanel};

use super::super::exhibit::{Exhibit, NamedFigure, NamedTable};
use super::super::parts::caption;
use super::super::parts::curves::by_sequence;
use super::super::parts::style::arms_of;
use super::super::parts::timeline::{Timeline, levels_of};
use super::panels::{HIDDEN, Line, WEIGHTS, chart, layer_order, layers, logged, of_seeds, panel, panels, value_layer};
use crate::measure::PREFIX;
use crate::report::analysis::{Analysis, Arm, Protocol};
use crate::report::names::file_name;

/// The layers that the main figures do not show.
pub struct Layers;

impl Exhibit for Layers {
    fn key(&self) -> &'static str {
        "layers"
    }

    fn heading(&self) -> &'static str {
        "Plasticity, layer by layer"
    }

    fn lead(&self) -> &'static str {
        "policy and value are PPO's two networks, q is DQN's; layers count from 0."
    }

    fn absence(&self) -> &'static str {
        "No curriculum has logged plasticity of further layers."
    }

    fn tables(&self, _: &Analysis) -> Vec<NamedTable> {
        Vec::new()
    }

    fn figures(&self, analysis: &Analysis) -> Vec<NamedFigure> {
        let curricula = arms_of(analysis, Protocol::Curriculum);
        by_sequence(&curricula).iter().flat_map(|arms| by_layer(analysis, arms)).collect()
    }
}

/// The last hidden layer of the network that values states, which stands beside the main figure.
pub(super) fn of_values(analysis: &Analysis, arms: &[(usize, &Arm)]) -> Option<NamedFigure> {
    of_layer(analysis, arms, arms.iter().find_map(|(_, arm)| value_layer(arm))?)
}

/// Every other hidden layer, and the weights of all layers.
fn by_layer(analysis: &Analysis, arms: &[(usize, &Arm)]) -> Vec<NamedFigure> {
    let (indices, lines, _) = logged(analysis, arms);
    let Some(first) = lines.first() else { return Vec::new() };
    let timeline = Timeline::new(&lines.iter().map(|line| line.arm).collect::<Vec<_>>(), &levels_of(first.arm));
    let all_layers = |measure: &str| {
        let layers: BTreeSet<&str> = lines.iter().flat_map(|line| layers(line.arm, measure)).collect();
        let mut layers: Vec<&str> = layers.into_iter().collect();
        layers.sort_by_key(|layer| layer_order(layer));
        layers
    };
    let values = arms.iter().find_map(|(_, arm)| value_layer(arm));
    let others = all_layers(HIDDEN).into_iter().filter(|&layer| values != Some(layer));
    let mut figures: Vec<NamedFigure> = others.filter_map(|layer| of_layer(analysis, arms, layer)).collect();
    let weights_of = |layer: &str| {
        let column = |_: &Line| Some(format!("{PREFIX}{layer}/{WEIGHTS}"));
        panel(analysis, &timeline, &lines, format!("layer {layer}"), column)
    };
    let weights: Vec<CurvePanel> = all_layers(WEIGHTS).into_iter().filter_map(weights_of).collect();
    if !weights.is_empty() {
        let title = "Mean magnitude of the weights of every layer, the output layers' too";
        figures.push(NamedFigure {
            name: "plasticity-weights".to_owned(),
            caption: caption::join([format!("{title}."), of_seeds(analysis, &timeline, &indices)]),
            drawing: chart(&timeline, About::new(title, "A panel per layer."), weights),
            tables: Vec::new(),
        });
    }
    figures
}

/// One hidden layer of the arms that have it; none that the main figure has already.
fn of_layer(analysis: &Analysis, arms: &[(usize, &Arm)], layer: &str) -> Option<NamedFigure> {
    let (indices, lines, _) = logged(analysis, arms);
    let timeline =
        Timeline::new(&lines.iter().map(|line| line.arm).collect::<Vec<_>>(), &levels_of(lines.first()?.arm));
    let in_it = |line: &Line| layers(line.arm, HIDDEN).contains(&layer);
    if lines.iter().filter(|line| in_it(line)).all(|line| line.layer == Some(layer)) {
        return None;
    }
    let shown: Vec<usize> =
        indices.iter().zip(&lines).filter(|(_, line)| in_it(line)).map(|(index, _)| *index).collect();
    let with: Vec<Line> = lines.into_iter().filter(in_it).map(|line| Line { layer: Some(layer), ..line }).collect();
    let title = format!("Hidden layer {layer} during the curriculum");
    Some(NamedFigure {
        name: format!("plasticity-{}", file_name(layer)),
        caption: caption::join([format!("{title}."), of_seeds(analysis, &timeline, &shown)]),
        drawing: chart(&timeline, About::new(title, "A panel per measure."), panels(analysis, &timeline, &with, false)),
        tables: Vec::new(),
    })
}
