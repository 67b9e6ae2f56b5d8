//! A drawing as SVG text.
//!
//! There are no ids, so that any number of charts can be inlined into one page; what is clipped stands in a nested
//! `<svg>`, which clips by itself. Colours are presentation attributes, which the page's classes overrule.

use std::fmt::Write;

use crate::color::{Marker, Paint, hex};
use crate::drawing::{Anchor, Drawing, Fill, Item, Point, Rect, Stroke, Text};
use crate::font;

impl Drawing {
    /// The figure as SVG: a whole document that can be written to a file or inlined into HTML.
    pub fn to_svg(&self) -> String {
        let (width, height) = (coordinate(self.width), coordinate(self.height));
        let mut svg = format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" class=\"chart\" role=\"img\" width=\"{width}pt\" \
             height=\"{height}pt\" viewBox=\"0 0 {width} {height}\" font-family=\"{}\">\n\
             <title>{}</title>\n<desc>{}</desc>\n",
            escape(font::FAMILY),
            escape(&self.about.title),
            escape(&self.about.description),
        );
        let page = Rect { left: 0.0, top: 0.0, width: self.width, height: self.height };
        write_rect(&mut svg, &page, None, Some(Paint::Surface.into()));
        for item in &self.items {
            write_item(&mut svg, item);
        }
        svg + "</svg>\n"
    }
}

fn write_item(svg: &mut String, item: &Item) {
    match item {
        Item::Text(text) => write_text(svg, text),
        Item::Path { runs, stroke, fill } => {
            let data: String = runs.iter().map(|run| path_data(run, fill.is_some())).collect();
            push(svg, format_args!("<path d=\"{data}\"{}/>\n", attributes(*stroke, *fill)));
        }
        Item::Rect { rect, stroke, fill } => write_rect(svg, rect, *stroke, *fill),
        Item::Mark { at, radius, marker, fill } => write_mark(svg, *at, *radius, *marker, *fill),
        Item::Clip { rect, items } => {
            let [x, y, width, height] = [rect.left, rect.top, rect.width, rect.height].map(coordinate);
            push(
                svg,
                format_args!(
                    "<svg x=\"{x}\" y=\"{y}\" width=\"{width}\" height=\"{height}\" \
                     viewBox=\"{x} {y} {width} {height}\">\n"
                ),
            );
            for item in items {
                write_item(svg, item);
            }
            svg.push_str("</svg>\n");
        }
    }
}

fn write_text(svg: &mut String, text: &Text) {
    let [x, y, size] = [text.at.0, text.at.1, text.size].map(coordinate);
    let anchor = match text.anchor {
        Anchor::Start => "",
        Anchor::Middle => " text-anchor=\"middle\"",
        Anchor::End => " text-anchor=\"end\"",
    };
    let turn = if text.upwards { format!(" transform=\"rotate(-90 {x} {y})\"") } else { String::new() };
    let fill = attributes(None, Some(text.paint.into()));
    let content = escape(&text.content);
    push(svg, format_args!("<text x=\"{x}\" y=\"{y}\" font-size=\"{size}\"{anchor}{turn}{fill}>{content}</text>\n"));
}

fn write_rect(svg: &mut String, rect: &Rect, stroke: Option<Stroke>, fill: Option<Fill>) {
    let [x, y, width, height] = [rect.left, rect.top, rect.width, rect.height].map(coordinate);
    let look = attributes(stroke, fill);
    push(svg, format_args!("<rect x=\"{x}\" y=\"{y}\" width=\"{width}\" height=\"{height}\"{look}/>\n"));
}

fn write_mark(svg: &mut String, at: Point, radius: f64, marker: Marker, fill: Fill) {
    let (x, y) = at;
    let shape = |corners: &[Point]| -> Vec<Point> {
        corners.iter().map(|(dx, dy)| (x + radius * dx, y + radius * dy)).collect()
    };
    let outline = |corners: &[Point]| path_data(&shape(corners), true);
    let look = attributes(None, Some(fill));
    let data = match marker {
        Marker::Circle => {
            let [x, y, r] = [x, y, radius].map(coordinate);
            return push(svg, format_args!("<circle cx=\"{x}\" cy=\"{y}\" r=\"{r}\"{look}/>\n"));
        }
        Marker::Square => outline(&[(-0.88, -0.88), (0.88, -0.88), (0.88, 0.88), (-0.88, 0.88)]),
        Marker::Triangle => outline(&[(0.0, -1.15), (1.08, 0.75), (-1.08, 0.75)]),
        Marker::Inverted => outline(&[(0.0, 1.15), (-1.08, -0.75), (1.08, -0.75)]),
        Marker::Diamond => outline(&[(0.0, -1.3), (1.1, 0.0), (0.0, 1.3), (-1.1, 0.0)]),
        Marker::Plus => outline(&cross(|(dx, dy)| (dx, dy))),
        Marker::Cross => outline(&cross(|(dx, dy)| ((dx - dy) * 0.71, (dx + dy) * 0.71))),
    };
    push(svg, format_args!("<path d=\"{data}\"{look}/>\n"));
}

/// The outline of an upright cross whose corners `turn` moves.
fn cross(turn: impl Fn(Point) -> Point) -> Vec<Point> {
    const ARM: f64 = 1.2;
    const HALF: f64 = 0.4;
    [
        (-HALF, -ARM),
        (HALF, -ARM),
        (HALF, -HALF),
        (ARM, -HALF),
        (ARM, HALF),
        (HALF, HALF),
        (HALF, ARM),
        (-HALF, ARM),
        (-HALF, HALF),
        (-ARM, HALF),
        (-ARM, -HALF),
        (-HALF, -HALF),
    ]
    .map(turn)
    .to_vec()
}

/// Path data of one run, in steps from point to point. Steps are between rounded points, so that errors do not
/// add up.
fn path_data(run: &[Point], close: bool) -> String {
    let hundredths = |value: f64| (value * 100.0).round() as i64;
    let mut data = String::new();
    let mut last: Option<(i64, i64)> = None;
    for &(x, y) in run {
        let (x, y) = (hundredths(x), hundredths(y));
        match last {
            None => push(&mut data, format_args!("M{} {}", decimal(x), decimal(y))),
            Some((last_x, last_y)) => push(&mut data, format_args!("l{} {}", decimal(x - last_x), decimal(y - last_y))),
        }
        last = Some((x, y));
    }
    if close {
        data.push('z');
    }
    data
}

fn attributes(stroke: Option<Stroke>, fill: Option<Fill>) -> String {
    let mut classes = Vec::new();
    let mut text = String::new();
    match fill {
        None => text.push_str(" fill=\"none\""),
        Some(fill) => {
            classes.extend(fill.paint.name().map(|name| format!("f-{name}")));
            push(&mut text, format_args!(" fill=\"{}\"", hex(fill.paint.light())));
            if fill.opacity < 1.0 {
                push(&mut text, format_args!(" fill-opacity=\"{}\"", coordinate(fill.opacity)));
            }
        }
    }
    if let Some(stroke) = stroke {
        classes.extend(stroke.paint.name().map(|name| format!("s-{name}")));
        let (color, width) = (hex(stroke.paint.light()), coordinate(stroke.width));
        push(&mut text, format_args!(" stroke=\"{color}\" stroke-width=\"{width}\" stroke-linejoin=\"round\""));
        if !stroke.dash.is_empty() {
            let dash: Vec<String> = stroke.dash.iter().map(|length| coordinate(*length)).collect();
            push(&mut text, format_args!(" stroke-dasharray=\"{}\"", dash.join(" ")));
        }
        if stroke.opacity < 1.0 {
            push(&mut text, format_args!(" stroke-opacity=\"{}\"", coordinate(stroke.opacity)));
        }
    }
    if classes.is_empty() { text } else { format!(" class=\"{}\"{text}", classes.join(" ")) }
}

/// `value` with at most two decimals.
fn coordinate(value: f64) -> String {
    decimal((value * 100.0).round() as i64)
}

/// `hundredths` / 100, without trailing zeros.
fn decimal(hundredths: i64) -> String {
    let sign = if hundredths < 0 { "-" } else { "" };
    let (whole, fraction) = (hundredths.unsigned_abs() / 100, hundredths.unsigned_abs() % 100);
    match fraction {
        0 => format!("{sign}{whole}"),
        tens if tens % 10 == 0 => format!("{sign}{whole}.{}", tens / 10),
        _ => format!("{sign}{whole}.{fraction:02}"),
    }
}

/// `text` as XML character data or an attribute's value. Characters that XML cannot hold become "�".
fn escape(text: &str) -> String {
    let mut escaped = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '&' => escaped.push_str("&amp;"),
            '<' => escaped.push_str("&lt;"),
            '>' => escaped.push_str("&gt;"),
            '"' => escaped.push_str("&quot;"),
            '\t' | '\n' | '\r' => escaped.push(' '),
            '\0'..='\u{1f}' | '\u{fffe}' | '\u{ffff}' => escaped.push('\u{fffd}'),
            c => escaped.push(c),
        }
    }
    escaped
}

fn push(text: &mut String, arguments: std::fmt::Arguments<'_>) {
    text.write_fmt(arguments).expect("writing to a string never fails");
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn decimals_are_short() {
        for (hundredths, expected) in [(0, "0"), (-5, "-0.05"), (150, "1.5"), (-1234, "-12.34"), (300, "3")] {
            assert_eq!(decimal(hundredths), expected);
        }
    }

    #[test]
    fn steps_return_to_where_they_began() {
        let thirds: Vec<Point> = (0..4).map(|i| (f64::from(i) / 3.0, 0.0)).collect();
        assert_eq!(path_data(&thirds, false), "M0 0l0.33 0l0.34 0l0.33 0");
    }

    #[test]
    fn escapes_what_xml_reserves_or_forbids() {
        assert_eq!(escape("a<b & \"c\"\u{1}\n>"), "a&lt;b &amp; &quot;c&quot;\u{fffd} &gt;");
    }
}
