//! A drawn figure: shapes and texts at their places, before any file format.

use crate::color::{Marker, Paint};
use crate::font;
use crate::layout::About;

/// A point of the drawing, x to the right and y down, in points.
pub(crate) type Point = (f64, f64);

/// An axis-aligned rectangle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Rect {
    pub left: f64,
    pub top: f64,
    pub width: f64,
    pub height: f64,
}

impl Rect {
    pub fn right(&self) -> f64 {
        self.left + self.width
    }

    pub fn bottom(&self) -> f64 {
        self.top + self.height
    }

    pub fn center(&self) -> Point {
        (self.left + self.width / 2.0, self.top + self.height / 2.0)
    }
}

/// How a line is drawn.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Stroke {
    pub paint: Paint,
    pub width: f64,
    pub dash: &'static [f64],
    pub opacity: f64,
}

impl Stroke {
    pub fn new(paint: Paint, width: f64) -> Self {
        Self { paint, width, dash: &[], opacity: 1.0 }
    }
}

/// How an area is filled.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Fill {
    pub paint: Paint,
    pub opacity: f64,
}

impl From<Paint> for Fill {
    fn from(paint: Paint) -> Self {
        Self { paint, opacity: 1.0 }
    }
}

/// Which part of a text its place is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Anchor {
    Start,
    Middle,
    End,
}

/// One line of text.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Text {
    pub at: Point,
    pub content: String,
    pub size: f64,
    pub anchor: Anchor,
    pub paint: Paint,
    /// Whether it reads upwards, turned about `at`.
    pub upwards: bool,
}

impl Text {
    /// The box that its ink lies in.
    #[cfg(test)]
    pub fn bounds(&self) -> Rect {
        let width = font::width(&self.content, self.size);
        let before = match self.anchor {
            Anchor::Start => 0.0,
            Anchor::Middle => width / 2.0,
            Anchor::End => width,
        };
        let (ascent, height) = (font::ASCENT * self.size, (font::ASCENT + font::DESCENT) * self.size);
        let (x, y) = self.at;
        if self.upwards {
            Rect { left: x - ascent, top: y + before - width, width: height, height: width }
        } else {
            Rect { left: x - before, top: y - ascent, width, height }
        }
    }
}

#[derive(Clone, Debug)]
pub(crate) enum Item {
    Text(Text),
    /// Connected runs of points; runs are closed where there is a fill.
    Path {
        runs: Vec<Vec<Point>>,
        stroke: Option<Stroke>,
        fill: Option<Fill>,
    },
    Rect {
        rect: Rect,
        stroke: Option<Stroke>,
        fill: Option<Fill>,
    },
    Mark {
        at: Point,
        radius: f64,
        marker: Marker,
        fill: Fill,
    },
    /// Items of which only what lies within the rectangle is seen.
    Clip {
        rect: Rect,
        items: Vec<Item>,
    },
}

/// A figure that was laid out; it can be written as SVG or PNG.
#[derive(Clone, Debug)]
pub struct Drawing {
    pub(crate) about: About,
    pub(crate) width: f64,
    pub(crate) height: f64,
    pub(crate) items: Vec<Item>,
}

impl Drawing {
    pub(crate) fn new(about: About, width: f64, height: f64) -> Self {
        Self { about, width, height, items: Vec::new() }
    }

    /// Width in points.
    pub fn width(&self) -> f64 {
        self.width
    }

    /// Height in points.
    pub fn height(&self) -> f64 {
        self.height
    }

    pub(crate) fn line(&mut self, from: Point, to: Point, stroke: Stroke) {
        self.path(vec![vec![from, to]], stroke);
    }

    pub(crate) fn path(&mut self, runs: Vec<Vec<Point>>, stroke: Stroke) {
        if !runs.is_empty() {
            self.items.push(Item::Path { runs, stroke: Some(stroke), fill: None });
        }
    }

    pub(crate) fn area(&mut self, runs: Vec<Vec<Point>>, fill: Fill) {
        if !runs.is_empty() {
            self.items.push(Item::Path { runs, stroke: None, fill: Some(fill) });
        }
    }

    pub(crate) fn fill_rect(&mut self, rect: Rect, fill: impl Into<Fill>) {
        self.items.push(Item::Rect { rect, stroke: None, fill: Some(fill.into()) });
    }

    pub(crate) fn frame_rect(&mut self, rect: Rect, stroke: Stroke) {
        self.items.push(Item::Rect { rect, stroke: Some(stroke), fill: None });
    }

    pub(crate) fn mark(&mut self, at: Point, radius: f64, marker: Marker, fill: impl Into<Fill>) {
        self.items.push(Item::Mark { at, radius, marker, fill: fill.into() });
    }

    /// Text whose `at` is on its baseline.
    pub(crate) fn text(&mut self, at: Point, content: impl Into<String>, size: f64, anchor: Anchor, paint: Paint) {
        self.items.push(Item::Text(Text { at, content: content.into(), size, anchor, paint, upwards: false }));
    }

    /// Text that reads upwards; `at` is on its baseline, which runs up the page.
    pub(crate) fn upward_text(&mut self, at: Point, content: &str, size: f64, anchor: Anchor, paint: Paint) {
        self.items.push(Item::Text(Text { at, content: content.to_owned(), size, anchor, paint, upwards: true }));
    }

    /// Text in the middle of `at`, in both directions.
    pub(crate) fn centered_text(&mut self, at: Point, content: impl Into<String>, size: f64, paint: Paint) {
        self.text((at.0, at.1 + font::MIDDLE * size), content, size, Anchor::Middle, paint);
    }

    /// Runs `draw` on this drawing and clips what it drew to `rect`.
    pub(crate) fn clipped(&mut self, rect: Rect, draw: impl FnOnce(&mut Self)) {
        let before = self.items.len();
        draw(self);
        let items = self.items.split_off(before);
        if !items.is_empty() {
            self.items.push(Item::Clip { rect, items });
        }
    }

    /// All texts, in drawing order.
    #[cfg(test)]
    pub(crate) fn texts(&self) -> Vec<&Text> {
        fn collect<'a>(items: &'a [Item], texts: &mut Vec<&'a Text>) {
            for item in items {
                match item {
                    Item::Text(text) => texts.push(text),
                    Item::Clip { items, .. } => collect(items, texts),
                    _ => {}
                }
            }
        }
        let mut texts = Vec::new();
        collect(&self.items, &mut texts);
        texts
    }

    /// Panics where a text leaves the drawing or touches another, or is smaller than 7 pt.
    #[cfg(test)]
    pub(crate) fn assert_legible(&self) {
        let texts = self.texts();
        for (i, text) in texts.iter().enumerate() {
            let bounds = text.bounds();
            assert!(text.size >= 7.0, "{:?} is set at {} pt", text.content, text.size);
            let inside = bounds.left >= -1e-6
                && bounds.top >= -1e-6
                && bounds.right() <= self.width + 1e-6
                && bounds.bottom() <= self.height + 1e-6;
            assert!(inside, "{:?} at {bounds:?} leaves the drawing of {} × {}", text.content, self.width, self.height);
            for other in &texts[..i] {
                let theirs = other.bounds();
                let apart = bounds.left >= theirs.right()
                    || theirs.left >= bounds.right()
                    || bounds.top >= theirs.bottom()
                    || theirs.top >= bounds.bottom();
                assert!(apart, "{:?} at {bounds:?} overlaps {:?} at {theirs:?}", text.content, other.content);
            }
        }
    }
}
