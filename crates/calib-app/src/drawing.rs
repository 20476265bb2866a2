//! Images that were decoded, and plans from drawings.
//!
//! An SVG plan is rasterised once when it is loaded and stored as PNG, so that every program shows the same pixels. A
//! PDF or DXF stays the image of the plan, because its page and its layers can be changed later.

use std::path::Path;
use std::sync::Arc;

use calib_editor::images::has_ending;
use calib_plan::{DrawingFacts, ImagePosition, MapSystem, ScaleSource, View};
use calib_site::{CoordinateSystem, MapPosition, Plan, Site};
use image::RgbImage;

/// File name endings of drawings.
pub(crate) const DRAWINGS: [&str; 3] = ["dxf", "pdf", "svg"];

/// Whether a file is a drawing, by the ending of its name.
pub(crate) fn is_drawing(path: &Path) -> bool {
    DRAWINGS.iter().any(|ending| has_ending(path, ending))
}

/// Decoded image.
#[derive(Debug)]
pub struct DecodedImage {
    /// Pixels.
    pub image: RgbImage,
    /// Properties of the drawing that was rasterised; `None` for other images.
    pub drawing: Option<DrawingFacts>,
    /// SVG document of a PDF or a DXF, from which visible parts are drawn sharply.
    pub svg: Option<Arc<[u8]>>,
}

/// Returns the page and the layers of a drawing that the plan shows.
pub(crate) fn plan_view(plan: &Plan) -> View {
    View { page: plan.page, layers: plan.layers.clone() }
}

/// Returns the plan entry of a drawing, and a note on the source of its scale. `None` if the scale is unknown.
pub(crate) fn plan_from_drawing(drawing: &DrawingFacts) -> Option<(Plan, String)> {
    let metres_per_px = drawing.metres_per_px?;
    let source = match drawing.scale_source? {
        ScaleSource::Unit => "Scale read from the unit of the drawing.".into(),
        ScaleSource::Text(ratio) => {
            format!(
                "Scale 1:{ratio} read from the text of the page. Check it with the Measure tool (A) and a \
                 known distance."
            )
        }
    };
    let plan = Plan {
        image: None,
        page: None,
        layers: None,
        metres_per_px,
        origin_px: drawing.world_origin_px().into(),
        x_axis_deg: 0.0,
        georeference: None,
    };
    Some((plan, source))
}

/// Returns the plan entry of a georeferenced image, and a note on the source of the scale. `None` if neither the
/// image nor the site specifies the map grid.
pub(crate) fn plan_on_map(
    site: &Site,
    size: [u32; 2],
    position: ImagePosition,
) -> Result<Option<(Plan, String)>, String> {
    let system = match position.system {
        MapSystem::Degrees => None,
        MapSystem::Projected(code) => {
            let name = format!("EPSG:{code}");
            let system = CoordinateSystem::new(&name);
            Some(system.map_err(|error| {
                format!(
                    "The georeference of the image was not read because its grid {name} is not supported. \
                     Expected {error}."
                )
            })?)
        }
        MapSystem::Unknown => match site.coordinate_system() {
            Some(system) => Some(system),
            None => return Ok(None),
        },
    };
    let position = MapPosition { transform: position.transform, system };
    let plan = site.plan_on_map(None, size, &position).map_err(|error| error.to_string())?;
    Ok(Some((plan, "Scale and georeference read from the GeoTIFF.".into())))
}
