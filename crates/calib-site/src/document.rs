//! The site file (format version 1): cameras, floor plan, links, marks, distances, and the results of
//! solving.
//!
//! Units are degrees, metres and pixels. Most field names end with their unit.

use calib_core::camera::{FloorPoint, ImageCircle, Pixel, PlanPixel, WorldPoint};
use calib_core::floor::MarkKind;
use calib_core::single::{Annotation, Known};
#[cfg(feature = "schema")]
use calib_core::single::{USUAL_SIZES, UsualSize};
use serde::{Deserialize, Serialize};

use crate::bounds;
use crate::data_sheet::Nominal;
use crate::pixel_aspect::PixelAspectEntry;
use crate::principal_point::PrincipalPointEntry;
use crate::scene::PlaneEntry;
use crate::scene::SceneEntry;
use crate::site_solution::{ElementSolution, SiteSolution};
use crate::solution::{DistortionEntry, FailureEntry, Solution, document};
use crate::survey_entries::{Area, LevelLimitsEntry, Measurement, WallEntry};
use crate::units::Units;

/// Returns the default position of a mark without a position in the file: all coordinates are NaN.
const fn no_position() -> WorldPoint {
    WorldPoint { x: f64::NAN, y: f64::NAN, z: f64::NAN }
}

/// Returns the default size of a plan pixel, in metres: NaN. The check of the site refuses it, unless the scale is
/// read from a drawing before.
const fn not_stated() -> f64 {
    f64::NAN
}

document! {
    /// Link between cameras: a point, a post or a line on the floor that several cameras observe.
    struct Link {
        /// Identifier of the link, for references from other entries.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        id: Option<String>,
        /// Display name of the link.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        name: Option<String>,
        /// Whether the link is switched off. It is then not used; only its residual is reported.
        #[serde(default, skip_serializing_if = "std::ops::Not::not")]
        off: bool,
        /// Whether the link is protected from rejection as an outlier.
        #[serde(default, skip_serializing_if = "std::ops::Not::not")]
        keep: bool,
        /// Kind of link; a point if absent.
        #[serde(default)]
        kind: LinkKind,
        /// Height of a point above the floor or above its plane, in metres; 0 if absent.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        height_m: Option<f64>,
        /// Id of the plane of the link; the floor if absent.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        plane: Option<String>,
        /// Length of a post, in metres.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        length_m: Option<Known>,
        /// WGS84 latitude of a point, in degrees.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        lat_deg: Option<f64>,
        /// WGS84 longitude of a point, in degrees.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        lon_deg: Option<f64>,
        /// East and north of a point in the grid `crs` of the site, instead of `lat_deg` and `lon_deg`, in the unit
        /// of the grid (usually metres).
        #[serde(default, skip_serializing_if = "Option::is_none")]
        crs_m: Option<[f64; 2]>,
        /// Height of a point above the WGS84 ellipsoid, in metres, instead of `height_m`. It is not the height
        /// above sea level.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        alt_m: Option<f64>,
        /// Standard deviation of the geographic coordinates, in metres.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        sigma_m: Option<f64>,
        /// Observations, one for each camera that shows the link.
        #[serde(deserialize_with = "bounds::items")]
        seen: Vec<LinkObservation>,
        /// Result of solving: position and residuals of the link.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        solution: Option<ElementSolution>,
    }

    /// Observation of a link in one camera: `px` for a point, `foot` and `head` for a post, `segment` for a
    /// line.
    struct LinkObservation {
        /// Id of the camera that observes the link.
        camera: String,
        /// Raw pixel of a point.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        px: Option<Pixel>,
        /// Raw pixel of the foot of a post.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        foot: Option<Pixel>,
        /// Raw pixel of the head of a post.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        head: Option<Pixel>,
        /// Raw pixels of both ends of a line.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        segment: Option<Vec<Pixel>>,
        /// Standard deviation of each coordinate, in pixels; the camera's `sigma_px` if absent.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        sigma_px: Option<f64>,
    }

    /// Virtual element of known shape, such as a box or a person.
    struct Mark {
        /// Identifier of the mark, for references from other entries.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        id: Option<String>,
        /// Display name of the mark.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        name: Option<String>,
        /// Whether the mark is switched off. It is then not used; only its residuals are reported.
        #[serde(default, skip_serializing_if = "std::ops::Not::not")]
        off: bool,
        /// Whether the mark is protected from rejection as an outlier.
        #[serde(default, skip_serializing_if = "std::ops::Not::not")]
        keep: bool,
        /// Kind of shape; it defines the dimensions in `size_m` and the names of the points.
        kind: MarkKind,
        /// World position of the foot or centre, in metres. With geographic coordinates it follows from them.
        #[serde(default = "no_position")]
        at_m: WorldPoint,
        /// WGS84 latitude of the foot or centre, in degrees.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        lat_deg: Option<f64>,
        /// WGS84 longitude of the foot or centre, in degrees.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        lon_deg: Option<f64>,
        /// East and north of the foot or centre in the grid `crs` of the site, instead of `lat_deg` and `lon_deg`,
        /// in the unit of the grid (usually metres).
        #[serde(default, skip_serializing_if = "Option::is_none")]
        crs_m: Option<[f64; 2]>,
        /// Height of the foot or centre above the WGS84 ellipsoid, in metres. It is not the height above sea level.
        /// If absent, a mark with geographic coordinates stands on the floor.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        alt_m: Option<f64>,
        /// Standard deviation of the geographic coordinates, in metres.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        sigma_m: Option<f64>,
        /// Rotation about the vertical axis, counter-clockwise, in degrees.
        #[serde(default)]
        turn_deg: f64,
        /// Dimensions; their number and order depend on `kind`. Lengths are in metres; the numbers of columns and
        /// rows of a grid are counts.
        size_m: Vec<f64>,
        /// Whether the mark is fixed during joint refinement.
        #[serde(default, skip_serializing_if = "std::ops::Not::not")]
        fixed: bool,
        /// Observations of named points of the mark in the images.
        #[serde(default, deserialize_with = "bounds::items", skip_serializing_if = "Vec::is_empty")]
        seen: Vec<MarkObservation>,
        /// Result of solving: position and residuals of the mark.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        solution: Option<ElementSolution>,
    }

    /// Observation of a named point of a mark in one camera.
    struct MarkObservation {
        /// Id of the camera that observes the mark.
        camera: String,
        /// Name of the point, as defined by the kind of mark.
        point: String,
        /// Raw pixel of the observed point.
        px: Pixel,
    }

    /// Known distance between two links or marks.
    struct Distance {
        /// Identifier of the distance, for references from other entries.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        id: Option<String>,
        /// Display name of the distance.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        name: Option<String>,
        /// Whether the distance is switched off. It is then not used.
        #[serde(default, skip_serializing_if = "std::ops::Not::not")]
        off: bool,
        /// Whether the distance is protected from rejection as an outlier.
        #[serde(default, skip_serializing_if = "std::ops::Not::not")]
        keep: bool,
        /// Ids of the two links or marks.
        between: [String; 2],
        /// Measured length, in metres.
        length_m: Known,
    }
}

/// Kind of a link.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(rename_all = "snake_case")]
pub enum LinkKind {
    /// One point of the scene.
    #[default]
    Point,
    /// Vertical post, from foot to head.
    Post,
    /// One line on the floor; the views need not overlap.
    Line,
}

impl Link {
    /// Creates a link of a kind, with its observations.
    #[must_use]
    pub const fn new(id: Option<String>, kind: LinkKind, seen: Vec<LinkObservation>) -> Self {
        Self {
            id,
            name: None,
            off: false,
            keep: false,
            kind,
            height_m: None,
            plane: None,
            length_m: None,
            lat_deg: None,
            lon_deg: None,
            crs_m: None,
            alt_m: None,
            sigma_m: None,
            seen,
            solution: None,
        }
    }
}

impl LinkObservation {
    /// Creates an observation by a camera, without a pixel yet.
    #[must_use]
    pub fn new(camera: impl Into<String>) -> Self {
        Self { camera: camera.into(), px: None, foot: None, head: None, segment: None, sigma_px: None }
    }
}

/// File format identifier.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub enum Format {
    /// Site file of this project.
    #[default]
    #[serde(rename = "calib-site")]
    CalibSite,
}

document! {
    /// Site: all data that are calibrated together.
    struct Site {
        /// File format identifier: always "calib-site".
        format: Format,
        /// Version of the format: 1.
        version: u32,
        /// Display name of the site.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        name: Option<String>,
        /// Unit in which programs show lengths and accept typed lengths. Lengths in files are in metres.
        #[serde(default, skip_serializing_if = "Units::is_metres")]
        units: Units,
        /// Floor plan of the site.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        plan: Option<Plan>,
        /// Cameras of the site, one entry for each validity period.
        #[serde(default, deserialize_with = "bounds::cameras", skip_serializing_if = "Vec::is_empty")]
        cameras: Vec<SiteCamera>,
        /// Links between cameras.
        #[serde(default, deserialize_with = "bounds::items", skip_serializing_if = "Vec::is_empty")]
        links: Vec<Link>,
        /// Virtual elements of known shape.
        #[serde(default, deserialize_with = "bounds::items", skip_serializing_if = "Vec::is_empty")]
        marks: Vec<Mark>,
        /// Known distances between links and marks.
        #[serde(default, deserialize_with = "bounds::items", skip_serializing_if = "Vec::is_empty")]
        distances: Vec<Distance>,
        /// Geographic position of world (0, 0).
        #[serde(default, skip_serializing_if = "Option::is_none")]
        georeference: Option<Georeference>,
        /// Projected coordinate system of the grid coordinates `crs_m`: its EPSG code, such as "EPSG:25832".
        #[serde(default, skip_serializing_if = "Option::is_none")]
        crs: Option<String>,
        /// Expected deviations of the scene from the annotations' assumptions; the usual values if absent.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        scene: Option<SceneEntry>,
        /// Planes in addition to the floor.
        #[serde(default, deserialize_with = "bounds::items", skip_serializing_if = "Vec::is_empty")]
        planes: Vec<PlaneEntry>,
        /// Walls and obstacles that block the view, for the coverage.
        #[serde(default, deserialize_with = "bounds::items", skip_serializing_if = "Vec::is_empty")]
        walls: Vec<WallEntry>,
        /// Areas of interest, for the coverage.
        #[serde(default, deserialize_with = "bounds::items", skip_serializing_if = "Vec::is_empty")]
        areas: Vec<Area>,
        /// Smallest pixel density of each level; the limits of EN 62676-4 if absent.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        level_px_per_m: Option<LevelLimitsEntry>,
        /// Measurements in the images.
        #[serde(default, deserialize_with = "bounds::items", skip_serializing_if = "Vec::is_empty")]
        measurements: Vec<Measurement>,
        /// Points with known coordinates that wait for a click in an image, such as surveyed points.
        #[serde(default, deserialize_with = "bounds::items", skip_serializing_if = "Vec::is_empty")]
        ground_points: Vec<GroundPoint>,
        /// Results for the site as a whole.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        solution: Option<SiteSolution>,
    }

    /// Floor plan: image and scale.
    struct Plan {
        /// Path relative to the site file, or a `data:` URI: an image (such as PNG or JPEG), or a drawing (SVG,
        /// PDF or DXF).
        #[serde(default, skip_serializing_if = "Option::is_none")]
        image: Option<String>,
        /// Page of a PDF, from 1; the first if absent.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        page: Option<u32>,
        /// Shown layers of a DXF; the layers that are on in the drawing if absent.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        layers: Option<Vec<String>>,
        /// Size of a plan pixel, in metres. It may be absent if the drawing contains the scale: a DXF with a unit, or
        /// a PDF with one scale in its text.
        #[serde(default = "not_stated")]
        metres_per_px: f64,
        /// Plan pixel of world (0, 0).
        #[serde(default)]
        origin_px: PlanPixel,
        /// Angle from the plan's right to world +x, counter-clockwise, in degrees.
        #[serde(default)]
        x_axis_deg: f64,
        /// Geographic position of world (0, 0).
        #[serde(default, skip_serializing_if = "Option::is_none")]
        georeference: Option<Georeference>,
    }

    /// Geographic position of world (0, 0) and direction of world +x.
    struct Georeference {
        /// WGS84 latitude, in degrees.
        lat_deg: f64,
        /// WGS84 longitude, in degrees.
        lon_deg: f64,
        /// Azimuth of world +x, clockwise from north, in degrees.
        x_axis_azimuth_deg: f64,
        /// Height of the floor above the WGS84 ellipsoid, in metres; 0 if absent. It is not the height above
        /// sea level.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        alt_m: Option<f64>,
    }

    /// Point with known coordinates and without a pixel. A control point with the same `id` in a camera is a click
    /// on it.
    #[derive(Default)]
    struct GroundPoint {
        /// Identifier of the point.
        id: String,
        /// Description of the point.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        name: Option<String>,
        /// World coordinates, in metres.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        world_m: Option<WorldPoint>,
        /// Height above the floor of a point given by geographic coordinates, in metres; 0 if absent.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        height_m: Option<f64>,
        /// WGS84 latitude of the point, in degrees.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        lat_deg: Option<f64>,
        /// WGS84 longitude of the point, in degrees.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        lon_deg: Option<f64>,
        /// East and north of the point in the grid `crs` of the site, instead of `lat_deg` and `lon_deg`, in
        /// the unit of the grid (usually metres).
        #[serde(default, skip_serializing_if = "Option::is_none")]
        crs_m: Option<[f64; 2]>,
        /// Height of the point above the WGS84 ellipsoid, in metres, instead of `height_m`.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        alt_m: Option<f64>,
        /// Standard deviation of the known coordinates, in metres.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        sigma_m: Option<f64>,
    }

    /// Camera: its image, known values, annotations and result.
    struct SiteCamera {
        /// Identifier of the camera, for references from other entries.
        id: String,
        /// Display name of the camera.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        name: Option<String>,
        /// Image of the camera: a path relative to the site file, or a `data:` URI.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        image: Option<String>,
        /// Width and height of the image after the EXIF rotation, in pixels.
        size_px: [u32; 2],
        /// Known values of the lens and of the orientation.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        lens: Option<LensEntry>,
        /// Height above the floor, in metres.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        height_m: Option<Known>,
        /// Standard deviation of an annotated coordinate, in pixels. If absent, it is 1, or larger if the residuals
        /// require a larger value.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        sigma_px: Option<f64>,
        /// Expected deviations of the scene in this image from the annotations' assumptions; the deviations
        /// of the site if absent.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        scene: Option<SceneEntry>,
        /// Annotations on the image.
        #[serde(default, deserialize_with = "bounds::items", skip_serializing_if = "Vec::is_empty")]
        annotations: Vec<Annotation>,
        /// Polygon of the effective field of view (EFOV), in raw pixels.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        efov_px: Option<Vec<Pixel>>,
        /// Id of the plane of the EFOV polygon; the floor if absent.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        efov_plane: Option<String>,
        /// Placement of the EFOV polygon on the plan by the operator.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        placement: Option<PlacementEntry>,
        /// Image points with known coordinates.
        #[serde(default, deserialize_with = "bounds::items", skip_serializing_if = "Vec::is_empty")]
        control_points: Vec<ControlPointEntry>,
        /// Start of the validity of this calibration (RFC 3339), inclusive.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        valid_from: Option<String>,
        /// End of the validity of this calibration (RFC 3339), exclusive.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        valid_to: Option<String>,
        /// Result of solving: pose, focal length, lens and residuals of the camera.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        solution: Option<Solution>,
        /// Reason why solving gave no result for the camera.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        error: Option<FailureEntry>,
    }

    /// Known values of the lens and of the camera's orientation.
    #[derive(Default)]
    struct LensEntry {
        /// Focal length, in pixels.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        focal_px: Option<Known>,
        /// Horizontal field of view of the image, distortion included, in degrees. A bare number has a standard
        /// deviation of 3 % of the focal length.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        hfov_deg: Option<Nominal>,
        /// Vertical field of view of the image, distortion included, in degrees. A bare number has a standard
        /// deviation of 3 % of the focal length.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        vfov_deg: Option<Nominal>,
        /// Diagonal field of view of the image, distortion included, in degrees. A bare number has a standard
        /// deviation of 3 % of the focal length.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        dfov_deg: Option<Nominal>,
        /// Focal length, in millimetres; needs the size of the sensor. A bare number has a standard deviation of 3 %.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        focal_mm: Option<Nominal>,
        /// Width and height of the part of the sensor that the image shows, in millimetres.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        sensor_mm: Option<[f64; 2]>,
        /// Optical format of the sensor, in inches, such as "1/2.8". The image must show the whole sensor.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        sensor: Option<String>,
        /// Roll, in degrees; positive if the camera is rotated clockwise, seen from behind.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        roll_deg: Option<Known>,
        /// Pitch, in degrees, positive downwards.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        pitch_deg: Option<Known>,
        /// Principal point, in raw pixels: `[u, v]` if it is known, or an object with `value` and `sigma`, the prior
        /// of its estimate. If absent, it is estimated near the centre of the image; in an exact scene it is the
        /// centre. For a fisheye, the centre of the entered image circle replaces the centre of the image.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        principal_point_px: Option<PrincipalPointEntry>,
        /// Pixel aspect: width over height of a pixel, which is the ratio of the focal lengths `fy / fx`. It is a
        /// known number, or an object with `value` and `sigma`, the prior of its estimate. `{"fit": true}` estimates
        /// it from the lines. If absent, pixels are square.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        pixel_aspect: Option<PixelAspectEntry>,
        /// Part of the calibrated image that the image of this camera shows, after a digital zoom or a crop: left,
        /// top, width and height, in pixels of the calibrated image. The other lens values then belong to the
        /// calibrated image.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        window_px: Option<[f64; 4]>,
        /// Image circle of a fisheye: centre and radius, in pixels.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        image_circle_px: Option<ImageCircle>,
        /// Distortion coefficients, or the coefficients to fit.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        distortion: Option<DistortionEntry>,
        /// Id of the camera that has the same lens: its distortion and focal length are used.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        like: Option<String>,
    }

    /// Placement on the plan: translation, rotation and scale of the EFOV polygon. The polygon is projected
    /// by a camera at (0, 0, 3 m) with yaw 0 and the estimated roll, pitch and focal length.
    struct PlacementEntry {
        /// Translation on the plan, in metres: the camera's x0, y0.
        #[serde(default)]
        move_m: FloorPoint,
        /// Rotation on the plan, counter-clockwise, in degrees: the camera's yaw.
        #[serde(default)]
        turn_deg: f64,
        /// Scale of the polygon: the camera height is this factor times 3 m. If absent, the placement does
        /// not set the height.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        scale: Option<f64>,
        /// Whether x0, y0, z0 and yaw are fixed during joint refinement.
        #[serde(default, skip_serializing_if = "std::ops::Not::not")]
        fixed: bool,
        /// Coordinates that are fixed individually during joint refinement. To fix only the height, use
        /// `height_m`.
        #[serde(default, skip_serializing_if = "FixedEntry::is_empty")]
        held: FixedEntry,
        /// Whether a joint solve or an automatic search estimated the placement. It is then a start value: its
        /// scale is not evidence of the height.
        #[serde(default, skip_serializing_if = "std::ops::Not::not")]
        estimated: bool,
    }

    /// Coordinates of a placement that are exact, while joint refinement estimates the others.
    #[derive(Copy, Default, Eq)]
    struct FixedEntry {
        /// Whether x0 is fixed.
        #[serde(default, skip_serializing_if = "std::ops::Not::not")]
        x: bool,
        /// Whether y0 is fixed.
        #[serde(default, skip_serializing_if = "std::ops::Not::not")]
        y: bool,
        /// Whether the yaw is fixed.
        #[serde(default, skip_serializing_if = "std::ops::Not::not")]
        turn: bool,
    }

    /// Control point: an image point with known coordinates (`world_m`, or `plan_px` with `height_m`, or
    /// `lat_deg` and `lon_deg`, or `crs_m`).
    struct ControlPointEntry {
        /// Identifier of the control point, for references from other entries.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        id: Option<String>,
        /// Display name of the control point.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        name: Option<String>,
        /// Whether the control point is switched off. It is then not used, but its residual is still
        /// reported.
        #[serde(default, skip_serializing_if = "std::ops::Not::not")]
        off: bool,
        /// Whether the control point is protected from rejection as an outlier.
        #[serde(default, skip_serializing_if = "std::ops::Not::not")]
        keep: bool,
        /// Raw pixel of the control point.
        px: Pixel,
        /// World coordinates, in metres.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        world_m: Option<WorldPoint>,
        /// Plan pixel of the control point; its world coordinates follow from the scale of the plan.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        plan_px: Option<PlanPixel>,
        /// Height above the floor of a point given by `plan_px` or by geographic coordinates, in metres; 0 if
        /// absent.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        height_m: Option<f64>,
        /// WGS84 latitude of the control point, in degrees. Without an entered georeference, points with
        /// geographic coordinates determine the georeference of the site.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        lat_deg: Option<f64>,
        /// WGS84 longitude of the control point, in degrees.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        lon_deg: Option<f64>,
        /// East and north of the control point in the grid `crs` of the site, instead of `lat_deg` and `lon_deg`,
        /// in the unit of the grid (usually metres).
        #[serde(default, skip_serializing_if = "Option::is_none")]
        crs_m: Option<[f64; 2]>,
        /// Height of the control point above the WGS84 ellipsoid, in metres, instead of `height_m`. It is not the
        /// height above sea level.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        alt_m: Option<f64>,
        /// Standard deviation of the pixel coordinates, in pixels.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        sigma_px: Option<f64>,
        /// Standard deviation of the known coordinates, in metres.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        sigma_m: Option<f64>,
    }
}

impl Site {
    /// Creates an empty site.
    #[must_use]
    pub const fn new() -> Self {
        Self {
            format: Format::CalibSite,
            version: 1,
            name: None,
            units: Units::Metres,
            plan: None,
            cameras: Vec::new(),
            links: Vec::new(),
            marks: Vec::new(),
            distances: Vec::new(),
            georeference: None,
            crs: None,
            scene: None,
            planes: Vec::new(),
            walls: Vec::new(),
            areas: Vec::new(),
            level_px_per_m: None,
            measurements: Vec::new(),
            ground_points: Vec::new(),
            solution: None,
        }
    }

    /// Returns the document as indented JSON. Numbers have the shortest form that reads back unchanged.
    #[must_use]
    pub fn to_json(&self) -> String {
        let mut text = serde_json::to_string_pretty(self).unwrap_or_default();
        text.push('\n');
        text
    }

    /// Returns the JSON Schema of the document.
    #[cfg(feature = "schema")]
    #[must_use]
    pub fn json_schema() -> serde_json::Value {
        let mut schema = schemars::schema_for!(Self).to_value();
        if let Some(like) = schema.pointer_mut("/$defs/Annotation/properties/like") {
            like["oneOf"] = USUAL_SIZES.iter().map(usual_size_schema).collect();
        }
        // The default is NaN, which has no JSON value.
        let scale = schema.pointer_mut("/$defs/Plan/properties/metres_per_px");
        if let Some(scale) = scale.and_then(serde_json::Value::as_object_mut) {
            scale.remove("default");
        }
        let position = schema.pointer_mut("/$defs/Mark/properties/at_m");
        if let Some(position) = position.and_then(serde_json::Value::as_object_mut) {
            position.remove("default");
        }
        schema
    }
}

/// Describes an object of usual size for the schema: its name, size, uncertainty and source.
#[cfg(feature = "schema")]
fn usual_size_schema(usual: &UsualSize) -> serde_json::Value {
    let Known { value, sigma, .. } = usual.size;
    let description = format!("{value} +- {} m: {}", sigma.unwrap_or_default(), usual.source);
    serde_json::json!({ "const": usual.id, "title": usual.title, "description": description })
}

impl FixedEntry {
    /// Whether no coordinate is fixed.
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
    /// Creates a camera without known values or annotations; `size_px` is the width and height of its image.
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

    /// Returns the width and height of the image, in pixels.
    #[must_use]
    pub fn size(&self) -> [f64; 2] {
        self.size_px.map(f64::from)
    }
}
