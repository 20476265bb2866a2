//! Distances between the solved position of each link or mark and its observation in every camera.

use std::collections::{BTreeMap, HashMap};

use calib_core::{Camera, FloorPoint, Pixel, Plane, WorldPoint};

use calib_core::floor::FloorLine;

use calib_site::{ElementSolution, Link, LinkKind, Mark, Site, SiteCamera};

/// Solved link or mark with its observations.
#[derive(Clone, Debug)]
pub struct Element<'a> {
    /// Kind of the element: "link" or "mark".
    pub kind: &'static str,
    /// Id of the link or mark, as in residuals and warnings; its index in the site if it has no id.
    pub id: String,
    /// Solution of the link or mark.
    pub solution: &'a ElementSolution,
    /// Whether an observation of the element is an outlier, so that the element is rejected.
    pub is_rejected: bool,
    /// Whether the operator switched the element off.
    pub is_off: bool,
    /// Whether the element is a post or a line. Its points in a view are then the ends of one element.
    pub is_long: bool,
    /// Observations of the element, one entry for each camera that shows it.
    pub views: Vec<View<'a>>,
}

/// Observations of a link or mark by one camera.
#[derive(Clone, Debug)]
pub struct View<'a> {
    /// Entry of the camera in the site.
    pub entry: &'a SiteCamera,
    /// Index of the camera in its site.
    pub index: usize,
    /// Points of the element that the camera shows.
    pub sightings: Vec<Sighting>,
}

/// Annotated pixel, compared with the solved point that it shows.
#[derive(Clone, Debug)]
pub struct Sighting {
    /// Annotated position in the image, in raw pixels.
    pub annotated: Pixel,
    /// Projection of the solved point into the image, in raw pixels.
    pub reprojected: Pixel,
    /// Solved point projected vertically onto the floor, in metres.
    pub solved_floor: FloorPoint,
    /// Intersection of the ray of the annotated pixel with the plane through the solved point, as floor
    /// metres. `None` if the ray does not meet the plane.
    pub floor: Option<FloorPoint>,
}

impl View<'_> {
    /// Returns the RMS distance between annotated and reprojected points in the image, in pixels.
    #[must_use]
    pub fn px(&self) -> f64 {
        rms(self.sightings.iter().map(|seen| seen.annotated.distance(seen.reprojected))).unwrap_or(0.0)
    }

    /// Returns the RMS distance between annotated and solved points on the floor, in metres.
    #[must_use]
    pub fn floor_m(&self) -> Option<f64> {
        rms(self.sightings.iter().filter_map(|seen| Some(seen.floor?.distance(seen.solved_floor))))
    }
}

impl Element<'_> {
    /// Whether the element contributes to the solution of the site: neither rejected nor switched off.
    #[must_use]
    pub fn is_used(&self) -> bool {
        !self.is_rejected && !self.is_off
    }

    /// Returns the largest RMS distance of all views, in pixels.
    #[must_use]
    pub fn worst_px(&self) -> f64 {
        self.views.iter().map(View::px).fold(0.0, f64::max)
    }
}

/// Returns the root mean square of values; `None` without values.
fn rms(values: impl Iterator<Item = f64>) -> Option<f64> {
    let (sum, count) = values.fold((0.0, 0.0), |(sum, count), value| (sum + value * value, count + 1.0));
    (count > 0.0).then(|| f64::sqrt(sum / count))
}

/// Returns all solved links and marks, with the observations of placed cameras.
#[must_use]
pub fn elements(site: &Site) -> Vec<Element<'_>> {
    let mut cameras: HashMap<&str, (usize, Camera)> = HashMap::new();
    for (index, entry) in site.cameras.iter().enumerate() {
        let stands = entry.is_placed();
        if let Some(camera) = entry.camera().filter(|_| stands) {
            cameras.entry(&entry.id).or_insert((index, camera));
        }
    }
    let links = site.links.iter().enumerate().filter_map(|(index, link)| {
        let found = link.solution.as_ref()?;
        let seen = |camera: &str, camera_is: &Camera| {
            let of = link.seen.iter().filter(|seen| seen.camera == camera);
            let plane = site.plane_or_floor(link.plane.as_deref());
            of.flat_map(|seen| points_of_link(link, found, seen, camera_is, &plane)).collect()
        };
        let cameras_of = link.seen.iter().map(|seen| seen.camera.as_str());
        let views = views(site, &cameras, cameras_of, &seen);
        let id = link.id.clone().unwrap_or_else(|| index.to_string());
        Some(Element {
            kind: "link",
            id,
            solution: found,
            is_rejected: has_outlier(found),
            is_off: link.off,
            is_long: link.kind != LinkKind::Point,
            views,
        })
    });
    let marks = site.marks.iter().enumerate().filter_map(|(index, mark)| {
        let found = mark.solution.as_ref()?;
        let seen = |camera: &str, camera_is: &Camera| points_of_mark(mark, camera, camera_is);
        let cameras_of = mark.seen.iter().map(|seen| seen.camera.as_str());
        let views = views(site, &cameras, cameras_of, &seen);
        let id = mark.id.clone().unwrap_or_else(|| index.to_string());
        Some(Element {
            kind: "mark",
            id,
            solution: found,
            is_rejected: has_outlier(found),
            is_off: mark.off,
            is_long: false,
            views,
        })
    });
    links.chain(marks).collect()
}

/// Whether any residual of the element is an outlier.
fn has_outlier(found: &ElementSolution) -> bool {
    found.residuals.iter().any(|residual| residual.outlier)
}

/// Returns the observations of a link or mark in the placed cameras with these ids. `cameras` contains the placed
/// cameras by id. `seen` compares the observations of one camera with the solved position.
fn views<'a>(
    site: &'a Site,
    cameras: &HashMap<&str, (usize, Camera)>,
    ids: impl Iterator<Item = &'a str>,
    seen: &dyn Fn(&str, &Camera) -> Vec<Sighting>,
) -> Vec<View<'a>> {
    let shown: BTreeMap<usize, &(usize, Camera)> =
        ids.filter_map(|id| cameras.get(id)).map(|camera| (camera.0, camera)).collect();
    shown
        .into_values()
        .map(|(index, camera)| {
            let entry = &site.cameras[*index];
            View { entry, index: *index, sightings: seen(&entry.id, camera) }
        })
        .filter(|view| !view.sightings.is_empty())
        .collect()
}

/// Compares the points of one link observation with the solved link: one point, foot and head, or a segment.
fn points_of_link(
    link: &Link,
    found: &ElementSolution,
    seen: &calib_site::LinkObservation,
    camera: &Camera,
    plane: &Plane,
) -> Vec<Sighting> {
    let at = found.at_m;
    match link.kind {
        LinkKind::Point => {
            seen.px.and_then(|px| compare_with_point(camera, px, at, plane)).into_iter().collect()
        }
        LinkKind::Post => {
            let head = WorldPoint { z: at.z + found.length_m.unwrap_or(0.0), ..at };
            [(seen.foot, at), (seen.head, head)]
                .into_iter()
                .filter_map(|(px, at)| compare_with_point(camera, px?, at, plane))
                .collect()
        }
        LinkKind::Line => {
            let turn = found.turn_deg.unwrap_or(0.0).to_radians();
            let drawn = seen.segment.iter().flatten();
            drawn.filter_map(|&px| compare_with_line(camera, px, (at.on_floor(), turn), plane)).collect()
        }
    }
}

/// Compares the pinned corners of a mark in one camera with the solved mark.
fn points_of_mark(mark: &Mark, camera_id: &str, camera: &Camera) -> Vec<Sighting> {
    let shape = mark.shape();
    let of = mark.seen.iter().filter(|seen| seen.camera == camera_id);
    of.filter_map(|seen| compare_with_point(camera, seen.px, shape.point(&seen.point)?, &Plane::FLOOR))
        .collect()
}

/// Compares an annotated pixel with a solved point. For the floor position, the ray of the pixel is
/// intersected with the plane through the point that is parallel to `plane`.
fn compare_with_point(camera: &Camera, annotated: Pixel, at: WorldPoint, plane: &Plane) -> Option<Sighting> {
    let reprojected = camera.world_to_pixel(at)?;
    let through = Plane { height: at.z, anchor: at.on_floor(), ..*plane };
    let floor = camera.pixel_to_plane(annotated, &through).map(WorldPoint::on_floor);
    Some(Sighting { annotated, reprojected, solved_floor: at.on_floor(), floor })
}

/// Compares an annotated pixel with the point of a solved floor line that is closest to it in the image. The
/// line is given by a point and an angle in radians.
fn compare_with_line(
    camera: &Camera,
    annotated: Pixel,
    (through, turn): (FloorPoint, f64),
    plane: &Plane,
) -> Option<Sighting> {
    let floor = camera.pixel_to_plane(annotated, plane)?.on_floor();
    let (solved_floor, reprojected) = FloorLine { through, turn }.nearest(camera, annotated, plane)?;
    Some(Sighting { annotated, reprojected, solved_floor, floor: Some(floor) })
}
