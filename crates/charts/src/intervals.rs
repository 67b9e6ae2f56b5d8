//! Estimates with intervals, grouped by category: returns per level and arm, measures per arm, probabilities.

use crate::axis::{Axis, Scale, Tick, drawable};
use crate::color::{Marker, Paint, Style};
use crate::drawing::{Anchor, Drawing, Fill, Point, Rect, Stroke};
use crate::font;
use crate::frame::{self, Frame, PanelHeight, Plan};
use crate::layout::{About, Layout};
use crate::legend::{self, Key};
use crate::reference::{self, Reference};

/// Points with intervals in one or several panels.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct IntervalChart {
    /// Name and description.
    pub about: About,
    /// Size and arrangement.
    pub layout: Layout,
    /// Which way the values run.
    pub orientation: Orientation,
    /// What the values measure.
    pub values: Axis,
    /// What the categories are; empty if they say so themselves.
    pub category_label: String,
    /// Whether each panel has its own range of values rather than one for all.
    pub free_values: bool,
    /// The panels, row by row.
    pub panels: Vec<IntervalPanel>,
}

/// Which way the values run.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Orientation {
    /// Up; categories stand side by side.
    #[default]
    Vertical,
    /// To the right; categories stand one below the other, which suits long names.
    Horizontal,
}

/// One panel of an [`IntervalChart`].
#[derive(Clone, Debug, Default, PartialEq)]
pub struct IntervalPanel {
    /// Stands above the panel; empty for none.
    pub title: String,
    /// In order from the left or from the top; one without a name serves panels whose series alone differ.
    pub categories: Vec<String>,
    /// Stand beside each other within each category.
    pub series: Vec<IntervalSeries>,
    /// Levels to compare with, across the panel or category by category.
    pub references: Vec<Reference>,
}

/// The estimates of one arm.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct IntervalSeries {
    /// Its entry in the legend, once for all panels; empty for none.
    pub name: String,
    /// Colour and marker.
    pub style: Style,
    /// One per category; what is missing is marked with "–".
    pub estimates: Vec<Option<Estimate>>,
}

/// A value and how far it can be trusted.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Estimate {
    /// The point estimate.
    pub value: f64,
    /// Lower and upper end of its interval; `None` for one seed.
    pub interval: Option<(f64, f64)>,
    /// The values of single seeds, drawn faint.
    pub seeds: Vec<f64>,
}

/// Space that labels of a horizontal axis may take beyond its ends.
const OVERHANG: f64 = 8.0;
/// Lines and share of the panel that a category's name may take.
const MAX_LINES: usize = 3;
const MAX_SHARE: f64 = 0.4;
const CATEGORY_LINE: f64 = font::TICK * font::LINE;

impl IntervalChart {
    /// Lays the figure out.
    pub fn draw(&self) -> Drawing {
        let nothing = [IntervalPanel::default()];
        let panels = if self.panels.is_empty() { &nothing } else { self.panels.as_slice() };
        let names = reference::names(panels.iter().flat_map(|panel| &panel.references));
        let scales = self.scales(panels);
        let vertical = self.orientation == Orientation::Vertical;

        // Panels of one row show the same labels at their left if these are the same.
        let same_categories = panels.iter().all(|panel| panel.categories == panels[0].categories);
        let same_left = if vertical { !self.free_values } else { same_categories };
        let labeled_left = |columns: usize, index: usize| !same_left || index.is_multiple_of(columns);
        let same_below = if vertical { same_categories } else { !self.free_values };

        let value_ticks: Vec<Vec<Tick>> = scales
            .iter()
            .map(|scale| scale.map_or_else(Vec::new, |scale| frame::y_ticks(&scale, self.layout.panel_height)))
            .collect();
        let most = MAX_SHARE * self.layout.width.points() / self.layout.columns.clamp(1, panels.len()) as f64;
        let wrapped: Vec<Vec<Vec<String>>> = panels
            .iter()
            .map(|panel| panel.categories.iter().map(|name| font::wrap(name, font::TICK, most, MAX_LINES)).collect())
            .collect();
        let left = frame::gutters(&self.layout, panels.len(), OVERHANG, |columns, column| {
            let labeled = (column..panels.len()).step_by(columns).filter(|index| labeled_left(columns, *index));
            if vertical {
                frame::gutter(labeled.flat_map(|index| &value_ticks[index]).map(|tick| tick.label.as_str()))
            } else {
                frame::gutter(labeled.flat_map(|index| wrapped[index].iter().flatten()).map(String::as_str))
            }
        });
        let columns = left.len();
        let labeled_below = |index: usize| !same_below || frame::is_lowest(index, panels.len(), columns);

        let value_title = match scales[0] {
            Some(scale) if !self.free_values => self.values.title(scale.multiplier()),
            _ => self.values.label.clone(),
        };
        let (x_title, y_title) = if vertical {
            (self.category_label.clone(), value_title)
        } else {
            (value_title, self.category_label.clone())
        };
        let below = if vertical {
            let slots = frame::panel_width(&self.layout, &left, OVERHANG, &y_title);
            panels.iter().map(|panel| category_height(panel, slots)).fold(0.0, f64::max)
        } else {
            frame::TICK_LINE
        };
        let series = panels.iter().flat_map(|panel| &panel.series).map(|series| (series.name.as_str(), series.style));
        let rows_labeled = !same_below && panels.len() > columns;
        let frame = Frame {
            about: &self.about,
            layout: &self.layout,
            height: PanelHeight::Fixed(if vertical { self.layout.panel_height } else { self.listed_height(&wrapped) }),
            titles: self.titles(panels, &scales),
            legend: legend::entries(series, Key::Point, &names),
            left,
            right: OVERHANG,
            // Labels below the panels of one row stand above the titles of the next.
            row_gap: if rows_labeled { below } else { 0.0 },
            above: 0.0,
            below,
            x_title,
            y_title,
            footer: 0.0,
        };
        let Plan { mut drawing, panels: rects, .. } = frame.arrange();

        for (index, (panel, rect)) in panels.iter().zip(rects).enumerate() {
            let Some(scale) = scales[index].filter(|_| panel.has_data()) else {
                frame::no_data(&mut drawing, rect);
                continue;
            };
            let slots = Slots { panel: rect, vertical, scale, count: panel.categories.len() };
            if vertical {
                frame::draw_y_ticks(&mut drawing, rect, &scale, &value_ticks[index], labeled_left(columns, index));
                if labeled_below(index) {
                    draw_categories_below(&mut drawing, panel, &slots);
                }
            } else {
                let ticks = frame::x_ticks(&scale, rect.width, OVERHANG);
                for tick in &ticks {
                    let x = scale.place(tick.value, rect.left, rect.right());
                    drawing.line((x, rect.top), (x, rect.bottom()), Stroke::new(Paint::Grid, 0.5));
                }
                frame::draw_x_ticks(&mut drawing, rect, &scale, &ticks, labeled_below(index));
                if labeled_left(columns, index) {
                    draw_categories_beside(&mut drawing, &wrapped[index], &slots);
                }
            }
            slots.draw_separators(&mut drawing);
            drawing.clipped(rect, |drawing| {
                reference::draw(drawing, &panel.references, &names, |along, value| slots.place(along, value));
                for (i, series) in panel.series.iter().enumerate() {
                    draw_series(drawing, series, &slots, i, panel.series.len());
                }
            });
            frame::outline(&mut drawing, rect);
        }
        drawing
    }

    fn scales(&self, panels: &[IntervalPanel]) -> Vec<Option<Scale>> {
        const PADDING: f64 = 0.06;
        if self.free_values {
            panels.iter().map(|panel| Scale::fit(panel.all_values(), &self.values, PADDING)).collect()
        } else {
            vec![Scale::fit(panels.iter().flat_map(IntervalPanel::all_values), &self.values, PADDING); panels.len()]
        }
    }

    /// Height of a panel whose categories stand one below the other: no less than their names need.
    fn listed_height(&self, names: &[Vec<Vec<String>>]) -> f64 {
        let lines = names.iter().flatten().map(Vec::len).max().unwrap_or(0).max(1) as f64;
        let categories = names.iter().map(Vec::len).max().unwrap_or(0) as f64;
        self.layout.panel_height.max(categories * (lines * CATEGORY_LINE + 2.0))
    }

    /// The panels' titles. Where panels differ in their ranges, they say the multiplier.
    fn titles(&self, panels: &[IntervalPanel], scales: &[Option<Scale>]) -> Vec<String> {
        let title = |(panel, scale): (&IntervalPanel, &Option<Scale>)| match scale
            .and_then(|scale| scale.multiplier().word())
        {
            Some(word) if self.free_values => format!("{} ({word})", panel.title).trim_start().to_owned(),
            _ => panel.title.clone(),
        };
        panels.iter().zip(scales).map(title).collect()
    }
}

impl IntervalPanel {
    fn estimated_values(&self) -> impl Iterator<Item = f64> {
        self.series.iter().flat_map(|series| series.estimates.iter().flatten()).flat_map(|estimate| {
            let ends = estimate.interval.into_iter().flat_map(|(lower, upper)| [lower, upper]);
            estimate.seeds.iter().copied().chain(ends).chain([estimate.value])
        })
    }

    fn all_values(&self) -> impl Iterator<Item = f64> {
        let segments = self.references.iter().flat_map(|reference| &reference.segments);
        self.estimated_values().chain(segments.map(|segment| segment.value))
    }

    fn has_data(&self) -> bool {
        !self.categories.is_empty() && self.estimated_values().any(drawable)
    }
}

/// The places of a panel's categories.
#[derive(Clone, Copy)]
struct Slots {
    panel: Rect,
    vertical: bool,
    scale: Scale,
    count: usize,
}

impl Slots {
    /// Extent of one category, in points.
    fn size(&self) -> f64 {
        (if self.vertical { self.panel.width } else { self.panel.height }) / self.count as f64
    }

    /// The place of `value` at `along`, which counts categories.
    fn place(&self, along: f64, value: f64) -> Point {
        let along = along.clamp(0.0, self.count as f64) * self.size();
        if self.vertical {
            (self.panel.left + along, self.scale.place(value, self.panel.bottom(), self.panel.top))
        } else {
            (self.scale.place(value, self.panel.left, self.panel.right()), self.panel.top + along)
        }
    }

    /// Lines between categories.
    fn draw_separators(&self, drawing: &mut Drawing) {
        for i in 1..self.count {
            let (from, to) = (self.place(i as f64, f64::NEG_INFINITY), self.place(i as f64, f64::INFINITY));
            drawing.line(from, to, Stroke::new(Paint::Grid, 0.5));
        }
    }
}

fn draw_series(drawing: &mut Drawing, series: &IntervalSeries, slots: &Slots, index: usize, count: usize) {
    const SHARE: f64 = 0.76;
    let step = SHARE / count as f64;
    let radius = (slots.size() * step * 0.32).clamp(1.1, 2.4);
    for category in 0..slots.count {
        let along = category as f64 + (1.0 - SHARE) / 2.0 + (index as f64 + 0.5) * step;
        let estimate = series.estimates.get(category).and_then(Option::as_ref);
        let Some(estimate) = estimate.filter(|estimate| drawable(estimate.value)) else {
            draw_missing(drawing, series.style, slots, along);
            continue;
        };
        // Seeds stand beside the interval, not under it.
        let aside = (radius + 1.2) / slots.size();
        for seed in estimate.seeds.iter().filter(|seed| drawable(**seed)) {
            let fill = Fill { paint: series.style.paint(), opacity: 0.45 };
            drawing.mark(slots.place(along + aside, *seed), 0.75, Marker::Circle, fill);
        }
        if let Some((lower, upper)) = estimate.interval.filter(|(lower, upper)| drawable(*lower) && drawable(*upper)) {
            let stroke = Stroke::new(series.style.paint(), 1.1);
            drawing.line(slots.place(along, lower), slots.place(along, upper), stroke);
            let cap = 0.8 * radius / slots.size();
            for end in [lower, upper] {
                drawing.line(slots.place(along - cap, end), slots.place(along + cap, end), stroke);
            }
        }
        drawing.mark(slots.place(along, estimate.value), radius, series.style.marker(), series.style.paint());
    }
}

/// Marks a missing estimate at the low end of the panel.
fn draw_missing(drawing: &mut Drawing, style: Style, slots: &Slots, along: f64) {
    let (x, y) = slots.place(along, f64::NEG_INFINITY);
    let at = if slots.vertical { (x, y - 5.0) } else { (x + 5.0, y) };
    drawing.centered_text(at, "–", font::TICK, style.paint());
}

/// The category names below a panel, in lines no wider than a category; `None` where a word alone is wider.
fn names_in_slots(panel: &IntervalPanel, width: f64) -> Option<Vec<Vec<String>>> {
    let slot = width / panel.categories.len().max(1) as f64 - 2.0;
    let fits = |name: &String| name.split_whitespace().all(|word| font::width(word, font::TICK) <= slot);
    panel
        .categories
        .iter()
        .all(fits)
        .then(|| panel.categories.iter().map(|name| font::wrap(name, font::TICK, slot, MAX_LINES)).collect())
}

/// How long a name may be that stands upright because it is wider than its category.
const UPRIGHT: f64 = 80.0;

/// Height of what stands below a panel `width` wide.
fn category_height(panel: &IntervalPanel, width: f64) -> f64 {
    match names_in_slots(panel, width) {
        Some(names) => {
            let lines = names.iter().map(Vec::len).max().unwrap_or(0);
            if lines == 0 { 0.0 } else { frame::TICK_LINE + (lines - 1) as f64 * CATEGORY_LINE }
        }
        None => font::widest(panel.categories.iter().map(String::as_str), font::TICK).min(UPRIGHT) + 4.0,
    }
}

fn draw_categories_below(drawing: &mut Drawing, panel: &IntervalPanel, slots: &Slots) {
    let middle = |i: usize| slots.panel.left + (i as f64 + 0.5) * slots.size();
    match names_in_slots(panel, slots.panel.width) {
        Some(names) => {
            for (i, lines) in names.iter().enumerate() {
                let mut y = slots.panel.bottom() + frame::TICK_LINE - font::DESCENT * font::TICK;
                for line in lines {
                    drawing.text((middle(i), y), line, font::TICK, Anchor::Middle, Paint::Muted);
                    y += CATEGORY_LINE;
                }
            }
        }
        None => {
            // More categories than lines of text fit side by side are named in part.
            let every = (CATEGORY_LINE / slots.size()).ceil() as usize;
            for (i, name) in panel.categories.iter().enumerate().step_by(every) {
                let name = font::shorten(name, font::TICK, UPRIGHT);
                let at = (middle(i) + font::MIDDLE * font::TICK, slots.panel.bottom() + 3.0);
                drawing.upward_text(at, &name, font::TICK, Anchor::End, Paint::Muted);
            }
        }
    }
}

fn draw_categories_beside(drawing: &mut Drawing, names: &[Vec<String>], slots: &Slots) {
    for (i, lines) in names.iter().enumerate() {
        let middle = slots.panel.top + (i as f64 + 0.5) * slots.size();
        for (k, line) in lines.iter().enumerate() {
            let y = middle + (k as f64 - (lines.len() - 1) as f64 / 2.0) * CATEGORY_LINE + font::MIDDLE * font::TICK;
            drawing.text((slots.panel.left - 4.3, y), line, font::TICK, Anchor::End, Paint::Muted);
        }
    }
}
