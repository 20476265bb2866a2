//! Image edges for suggested lines: detected edges with about the position and direction of the suggested line.
//!
//! A suggestion is an example: the solver computes it from the estimated camera, without using the image.
//! Only an edge in the image is evidence, and only after the operator has accepted it.

use calib_core::{Camera, Covariance, FloorPoint, Kind, Pixel, WorldPoint};

use calib_image::Edge;
use calib_site::{SiteCamera, SuggestionEntry};

use crate::hit;

/// Largest distance between the midpoints of an edge and of the suggested line, divided by the image
/// diagonal.
const MAX_DISTANCE_REL: f64 = 0.22;
/// Smallest length of an edge, divided by the length of the suggested line.
const MIN_LENGTH_REL: f64 = 0.2;
/// Largest angle between an edge and the vertical, in radians. The limit is generous, because the camera may be
/// estimated from few lines.
const MAX_LEAN_RAD: f64 = 0.1;
/// Largest angle on the floor between an edge and the suggested line, in radians.
const MAX_DIRECTION_ERROR_RAD: f64 = 0.45;
/// Largest deviation of two edges on the floor from parallel or from perpendicular, in radians.
const MAX_ANGLE_ERROR_RAD: f64 = 0.06;

/// Returns, for every line of the suggestion, the best edge that is not annotated yet. The result is empty
/// unless every line has an edge.
#[must_use]
pub fn edges_for_suggestion(
    next: &SuggestionEntry,
    camera: &Camera,
    entry: &SiteCamera,
    edges: &[Edge],
) -> Vec<Edge> {
    let Some(kind) = next.kind else { return Vec::new() };
    let size = entry.size();
    let reach = MAX_DISTANCE_REL * size[0].hypot(size[1]);
    let mut chosen: Vec<Edge> = Vec::new();
    for example in &next.segments_px {
        let fits = |edge: &&Edge| {
            !chosen.contains(edge)
                && !is_annotated(edge, entry)
                && is_long_enough(edge, example)
                && midpoint(edge).distance(midpoint(example)) < reach
                && is_similar(kind, camera, edge, example)
                && chosen.first().is_none_or(|first| is_consistent(kind, camera, edge, first))
        };
        let off = |edge: &Edge| midpoint(edge).distance(midpoint(example)) - 0.5 * edge[0].distance(edge[1]);
        let best = edges.iter().filter(fits).min_by(|a, b| off(a).total_cmp(&off(b)));
        let Some(edge) = best else { return Vec::new() };
        chosen.push(*edge);
    }
    chosen
}

/// Whether an edge is annotated already. Either both ends of the edge are close to an annotated line, or both
/// ends of an annotated line are close to the edge.
pub(crate) fn is_annotated(edge: &Edge, entry: &SiteCamera) -> bool {
    /// Largest distance of an end from the other line, in pixels.
    const MAX_LINE_DISTANCE_PX: f64 = 8.0;
    let along = |[a, b]: Edge, [c, d]: Edge| {
        hit::distance_to_segment(a, b, c) < MAX_LINE_DISTANCE_PX
            && hit::distance_to_segment(a, b, d) < MAX_LINE_DISTANCE_PX
    };
    let lines = entry.annotations.iter().flat_map(calib_core::Annotation::polylines);
    lines.into_iter().any(|points| {
        points.windows(2).any(|pair| {
            let line = [pair[0], pair[1]];
            along(line, *edge) || along(*edge, line)
        })
    })
}

/// Returns the midpoint of an edge.
fn midpoint([a, b]: &Edge) -> Pixel {
    Pixel::new(0.5 * (a.u + b.u), 0.5 * (a.v + b.v))
}

/// Whether an edge is long enough compared with the suggested line.
fn is_long_enough(edge: &Edge, example: &Edge) -> bool {
    edge[0].distance(edge[1]) >= MIN_LENGTH_REL * example[0].distance(example[1])
}

/// Returns the standard deviation of the camera's pitch, in radians, limited to a maximum; 0 if it is unknown. It is
/// added to the tolerances of directions.
fn direction_sigma(camera: &Camera) -> f64 {
    /// Largest standard deviation that is returned, in radians.
    const MAX_DIRECTION_SIGMA_RAD: f64 = 0.3;
    camera.covariance.sigma(Covariance::PITCH).map_or(0.0, |sigma| sigma.min(MAX_DIRECTION_SIGMA_RAD))
}

/// Whether an edge can replace the suggested line `example`, because both have about the same direction in
/// space. False for kinds that depend on lengths, because an image does not show which lengths are equal.
fn is_similar(kind: Kind, camera: &Camera, edge: &Edge, example: &Edge) -> bool {
    match kind {
        Kind::Vertical => {
            lean(camera, edge).is_some_and(|lean| lean < MAX_LEAN_RAD + direction_sigma(camera))
        }
        Kind::Parallel | Kind::Perpendicular => {
            let turned =
                azimuth(camera, edge).zip(azimuth(camera, example)).map(|(a, b)| angle_between(a, b));
            turned.is_some_and(|turned| turned < MAX_DIRECTION_ERROR_RAD + direction_sigma(camera))
        }
        _ => false,
    }
}

/// Whether an edge is parallel or perpendicular to the first chosen edge, as the kind of the suggestion
/// requires.
fn is_consistent(kind: Kind, camera: &Camera, edge: &Edge, first: &Edge) -> bool {
    let apart = || Some(angle_between(azimuth(camera, edge)?, azimuth(camera, first)?));
    let agree = MAX_ANGLE_ERROR_RAD + direction_sigma(camera);
    match kind {
        Kind::Parallel => apart().is_some_and(|apart| apart < agree),
        Kind::Perpendicular => apart().is_some_and(|apart| std::f64::consts::FRAC_PI_2 - apart < agree),
        _ => true,
    }
}

/// Returns the angle in the image between an edge and the vertical at its midpoint, in radians.
#[must_use]
pub fn lean(camera: &Camera, edge: &Edge) -> Option<f64> {
    /// Distance of the point on the ray at which the vertical is projected, in metres. Its value does not
    /// affect the result.
    const SAMPLE_DISTANCE_M: f64 = 5.0;
    let ray = camera.pixel_to_ray(midpoint(edge))?;
    let at = |z: f64| {
        let [x, y, own] = ray.direction;
        let o = ray.origin;
        camera.world_to_pixel(WorldPoint::new(
            o.x + SAMPLE_DISTANCE_M * x,
            o.y + SAMPLE_DISTANCE_M * y,
            o.z + SAMPLE_DISTANCE_M * own + z,
        ))
    };
    let (low, high) = (at(-0.1)?, at(0.1)?);
    let angle = |a: Pixel, b: Pixel| (b.v - a.v).atan2(b.u - a.u);
    Some(angle_between(angle(low, high), angle(edge[0], edge[1])))
}

/// Returns the direction of an edge on the floor, in radians counter-clockwise from +x. `None` if an end is
/// above the horizon.
fn azimuth(camera: &Camera, edge: &Edge) -> Option<f64> {
    let [a, b]: [Option<FloorPoint>; 2] = edge.map(|end| camera.pixel_to_floor(end, 0.0));
    let (a, b) = (a?, b?);
    Some((b.y - a.y).atan2(b.x - a.x))
}

/// Returns the angle between two undirected lines with these directions, from 0 to π/2, in radians.
fn angle_between(a: f64, b: f64) -> f64 {
    let half = std::f64::consts::PI;
    let by = (a - b).rem_euclid(half);
    by.min(half - by)
}

#[cfg(test)]
mod tests {
    use super::*;
    use calib_core::{Annotation, Lens};

    fn camera() -> Camera {
        Camera {
            position: WorldPoint::new(0.0, 0.0, 3.0),
            yaw: 0.0,
            pitch: 0.5,
            roll: 0.0,
            focal: 1000.0,
            lens: Lens::pinhole(Pixel::new(960.0, 540.0)),
            covariance: Covariance::EXACT,
        }
    }

    fn entry() -> SiteCamera {
        SiteCamera::new("a", [1920, 1080])
    }

    fn shown(a: [f64; 3], b: [f64; 3]) -> Edge {
        [a, b].map(|[x, y, z]| camera().world_to_pixel(WorldPoint::new(x, y, z)).unwrap())
    }

    fn next(kind: Kind, segments_px: Vec<Edge>) -> SuggestionEntry {
        SuggestionEntry {
            drawing: None,
            kind: Some(kind),
            message: String::new(),
            segments_px,
            floor_length_rel: 0.01,
            otherwise: Vec::new(),
        }
    }

    #[test]
    fn vertical_edge_near_the_example_is_suggested_and_a_leaning_one_is_not() {
        let example = shown([-2.0, 6.0, 0.2], [-2.0, 6.0, 2.0]);
        let post = shown([-1.8, 6.5, 0.0], [-1.8, 6.5, 1.8]);
        let joint = shown([-1.8, 5.0, 0.0], [-1.5, 8.0, 0.0]);
        let next = next(Kind::Vertical, vec![example]);
        assert_eq!(edges_for_suggestion(&next, &camera(), &entry(), &[joint, post]), [post]);
        assert_eq!(edges_for_suggestion(&next, &camera(), &entry(), &[joint]), Vec::<Edge>::new());
        let mut drawn = entry();
        drawn.annotations.push(Annotation::from_segments(Kind::Vertical, vec![post.to_vec()]));
        assert_eq!(
            edges_for_suggestion(&next, &camera(), &drawn, &[joint, post]),
            Vec::<Edge>::new(),
            "drawn already"
        );
    }

    #[test]
    fn two_parallels_need_two_edges_that_are_parallel_on_the_floor() {
        let left = shown([-1.0, 4.0, 0.0], [-1.0, 6.0, 0.0]);
        let right = shown([1.0, 4.0, 0.0], [1.0, 6.0, 0.0]);
        let askew = shown([1.0, 4.0, 0.0], [1.7, 6.0, 0.0]);
        let next = next(Kind::Parallel, vec![left, right]);
        assert_eq!(edges_for_suggestion(&next, &camera(), &entry(), &[left, askew]), Vec::<Edge>::new());
        assert_eq!(edges_for_suggestion(&next, &camera(), &entry(), &[askew, left, right]), [left, right]);
    }
}
