//! What all charts are asked for besides their data.

/// How wide a figure is printed.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Width {
    /// One column of a two-column paper: 85 mm.
    #[default]
    Column,
    /// Across both columns: 178 mm.
    Page,
}

impl Width {
    /// In points.
    pub(crate) fn points(self) -> f64 {
        match self {
            Self::Column => 241.0,
            Self::Page => 504.0,
        }
    }
}

/// Size and arrangement of a figure's panels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Layout {
    /// How wide the whole figure is.
    pub width: Width,
    /// How many panels stand side by side; further ones go into further rows.
    pub columns: usize,
    /// Height of one panel's plotting area, in points. Maps and heat maps follow their cells instead.
    pub panel_height: f64,
}

impl Default for Layout {
    fn default() -> Self {
        Self { width: Width::Column, columns: 1, panel_height: 120.0 }
    }
}

/// What a figure is called and says, for those who cannot see it; neither is drawn.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct About {
    /// A short name: the SVG's `<title>`.
    pub title: String,
    /// One or two sentences: the SVG's `<desc>`.
    pub description: String,
}

impl About {
    /// A figure's name and description.
    pub fn new(title: impl Into<String>, description: impl Into<String>) -> Self {
        Self { title: title.into(), description: description.into() }
    }
}
