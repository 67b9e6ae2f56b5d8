//! Maps as SVG.

use std::fmt::Write;

use coverage_env::{Cell, Level};

/// Sides in SVG units: of a cell, between maps, and of the line of text below a map.
const CELL: usize = 16;
const GAP: usize = 24;
const CAPTION: usize = 24;

/// Maps side by side with their names below: targets green, walls black, free cells white.
pub fn draw(levels: &[Level]) -> String {
    let width: usize = levels.iter().map(|level| level.width() * CELL + GAP).sum::<usize>() + GAP;
    let height = levels.iter().map(Level::height).max().unwrap_or(0) * CELL + 2 * GAP + CAPTION;
    let mut svg = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {width} {height}\" width=\"{width}\" \
         height=\"{height}\" font-family=\"sans-serif\" font-size=\"13\">\n\
         <rect width=\"{width}\" height=\"{height}\" fill=\"#ffffff\"/>\n"
    );
    let mut left = GAP;
    for level in levels {
        draw_map(&mut svg, level, left);
        left += level.width() * CELL + GAP;
    }
    svg + "</svg>\n"
}

fn draw_map(svg: &mut String, level: &Level, left: usize) {
    for index in 0..level.len() {
        let fill = match level.cell(index) {
            Cell::Free => "#ffffff",
            Cell::Wall => "#000000",
            Cell::Target => "#2e9e4f",
        };
        let (row, column) = level.position(index);
        let (x, y) = (left + column * CELL, GAP + row * CELL);
        // Writing to a String cannot fail.
        let _ = writeln!(
            svg,
            "<rect x=\"{x}\" y=\"{y}\" width=\"{CELL}\" height=\"{CELL}\" fill=\"{fill}\" stroke=\"#b0b0b0\" \
             stroke-width=\"0.5\"/>"
        );
    }
    let (x, y) = (left + level.width() * CELL / 2, GAP + level.height() * CELL + CAPTION - 6);
    let name = level.name().replace('&', "&amp;").replace('<', "&lt;");
    let _ = writeln!(svg, "<text x=\"{x}\" y=\"{y}\" text-anchor=\"middle\">level {name}</text>");
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_cell_is_drawn_where_it_lies() {
        let svg = draw(&[Level::from_map("a<b", "T.#\n...").unwrap()]);
        assert_eq!(svg.matches("stroke=").count(), 6);
        assert!(svg.contains("<rect x=\"24\" y=\"24\" width=\"16\" height=\"16\" fill=\"#2e9e4f\""));
        assert!(svg.contains("<rect x=\"56\" y=\"24\" width=\"16\" height=\"16\" fill=\"#000000\""));
        assert!(svg.contains("<rect x=\"56\" y=\"40\" width=\"16\" height=\"16\" fill=\"#ffffff\""));
        assert!(svg.contains("level a&lt;b"));
    }
}
