//! Every figure of the gallery and cases beyond it, as the formats' readers see them.

#[allow(dead_code, reason = "the gallery's page needs what its tests do not")]
#[path = "../examples/gallery/figures.rs"]
mod figures;

use resvg::usvg::roxmltree::{Document, Node};

use crate::{Axis, Curve, CurveChart, CurvePanel, Drawing, HeatMap, HeatPanel, Layout, Style, Width};

fn paths(svg: &str) -> usize {
    Document::parse(svg).unwrap().descendants().filter(|node| node.has_tag_name("path")).count()
}

fn texts(drawing: &Drawing) -> Vec<String> {
    drawing.texts().into_iter().map(|text| text.content.clone()).collect()
}

fn curve_chart(curves: Vec<Curve>) -> CurveChart {
    CurveChart { panels: vec![CurvePanel { curves, ..CurvePanel::default() }], ..CurveChart::default() }
}

#[test]
fn texts_are_whole_and_apart() {
    for example in figures::all() {
        println!("{}", example.name);
        example.drawing.assert_legible();
    }
}

#[test]
fn labels_survive_every_layout() {
    for width in [Width::Column, Width::Page] {
        for columns in [1, 2, 3, 5] {
            for (low, high) in [(-200.0f64, 45.0f64), (0.0, 1.0), (1e6, 1e6 + 3.0), (0.0, 123_456.0), (-1e-8, 1e-8)] {
                let curve = Curve {
                    centre: vec![(0.0, low), (high.abs() * 3.0, high)],
                    ..Curve::new("an arm of the study", Style(0))
                };
                let panel = CurvePanel { title: "a measure".to_owned(), curves: vec![curve], ..CurvePanel::default() };
                for free_y in [false, true] {
                    let chart = CurveChart {
                        layout: Layout { width, columns, panel_height: 60.0 },
                        x: Axis::new("timesteps"),
                        y: Axis::new("return"),
                        free_y,
                        panels: vec![panel.clone(); 5],
                        ..CurveChart::default()
                    };
                    chart.draw().assert_legible();
                }
            }
        }
    }
}

#[test]
fn svg_is_well_formed_named_and_without_ids() {
    for example in figures::all() {
        let svg = example.drawing.to_svg();
        let document = Document::parse(&svg).unwrap_or_else(|error| panic!("{}: {error}", example.name));
        let root = document.root_element();
        assert_eq!(root.attribute("role"), Some("img"));
        let child = |name| root.children().find(|node: &Node| node.has_tag_name(name)).and_then(|node| node.text());
        assert!(child("title").is_some_and(|title| !title.is_empty()), "{}", example.name);
        assert!(child("desc").is_some_and(|title| !title.is_empty()), "{}", example.name);
        assert!(document.descendants().all(|node| node.attribute("id").is_none()));
        let numbers = ["x", "y", "d", "width", "height", "viewBox", "transform"];
        let mut values = document.descendants().flat_map(|node| numbers.map(|name| node.attribute(name))).flatten();
        assert!(values.all(|value| !value.contains("NaN") && !value.contains("inf")), "{}", example.name);
    }
}

#[test]
fn the_same_description_gives_the_same_bytes() {
    for (first, second) in figures::all().iter().zip(figures::all()) {
        assert_eq!(first.drawing.to_svg(), second.drawing.to_svg(), "{}", first.name);
    }
}

#[test]
fn names_are_escaped() {
    let example = figures::all().into_iter().find(|example| example.name == "many-series").unwrap();
    let svg = example.drawing.to_svg();
    assert!(svg.contains("arm 3 &lt;&amp;&gt;") && svg.contains("Seven &lt;series&gt; &amp; more"));
}

#[test]
fn empty_charts_say_so() {
    let all_nan = Curve { centre: vec![(0.0, f64::NAN)], ..Curve::new("PPO", Style(0)) };
    for drawing in [
        CurveChart::default().draw(),
        curve_chart(Vec::new()).draw(),
        curve_chart(vec![all_nan]).draw(),
        HeatMap::default().draw(),
        crate::IntervalChart::default().draw(),
        crate::GridMaps::default().draw(),
        HeatMap {
            panels: vec![HeatPanel { rows: vec!["a".to_owned()], ..HeatPanel::default() }],
            ..HeatMap::default()
        }
        .draw(),
    ] {
        assert!(texts(&drawing).contains(&"no data".to_owned()), "{:?}", texts(&drawing));
        drawing.assert_legible();
        assert!(Document::parse(&drawing.to_svg()).is_ok());
    }
}

#[test]
fn gaps_break_lines_and_lone_points_stay_visible() {
    let centre =
        vec![(0.0, 0.0), (1.0, 1.0), (2.0, f64::NAN), (3.0, 2.0), (4.0, f64::INFINITY), (5.0, 1.0), (6.0, 0.0)];
    let svg = curve_chart(vec![Curve { centre, ..Curve::new("", Style(0)) }]).draw().to_svg();
    let document = Document::parse(&svg).unwrap();
    let lines = document.descendants().filter_map(|node| node.attribute("d")).find(|d| d.matches('M').count() == 2);
    assert!(lines.is_some(), "two runs of points make one path of two lines");
    assert_eq!(document.descendants().filter(|node| node.has_tag_name("circle")).count(), 1);
}

#[test]
fn one_seed_has_no_band() {
    let centre = vec![(0.0, 0.0), (1.0, 1.0)];
    let alone = Curve { centre: centre.clone(), ..Curve::new("", Style(0)) };
    let band = vec![(0.0, -1.0, 1.0), (1.0, 0.0, 2.0)];
    let with_band = Curve { band, ..alone.clone() };
    let [alone, with_band] = [alone, with_band].map(|curve| curve_chart(vec![curve]).draw().to_svg());
    assert!(!alone.contains("fill-opacity") && with_band.contains("fill-opacity"));
}

#[test]
fn what_is_laid_beside_a_curve_is_thin() {
    let curve = Curve { centre: vec![(0.0, 0.0), (1.0, 1.0)], ..Curve::new("", Style(0)) };
    let thin = Curve { thin: true, ..curve.clone() };
    let widths = |curve: &Curve| {
        let svg = curve_chart(vec![curve.clone()]).draw().to_svg();
        [r#"stroke-width="1.2""#, r#"stroke-width="0.6""#].map(|width| svg.matches(width).count())
    };
    let [plain, thin] = [widths(&curve), widths(&thin)];
    // Axes and ticks are as thin.
    assert_eq!((plain[0], thin), (1, [0, plain[1] + 1]));
}

#[test]
fn missing_cells_are_hatched_and_marked() {
    let panel = |cell| HeatPanel {
        rows: vec!["0".to_owned()],
        columns: ["0", "1", "2"].map(str::to_owned).to_vec(),
        cells: vec![vec![Some(1.0), Some(3.0), cell]],
        ..HeatPanel::default()
    };
    for cell in [None, Some(f64::NAN)] {
        let drawing = HeatMap { panels: vec![panel(cell)], ..HeatMap::default() }.draw();
        assert!(texts(&drawing).contains(&"–".to_owned()));
        let whole = HeatMap { panels: vec![panel(Some(2.0))], ..HeatMap::default() }.draw();
        assert!(paths(&drawing.to_svg()) > paths(&whole.to_svg()));
    }
}

#[test]
fn png_has_the_size_of_the_figure_and_shows_its_text() {
    let chart = CurveChart { x: Axis::new("timesteps"), ..CurveChart::default() };
    let drawing = chart.draw();
    let png = drawing.to_png(2.0).unwrap();
    let image = resvg::tiny_skia::Pixmap::decode_png(&png).unwrap();
    assert_eq!(f64::from(image.width()), (drawing.width() * 4.0 / 3.0 * 2.0).ceil());
    let dark = |image: &resvg::tiny_skia::Pixmap| image.pixels().iter().filter(|pixel| pixel.red() < 0x40).count();
    let silent = CurveChart::default().draw().to_png(2.0).unwrap();
    let silent = resvg::tiny_skia::Pixmap::decode_png(&silent).unwrap();
    assert!(dark(&image) > dark(&silent) + 50, "the axis title is dark");
    assert!(drawing.to_png(0.0).is_err());
}

#[test]
fn long_runs_make_small_files() {
    let seeds = (0..10).map(|seed| (0..50_000).map(|i| (f64::from(i), f64::from((i * 7919 + seed) % 1000))).collect());
    let svg = curve_chart(vec![Curve { seeds: seeds.collect(), ..Curve::new("", Style(0)) }]).draw().to_svg();
    assert!(svg.len() < 600_000, "{} bytes", svg.len());
}
