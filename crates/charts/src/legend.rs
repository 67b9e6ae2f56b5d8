//! The legend: a row of entries above the panels, in as many lines as they need.

use crate::color::{Paint, Style};
use crate::drawing::{Anchor, Drawing, Rect, Stroke};
use crate::{font, reference};

/// What stands before an entry's name.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Key {
    Curve(Style),
    Point(Style),
    /// By its number among the chart's references.
    Reference(usize),
    Tile(Paint),
}

#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Entry {
    pub key: Key,
    pub name: String,
}

impl Entry {
    pub fn new(key: Key, name: &str) -> Self {
        Self { key, name: name.to_owned() }
    }
}

/// One entry for each series name, in order of appearance, then one for each reference.
pub(crate) fn entries<'a>(
    series: impl Iterator<Item = (&'a str, Style)>,
    key: fn(Style) -> Key,
    references: &[&str],
) -> Vec<Entry> {
    let mut entries: Vec<Entry> = Vec::new();
    for (name, style) in series {
        if !name.is_empty() && entries.iter().all(|entry| entry.name != name) {
            entries.push(Entry::new(key(style), name));
        }
    }
    entries.extend(references.iter().enumerate().map(|(i, name)| Entry::new(Key::Reference(i), name)));
    entries
}

const SIZE: f64 = font::LABEL;
const LINE: f64 = SIZE * 1.4;
const KEY_WIDTH: f64 = 17.0;
const TILE: f64 = 6.5;
const KEY_GAP: f64 = 3.5;
const ENTRY_GAP: f64 = 11.0;

impl Key {
    fn width(self) -> f64 {
        match self {
            Self::Curve(_) | Self::Reference(_) => KEY_WIDTH,
            Self::Point(_) | Self::Tile(_) => TILE,
        }
    }

    fn draw(self, drawing: &mut Drawing, left: f64, middle: f64) {
        let right = left + self.width();
        match self {
            Self::Curve(style) => {
                let stroke = Stroke { dash: style.dash(), ..Stroke::new(style.paint(), 1.4) };
                drawing.line((left, middle), (right, middle), stroke);
            }
            Self::Point(style) => drawing.mark((left + TILE / 2.0, middle), 2.4, style.marker(), style.paint()),
            Self::Reference(index) => drawing.line((left, middle), (right, middle), reference::stroke(index)),
            Self::Tile(paint) => {
                let tile = Rect { left, top: middle - TILE / 2.0, width: TILE, height: TILE };
                drawing.fill_rect(tile, paint);
                drawing.frame_rect(tile, Stroke::new(Paint::Muted, 0.5));
            }
        }
    }
}

/// Entries with their texts cut to the width, in lines.
fn lines(entries: &[Entry], width: f64) -> Vec<Vec<(Key, String, f64)>> {
    let mut lines: Vec<Vec<(Key, String, f64)>> = Vec::new();
    let mut used = 0.0;
    for entry in entries {
        let before = entry.key.width() + KEY_GAP;
        let name = font::shorten(&entry.name, SIZE, width - before);
        let needed = before + font::width(&name, SIZE);
        match lines.last_mut() {
            Some(line) if used + ENTRY_GAP + needed <= width => {
                used += ENTRY_GAP + needed;
                line.push((entry.key, name, needed));
            }
            _ => {
                used = needed;
                lines.push(vec![(entry.key, name, needed)]);
            }
        }
    }
    lines
}

/// Height of the legend of a figure `width` wide, with its distance to what follows; 0 without entries.
pub(crate) fn height(entries: &[Entry], width: f64) -> f64 {
    let lines = lines(entries, width).len();
    if lines == 0 { 0.0 } else { lines as f64 * LINE + 4.0 }
}

/// Draws the legend, centred, from `top` downwards.
pub(crate) fn draw(drawing: &mut Drawing, entries: &[Entry], left: f64, top: f64, width: f64) {
    for (i, line) in lines(entries, width).into_iter().enumerate() {
        let needed: f64 = line.iter().map(|entry| entry.2).sum::<f64>() + ENTRY_GAP * (line.len() - 1) as f64;
        let middle = top + (i as f64 + 0.5) * LINE;
        let mut x = left + (width - needed) / 2.0;
        for (key, name, needed) in line {
            key.draw(drawing, x, middle);
            let at = (x + key.width() + KEY_GAP, middle + font::MIDDLE * SIZE);
            drawing.text(at, name, SIZE, Anchor::Start, Paint::Ink);
            x += needed + ENTRY_GAP;
        }
    }
}
