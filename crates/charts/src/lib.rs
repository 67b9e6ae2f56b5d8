//! Charts for papers and reports: a typed description in, SVG and PNG out, and one HTML file that holds them.
//!
//! The crate knows nothing of where its numbers come from. A caller fills in one of four descriptions and
//! draws it:
//!
//! | description | shows |
//! |---|---|
//! | [`CurveChart`] | curves over a common x axis, each a centre line, a band and thin individual seeds |
//! | [`IntervalChart`] | estimates with intervals and seeds, grouped by category |
//! | [`HeatMap`] | matrices as coloured cells with their numbers |
//! | [`GridMaps`] | grid worlds of free cells, walls and targets |
//!
//! All of them lay out small multiples: a [`Layout`] says how wide the figure is and in how many columns its
//! panels stand. Lengths are points (1/72 inch) throughout; no text is smaller than 7 pt at the printed width.
//!
//! ```
//! use charts::{About, Axis, Curve, CurveChart, CurvePanel, Style};
//!
//! let curve = Curve { centre: vec![(0.0, -200.0), (1e6, 12.0)], ..Curve::new("PPO", Style(0)) };
//! let chart = CurveChart {
//!     about: About::new("Return during training", "PPO rises from −200 to 12."),
//!     x: Axis::new("timesteps"),
//!     y: Axis::new("return"),
//!     panels: vec![CurvePanel { curves: vec![curve], ..CurvePanel::default() }],
//!     ..CurveChart::default()
//! };
//! let drawing = chart.draw();
//! assert!(drawing.to_svg().starts_with("<svg"));
//! ```
//!
//! # What every figure keeps to
//! - Texts are measured with the font they are set in (Arimo, whose advances are Arial's, Helvetica's and
//!   Liberation Sans's), so nothing overlaps or is cut off; what is too long is wrapped or shortened with "…".
//! - Series differ in colour (after Okabe and Ito), dash and marker, so that colour is never the only cue.
//! - Values that are not finite are gaps, never zeros. A panel without values says "no data".
//! - The same description gives the same bytes, on every machine, without system fonts.
//! - A stand-alone file is light. Inlined into a [`html::Page`] the same SVG follows the page's colours, because
//!   its elements carry classes besides their literal colours.

mod axis;
mod color;
mod curves;
mod drawing;
mod font;
mod frame;
mod heat;
pub mod html;
mod intervals;
mod layout;
mod legend;
mod maps;
mod number;
mod png;
mod reference;
mod svg;

pub use axis::Axis;
pub use color::Style;
pub use curves::{Curve, CurveChart, CurvePanel, Stage};
pub use drawing::Drawing;
pub use heat::{HeatMap, HeatPanel};
pub use intervals::{Estimate, IntervalChart, IntervalPanel, IntervalSeries, Orientation};
pub use layout::{About, Layout, Width};
pub use maps::{GridMap, GridMaps, Tile};
pub use number::number;
pub use png::PngError;
pub use reference::{Reference, Segment};

#[cfg(test)]
mod tests;
#[cfg(test)]
extern crate self as charts; // the tests share the gallery's figures, which call the crate by its name
