//! Levels to compare with: a planner's return, the proved optimum, a probability of one half.

use crate::color::Paint;
use crate::drawing::{Drawing, Stroke};

/// A named level, drawn as a line across the panel or as one line per segment. References are black and told
/// apart by their dashes, in order of appearance in the chart.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Reference {
    /// Its entry in the legend.
    pub name: String,
    /// Where it lies.
    pub segments: Vec<Segment>,
}

/// A level over part of the other axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Segment {
    /// Where it begins, on the x axis of curves; among estimates category `i` spans `i` to `i + 1`.
    pub from: f64,
    /// Where it ends; an infinite end is the panel's edge.
    pub to: f64,
    /// Its value.
    pub value: f64,
}

impl Reference {
    /// One level across the whole panel.
    pub fn across(name: impl Into<String>, value: f64) -> Self {
        let segment = Segment { from: f64::NEG_INFINITY, to: f64::INFINITY, value };
        Self { name: name.into(), segments: vec![segment] }
    }
}

const DASHES: [&[f64]; 4] = [&[2.6, 1.6], &[0.9, 1.2], &[5.0, 1.4, 0.9, 1.4], &[6.0, 3.0]];

/// The line of the `index`-th reference of a chart.
pub(crate) fn stroke(index: usize) -> Stroke {
    Stroke { dash: DASHES[index % DASHES.len()], ..Stroke::new(Paint::Ink, 0.8) }
}

/// The names of all references, each once, in order of appearance.
pub(crate) fn names<'a>(references: impl Iterator<Item = &'a Reference>) -> Vec<&'a str> {
    let mut names: Vec<&str> = Vec::new();
    for reference in references {
        if !names.contains(&reference.name.as_str()) {
            names.push(&reference.name);
        }
    }
    names
}

/// Draws `references`; `names` gives each its line, and `place` maps (along, value) into the drawing, clamping
/// infinities.
pub(crate) fn draw(
    drawing: &mut Drawing,
    references: &[Reference],
    names: &[&str],
    place: impl Fn(f64, f64) -> (f64, f64),
) {
    for reference in references {
        let index = names.iter().position(|name| *name == reference.name).expect("names holds every reference");
        for segment in reference.segments.iter().filter(|segment| segment.value.is_finite()) {
            drawing.line(place(segment.from, segment.value), place(segment.to, segment.value), stroke(index));
        }
    }
}
