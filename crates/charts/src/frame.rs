//! Where the panels of a figure lie, and what stands around all of them: legend, panel titles and axis titles.

use crate::color::Paint;
use crate::drawing::{Anchor, Drawing, Rect, Stroke};
use crate::layout::{About, Layout};
use crate::legend::{self, Entry};
use crate::{axis, font};

/// Free space at the figure's edges.
const MARGIN: f64 = 2.0;
/// Free space between two panels of a row, besides their gutters, and between two rows.
const GAP: f64 = 7.0;
/// Length of tick marks and their distance to labels.
pub(crate) const TICK_MARK: f64 = 2.5;
const TICK_GAP: f64 = 1.8;
/// From an axis to the far edge of its tick labels' line.
pub(crate) const TICK_LINE: f64 = TICK_MARK + TICK_GAP + font::TICK * (font::ASCENT + font::DESCENT);

/// How high the panels are.
#[derive(Clone, Copy, Debug)]
pub(crate) enum PanelHeight {
    Fixed(f64),
    /// This many times the panel's width, but at most so high.
    Share(f64, f64),
}

/// What a figure needs around its panels.
#[derive(Debug)]
pub(crate) struct Frame<'a> {
    pub about: &'a About,
    pub layout: &'a Layout,
    pub height: PanelHeight,
    /// Of each panel; empty for none.
    pub titles: Vec<String>,
    pub legend: Vec<Entry>,
    /// Space left of the panels of each column, for tick labels.
    pub left: Vec<f64>,
    /// Space right of each panel, into which labels of ticks at its edge reach.
    pub right: f64,
    /// Space between a panel and its title.
    pub above: f64,
    /// Space between rows of panels, besides what all figures have.
    pub row_gap: f64,
    /// Space below the lowest panel of each column.
    pub below: f64,
    pub x_title: String,
    pub y_title: String,
    /// Space at the bottom of the figure.
    pub footer: f64,
}

/// A frame that was laid out.
#[derive(Debug)]
pub(crate) struct Plan {
    pub drawing: Drawing,
    /// The plotting areas.
    pub panels: Vec<Rect>,
    /// Upper edge of the footer.
    pub footer: f64,
}

/// The gutters of as many columns as the layout asks for, or of fewer, until panels are wide enough to be read.
/// `gutter` gives the space left of one column's panels, from the number of columns and the column.
pub(crate) fn gutters(layout: &Layout, panels: usize, right: f64, gutter: impl Fn(usize, usize) -> f64) -> Vec<f64> {
    const NARROWEST: f64 = 32.0;
    let with = |columns: usize| -> Vec<f64> { (0..columns).map(|column| gutter(columns, column)).collect() };
    let most = layout.columns.clamp(1, panels.max(1));
    // Whether there will be a y title is not known yet, so that there is room for one.
    let wide = |left: &Vec<f64>| panel_width(layout, left, right, "y") >= NARROWEST;
    (2..=most).rev().map(with).find(wide).unwrap_or_else(|| with(1))
}

/// Whether nothing stands below panel `index` of `panels`.
pub(crate) fn is_lowest(index: usize, panels: usize, columns: usize) -> bool {
    index + columns >= panels
}

/// Width that is left for each panel, if the gutters are these.
pub(crate) fn panel_width(layout: &Layout, left: &[f64], right: f64, y_title: &str) -> f64 {
    let gaps = GAP * (left.len() - 1) as f64 + right * left.len() as f64;
    let y_title = if y_title.is_empty() { 0.0 } else { font::LABEL * LABEL_LINE };
    // A figure whose labels leave no room gets tiny panels rather than negative ones.
    ((layout.width.points() - 2.0 * MARGIN - y_title - gaps - left.iter().sum::<f64>()) / left.len() as f64).max(10.0)
}

/// Height of an axis title's line, per size.
const LABEL_LINE: f64 = 1.5;

impl Frame<'_> {
    pub fn arrange(self) -> Plan {
        let width = self.layout.width.points();
        let columns = self.left.len();
        let panel_width = panel_width(self.layout, &self.left, self.right, &self.y_title);
        let panel_height = match self.height {
            PanelHeight::Fixed(height) => height,
            PanelHeight::Share(share, most) => (share * panel_width).min(most),
        };
        let legend_width = width - 2.0 * MARGIN;
        let y_title = if self.y_title.is_empty() { 0.0 } else { font::LABEL * LABEL_LINE };

        // The height is known only when all rows are placed.
        let mut drawing = Drawing::new(self.about.clone(), width, 0.0);
        legend::draw(&mut drawing, &self.legend, MARGIN, MARGIN, legend_width);
        let first = MARGIN + legend::height(&self.legend, legend_width);
        let mut top = first;
        let mut panels = Vec::new();
        for row in self.titles.chunks(columns) {
            // A title may reach over the gutters beside its panel, but neither into its neighbour's nor off the page.
            let room = panel_width + (self.right + GAP - 3.0).min(2.0 * self.left[0]);
            let titles: Vec<_> = row.iter().map(|title| font::wrap(title, font::TITLE, room, 3)).collect();
            let lines = titles.iter().map(Vec::len).max().unwrap_or(0) as f64;
            let title_height = if lines == 0.0 { 0.0 } else { lines * font::TITLE * font::LINE + 2.0 };
            let mut left = MARGIN + y_title;
            for (column, lines_of_title) in titles.iter().enumerate() {
                left += self.left[column];
                let rect =
                    Rect { left, top: top + title_height + self.above, width: panel_width, height: panel_height };
                for (i, line) in lines_of_title.iter().rev().enumerate() {
                    let baseline = top + title_height - 3.5 - i as f64 * font::TITLE * font::LINE;
                    drawing.text((rect.center().0, baseline), line, font::TITLE, Anchor::Middle, Paint::Ink);
                }
                panels.push(rect);
                left += panel_width + self.right + GAP;
            }
            top += title_height + self.above + panel_height + self.row_gap + GAP;
        }
        let bottom = panels.last().map_or(top, Rect::bottom);
        let mut end = bottom + self.below;

        let plot_left = MARGIN + y_title + self.left[0];
        let plot_right = panels.iter().map(Rect::right).fold(plot_left, f64::max);
        if !self.x_title.is_empty() {
            for line in font::wrap(&self.x_title, font::LABEL, plot_right - plot_left, 2) {
                end += font::LABEL * LABEL_LINE;
                let at = ((plot_left + plot_right) / 2.0, end - font::LABEL * (LABEL_LINE - 1.0) * 0.8);
                drawing.text(at, line, font::LABEL, Anchor::Middle, Paint::Ink);
            }
        }
        if !self.y_title.is_empty() {
            let plots = panels.first().map_or(first, |rect| rect.top)..bottom;
            // Beside a single low panel a long title may use the space around it too.
            let room = end - first;
            let line = font::shorten(&self.y_title, font::LABEL, room);
            let half = font::width(&line, font::LABEL) / 2.0;
            let middle = ((plots.start + plots.end) / 2.0).clamp(first + half, (end - half).max(first + half));
            let at = (MARGIN + font::LABEL * font::ASCENT, middle);
            drawing.upward_text(at, &line, font::LABEL, Anchor::Middle, Paint::Ink);
        }
        drawing.height = end + self.footer + MARGIN;
        Plan { drawing, panels, footer: end }
    }
}

/// Draws a panel's outline.
pub(crate) fn outline(drawing: &mut Drawing, panel: Rect) {
    drawing.frame_rect(panel, Stroke::new(Paint::Muted, 0.6));
}

/// Says in a panel's middle that it is empty.
pub(crate) fn no_data(drawing: &mut Drawing, panel: Rect) {
    outline(drawing, panel);
    drawing.centered_text(panel.center(), "no data", font::LABEL, Paint::Muted);
}

/// Draws a vertical axis's grid lines and tick marks at `ticks`, and its labels if `labeled`.
pub(crate) fn draw_y_ticks(
    drawing: &mut Drawing,
    panel: Rect,
    scale: &axis::Scale,
    ticks: &[axis::Tick],
    labeled: bool,
) {
    for tick in ticks {
        let y = scale.place(tick.value, panel.bottom(), panel.top);
        drawing.line((panel.left, y), (panel.right(), y), Stroke::new(Paint::Grid, 0.5));
        drawing.line((panel.left - TICK_MARK, y), (panel.left, y), Stroke::new(Paint::Muted, 0.6));
        if labeled {
            let at = (panel.left - TICK_MARK - TICK_GAP, y + font::MIDDLE * font::TICK);
            drawing.text(at, &tick.label, font::TICK, Anchor::End, Paint::Muted);
        }
    }
}

/// Draws a horizontal axis's tick marks at `ticks`, and its labels if `labeled`.
pub(crate) fn draw_x_ticks(
    drawing: &mut Drawing,
    panel: Rect,
    scale: &axis::Scale,
    ticks: &[axis::Tick],
    labeled: bool,
) {
    for tick in ticks {
        let x = scale.place(tick.value, panel.left, panel.right());
        drawing.line((x, panel.bottom()), (x, panel.bottom() + TICK_MARK), Stroke::new(Paint::Muted, 0.6));
        if labeled {
            let at = (x, panel.bottom() + TICK_MARK + TICK_GAP + font::ASCENT * font::TICK);
            drawing.text(at, &tick.label, font::TICK, Anchor::Middle, Paint::Muted);
        }
    }
}

/// Width of the gutter that holds `labels` beside a vertical axis.
pub(crate) fn gutter<'a>(labels: impl IntoIterator<Item = &'a str>) -> f64 {
    let widest = font::widest(labels, font::TICK);
    if widest == 0.0 { TICK_MARK } else { widest + TICK_MARK + TICK_GAP }
}

/// The ticks of a horizontal axis `width` wide: as many as fit beside each other, and such that no label reaches
/// further than `overhang` beyond the ends.
pub(crate) fn x_ticks(scale: &axis::Scale, width: f64, overhang: f64) -> Vec<axis::Tick> {
    x_ticks_of(scale, width, overhang, |max| scale.ticks(max))
}

/// The same of the ticks that `of` gives for at most so many.
pub(crate) fn x_ticks_of(
    scale: &axis::Scale,
    width: f64,
    overhang: f64,
    of: impl Fn(usize) -> Vec<axis::Tick>,
) -> Vec<axis::Tick> {
    const APART: f64 = 5.0;
    let fits = |ticks: &[axis::Tick]| {
        let spans: Vec<_> = ticks
            .iter()
            .map(|tick| {
                let (x, half) = (scale.place(tick.value, 0.0, width), font::width(&tick.label, font::TICK) / 2.0);
                (x - half, x + half)
            })
            .collect();
        let inside = spans.iter().all(|(from, to)| *from >= -overhang && *to <= width + overhang);
        inside && spans.windows(2).all(|pair| pair[0].1 + APART <= pair[1].0)
    };
    (1..=7).rev().map(of).find(|ticks| fits(ticks)).unwrap_or_default()
}

/// The ticks of a vertical axis `height` high.
pub(crate) fn y_ticks(scale: &axis::Scale, height: f64) -> Vec<axis::Tick> {
    let max = (height / (font::TICK * 2.4)) as usize;
    scale.ticks(max.clamp(1, 6))
}
