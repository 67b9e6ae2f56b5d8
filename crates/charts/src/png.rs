//! A drawing as PNG.

use std::error::Error;
use std::fmt;
use std::sync::{Arc, LazyLock};

use resvg::tiny_skia::{Pixmap, Transform};
use resvg::usvg::fontdb::Database;
use resvg::usvg::{Options, Tree};

use crate::drawing::Drawing;
use crate::font;

static FONTS: LazyLock<Arc<Database>> = LazyLock::new(|| {
    let mut fonts = Database::new();
    fonts.load_font_data(font::ARIMO.to_vec());
    Arc::new(fonts)
});

/// Why a drawing could not be rasterised.
#[derive(Debug)]
pub enum PngError {
    /// The image would be empty or too large, at this many pixels.
    Size(f64, f64),
    /// The rasteriser's reason.
    Render(String),
}

impl fmt::Display for PngError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Size(width, height) => write!(f, "cannot make an image of {width} × {height} pixels"),
            Self::Render(reason) => write!(f, "cannot draw the image: {reason}"),
        }
    }
}

impl Error for PngError {}

impl Drawing {
    /// The figure as PNG, at `scale` times 96 pixels per inch: 2 suits screens, 4 and more print.
    ///
    /// # Errors
    /// If the image would be empty or too large to hold.
    pub fn to_png(&self, scale: f64) -> Result<Vec<u8>, PngError> {
        let options = Options { fontdb: Arc::clone(&FONTS), ..Options::default() };
        let tree = Tree::from_str(&self.to_svg(), &options).map_err(|error| PngError::Render(error.to_string()))?;
        let size = tree.size();
        let [width, height] = [size.width(), size.height()].map(|side| (f64::from(side) * scale).ceil());
        let mut pixels = Pixmap::new(width as u32, height as u32).ok_or(PngError::Size(width, height))?;
        let [x, y] = [width / f64::from(size.width()), height / f64::from(size.height())].map(|factor| factor as f32);
        resvg::render(&tree, Transform::from_scale(x, y), &mut pixels.as_mut());
        pixels.encode_png().map_err(|error| PngError::Render(error.to_string()))
    }
}
