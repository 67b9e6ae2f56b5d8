//! Curves over a common x axis: learning curves, measures during training.

mod thin;

use crate::axis::{Axis, Scale, Tick, drawable};
use crate::color::{Marker, Paint, Style};
use crate::drawing::{Anchor, Drawing, Fill, Point, Rect, Stroke};
use crate::font;
use crate::frame::{self, Frame, PanelHeight, Plan};
use crate::layout::{About, Layout};
use crate::legend::{self, Key};
use crate::reference::{self, Reference};

/// Curves in one or several panels that share their x axis.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct CurveChart {
    /// Name and description.
    pub about: About,
    /// Size and arrangement.
    pub layout: Layout,
    /// What all panels have in common along x.
    pub x: Axis,
    /// What the curves measure. Without a label the panels' titles should say it.
    pub y: Axis,
    /// Whether each panel has its own range of y rather than one for all.
    pub free_y: bool,
    /// The panels, row by row.
    pub panels: Vec<CurvePanel>,
}

/// One panel of a [`CurveChart`].
#[derive(Clone, Debug, Default, PartialEq)]
pub struct CurvePanel {
    /// Stands above the panel; empty for none.
    pub title: String,
    /// Later ones are drawn over earlier ones.
    pub curves: Vec<Curve>,
    /// Levels to compare with.
    pub references: Vec<Reference>,
    /// Stretches of the x axis, their boundaries marked by vertical lines.
    pub stages: Vec<Stage>,
}

/// A series: what is said of all seeds, and each seed.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Curve {
    /// Its entry in the legend, once for all panels; empty for none.
    pub name: String,
    /// Colour and dash.
    pub style: Style,
    /// (x, mean or the like), in order of x. A y that is not finite interrupts the line.
    pub centre: Vec<(f64, f64)>,
    /// Whether the centre is drawn thin, as what is laid beside a curve.
    pub thin: bool,
    /// (x, lower, upper end of the interval), in order of x; empty for none, as for one seed.
    pub band: Vec<(f64, f64, f64)>,
    /// (x, y) of every seed, drawn thin; empty where they are not to be seen.
    pub seeds: Vec<Vec<(f64, f64)>>,
}

impl Curve {
    /// A curve without points.
    pub fn new(name: impl Into<String>, style: Style) -> Self {
        Self { name: name.into(), style, ..Self::default() }
    }
}

/// A stretch of the x axis with a name, such as the training on one level.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Stage {
    /// Where it begins.
    pub from: f64,
    /// Where it ends.
    pub to: f64,
    /// Stands above it: "level 0".
    pub label: String,
    /// Stands there if the labels of a panel's stages do not fit: "0".
    pub short: String,
}

/// Space that labels of the x axis may take beyond its ends.
const OVERHANG: f64 = 8.0;
/// Height of the line of stage labels.
const STAGES: f64 = font::TICK * 1.25;

impl CurveChart {
    /// Lays the figure out.
    pub fn draw(&self) -> Drawing {
        let nothing = [CurvePanel::default()];
        let panels = if self.panels.is_empty() { &nothing } else { self.panels.as_slice() };
        let names = reference::names(panels.iter().flat_map(|panel| &panel.references));
        let x_scale = Scale::fit(panels.iter().flat_map(CurvePanel::xs), &self.x, 0.0);
        let y_scales = self.y_scales(panels);
        let y_ticks: Vec<Vec<Tick>> = y_scales
            .iter()
            .map(|scale| scale.map_or_else(Vec::new, |scale| frame::y_ticks(&scale, self.layout.panel_height)))
            .collect();

        let labeled_y = |columns: usize, index: usize| self.free_y || index.is_multiple_of(columns);
        let left = frame::gutters(&self.layout, panels.len(), OVERHANG, |columns, column| {
            let labeled = (column..panels.len()).step_by(columns).filter(|index| labeled_y(columns, *index));
            frame::gutter(labeled.flat_map(|index| &y_ticks[index]).map(|tick| tick.label.as_str()))
        });
        let columns = left.len();
        let series = panels.iter().flat_map(|panel| &panel.curves).map(|curve| (curve.name.as_str(), curve.style));
        let frame = Frame {
            about: &self.about,
            layout: &self.layout,
            height: PanelHeight::Fixed(self.layout.panel_height),
            titles: self.titles(panels, &y_scales),
            legend: legend::entries(series, Key::Curve, &names),
            left,
            right: OVERHANG,
            above: if panels.iter().any(|panel| !panel.stages.is_empty()) { STAGES } else { 0.0 },
            row_gap: 0.0,
            below: frame::TICK_LINE,
            x_title: x_scale.map_or_else(|| self.x.label.clone(), |scale| self.x.title(scale.multiplier())),
            y_title: match y_scales[0] {
                Some(scale) if !self.free_y => self.y.title(scale.multiplier()),
                _ => self.y.label.clone(),
            },
            footer: 0.0,
        };
        let Plan { mut drawing, panels: rects, .. } = frame.arrange();

        let x_ticks = x_scale.map_or_else(Vec::new, |scale| {
            let ticks = |max: usize| if self.x.powers { scale.power_ticks(max) } else { scale.ticks(max) };
            frame::x_ticks_of(&scale, rects[0].width, OVERHANG, ticks)
        });
        for (index, (panel, rect)) in panels.iter().zip(rects).enumerate() {
            let (Some(x), Some(y)) = (x_scale, y_scales[index]) else {
                frame::no_data(&mut drawing, rect);
                continue;
            };
            let lowest = frame::is_lowest(index, panels.len(), columns);
            frame::draw_y_ticks(&mut drawing, rect, &y, &y_ticks[index], labeled_y(columns, index));
            frame::draw_x_ticks(&mut drawing, rect, &x, &x_ticks, lowest);
            draw_stages(&mut drawing, &panel.stages, rect, &x);
            if !panel.has_data() {
                frame::no_data(&mut drawing, rect);
                continue;
            }
            let place =
                |at: f64, value: f64| (x.place(at, rect.left, rect.right()), y.place(value, rect.bottom(), rect.top));
            drawing.clipped(rect, |drawing| {
                draw_curves(drawing, &panel.curves, place);
                reference::draw(drawing, &panel.references, &names, place);
                draw_centres(drawing, &panel.curves, place);
            });
            frame::outline(&mut drawing, rect);
        }
        drawing
    }

    /// One scale for each panel; the same for all unless y is free.
    fn y_scales(&self, panels: &[CurvePanel]) -> Vec<Option<Scale>> {
        const PADDING: f64 = 0.04;
        if self.free_y {
            panels.iter().map(|panel| Scale::fit(panel.ys(), &self.y, PADDING)).collect()
        } else {
            vec![Scale::fit(panels.iter().flat_map(CurvePanel::ys), &self.y, PADDING); panels.len()]
        }
    }

    /// The panels' titles. Where panels differ in their ranges of y, they say the multiplier.
    fn titles(&self, panels: &[CurvePanel], y_scales: &[Option<Scale>]) -> Vec<String> {
        let title =
            |(panel, scale): (&CurvePanel, &Option<Scale>)| match scale.and_then(|scale| scale.multiplier().word()) {
                Some(word) if self.free_y => format!("{} ({word})", panel.title).trim_start().to_owned(),
                _ => panel.title.clone(),
            };
        panels.iter().zip(y_scales).map(title).collect()
    }
}

impl CurvePanel {
    fn xs(&self) -> impl Iterator<Item = f64> {
        let stages = self.stages.iter().flat_map(|stage| [stage.from, stage.to]);
        let segments = self.references.iter().flat_map(|reference| &reference.segments);
        let curves = self.curves.iter().flat_map(|curve| {
            let centre = curve.centre.iter().map(|(x, _)| *x);
            centre.chain(curve.band.iter().map(|(x, ..)| *x)).chain(curve.seeds.iter().flatten().map(|(x, _)| *x))
        });
        stages.chain(segments.flat_map(|segment| [segment.from, segment.to])).chain(curves)
    }

    fn curve_ys(&self) -> impl Iterator<Item = f64> {
        self.curves.iter().flat_map(|curve| {
            let centre = curve.centre.iter().map(|(_, y)| *y);
            let band = curve.band.iter().flat_map(|(_, lower, upper)| [*lower, *upper]);
            centre.chain(band).chain(curve.seeds.iter().flatten().map(|(_, y)| *y))
        })
    }

    fn ys(&self) -> impl Iterator<Item = f64> {
        let segments = self.references.iter().flat_map(|reference| &reference.segments);
        self.curve_ys().chain(segments.map(|segment| segment.value))
    }

    fn has_data(&self) -> bool {
        self.curve_ys().any(drawable)
    }
}

/// Draws bands, then seeds.
fn draw_curves(drawing: &mut Drawing, curves: &[Curve], place: impl Fn(f64, f64) -> Point) {
    for curve in curves {
        let fill = Fill { paint: curve.style.paint(), opacity: 0.2 };
        for run in curve.band.split(|(x, lower, upper)| !(drawable(*x) && drawable(*lower) && drawable(*upper))) {
            let placed: Vec<_> = run.iter().map(|(x, lower, upper)| (place(*x, *lower), place(*x, *upper).1)).collect();
            let outline = thin::band(&placed);
            if !outline.is_empty() {
                drawing.area(vec![outline], fill);
            }
        }
    }
    for curve in curves {
        let stroke = Stroke { opacity: 0.35, ..Stroke::new(curve.style.paint(), 0.4) };
        for seed in &curve.seeds {
            draw_line(drawing, seed, stroke, &place);
        }
    }
}

fn draw_centres(drawing: &mut Drawing, curves: &[Curve], place: impl Fn(f64, f64) -> Point) {
    for curve in curves {
        let width = if curve.thin { 0.6 } else { 1.2 };
        let stroke = Stroke { dash: curve.style.dash(), ..Stroke::new(curve.style.paint(), width) };
        draw_line(drawing, &curve.centre, stroke, &place);
    }
}

/// Draws `points` as a line that breaks at values that are not finite. A point between two breaks is a dot.
fn draw_line(drawing: &mut Drawing, points: &[(f64, f64)], stroke: Stroke, place: impl Fn(f64, f64) -> Point) {
    let mut lines = Vec::new();
    for run in points.split(|(x, y)| !(drawable(*x) && drawable(*y))) {
        let placed: Vec<Point> = run.iter().map(|(x, y)| place(*x, *y)).collect();
        match placed.as_slice() {
            [] => {}
            [lone] => drawing.mark(
                *lone,
                1.2 * stroke.width,
                Marker::Circle,
                Fill { paint: stroke.paint, opacity: stroke.opacity },
            ),
            _ => lines.push(thin::line(&placed)),
        }
    }
    drawing.path(lines, stroke);
}

/// Draws the boundaries between stages, and above the panel their labels: all long, or all short.
fn draw_stages(drawing: &mut Drawing, stages: &[Stage], panel: Rect, x: &Scale) {
    let span =
        |stage: &Stage| (x.place(stage.from, panel.left, panel.right()), x.place(stage.to, panel.left, panel.right()));
    let fits = |stage: &Stage, label: &str| {
        let (from, to) = span(stage);
        font::width(label, font::TICK) + 2.0 <= to - from
    };
    let long = stages.iter().all(|stage| fits(stage, &stage.label));
    for stage in stages {
        let (from, to) = span(stage);
        // Where the next stage begins at once, that one draws the boundary.
        let ends = !stages.iter().any(|next| next.from == stage.to);
        for boundary in [Some(from), ends.then_some(to)].into_iter().flatten() {
            if boundary > panel.left + 0.5 && boundary < panel.right() - 0.5 {
                let stroke = Stroke::new(Paint::Muted, 0.5);
                drawing.line((boundary, panel.top - STAGES + 2.0), (boundary, panel.bottom()), stroke);
            }
        }
        let label = if long { &stage.label } else { &stage.short };
        // A short label that still does not fit would run into its neighbour.
        if fits(stage, label) {
            let at = ((from + to) / 2.0, panel.top - 2.2);
            drawing.text(at, label, font::TICK, Anchor::Middle, Paint::Muted);
        }
    }
}
