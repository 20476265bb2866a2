//! Result of reading a drawing, and recognition of file types.

use image::RgbImage;

#[cfg(feature = "raster")]
use crate::guard::guarded;
#[cfg(feature = "raster")]
use crate::svg::rasterise;

use serde::{Deserialize, Serialize};

/// File type of a drawing.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum DrawingKind {
    /// Scalable Vector Graphics.
    Svg,
    /// Portable Document Format.
    Pdf,
    /// Drawing Exchange Format, as text or binary.
    Dxf,
    /// Drawing format of `AutoCAD`; not supported.
    Dwg,
    /// TIFF image that is read at a reduced resolution, because it is large.
    LargeTiff,
}

impl DrawingKind {
    /// Returns the type of a file from its first bytes; `None` if it is not a drawing.
    #[must_use]
    pub fn of(bytes: &[u8]) -> Option<Self> {
        /// Length of the part of the file that is searched for signatures of file types, in bytes.
        const SEARCHED_BYTES: usize = 4096;
        let head = &bytes[..bytes.len().min(SEARCHED_BYTES)];
        let text = String::from_utf8_lossy(head);
        let text = text.trim_start_matches('\u{feff}').trim_start();
        match () {
            () if head.starts_with(DXF_SENTINEL) => Some(Self::Dxf),
            () if head.windows(5).take(1024).any(|five| five == b"%PDF-") => Some(Self::Pdf),
            () if head.starts_with(b"AC10") => Some(Self::Dwg),
            () if text.starts_with('<') && text.contains("<svg") => Some(Self::Svg),
            () if is_dxf(text) => Some(Self::Dxf),
            () => None,
        }
    }
}

/// First bytes of a binary DXF.
pub(crate) const DXF_SENTINEL: &[u8] = b"AutoCAD Binary DXF\r\n\x1a\0";

/// Whether a text starts with the pairs of a DXF: comments (code 999), then "0" and "SECTION".
fn is_dxf(text: &str) -> bool {
    let mut lines = text.lines().map(str::trim);
    while let (Some(code), Some(value)) = (lines.next(), lines.next()) {
        match code {
            "999" => {}
            "0" => return value == "SECTION",
            _ => return false,
        }
    }
    false
}

/// Part of a drawing that is shown.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct View {
    /// Page of a PDF, from 1; the first if absent.
    pub page: Option<u32>,
    /// Names of the shown layers of a DXF, in any case; absent: the layers that are on in the drawing.
    pub layers: Option<Vec<String>>,
}

/// Picture of a drawing.
#[derive(Clone, Debug)]
pub enum Picture {
    /// Pixels.
    Pixels(RgbImage),
    /// Text of an SVG document.
    Svg(String),
}

/// Source of the scale of a drawing.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum ScaleSource {
    /// Unit of length of a DXF.
    Unit,
    /// Only scale in the texts of a page, such as 100 for "1:100".
    Text(u32),
}

/// Layer of a DXF.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Layer {
    /// Name.
    pub name: String,
    /// Whether the layer is shown.
    pub is_shown: bool,
    /// Number of lines and texts of the layer in the drawing.
    pub count: usize,
    /// Straight lines of a shown layer in the picture: both ends, in pixels.
    pub lines_px: Vec<[[f32; 2]; 2]>,
    /// Number of the other lines of a shown layer: arcs, circles, curves, and straight lines beyond the limit.
    pub other_lines: usize,
}

/// Properties of a drawing.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct DrawingFacts {
    /// File type.
    pub kind: DrawingKind,
    /// Width and height of the picture, in pixels.
    pub size: [u32; 2],
    /// Side of the square of pixels of the file that is one pixel of the picture; 1 except for a large TIFF.
    pub reduction: u32,
    /// Size of a pixel on paper, in metres; `None` if the drawing has no paper size.
    pub paper_metres_per_px: Option<f64>,
    /// Drawing units per pixel of a DXF.
    pub units_per_px: Option<f64>,
    /// Size of a pixel in the real world, in metres; `None` if the drawing does not contain its scale.
    pub metres_per_px: Option<f64>,
    /// Source of `metres_per_px`.
    pub scale_source: Option<ScaleSource>,
    /// All denominators of scales in the texts of the page, such as 100 for "1:100".
    pub scales_in_text: Vec<u32>,
    /// Pixel of the origin of the drawing's coordinates (DXF).
    pub origin_px: Option<[f64; 2]>,
    /// Number of pages; 1 for types without pages.
    pub pages: usize,
    /// Layers in the order of their names; empty for types without layers.
    pub layers: Vec<Layer>,
    /// Ends and corners of lines, in pixels, without duplicates.
    pub corners_px: Vec<[f32; 2]>,
    /// Parts of the drawing that are not shown, and the reason.
    pub notes: Vec<String>,
}

impl DrawingFacts {
    /// Returns the properties of a drawing of this type and size without any other information.
    pub(crate) fn new(kind: DrawingKind, size: [u32; 2]) -> Self {
        Self {
            kind,
            size,
            reduction: 1,
            paper_metres_per_px: None,
            units_per_px: None,
            metres_per_px: None,
            scale_source: None,
            scales_in_text: Vec::new(),
            origin_px: None,
            pages: 1,
            layers: Vec::new(),
            corners_px: Vec::new(),
            notes: Vec::new(),
        }
    }

    /// Whether the drawing has a layer with this name, in any case.
    #[must_use]
    pub fn has_layer(&self, name: &str) -> bool {
        has_layer(&self.layers, name)
    }

    /// Returns the pixel of world (0, 0) for a new plan. This is the origin of a DXF if the picture contains it,
    /// otherwise the lower left corner.
    #[must_use]
    pub fn world_origin_px(&self) -> [f64; 2] {
        let [width, height] = self.size.map(f64::from);
        let inside = |&[x, y]: &[f64; 2]| (0.0..=width).contains(&x) && (0.0..=height).contains(&y);
        self.origin_px.filter(inside).unwrap_or([0.0, height])
    }
}

/// Whether one of the layers has this name, in any case.
pub(crate) fn has_layer(layers: &[Layer], name: &str) -> bool {
    layers.iter().any(|layer| layer.name.to_uppercase() == name.to_uppercase())
}

/// Drawing that was read.
#[derive(Clone, Debug)]
pub struct Drawing {
    /// Rendered drawing on a white background.
    pub picture: Picture,
    /// Properties.
    pub facts: DrawingFacts,
}

impl Drawing {
    /// Returns the pixels of the picture.
    ///
    /// # Errors
    ///
    /// Fails if the drawing needs too much memory.
    #[cfg(feature = "raster")]
    pub fn into_image(self) -> Result<RgbImage, crate::error::PlanError> {
        match self.picture {
            Picture::Pixels(image) => Ok(image),
            Picture::Svg(text) => {
                let size = self.facts.size;
                guarded("drawing", move || rasterise(text.as_bytes(), Some(size)))
            }
        }
    }
}
