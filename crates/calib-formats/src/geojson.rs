//! `GeoJSON` with the EFOV and the position of each camera, and the region of each plane other than the
//! floor.
//!
//! With a georeference, coordinates are WGS84 as RFC 7946 requires. Otherwise they are metres of the site,
//! and the file name contains `local`. The additional members `units` and `fields` describe the numbers.

use calib_core::{Covariance, FloorPoint, Plane};

use calib_site::{Georeference, GeoreferenceSolution, PlaneEntry, Site, SiteCoverage};
use serde_json::{Value, json};

use crate::export::{Export, Scene};
use crate::planes::covering;
use crate::tree::pretty;
use crate::view::View;

pub(crate) fn write(scene: &Scene, export: &mut Export) {
    let georeference = scene.site.georeference();
    let earth = georeference.as_ref();
    let estimated = scene.site.estimated_georeference();
    let features = scene.views.iter().flat_map(|view| features(view, earth, estimated.as_ref()));
    let planes = covering(scene.site);
    let regions = planes.iter().map(|(entry, plane)| region(entry, plane, earth));
    let features: Vec<Value> = features.chain(regions).collect();
    let mut document = json!({"type": "FeatureCollection", "features": features});
    document["fields"] = fields(earth.is_some(), !planes.is_empty());
    if earth.is_some() {
        export.push("site.geojson", pretty(&document));
        return;
    }
    document["units"] = json!("m");
    document["frame"] = json!("site");
    export.push("site.local.geojson", pretty(&document));
    export
        .notes
        .push("the site has no georeference: coordinates are metres of the site instead of WGS84".into());
}

/// Returns the coverage of a site as `GeoJSON`: rectangles of visible floor with their level, hand-over zones, and
/// areas of interest with their results. Coordinates are as in the export of the site.
#[must_use]
pub fn coverage_geojson(site: &Site, coverage: &SiteCoverage<'_>) -> String {
    let georeference = site.georeference();
    let earth = georeference.as_ref();
    let mut features = Vec::new();
    for rectangle in coverage.rectangles() {
        let level = rectangle.value.map(calib_core::floor::DensityLevel::name);
        features.push(json!({"type": "Feature", "properties": {"kind": "visible", "level": level},
            "geometry": polygon(&rectangle.corners(), earth)}));
    }
    for zone in &coverage.hand_overs {
        let found = zone.disagreement.ok();
        features.push(json!({"type": "Feature", "geometry": {"type": "Point", "coordinates": coordinates(zone.middle, earth)},
            "properties": {"kind": "hand_over", "cameras": coverage.ids_of(zone),
                "area_m2": coverage.area_of(zone), "disagreement_m": found.map(|found| found.rms),
                "worst_disagreement_m": found.map(|found| found.worst)}}));
    }
    for result in &coverage.areas {
        let found = result.coverage;
        features.push(json!({"type": "Feature", "geometry": polygon(&result.area.polygon_m, earth),
            "properties": {"kind": "area", "id": result.area.id, "name": result.area.name,
                "level": result.level, "share": found.map(|area| area.share),
                "blind_share": found.map(|area| area.blind_share),
                "worst_px_per_m": found.and_then(|area| area.worst_density)}}));
    }
    let mut document = json!({"type": "FeatureCollection", "features": features,
        "fields": {"kind": "visible: floor that a camera sees; area: area of interest; hand_over: middle of the floor \
                that two cameras see",
            "cameras": "ids of the two cameras",
            "area_m2": "floor that both cameras see, in square metres",
            "disagreement_m": "expected RMS distance between the positions that the two cameras compute for one \
                target, in metres; null if unknown",
            "worst_disagreement_m": "expected RMS distance between these positions at the worst point of the zone, \
                in metres; null if unknown",
            "level": "visible: highest level that the best camera reaches; area: required level",
            "share": "share of the area that reaches the level, from 0 to 1",
            "blind_share": "share of the area that no camera sees, from 0 to 1",
            "worst_px_per_m": "smallest pixel density of the visible part, in pixels per metre"}});
    if earth.is_none() {
        document["units"] = json!("m");
        document["frame"] = json!("site");
    }
    pretty(&document)
}

/// Returns descriptions of the properties (member `fields`), for people who read the file without this
/// program. `on_earth` states whether the site has a georeference.
fn fields(on_earth: bool, has_planes: bool) -> Value {
    let direction = if on_earth {
        ("azimuth_deg", "viewing direction, in degrees clockwise from north")
    } else {
        (
            "heading_deg",
            "viewing direction, in degrees counter-clockwise from +x of the site, seen from above",
        )
    };
    let mut fields = json!({"height_m": "height of the camera above the floor, in metres",
        "kind": "efov: the floor that the camera shows; camera: its position"});
    fields[direction.0] = json!(direction.1);
    if on_earth {
        fields["kind"] = json!(
            "efov: the floor that the camera shows; camera: its position; position_sigma: ellipse of one standard deviation of its position"
        );
        fields["sigma_east_m"] = json!("standard deviation of the position toward east, in metres");
        fields["sigma_north_m"] = json!("standard deviation of the position toward north, in metres");
        fields["sigma_azimuth_deg"] = json!("standard deviation of azimuth_deg, in degrees");
    }
    if has_planes {
        fields["height_m"] = json!(
            "height above the floor, in metres: of the camera, or of the plane at the mean of its corners"
        );
        fields["kind"] = json!(
            "efov: the floor that the camera shows; camera: its position; position_sigma: ellipse of one standard deviation of its position; plane: region of a plane other than the floor"
        );
        fields["fall_deg"] = json!("slope of the plane, in degrees");
        let (name, from) = fall_direction(on_earth);
        fields[name] = json!(format!("direction toward which the plane falls, in degrees {from}"));
    }
    fields
}

/// Returns the name of the property for the direction in which a plane falls. Also returns a text that states
/// the zero and the sense of this angle.
const fn fall_direction(on_earth: bool) -> (&'static str, &'static str) {
    if on_earth {
        ("toward_azimuth_deg", "clockwise from north")
    } else {
        ("toward_deg", "counter-clockwise from +x of the site, seen from above")
    }
}

/// Returns the `GeoJSON` feature of a plane, with the region of the plane as its geometry.
fn region(entry: &PlaneEntry, plane: &Plane, earth: Option<&Georeference>) -> Value {
    let falls = plane.toward().to_degrees();
    let falls = earth.map_or(falls, |earth| earth.x_axis_azimuth_deg - falls).rem_euclid(360.0);
    let mut properties = json!({"plane_id": entry.id, "kind": "plane", "name": entry.name,
        "height_m": plane.height, "fall_deg": plane.fall().to_degrees()});
    properties[fall_direction(earth.is_some()).0] = json!(falls);
    json!({"type": "Feature", "properties": properties, "geometry": polygon(&entry.region, earth)})
}

/// Returns the `GeoJSON` polygon with these corners; null without corners. Its ring is closed and runs
/// counter-clockwise.
fn polygon(corners: &[FloorPoint], earth: Option<&Georeference>) -> Value {
    let mut ring: Vec<[f64; 2]> = corners.iter().map(|&point| coordinates(point, earth)).collect();
    if area(&ring) < 0.0 {
        ring.reverse();
    }
    ring.extend(ring.first().copied());
    if ring.is_empty() { Value::Null } else { json!({"type": "Polygon", "coordinates": [ring]}) }
}

fn coordinates(point: FloorPoint, earth: Option<&Georeference>) -> [f64; 2] {
    earth.map_or(point.into(), |earth| to_wgs84(earth, point))
}

fn features(
    view: &View,
    earth: Option<&Georeference>,
    estimated: Option<&GeoreferenceSolution>,
) -> Vec<Value> {
    let position = view.camera.position;
    // The heading counts clockwise from north with a georeference, otherwise counter-clockwise from +x.
    let heading = match earth {
        Some(earth) => json!({"azimuth_deg": view.azimuth_deg(earth)}),
        None => json!({"heading_deg": (90.0 + view.camera.yaw.to_degrees()).rem_euclid(360.0)}),
    };
    let mut camera = json!({"camera_id": view.id, "kind": "camera", "height_m": position.z});
    if let (Some(into), Some(from)) = (camera.as_object_mut(), heading.as_object()) {
        into.extend(from.clone());
    }
    let error = earth.and_then(|earth| PositionError::new(view, earth, estimated));
    if let (Some(error), Some(into)) = (&error, camera.as_object_mut()) {
        into.extend(error.properties().as_object().cloned().unwrap_or_default());
    }
    let mut features = vec![
        json!({"type": "Feature", "properties": {"camera_id": view.id, "kind": "efov"},
            "geometry": polygon(&view.efov_m, earth)}),
        json!({"type": "Feature", "properties": camera,
            "geometry": {"type": "Point", "coordinates": coordinates(position.on_floor(), earth)}}),
    ];
    if let Some((error, earth)) = error.zip(earth) {
        features
            .push(json!({"type": "Feature", "properties": {"camera_id": view.id, "kind": "position_sigma"},
            "geometry": polygon(&error.ellipse(position.on_floor()), Some(earth))}));
    }
    features
}

/// Errors of a camera's position and azimuth on the map, the errors of the georeference included.
struct PositionError {
    /// Covariance in world axes, in square metres.
    covariance: [[f64; 2]; 2],
    /// Standard deviations toward east and north, in metres.
    east_north: [f64; 2],
    /// Standard deviation of the azimuth, in degrees; `None` if it is unknown.
    azimuth_deg: Option<f64>,
}

impl PositionError {
    /// Returns the errors of a view; `None` if they are unknown.
    fn new(view: &View, earth: &Georeference, estimated: Option<&GeoreferenceSolution>) -> Option<Self> {
        let covariance = &view.camera.covariance;
        covariance.sigma(Covariance::X).zip(covariance.sigma(Covariance::Y))?;
        let index = [Covariance::X, Covariance::Y];
        let of_camera = |i: usize, j: usize| covariance.0[index[i]][index[j]];
        let of_map =
            estimated.map_or([[0.0; 2]; 2], |found| found.covariance_at(view.camera.position.on_floor()));
        // Unit vectors of the world axes x and y, as east and north.
        let (sin, cos) = earth.x_axis_azimuth_deg.to_radians().sin_cos();
        let axes = [[sin, cos], [-cos, sin]];
        let covariance = std::array::from_fn(|i| {
            std::array::from_fn(|j| {
                of_camera(i, j)
                    + (0..2)
                        .map(|k| axes[i][k] * (0..2).map(|l| of_map[k][l] * axes[j][l]).sum::<f64>())
                        .sum::<f64>()
            })
        });
        let [[xx, xy], [_, yy]]: [[f64; 2]; 2] = covariance;
        let along = |a: f64, b: f64| (a * a * xx + 2.0 * a * b * xy + b * b * yy).max(0.0).sqrt();
        let of_map = estimated.map_or(0.0, |found| found.sigma.azimuth_deg);
        let azimuth_deg =
            view.camera.covariance.sigma(Covariance::YAW).map(|sigma| sigma.to_degrees().hypot(of_map));
        Some(Self { covariance, east_north: [along(sin, -cos), along(cos, sin)], azimuth_deg })
    }

    fn properties(&self) -> Value {
        let [east, north] = self.east_north;
        json!({"sigma_east_m": east, "sigma_north_m": north, "sigma_azimuth_deg": self.azimuth_deg})
    }

    /// Returns the ellipse of one standard deviation around a position, in world coordinates.
    ///
    /// With the Cholesky factor L of the covariance, its points are `L (cos a, sin a)`.
    fn ellipse(&self, centre: FloorPoint) -> Vec<FloorPoint> {
        /// Number of corners.
        const CORNERS: u32 = 36;
        let [[xx, xy], [_, yy]] = self.covariance;
        let first = xx.max(0.0).sqrt();
        let below = if first > 0.0 { xy / first } else { 0.0 };
        let second = (yy - below * below).max(0.0).sqrt();
        let corner = |index: u32| {
            let (sin, cos) = (f64::from(index) * std::f64::consts::TAU / f64::from(CORNERS)).sin_cos();
            FloorPoint { x: centre.x + first * cos, y: centre.y + below * cos + second * sin }
        };
        (0..CORNERS).map(corner).collect()
    }
}

/// Computes twice the signed area of a ring, positive if its corners run counter-clockwise.
fn area(ring: &[[f64; 2]]) -> f64 {
    (0..ring.len())
        .map(|i| (ring[i], ring[(i + 1) % ring.len()]))
        .map(|(a, b)| a[0] * b[1] - b[0] * a[1])
        .sum()
}

/// Converts a floor point to longitude and latitude, in degrees.
pub(crate) fn to_wgs84(earth: &Georeference, point: FloorPoint) -> [f64; 2] {
    let at = earth.tangent_plane().to_geographic(point.at_height(0.0));
    [at.longitude.to_degrees(), at.latitude.to_degrees()]
}
