//! Matrices as coloured cells, such as the return on level j after stage i.

use colorgrad::{Gradient, preset};

use crate::axis::{Axis, Scale, drawable};
use crate::color::{Paint, Rgb, text_on};
use crate::drawing::{Anchor, Drawing, Point, Rect, Stroke};
use crate::font;
use crate::frame::{self, Frame, PanelHeight, Plan};
use crate::layout::{About, Layout};
use crate::number::number;

/// Matrices side by side on one colour scale.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct HeatMap {
    /// Name and description.
    pub about: About,
    /// Size and arrangement.
    pub layout: Layout,
    /// What a row is.
    pub row_label: String,
    /// What a column is.
    pub column_label: String,
    /// What the cells measure; stands at the colour bar.
    pub values: Axis,
    /// Decimals of the numbers in the cells. Numbers that do not fit lose decimals, and cells too narrow for whole
    /// numbers lose them altogether.
    pub decimals: usize,
    /// The matrices.
    pub panels: Vec<HeatPanel>,
}

/// One matrix of a [`HeatMap`].
#[derive(Clone, Debug, Default, PartialEq)]
pub struct HeatPanel {
    /// Stands above the panel; empty for none.
    pub title: String,
    /// Names of the rows, from the top.
    pub rows: Vec<String>,
    /// Names of the columns, from the left.
    pub columns: Vec<String>,
    /// `[rows][columns]`. Cells that are missing or not finite are hatched.
    pub cells: Vec<Vec<Option<f64>>>,
}

const BAR_HEIGHT: f64 = 6.0;
const FOOTER: f64 = 9.0 + BAR_HEIGHT + frame::TICK_LINE + font::LABEL * 1.3;
const OVERHANG: f64 = 3.0;
/// How high a cell is, as a share of its width and at most.
const CELL_SHARE: f64 = 0.8;
const CELL_MOST: f64 = 24.0;
/// More rows than this are no higher than their names.
const MANY_ROWS: f64 = 30.0;
const LONGEST_NAME: f64 = 80.0;

/// Values to colours, dark blue to yellow (cividis), which is safe for colour-blind readers: greater is lighter.
struct Palette {
    gradient: Box<dyn Gradient>,
    scale: Scale,
}

impl Palette {
    fn color(&self, value: f64) -> Rgb {
        let share = self.scale.place(value, 0.0, 1.0).clamp(0.0, 1.0);
        let [r, g, b, _] = self.gradient.at(share as f32).to_rgba8();
        [r, g, b]
    }
}

impl HeatMap {
    /// Lays the figure out.
    pub fn draw(&self) -> Drawing {
        let nothing = [HeatPanel::default()];
        let panels = if self.panels.is_empty() { &nothing } else { self.panels.as_slice() };
        let palette = self.palette(panels);

        let same_rows = panels.iter().all(|panel| panel.rows == panels[0].rows);
        let labeled_left = |columns: usize, index: usize| !same_rows || index.is_multiple_of(columns);
        let left = frame::gutters(&self.layout, panels.len(), OVERHANG, |columns, column| {
            let labeled = (column..panels.len()).step_by(columns).filter(|index| labeled_left(columns, *index));
            let names: Vec<_> = labeled.flat_map(|index| &panels[index].rows).map(|name| short(name)).collect();
            frame::gutter(names.iter().map(String::as_str))
        });
        let columns = left.len();
        let width = frame::panel_width(&self.layout, &left, OVERHANG, &self.row_label);
        let share = |panel: &HeatPanel| CELL_SHARE * panel.rows.len() as f64 / panel.columns.len().max(1) as f64;
        let most_rows = panels.iter().map(|panel| panel.rows.len()).max().unwrap_or(0).max(1) as f64;
        let below = panels.iter().map(|panel| names_height(panel, width)).fold(0.0, f64::max);
        let frame = Frame {
            about: &self.about,
            layout: &self.layout,
            height: PanelHeight::Share(
                panels.iter().map(share).fold(0.0, f64::max).max((font::TICK + 2.0) * most_rows / width),
                most_rows * if most_rows > MANY_ROWS { font::TICK + 2.0 } else { CELL_MOST },
            ),
            titles: panels.iter().map(|panel| panel.title.clone()).collect(),
            legend: Vec::new(),
            left,
            right: OVERHANG,
            above: 0.0,
            row_gap: below,
            below,
            x_title: self.column_label.clone(),
            y_title: self.row_label.clone(),
            footer: if palette.is_some() { FOOTER } else { 0.0 },
        };
        let Plan { mut drawing, panels: rects, footer } = frame.arrange();

        let decimals = self.decimals_that_fit(panels, &rects);
        for (index, (panel, rect)) in panels.iter().zip(&rects).enumerate() {
            match &palette {
                Some(palette) if panel.has_data() => {
                    draw_cells(&mut drawing, panel, *rect, palette, decimals);
                    draw_names(&mut drawing, panel, *rect, labeled_left(columns, index));
                    frame::outline(&mut drawing, *rect);
                }
                _ => frame::no_data(&mut drawing, *rect),
            }
        }
        if let Some(palette) = palette {
            let (from, to) = (rects[0].left, rects.iter().map(Rect::right).fold(0.0, f64::max));
            self.draw_bar(&mut drawing, &palette, (from + to) / 2.0, (to - from).min(160.0), footer + 9.0);
        }
        drawing
    }

    /// `None` without values.
    fn palette(&self, panels: &[HeatPanel]) -> Option<Palette> {
        let scale = Scale::fit(panels.iter().flat_map(HeatPanel::values), &self.values, 0.0)?;
        Some(Palette { gradient: Box::new(preset::cividis()), scale })
    }

    /// The most decimals, up to those asked for, with which every number fits its cell; `None` if none do.
    fn decimals_that_fit(&self, panels: &[HeatPanel], rects: &[Rect]) -> Option<usize> {
        (0..=self.decimals).rev().find(|decimals| {
            panels.iter().zip(rects).all(|(panel, rect)| {
                let room = rect.width / panel.columns.len().max(1) as f64 - 2.0;
                panel.values().all(|value| font::width(&number(value, *decimals), font::TICK) <= room)
            })
        })
    }

    fn draw_bar(&self, drawing: &mut Drawing, palette: &Palette, middle: f64, width: f64, top: f64) {
        const STEPS: usize = 64;
        let bar = Rect { left: middle - width / 2.0, top, width, height: BAR_HEIGHT };
        let step = width / STEPS as f64;
        let Scale { low, high } = palette.scale;
        for i in 0..STEPS {
            let value = low + (i as f64 + 0.5) / STEPS as f64 * (high - low);
            // Each step reaches under the next, or gaps show between them.
            let overlap = if i + 1 < STEPS { 0.3 } else { 0.0 };
            let rect = Rect { left: bar.left + i as f64 * step, width: step + overlap, ..bar };
            drawing.fill_rect(rect, Paint::Fixed(palette.color(value)));
        }
        frame::outline(drawing, bar);
        let ticks = frame::x_ticks(&palette.scale, width, 15.0);
        frame::draw_x_ticks(drawing, bar, &palette.scale, &ticks, true);
        let title = self.values.title(palette.scale.multiplier());
        let room = drawing.width - 2.0 * (drawing.width / 2.0 - middle).abs() - 4.0;
        let at = (middle, bar.bottom() + frame::TICK_LINE + font::LABEL * 0.95);
        drawing.text(at, font::shorten(&title, font::LABEL, room), font::LABEL, Anchor::Middle, Paint::Ink);
    }
}

impl HeatPanel {
    fn value(&self, row: usize, column: usize) -> Option<f64> {
        let cell = self.cells.get(row)?.get(column).copied().flatten();
        cell.filter(|value| drawable(*value))
    }

    fn values(&self) -> impl Iterator<Item = f64> {
        let cells = (0..self.rows.len()).flat_map(|row| (0..self.columns.len()).map(move |column| (row, column)));
        cells.filter_map(|(row, column)| self.value(row, column))
    }

    fn has_data(&self) -> bool {
        self.values().next().is_some()
    }

    fn cell(&self, panel: Rect, row: usize, column: usize) -> Rect {
        let (width, height) = (panel.width / self.columns.len() as f64, panel.height / self.rows.len() as f64);
        Rect { left: panel.left + column as f64 * width, top: panel.top + row as f64 * height, width, height }
    }
}

fn draw_cells(drawing: &mut Drawing, panel: &HeatPanel, rect: Rect, palette: &Palette, decimals: Option<usize>) {
    for row in 0..panel.rows.len() {
        for column in 0..panel.columns.len() {
            let cell = panel.cell(rect, row, column);
            let Some(value) = panel.value(row, column) else {
                draw_missing(drawing, cell, decimals.is_some());
                continue;
            };
            let color = palette.color(value);
            drawing.fill_rect(cell, Paint::Fixed(color));
            if let Some(decimals) = decimals {
                drawing.centered_text(cell.center(), number(value, decimals), font::TICK, text_on(color));
            }
        }
    }
    // Thin lines keep neighbours of like colours apart.
    for row in 1..panel.rows.len() {
        let y = panel.cell(rect, row, 0).top;
        drawing.line((rect.left, y), (rect.right(), y), Stroke::new(Paint::Surface, 0.6));
    }
    for column in 1..panel.columns.len() {
        let x = panel.cell(rect, 0, column).left;
        drawing.line((x, rect.top), (x, rect.bottom()), Stroke::new(Paint::Surface, 0.6));
    }
}

/// Hatches a cell and, where the others have numbers, writes "–" into it.
fn draw_missing(drawing: &mut Drawing, cell: Rect, labeled: bool) {
    const APART: f64 = 3.5;
    drawing.clipped(cell, |drawing| {
        let count = ((cell.width + cell.height) / APART) as usize;
        let lines: Vec<Vec<Point>> = (1..=count)
            .map(|i| {
                let x = cell.left + i as f64 * APART;
                vec![(x, cell.top), (x - cell.height, cell.bottom())]
            })
            .collect();
        drawing.path(lines, Stroke::new(Paint::Grid, 0.6));
    });
    if labeled {
        drawing.centered_text(cell.center(), "–", font::TICK, Paint::Muted);
    }
}

fn short(name: &str) -> String {
    font::shorten(name, font::TICK, LONGEST_NAME)
}

/// Whether the column names stand beside each other below a panel `width` wide.
fn names_fit(panel: &HeatPanel, width: f64) -> bool {
    let widest = font::widest(panel.columns.iter().map(String::as_str), font::TICK);
    widest + 2.0 <= width / panel.columns.len().max(1) as f64
}

fn names_height(panel: &HeatPanel, width: f64) -> f64 {
    if names_fit(panel, width) {
        frame::TICK_LINE
    } else {
        font::widest(panel.columns.iter().map(String::as_str), font::TICK).min(LONGEST_NAME) + 4.0
    }
}

fn draw_names(drawing: &mut Drawing, panel: &HeatPanel, rect: Rect, rows: bool) {
    for (row, name) in panel.rows.iter().enumerate().filter(|_| rows) {
        let y = panel.cell(rect, row, 0).center().1 + font::MIDDLE * font::TICK;
        drawing.text((rect.left - 4.3, y), short(name), font::TICK, Anchor::End, Paint::Muted);
    }
    let beside = names_fit(panel, rect.width);
    // More columns than lines of text fit side by side are named in part.
    let width = panel.cell(rect, 0, 0).width;
    let every = if beside { 1 } else { (font::TICK * font::LINE / width).ceil() as usize };
    for (column, name) in panel.columns.iter().enumerate().step_by(every) {
        let x = panel.cell(rect, 0, column).center().0;
        if beside {
            let at = (x, rect.bottom() + frame::TICK_LINE - font::DESCENT * font::TICK);
            drawing.text(at, name, font::TICK, Anchor::Middle, Paint::Muted);
        } else {
            let at = (x + font::MIDDLE * font::TICK, rect.bottom() + 3.0);
            drawing.upward_text(at, &short(name), font::TICK, Anchor::End, Paint::Muted);
        }
    }
}
