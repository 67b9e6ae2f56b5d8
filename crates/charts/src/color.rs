//! Colours with a role: literal in a stand-alone file, the page's where the SVG is inlined.

/// How a series looks, by number: colour, dash and marker.
///
/// Give one arm the same number in all figures. Colours and markers repeat after seven, dashes after four, so
/// the combinations of lines stay distinct up to 28.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Style(pub usize);

const NUM_SERIES: usize = 7;

const DASHES: [&[f64]; 4] = [&[], &[4.5, 1.5], &[4.5, 1.3, 1.1, 1.3], &[1.5, 1.2]];

/// The shapes of points.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Marker {
    Circle,
    Square,
    Triangle,
    Diamond,
    Inverted,
    Plus,
    Cross,
}

const MARKERS: [Marker; NUM_SERIES] =
    [Marker::Circle, Marker::Square, Marker::Triangle, Marker::Diamond, Marker::Inverted, Marker::Plus, Marker::Cross];

impl Style {
    pub(crate) fn paint(self) -> Paint {
        Paint::Series(self.0 % NUM_SERIES)
    }

    pub(crate) fn dash(self) -> &'static [f64] {
        DASHES[self.0 % DASHES.len()]
    }

    pub(crate) fn marker(self) -> Marker {
        MARKERS[self.0 % NUM_SERIES]
    }
}

/// A colour by what it is for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Paint {
    /// What the figure stands on.
    Surface,
    /// Texts, references and marks.
    Ink,
    /// Axes and tick labels.
    Muted,
    /// Lines that should be seen last.
    Grid,
    /// A series, by number below [`NUM_SERIES`].
    Series(usize),
    /// The same in light and dark: cells of heat maps and maps.
    Fixed(Rgb),
}

pub(crate) type Rgb = [u8; 3];

/// Name, light and dark colour of every paint that follows the page. The series are Okabe and Ito's (blue,
/// vermilion, bluish green, reddish purple, orange, sky blue), the light ones of them darkened and in dark mode
/// the dark ones lightened, until each has a contrast of 3 : 1 with its surface.
const THEME: [(&str, Rgb, Rgb); 4 + NUM_SERIES] = [
    ("surface", [0xff, 0xff, 0xff], [0x16, 0x19, 0x1d]),
    ("ink", [0x1a, 0x1a, 0x1a], [0xec, 0xee, 0xf0]),
    ("muted", [0x55, 0x5b, 0x61], [0xa9, 0xb1, 0xba]),
    ("grid", [0xdd, 0xe0, 0xe4], [0x3a, 0x40, 0x47]),
    ("series-0", [0x00, 0x72, 0xb2], [0x4d, 0xa6, 0xe0]),
    ("series-1", [0xd5, 0x5e, 0x00], [0xf0, 0x83, 0x3a]),
    ("series-2", [0x00, 0x8f, 0x68], [0x2c, 0xc5, 0x9b]),
    ("series-3", [0xb8, 0x5c, 0x90], [0xe6, 0x9f, 0xc8]),
    ("series-4", [0xb5, 0x7d, 0x00], [0xf2, 0xb8, 0x32]),
    ("series-5", [0x2f, 0x93, 0xcf], [0x9a, 0xd6, 0xf5]),
    ("series-6", [0x6b, 0x4a, 0x3a], [0xc9, 0xa8, 0x98]),
];

impl Paint {
    fn theme(self) -> Option<&'static (&'static str, Rgb, Rgb)> {
        match self {
            Self::Surface => Some(&THEME[0]),
            Self::Ink => Some(&THEME[1]),
            Self::Muted => Some(&THEME[2]),
            Self::Grid => Some(&THEME[3]),
            Self::Series(index) => Some(&THEME[4 + index]),
            Self::Fixed(_) => None,
        }
    }

    /// The name in classes and CSS variables; `None` for what never changes.
    pub(crate) fn name(self) -> Option<&'static str> {
        self.theme().map(|theme| theme.0)
    }

    /// The colour in a stand-alone file.
    pub(crate) fn light(self) -> Rgb {
        match self {
            Self::Fixed(rgb) => rgb,
            _ => self.theme().expect("all other paints are in the theme").1,
        }
    }
}

/// `#rrggbb`.
pub(crate) fn hex([r, g, b]: Rgb) -> String {
    format!("#{r:02x}{g:02x}{b:02x}")
}

/// CSS that gives inlined charts the colours of a light or, on a dark screen, a dark page. It defines the
/// variables `--surface`, `--ink`, `--muted`, `--grid` and `--series-0` … for the page too.
pub(crate) fn stylesheet() -> String {
    let variables = |pick: fn(&(&str, Rgb, Rgb)) -> Rgb| -> String {
        THEME.iter().map(|theme| format!("--{}:{};", theme.0, hex(pick(theme)))).collect()
    };
    let rules: String = THEME
        .iter()
        .map(|(name, ..)| format!(".f-{name}{{fill:var(--{name})}}.s-{name}{{stroke:var(--{name})}}\n"))
        .collect();
    format!(
        ":root{{color-scheme:light dark;{}}}\n@media screen and (prefers-color-scheme:dark){{:root{{{}}}}}\n{rules}",
        variables(|theme| theme.1),
        variables(|theme| theme.2),
    )
}

/// Relative luminance as WCAG 2 defines it, in [0, 1].
fn luminance(rgb: Rgb) -> f64 {
    let [r, g, b] = rgb.map(|channel| {
        let c = f64::from(channel) / 255.0;
        if c <= 0.04045 { c / 12.92 } else { ((c + 0.055) / 1.055).powf(2.4) }
    });
    0.2126 * r + 0.7152 * g + 0.0722 * b
}

/// Contrast ratio as WCAG 2 defines it, in [1, 21].
pub(crate) fn contrast(a: Rgb, b: Rgb) -> f64 {
    let (a, b) = (luminance(a), luminance(b));
    (a.max(b) + 0.05) / (a.min(b) + 0.05)
}

/// Black or white, whichever is better read on `background`.
pub(crate) fn text_on(background: Rgb) -> Paint {
    const BLACK: Rgb = [0, 0, 0];
    const WHITE: Rgb = [255, 255, 255];
    Paint::Fixed(if contrast(BLACK, background) >= contrast(WHITE, background) { BLACK } else { WHITE })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_colour_is_seen_on_its_surface() {
        let [(_, light, dark), rest @ ..] = &THEME;
        for (name, on_light, on_dark) in rest.iter().filter(|theme| theme.0 != "grid") {
            let least = if matches!(*name, "ink" | "muted") { 4.5 } else { 3.0 };
            assert!(contrast(*on_light, *light) >= least, "{name} on light: {}", contrast(*on_light, *light));
            assert!(contrast(*on_dark, *dark) >= least, "{name} on dark: {}", contrast(*on_dark, *dark));
        }
    }

    #[test]
    fn lines_are_distinct_for_28_series() {
        let looks: Vec<_> = (0..28).map(|i| (Style(i).paint(), Style(i).dash())).collect();
        for (i, look) in looks.iter().enumerate() {
            assert!(!looks[..i].contains(look), "{i}");
        }
    }

    #[test]
    fn text_contrasts_with_any_cell() {
        for level in 0..=255 {
            let gray = [level; 3];
            assert!(contrast(text_on(gray).light(), gray) >= 4.5);
        }
    }
}
