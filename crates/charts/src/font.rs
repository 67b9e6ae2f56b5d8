//! The font all texts are set in, and how wide and where its texts lie.

use std::sync::LazyLock;

use skrifa::charmap::Charmap;
use skrifa::instance::{LocationRef, Size};
use skrifa::metrics::GlyphMetrics;
use skrifa::{FontRef, MetadataProvider};

/// Arimo, cut down to Latin, Greek and common mathematics (`fonts/subset`), as TrueType.
pub(crate) static ARIMO: &[u8] = include_bytes!("../fonts/Arimo-subset.ttf");

/// What a viewer without Arimo should take: fonts with the same advances first.
pub(crate) const FAMILY: &str = "Arimo, Arial, Helvetica, 'Liberation Sans', sans-serif";

/// Sizes of texts, in points.
pub(crate) const TICK: f64 = 7.0;
pub(crate) const LABEL: f64 = 7.5;
pub(crate) const TITLE: f64 = 8.0;

/// Distance from one baseline to the next, and the reach of ink above and below a baseline, per size.
pub(crate) const LINE: f64 = 1.18;
pub(crate) const ASCENT: f64 = 0.75;
pub(crate) const DESCENT: f64 = 0.22;
/// From the middle of digits and capitals down to their baseline, per size.
pub(crate) const MIDDLE: f64 = 0.35;

const ELLIPSIS: &str = "…";

struct Face {
    charmap: Charmap<'static>,
    metrics: GlyphMetrics<'static>,
}

static FACE: LazyLock<Face> = LazyLock::new(|| {
    let font = FontRef::new(ARIMO).expect("the embedded font is whole");
    Face { charmap: font.charmap(), metrics: font.glyph_metrics(Size::new(1.0), LocationRef::default()) }
});

/// Width of `text` at `size`, in points. A character that the font lacks counts as a full em.
pub(crate) fn width(text: &str, size: f64) -> f64 {
    let advance =
        |c: char| FACE.charmap.map(c).and_then(|glyph| FACE.metrics.advance_width(glyph)).map_or(1.0, f64::from);
    size * text.chars().map(advance).sum::<f64>()
}

/// The widest of `texts` at `size`, in points; 0 where there is none.
pub(crate) fn widest<'a>(texts: impl IntoIterator<Item = &'a str>, size: f64) -> f64 {
    texts.into_iter().map(|text| width(text, size)).fold(0.0, f64::max)
}

/// `text`, shortened from its end with "…" until it is at most `max` wide.
pub(crate) fn shorten(text: &str, size: f64, max: f64) -> String {
    if width(text, size) <= max {
        return text.to_owned();
    }
    let mut kept: Vec<char> = text.chars().collect();
    while !kept.is_empty() {
        kept.pop();
        let shortened = kept.iter().collect::<String>().trim_end().to_owned() + ELLIPSIS;
        if width(&shortened, size) <= max {
            return shortened;
        }
    }
    ELLIPSIS.to_owned()
}

/// `text` in lines of at most `max` width and at most `lines` of them, broken between words; what does not fit
/// is shortened.
pub(crate) fn wrap(text: &str, size: f64, max: f64, lines: usize) -> Vec<String> {
    let mut wrapped: Vec<String> = Vec::new();
    for word in text.split_whitespace() {
        let joined = wrapped.last().map(|line| format!("{line} {word}"));
        match joined {
            Some(joined) if width(&joined, size) <= max || wrapped.len() == lines => {
                *wrapped.last_mut().expect("a line was joined to") = joined;
            }
            _ => wrapped.push(word.to_owned()),
        }
    }
    wrapped.iter().map(|line| shorten(line, size, max)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn advances_are_arials() {
        // Arial's advances per 2048 em units: A 1366, i 455, digits 1139, U+2212 1196.
        let expected = (1366.0 + 455.0 + 1139.0 + 1196.0) / 2048.0;
        assert!((width("Ai0−", 1.0) - expected).abs() < 1e-6);
        assert_eq!(width("漢", 7.0), 7.0);
    }

    #[test]
    fn shortened_texts_fit() {
        assert_eq!(shorten("level 0", 7.0, 100.0), "level 0");
        let short = shorten("PPO with weight decay", 7.0, 40.0);
        assert!(short.starts_with("PPO") && short.ends_with('…') && width(&short, 7.0) <= 40.0, "{short}");
        assert_eq!(shorten("PPO", 7.0, 0.0), "…");
    }

    #[test]
    fn wraps_between_words_and_keeps_to_the_lines() {
        assert_eq!(wrap("one two three", 7.0, width("one two", 7.0), 3), ["one two", "three"]);
        let two = wrap("one two three four five", 7.0, width("one two", 7.0), 2);
        assert_eq!(two[0], "one two");
        assert!(two.len() == 2 && two[1].ends_with('…'), "{two:?}");
        assert!(wrap("  ", 7.0, 10.0, 2).is_empty());
    }
}
