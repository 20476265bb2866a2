//! Floor plans from drawings: PDF, DXF and SVG.
//!
//! A drawing consists of lines, not of pixels. [`read()`] chooses the pixels by a fixed rule, so that pixel positions
//! in a site file mean the same place in every program:
//!
//! - PDF: 150 pixels per inch of paper, fewer if a side would exceed 6,144 pixels;
//! - DXF: a round number of drawing units per pixel, so that the longer side has 3,072 to 4,096 pixels;
//! - SVG: 3,072 pixels on the longer side;
//! - TIFF above 60 megapixels: means of squares of pixels, at most 40 megapixels.
//!
//! The scale of a DXF follows from its unit. The scale of a PDF follows from a text such as "1:100" and the paper
//! size. Otherwise the scale is unknown; it is not guessed.
//!
//! Rule: a file may be hostile. Sizes, nesting and the number of points are limited, and a panic in a library is
//! an error of the file. The modules, in data-flow order:
//!
//! - `error`: reasons why a drawing is not read;
//! - `part`: part of a drawing that is rasterised separately;
//! - `scale`: scales in texts;
//! - `guard`: limits for the work of libraries;
//! - `svg_memory`, `svg`: pixels of SVG documents;
//! - `drawing`: result of reading, and recognition of file types;
//! - `pdf`: pages of PDF documents, as SVG;
//! - `dxf`: lines, texts and layers of DXF drawings, as SVG;
//! - `large_tiff`: TIFF images in parts;
//! - `map_position`: position of a georeferenced image on the map;
//! - `read`: reading of a drawing of any type.

// A module uses only the modules above it.
mod error;
mod part;
#[cfg(feature = "pdf")]
mod scale;
#[cfg(any(feature = "pdf", feature = "raster"))]
mod guard;
#[cfg(feature = "raster")]
mod svg_memory;
#[cfg(feature = "raster")]
mod svg;
mod drawing;
#[cfg(feature = "pdf")]
mod pdf;
mod dxf;
mod map_position;
#[cfg(feature = "raster")]
mod large_tiff;
mod read;

pub use drawing::{Drawing, DrawingFacts, DrawingKind, Layer, Picture, ScaleSource, View};
pub use error::PlanError;
pub use map_position::{ImagePosition, KmlOverlay, MapSystem, system_of_wkt};
pub use part::Part;
pub use read::read;
#[cfg(feature = "raster")]
pub use svg::{rasterise, rasterise_part};
