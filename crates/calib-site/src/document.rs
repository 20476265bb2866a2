//! The site file: cameras, plan, links, marks, and what solving wrote (version 1).
//!
//! Degrees, metres, pixels; the unit is in the field's name.

use serde::{Deserialize, Serialize};

use crate::bounded_list;
use crate::elements::{Distance, Link, Mark};
use crate::planes::PlaneEntry;
use crate::scene::SceneEntry;
use crate::site_solution::SiteSolution;
use crate::solution::{DistortionEntry, FailureEntry, Solution, document};
use calib_core::camera::{FloorPoint, ImageCircle, Pixel, PlanPixel, WorldPoint};
use calib_core::single::{Annotation, Known};
#[cfg(feature = "schema")]
use calib_core::single::{USUAL_SIZES, UsualSize};

/// The only value of [`Site::format`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub enum Format {
    /// This project's site file.
    #[default]
    #[serde(rename = "calib-site")]
    CalibSite,
}

document! {
    /// One site: everything that is calibrated together.
    struct Site {
        /// Says that this is a site file.
        format: Format,
        /// Version of the format: 1.
        version: u32,
        /// What the operator calls it.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        name: Option<String>,
        /// The floor plan.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        plan: Option<Plan>,
        /// Every camera.
        #[serde(default, deserialize_with = "bounded_list::cameras", skip_serializing_if = "Vec::is_empty")]
        cameras: Vec<SiteCamera>,
        /// Evidence shared by cameras.
        #[serde(default, deserialize_with = "bounded_list::items", skip_serializing_if = "Vec::is_empty")]
        links: Vec<Link>,
        /// Virtual elements.
        #[serde(default, deserialize_with = "bounded_list::items", skip_serializing_if = "Vec::is_empty")]
        marks: Vec<Mark>,
        /// Known distances between links and marks.
        #[serde(default, deserialize_with = "bounded_list::items", skip_serializing_if = "Vec::is_empty")]
        distances: Vec<Distance>,
        /// Where world (0, 0) lies on the earth.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        georeference: Option<Georeference>,
        /// How far the scene may be from what was drawn; the usual if absent.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        scene: Option<SceneEntry>,
        /// Planes besides the floor.
        #[serde(default, deserialize_with = "bounded_list::items", skip_serializing_if = "Vec::is_empty")]
        planes: Vec<PlaneEntry>,
        /// What solving found out about the site as a whole.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        solution: Option<SiteSolution>,
    }

    /// The floor plan's picture and its scale.
    struct Plan {
        /// Path relative to the site file, or a `data:` URI.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        image: Option<String>,
        /// Size of a plan pixel, in metres.
        metres_per_px: f64,
        /// The plan pixel of world (0, 0).
        #[serde(default)]
        origin_px: PlanPixel,
        /// Turns world +x counter-clockwise from the plan's right, in degrees.
        #[serde(default)]
        x_axis_deg: f64,
        /// Where world (0, 0) lies on the earth.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        georeference: Option<Georeference>,
    }

    /// Where world (0, 0) lies on the earth and how world +x points there.
    struct Georeference {
        /// WGS84 latitude, in degrees.
        lat_deg: f64,
        /// WGS84 longitude, in degrees.
        lon_deg: f64,
        /// Azimuth of world +x, clockwise from north, in degrees.
        x_axis_azimuth_deg: f64,
    }

    /// One camera: its still, what is known of it, what was drawn on it, and the result.
    struct SiteCamera {
        /// By which others refer to it.
        id: String,
        /// What the operator calls it.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        name: Option<String>,
        /// Path relative to the site file, or a `data:` URI.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        image: Option<String>,
        /// Width and height of the image after EXIF turning, in pixels.
        size_px: [u32; 2],
        /// What is known of the lens.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        lens: Option<LensEntry>,
        /// Height above the floor, in metres.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        height_m: Option<Known>,
        /// Standard deviation of a drawn coordinate, in pixels.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        sigma_px: Option<f64>,
        /// How far the scene in this image may be from what was drawn; that of the site if absent.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        scene: Option<SceneEntry>,
        /// What the operator drew.
        #[serde(default, deserialize_with = "bounded_list::items", skip_serializing_if = "Vec::is_empty")]
        annotations: Vec<Annotation>,
        /// The polygon of the effective field of view, raw pixels.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        efov_px: Option<Vec<Pixel>>,
        /// The plane that this polygon lies on; the floor if absent.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        efov_plane: Option<String>,
        /// What the operator did to the polygon on the plan.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        placement: Option<PlacementEntry>,
        /// Pixels that show points with known coordinates.
        #[serde(default, deserialize_with = "bounded_list::items", skip_serializing_if = "Vec::is_empty")]
        control_points: Vec<ControlPointEntry>,
        /// From when this calibration holds (RFC 3339).
        #[serde(default, skip_serializing_if = "Option::is_none")]
        valid_from: Option<String>,
        /// Until when this calibration holds (RFC 3339), exclusive.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        valid_to: Option<String>,
        /// What solving found out.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        solution: Option<Solution>,
        /// Why solving found out nothing.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        error: Option<FailureEntry>,
    }

    /// What is known of a lens and of the angles of its camera.
    #[derive(Default)]
    struct LensEntry {
        /// Focal length, in pixels.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        focal_px: Option<Known>,
        /// Roll, in degrees.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        roll_deg: Option<Known>,
        /// Pitch, in degrees.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        pitch_deg: Option<Known>,
        /// Principal point; if absent the middle of the image circle, or else of the image.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        principal_point_px: Option<Pixel>,
        /// The disc in which a fisheye shows the scene: its middle and its radius, in pixels.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        image_circle_px: Option<ImageCircle>,
        /// Distortion: given, or to be fitted.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        distortion: Option<DistortionEntry>,
        /// The camera whose distortion and focal this one shares.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        like: Option<String>,
    }

    /// Move, turn and scale of the polygon projected with (0, 0, 3 m, roll, pitch, 0, focal).
    struct PlacementEntry {
        /// Becomes x0, y0, in metres.
        #[serde(default)]
        move_m: FloorPoint,
        /// Becomes yaw, in degrees, counter-clockwise.
        #[serde(default)]
        turn_deg: f64,
        /// Multiplies the height of 3 m; absent, the placement says nothing of the height.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        scale: Option<f64>,
        /// Holds x0, y0, yaw and z0 in a joint solve.
        #[serde(default, skip_serializing_if = "std::ops::Not::not")]
        fixed: bool,
        /// Holds some of x0, y0 and yaw in a joint solve; what holds z0 alone is `height_m`.
        #[serde(default, skip_serializing_if = "HeldEntry::is_empty")]
        held: HeldEntry,
    }

    /// Which numbers of a placement are held by themselves: exact, while a joint solve estimates the others.
    #[derive(Copy, Default, Eq)]
    struct HeldEntry {
        /// x0.
        #[serde(default, skip_serializing_if = "std::ops::Not::not")]
        x: bool,
        /// y0.
        #[serde(default, skip_serializing_if = "std::ops::Not::not")]
        y: bool,
        /// The yaw.
        #[serde(default, skip_serializing_if = "std::ops::Not::not")]
        turn: bool,
    }

    /// A pixel that shows a point with known coordinates: `world_m`, or `plan_px` with `height_m`.
    struct ControlPointEntry {
        /// By which others refer to it.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        id: Option<String>,
        /// What the operator calls it.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        name: Option<String>,
        /// Not used; its residual is reported all the same.
        #[serde(default, skip_serializing_if = "std::ops::Not::not")]
        off: bool,
        /// Never rejected as an outlier.
        #[serde(default, skip_serializing_if = "std::ops::Not::not")]
        keep: bool,
        /// Raw pixel.
        px: Pixel,
        /// Where it is, in metres.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        world_m: Option<WorldPoint>,
        /// Where it is on the plan.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        plan_px: Option<PlanPixel>,
        /// Height above the floor of a point on the plan, in metres; 0 if absent.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        height_m: Option<f64>,
        /// Standard deviation of the pixel's coordinates, in pixels.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        sigma_px: Option<f64>,
        /// Standard deviation of the known coordinates, in metres.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        sigma_m: Option<f64>,
    }
}

impl Site {
    /// An empty site.
    #[must_use]
    pub const fn new() -> Self {
        Self {
            format: Format::CalibSite,
            version: 1,
            name: None,
            plan: None,
            cameras: Vec::new(),
            links: Vec::new(),
            marks: Vec::new(),
            distances: Vec::new(),
            georeference: None,
            scene: None,
            planes: Vec::new(),
            solution: None,
        }
    }

    /// The document as text, indented, numbers in the shortest form that reads back the same.
    #[must_use]
    pub fn to_json(&self) -> String {
        let mut text = serde_json::to_string_pretty(self).unwrap_or_default();
        text.push('\n');
        text
    }

    /// The JSON Schema of the document.
    #[cfg(feature = "schema")]
    #[must_use]
    pub fn json_schema() -> serde_json::Value {
        let mut schema = schemars::schema_for!(Self).to_value();
        if let Some(like) = schema.pointer_mut("/$defs/Annotation/properties/like") {
            like["oneOf"] = USUAL_SIZES.iter().map(usual_size_schema).collect();
        }
        schema
    }
}

/// The name of a thing of a usual size, with what is known of it.
#[cfg(feature = "schema")]
fn usual_size_schema(usual: &UsualSize) -> serde_json::Value {
    let Known { value, sigma, .. } = usual.size;
    let description = format!("{value} +- {} m: {}", sigma.unwrap_or_default(), usual.source);
    serde_json::json!({ "const": usual.id, "title": usual.title, "description": description })
}

impl HeldEntry {
    /// Whether none is held.
    #[must_use]
    pub const fn is_empty(&self) -> bool {
        !(self.x || self.y || self.turn)
    }
}

impl Default for Site {
    fn default() -> Self {
        Self::new()
    }
}

impl SiteCamera {
    /// A camera of which nothing is known yet.
    #[must_use]
    pub fn new(id: impl Into<String>, size_px: [u32; 2]) -> Self {
        Self {
            id: id.into(),
            name: None,
            image: None,
            size_px,
            lens: None,
            height_m: None,
            sigma_px: None,
            scene: None,
            annotations: Vec::new(),
            efov_px: None,
            efov_plane: None,
            placement: None,
            control_points: Vec::new(),
            valid_from: None,
            valid_to: None,
            solution: None,
            error: None,
        }
    }

    /// Width and height, in pixels.
    #[must_use]
    pub fn size(&self) -> [f64; 2] {
        self.size_px.map(f64::from)
    }
}
