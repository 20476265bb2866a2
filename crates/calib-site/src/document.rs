//! The site file: cameras, plan, links, marks, and what solving wrote (version 1).
//!
//! Degrees, metres, pixels; the unit is in the field's name.
//!
//! What cameras have in common, as the document has it: links, marks, and measured distances.

use calib_core::camera::{FloorPoint, ImageCircle, Pixel, PlanPixel, WorldPoint};
use calib_core::floor::MarkKind;
use calib_core::single::{Annotation, Known};
#[cfg(feature = "schema")]
use calib_core::single::{USUAL_SIZES, UsualSize};
use serde::{Deserialize, Serialize};

use crate::bounds;
use crate::scene::PlaneEntry;
use crate::scene::SceneEntry;
use crate::site_solution::{ElementSolution, SiteSolution};
use crate::solution::{DistortionEntry, FailureEntry, Solution, document};

document! {
    /// Evidence shared by cameras: a point, a post, or a line of the floor.
    struct Link {
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
        /// What it is; a point if absent.
        #[serde(default)]
        kind: LinkKind,
        /// Height of a point above the floor or its plane, in metres; 0 if absent.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        height_m: Option<f64>,
        /// The plane it stands on; the floor if absent.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        plane: Option<String>,
        /// Length of a post, in metres.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        length_m: Option<Known>,
        /// Where every camera shows it.
        #[serde(deserialize_with = "bounds::items")]
        seen: Vec<LinkSeen>,
        /// What solving found out.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        solution: Option<ElementSolution>,
    }

    /// Where one camera shows a link: `px` of a point, `foot` and `head` of a post, `segment` of a line.
    struct LinkSeen {
        /// Id of the camera.
        camera: String,
        /// Of a point, raw pixel.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        px: Option<Pixel>,
        /// Of a post, raw pixel.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        foot: Option<Pixel>,
        /// Of a post, raw pixel.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        head: Option<Pixel>,
        /// Of a line, raw pixels.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        segment: Option<Vec<Pixel>>,
        /// Standard deviation of each coordinate, in pixels; that of the camera's drawings if absent.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        sigma_px: Option<f64>,
    }

    /// A virtual element of known shape.
    struct Mark {
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
        /// What it looks like.
        kind: MarkKind,
        /// Where its foot or centre is, in metres.
        at_m: WorldPoint,
        /// Turn about the vertical, counter-clockwise, in degrees.
        #[serde(default)]
        turn_deg: f64,
        /// Its size, in metres; what the numbers mean, the kind says.
        size_m: Vec<f64>,
        /// Holds the mark in a joint solve.
        #[serde(default, skip_serializing_if = "std::ops::Not::not")]
        fixed: bool,
        /// Pixels that show its named points.
        #[serde(default, deserialize_with = "bounds::items", skip_serializing_if = "Vec::is_empty")]
        seen: Vec<MarkSeen>,
        /// What solving found out.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        solution: Option<ElementSolution>,
    }

    /// A pixel that shows a named point of a mark.
    struct MarkSeen {
        /// Id of the camera.
        camera: String,
        /// Name of the point, as the kind has it.
        point: String,
        /// Raw pixel.
        px: Pixel,
    }

    /// A known distance between two links or marks.
    struct Distance {
        /// By which others refer to it.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        id: Option<String>,
        /// What the operator calls it.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        name: Option<String>,
        /// Not used.
        #[serde(default, skip_serializing_if = "std::ops::Not::not")]
        off: bool,
        /// Never rejected as an outlier.
        #[serde(default, skip_serializing_if = "std::ops::Not::not")]
        keep: bool,
        /// Ids of two links or marks.
        between: [String; 2],
        /// In metres.
        length_m: Known,
    }
}

/// What a link is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(rename_all = "snake_case")]
pub enum LinkKind {
    /// One point of the scene.
    #[default]
    Point,
    /// Something plumb, from foot to head.
    Post,
    /// One line of the floor; the views need not overlap.
    Line,
}

impl Link {
    /// A link of this kind, seen like this.
    #[must_use]
    pub const fn new(id: Option<String>, kind: LinkKind, seen: Vec<LinkSeen>) -> Self {
        Self {
            id,
            name: None,
            off: false,
            keep: false,
            kind,
            height_m: None,
            plane: None,
            length_m: None,
            seen,
            solution: None,
        }
    }
}

impl LinkSeen {
    /// What this camera is to show, still without a pixel.
    #[must_use]
    pub fn new(camera: impl Into<String>) -> Self {
        Self { camera: camera.into(), px: None, foot: None, head: None, segment: None, sigma_px: None }
    }
}

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
        #[serde(default, deserialize_with = "bounds::cameras", skip_serializing_if = "Vec::is_empty")]
        cameras: Vec<SiteCamera>,
        /// Evidence shared by cameras.
        #[serde(default, deserialize_with = "bounds::items", skip_serializing_if = "Vec::is_empty")]
        links: Vec<Link>,
        /// Virtual elements.
        #[serde(default, deserialize_with = "bounds::items", skip_serializing_if = "Vec::is_empty")]
        marks: Vec<Mark>,
        /// Known distances between links and marks.
        #[serde(default, deserialize_with = "bounds::items", skip_serializing_if = "Vec::is_empty")]
        distances: Vec<Distance>,
        /// Where world (0, 0) lies on the earth.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        georeference: Option<Georeference>,
        /// How far the scene may be from what was drawn; the usual if absent.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        scene: Option<SceneEntry>,
        /// Planes besides the floor.
        #[serde(default, deserialize_with = "bounds::items", skip_serializing_if = "Vec::is_empty")]
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
        #[serde(default, deserialize_with = "bounds::items", skip_serializing_if = "Vec::is_empty")]
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
        #[serde(default, deserialize_with = "bounds::items", skip_serializing_if = "Vec::is_empty")]
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
