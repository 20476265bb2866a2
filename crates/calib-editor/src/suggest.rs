//! Where the lines that would help most can be drawn: edges that were found in the image and run as they do.
//!
//! What the solution proposes is an example, placed where the estimate has floor and no one has looked. Only an
//! edge of the image is evidence, and only once the operator has taken it.

use calib_core::{Camera, Covariance, FloorPoint, Kind, Pixel, WorldPoint};

use calib_image::Edge;
use calib_site::{DrawNext, SiteCamera};

use crate::hit;

/// How far an edge may lie from the example, as a share of the image's diagonal.
const NEAR: f64 = 0.22;
/// An edge shorter than this share of the example says too little.
const LONG: f64 = 0.2;
/// How far an edge may lean from plumb, in radians, for the estimate is one of few lines.
const LEAN: f64 = 0.1;
/// How far it may run from the direction of the example on the floor, in radians.
const TURN: f64 = 0.45;
/// How far two edges may be from parallel, or from square, on the floor, in radians.
const AGREE: f64 = 0.06;

/// For every line of the proposal the edge that can be drawn in its place, and that no line is drawn on yet; none
/// unless all have one.
#[must_use]
pub fn on_edges(next: &DrawNext, camera: &Camera, entry: &SiteCamera, edges: &[Edge]) -> Vec<Edge> {
    let Some(kind) = next.kind else { return Vec::new() };
    let size = entry.size();
    let reach = NEAR * size[0].hypot(size[1]);
    let mut taken: Vec<Edge> = Vec::new();
    for example in &next.segments_px {
        let fits = |edge: &&Edge| {
            !taken.contains(edge)
                && !is_drawn(edge, entry)
                && long_enough(edge, example)
                && middle(edge).distance(middle(example)) < reach
                && runs_like(kind, camera, edge, example)
                && taken.first().is_none_or(|first| agrees(kind, camera, edge, first))
        };
        let off = |edge: &Edge| middle(edge).distance(middle(example)) - 0.5 * edge[0].distance(edge[1]);
        let best = edges.iter().filter(fits).min_by(|a, b| off(a).total_cmp(&off(b)));
        let Some(edge) = best else { return Vec::new() };
        taken.push(*edge);
    }
    taken
}

/// Whether a line is drawn along an edge: both of its ends lie beside it, or those of the line beside the edge.
pub(crate) fn is_drawn(edge: &Edge, entry: &SiteCamera) -> bool {
    /// In pixels.
    const BESIDE: f64 = 8.0;
    let along =
        |[a, b]: Edge, [c, d]: Edge| hit::to_segment(a, b, c) < BESIDE && hit::to_segment(a, b, d) < BESIDE;
    let lines = entry.annotations.iter().flat_map(calib_core::Annotation::polylines);
    lines.into_iter().any(|points| {
        points.windows(2).any(|pair| {
            let line = [pair[0], pair[1]];
            along(line, *edge) || along(*edge, line)
        })
    })
}

fn middle([a, b]: &Edge) -> Pixel {
    Pixel::new(0.5 * (a.u + b.u), 0.5 * (a.v + b.v))
}

fn long_enough(edge: &Edge, example: &Edge) -> bool {
    edge[0].distance(edge[1]) >= LONG * example[0].distance(example[1])
}

/// How far the estimate itself may be off, in radians: what little is drawn tells little of directions.
fn doubt(camera: &Camera) -> f64 {
    const MOST: f64 = 0.3;
    camera.covariance.sigma(Covariance::PITCH).map_or(0.0, |sigma| sigma.min(MOST))
}

/// Whether an edge may be what the example stands for. Which edges are of one length, no image tells.
fn runs_like(kind: Kind, camera: &Camera, edge: &Edge, example: &Edge) -> bool {
    match kind {
        Kind::Vertical => lean(camera, edge).is_some_and(|lean| lean < LEAN + doubt(camera)),
        Kind::Parallel | Kind::Perpendicular => {
            let turned = azimuth(camera, edge).zip(azimuth(camera, example)).map(|(a, b)| between(a, b));
            turned.is_some_and(|turned| turned < TURN + doubt(camera))
        }
        _ => false,
    }
}

/// Whether an edge goes with the first one of the proposal.
fn agrees(kind: Kind, camera: &Camera, edge: &Edge, first: &Edge) -> bool {
    let apart = || Some(between(azimuth(camera, edge)?, azimuth(camera, first)?));
    let agree = AGREE + doubt(camera);
    match kind {
        Kind::Parallel => apart().is_some_and(|apart| apart < agree),
        Kind::Perpendicular => apart().is_some_and(|apart| std::f64::consts::FRAC_PI_2 - apart < agree),
        _ => true,
    }
}

/// How far an edge leans from what is plumb at its middle, on the image, in radians.
#[must_use]
pub fn lean(camera: &Camera, edge: &Edge) -> Option<f64> {
    /// A place along the ray, in metres; how far does not matter.
    const FAR: f64 = 5.0;
    let ray = camera.pixel_to_ray(middle(edge))?;
    let at = |z: f64| {
        let [x, y, own] = ray.direction;
        let o = ray.origin;
        camera.world_to_pixel(WorldPoint::new(o.x + FAR * x, o.y + FAR * y, o.z + FAR * own + z))
    };
    let (low, high) = (at(-0.1)?, at(0.1)?);
    let angle = |a: Pixel, b: Pixel| (b.v - a.v).atan2(b.u - a.u);
    Some(between(angle(low, high), angle(edge[0], edge[1])))
}

/// The direction of an edge that lies on the floor, in radians; none above the horizon.
fn azimuth(camera: &Camera, edge: &Edge) -> Option<f64> {
    let [a, b]: [Option<FloorPoint>; 2] = edge.map(|end| camera.pixel_to_floor(end, 0.0));
    let (a, b) = (a?, b?);
    Some((b.y - a.y).atan2(b.x - a.x))
}

/// The angle between two lines, up to a right one.
fn between(a: f64, b: f64) -> f64 {
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

    fn next(kind: Kind, segments_px: Vec<Edge>) -> DrawNext {
        DrawNext {
            drawing: None,
            kind: Some(kind),
            message: String::new(),
            segments_px,
            floor_length_rel: 0.01,
            otherwise: Vec::new(),
        }
    }

    #[test]
    fn a_plumb_edge_near_the_example_is_offered_and_a_leaning_one_is_not() {
        let example = shown([-2.0, 6.0, 0.2], [-2.0, 6.0, 2.0]);
        let post = shown([-1.8, 6.5, 0.0], [-1.8, 6.5, 1.8]);
        let joint = shown([-1.8, 5.0, 0.0], [-1.5, 8.0, 0.0]);
        let next = next(Kind::Vertical, vec![example]);
        assert_eq!(on_edges(&next, &camera(), &entry(), &[joint, post]), [post]);
        assert_eq!(on_edges(&next, &camera(), &entry(), &[joint]), Vec::<Edge>::new());
        let mut drawn = entry();
        drawn.annotations.push(Annotation::of_segments(Kind::Vertical, vec![post.to_vec()]));
        assert_eq!(on_edges(&next, &camera(), &drawn, &[joint, post]), Vec::<Edge>::new(), "drawn already");
    }

    #[test]
    fn two_parallels_need_two_edges_that_are_parallel_on_the_floor() {
        let left = shown([-1.0, 4.0, 0.0], [-1.0, 6.0, 0.0]);
        let right = shown([1.0, 4.0, 0.0], [1.0, 6.0, 0.0]);
        let askew = shown([1.0, 4.0, 0.0], [1.7, 6.0, 0.0]);
        let next = next(Kind::Parallel, vec![left, right]);
        assert_eq!(on_edges(&next, &camera(), &entry(), &[left, askew]), Vec::<Edge>::new());
        assert_eq!(on_edges(&next, &camera(), &entry(), &[askew, left, right]), [left, right]);
    }
}
