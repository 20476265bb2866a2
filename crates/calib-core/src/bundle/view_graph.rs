//! The view graph: cameras are its nodes, what two of them share its edges. Its components are adjusted
//! independently of each other; of each it is determined what fixes its gauge in the base system.
//!
//! The floor and the vertical are known from stage 1, so what is left open of a component that shares only
//! unknown landmarks is a similarity of the floor: a move, a turn about the vertical, a scale. Control
//! points, fixed cameras and marks of known place fix the first two; known lengths and heights fix the
//! scale. What remains of the gauge is fixed by the placement of one camera, the root ([`Gauge`]).
//!
//! Resection of one more camera from landmarks that are triangulated already: the step by which the
//! initialisation proceeds along the view graph.
//!
//! Roll, pitch, focal and lens are known from stage 1; position and yaw are unknown. Observed points serve
//! as control points; where they are too few, points and floor lines together give a similarity of the
//! floor.

use std::collections::{BTreeMap, BTreeSet};

use nalgebra::{DMatrix, DVector, SVD};

use crate::bundle::camera::{BundleCamera, Gauge, InitialPose};
use crate::bundle::landmark::{DistanceMeasurement, LANDMARK_PARAMS, Landmark, LandmarkModel, SAME_PLACE};
use crate::bundle::triangulation::is_known;
use crate::camera::{Camera, FloorPoint, WorldPoint};
use crate::floor::{ControlPoint, from_control_points};

/// Cameras that share landmarks or distances, or of which the base system is known.
#[derive(Clone, Debug, PartialEq)]
pub struct Component {
    /// Indices of the cameras, ascending.
    pub views: Vec<usize>,
    /// The camera whose placement fixes what remains of the gauge.
    pub root: usize,
    /// Its position in the base system is determined by something known.
    pub is_located: bool,
    /// Its yaw in the base system is determined by something known.
    pub is_oriented: bool,
    /// Its scale is determined by something known: a length, a height, two places.
    pub is_scaled: bool,
    /// What the placement of the root fixes.
    pub(crate) of_root: Gauge,
}

impl Component {
    /// What the placement of a camera fixes of the gauge.
    pub(crate) fn gauge(&self, camera: usize) -> Gauge {
        if camera == self.root { self.of_root } else { Gauge::default() }
    }
}

/// What is known of a similarity of the floor: an orthonormal basis of the directions that are fixed among its
/// generators, a move along x, one along y, a turn and a growth about the root. A coordinate that is held fixes
/// the direction along which they change it: of a camera at (a, b) from the root x is changed by (1, 0, -b, a),
/// y by (0, 1, a, b), the yaw by (0, 0, 1, 0). Lengths are in units of the component's size.
#[derive(Debug, Default)]
struct FixedGauge(Vec<[f64; 4]>);

impl FixedGauge {
    const YAW: [f64; 4] = [0.0, 0.0, 1.0, 0.0];
    const SCALE: [f64; 4] = [0.0, 0.0, 0.0, 1.0];

    /// The directions in which x and y are changed of what is at `[a, b]`.
    fn place([a, b]: [f64; 2]) -> [[f64; 4]; 2] {
        [[1.0, 0.0, -b, a], [0.0, 1.0, a, b]]
    }

    /// The part of a direction that is not fixed yet, by Gram and Schmidt; none where next to nothing is left.
    fn open(&self, direction: [f64; 4]) -> Option<[f64; 4]> {
        /// Sine of the angle to what is fixed below which a direction says nothing.
        const LEAST: f64 = 1e-3;
        let norm = |of: &[f64; 4]| of.iter().map(|value| value * value).sum::<f64>().sqrt();
        let mut rest = direction.map(|value| value / norm(&direction));
        for fixed in &self.0 {
            let along: f64 = (0..4).map(|i| fixed[i] * rest[i]).sum();
            rest = std::array::from_fn(|i| rest[i] - along * fixed[i]);
        }
        let left = norm(&rest);
        (left > LEAST).then(|| rest.map(|value| value / left))
    }

    /// Fixes a direction; whether it was open.
    fn fix(&mut self, direction: [f64; 4]) -> bool {
        let open = self.open(direction);
        self.0.extend(open);
        open.is_some()
    }
}

/// Sets of nodes that are merged edge by edge (union-find with path halving).
struct DisjointSets(Vec<usize>);

impl DisjointSets {
    fn new(count: usize) -> Self {
        Self((0..count).collect())
    }

    /// The lowest node of the set.
    fn find(&mut self, mut node: usize) -> usize {
        while self.0[node] != node {
            self.0[node] = self.0[self.0[node]];
            node = self.0[node];
        }
        node
    }

    fn union(&mut self, a: usize, b: usize) {
        let (a, b) = (self.find(a), self.find(b));
        self.0[a.max(b)] = a.min(b);
    }
}

/// The connected components of the view graph; cameras that share nothing are in none. The base system is
/// a node of its own: cameras that see known places are connected through it.
pub(crate) fn components(
    cameras: &[BundleCamera],
    landmarks: &[Landmark],
    distances: &[DistanceMeasurement],
) -> Vec<Vec<usize>> {
    let base = cameras.len();
    let mut sets = DisjointSets::new(base + 1);
    let mut is_connected = vec![false; cameras.len()];
    let mut connect = |views: &[usize], is_known: bool| {
        if views.len() > 1 || is_known {
            views.iter().for_each(|&view| is_connected[view] = true);
        }
        views.windows(2).for_each(|pair| sets.union(pair[0], pair[1]));
        if let Some(&view) = views.first().filter(|_| is_known) {
            sets.union(view, base);
        }
    };
    for landmark in landmarks.iter().filter(|landmark| !landmark.off) {
        connect(&landmark.views(), is_known(landmark));
    }
    let is_used = |distance: &&DistanceMeasurement| {
        !distance.off && distance.between.iter().all(|&landmark| !landmarks[landmark].off)
    };
    for distance in distances.iter().filter(is_used) {
        let ends = distance.between.iter();
        connect(&ends.flat_map(|&landmark| landmarks[landmark].views()).collect::<Vec<_>>(), false);
    }
    for view in (0..base).filter(|&view| cameras[view].initial_pose == InitialPose::Fixed) {
        connect(&[view], true);
    }
    let mut components: BTreeMap<usize, Vec<usize>> = BTreeMap::new();
    for view in (0..base).filter(|&view| is_connected[view]) {
        components.entry(sets.find(view)).or_default().push(view);
    }
    components.into_values().collect()
}

/// The first camera of a component that has a pose, of those the one of which most is held, or else its first.
pub(crate) fn root(component: &[usize], cameras: &[BundleCamera]) -> usize {
    let posed = component.iter().filter(|&&view| cameras[view].initial_pose != InitialPose::Unknown);
    // Of equals the first.
    let posed = posed.rev().max_by_key(|&&view| cameras[view].held.count());
    posed.or(component.first()).copied().unwrap_or(0)
}

/// What of the gauge of a component is determined, with its cameras and landmarks where the adjustment
/// starts.
pub(crate) fn describe(
    views: Vec<usize>,
    cameras: &[BundleCamera],
    poses: &[Camera],
    landmarks: &[Landmark],
    distances: &[DistanceMeasurement],
) -> Component {
    let is_ours = |landmark: &Landmark| {
        !landmark.off && landmark.observations.iter().any(|seen| views.binary_search(&seen.view).is_ok())
    };
    let ours: Vec<&Landmark> = landmarks.iter().filter(|landmark| is_ours(landmark)).collect();
    let is_fixed = |view: &&usize| cameras[**view].initial_pose == InitialPose::Fixed;
    let fixed: Vec<FloorPoint> =
        views.iter().filter(is_fixed).map(|&view| poses[view].position.on_floor()).collect();
    let mut places = fixed.clone();
    places.extend(ours.iter().filter(|landmark| is_known(landmark)).flat_map(|known| known_places(known)));
    let is_oriented = !fixed.is_empty() || places.iter().any(|place| place.distance(places[0]) > SAME_PLACE);
    let is_measured = |distance: &DistanceMeasurement| {
        !distance.off && distance.between.iter().all(|&landmark| is_ours(&landmarks[landmark]))
    };
    let is_sized = is_oriented
        || spread_of_heights(&ours) > SAME_PLACE
        || ours.iter().any(|landmark| has_size(landmark))
        || views.iter().any(|&view| cameras[view].height_is_known())
        || distances.iter().any(is_measured);
    let root = root(&views, cameras);
    let origin = poses[root].position.on_floor();
    let size = views.iter().map(|&view| poses[view].position.on_floor().distance(origin)).fold(1.0, f64::max);
    let from_root = |at: FloorPoint| [(at.x - origin.x) / size, (at.y - origin.y) / size];
    let mut fixed = FixedGauge::default();
    // Of more places than one the turn and the scale follow, where they are apart.
    let place = places.first().map(|&place| FixedGauge::place(from_root(place)));
    place.into_iter().flatten().for_each(|by| _ = fixed.fix(by));
    for (&view, held) in views.iter().map(|view| (view, cameras[*view].held)) {
        let [by_x, by_y] = FixedGauge::place(from_root(poses[view].position.on_floor()));
        let held = [(held.x, by_x), (held.y, by_y), (held.yaw, FixedGauge::YAW)];
        held.into_iter().filter(|(is_held, _)| *is_held).for_each(|(_, by)| _ = fixed.fix(by));
    }
    for (_, by) in [(is_oriented, FixedGauge::YAW), (is_sized, FixedGauge::SCALE)].iter().filter(|of| of.0) {
        fixed.fix(*by);
    }
    let is_open = |by| fixed.open(by).is_some();
    let (is_oriented, is_scaled) = (!is_open(FixedGauge::YAW), !is_open(FixedGauge::SCALE));
    let [along_x, along_y] = FixedGauge::place([0.0; 2]);
    let is_located = !places.is_empty() || views.iter().any(|&view| cameras[view].held.is_at());
    let of_root = Gauge {
        yaw: fixed.fix(FixedGauge::YAW),
        scale: fixed.fix(FixedGauge::SCALE),
        x: fixed.fix(along_x),
        y: fixed.fix(along_y),
    };
    Component { root, is_located, is_oriented, is_scaled, of_root, views }
}

/// Where on the floor the points of a known landmark are that some camera sees.
fn known_places(landmark: &Landmark) -> Vec<FloorPoint> {
    let points: BTreeSet<usize> = landmark.observations.iter().map(|seen| seen.point).collect();
    points.iter().map(|&point| landmark.point(point).on_floor()).collect()
}

/// Whether the observed points of a landmark have a known size: two points of a mark, a post of known length.
fn has_size(landmark: &Landmark) -> bool {
    match &landmark.model {
        LandmarkModel::Mark { points, .. } => {
            let seen: BTreeSet<usize> = landmark.observations.iter().map(|seen| seen.point).collect();
            let first = seen.first().and_then(|&point| points.get(point));
            seen.iter().any(|&point| points.get(point) != first)
        }
        LandmarkModel::Post => !landmark.free[2] || !landmark.priors.is_empty(),
        LandmarkModel::Point { .. } | LandmarkModel::Measured | LandmarkModel::Line { .. } => false,
    }
}

/// Difference between the highest and the lowest known height. Two heights are a known length; one alone
/// may be the floor of another storey, and fixes no scale.
fn spread_of_heights(landmarks: &[&Landmark]) -> f64 {
    let heights = landmarks.iter().flat_map(|landmark| {
        let is_head = |point: usize| landmark.model == LandmarkModel::Post && point > 0;
        let seen = landmark.observations.iter().filter(move |seen| !is_head(seen.point));
        seen.map(|seen| landmark.point(seen.point).z)
    });
    let (low, high) =
        heights.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), z| (low.min(z), high.max(z)));
    high - low
}

/// Cameras that are adjusted as one problem, by components and by shared lenses: every component without
/// its unreached cameras, and every camera whose distortion is estimated or that shares a lens. Each
/// ascending.
pub(crate) fn clusters(
    cameras: &[BundleCamera],
    components: &[Component],
    unreached: &[usize],
) -> Vec<Vec<usize>> {
    let reached = |component: &Component| -> BTreeSet<usize> {
        component.views.iter().copied().filter(|view| !unreached.contains(view)).collect()
    };
    let mut sets: Vec<BTreeSet<usize>> = components.iter().map(reached).collect();
    for (index, camera) in cameras.iter().enumerate() {
        if camera.lens_of.is_some() || camera.fits_distortion() {
            sets.push(BTreeSet::from([index, camera.lens_owner(index)]));
        }
    }
    let mut merged: Vec<BTreeSet<usize>> = Vec::new();
    for mut set in sets {
        merged.retain(|other| {
            let is_apart = other.is_disjoint(&set);
            if !is_apart {
                set.extend(other);
            }
            is_apart
        });
        merged.push(set);
    }
    merged.into_iter().filter(|set| !set.is_empty()).map(|set| set.into_iter().collect()).collect()
}

/// A landmark with its triangulated parameters.
pub(crate) type PlacedLandmark = (Landmark, [f64; LANDMARK_PARAMS]);

/// The camera number `view` placed so that it shows these landmarks where they are; at `height`, if given.
pub(crate) fn attach(
    camera: &Camera,
    view: usize,
    height: Option<f64>,
    landmarks: &[PlacedLandmark],
) -> Option<Camera> {
    let points = control_points(view, landmarks.iter().map(|(landmark, place)| (landmark, *place)));
    by_points(camera, &points, height).or_else(|| by_points_and_lines(camera, view, landmarks))
}

/// Points of the base system with the pixels of a camera that show them.
pub(crate) fn control_points<'a>(
    view: usize,
    landmarks: impl Iterator<Item = (&'a Landmark, [f64; LANDMARK_PARAMS])>,
) -> Vec<ControlPoint> {
    let points = landmarks.filter(|(landmark, _)| !matches!(landmark.model, LandmarkModel::Line { .. }));
    let seen = points.flat_map(|(landmark, place)| {
        let own = landmark.observations.iter().filter(move |seen| seen.view == view);
        own.map(move |seen| (seen.pixel, landmark.model.point(&place, seen.point, &landmark.ground).0))
    });
    seen.map(|(pixel, world)| ControlPoint { pixel, world }).collect()
}

/// Resection robust to outliers: of the placements by pairs of points and by all, the one of least median
/// error (least median of squares, Rousseeuw 1984), fitted again to its inliers.
fn by_points(camera: &Camera, points: &[ControlPoint], height: Option<f64>) -> Option<Camera> {
    /// A point is an inlier up to this multiple of the median error.
    const INLIER_RATIO: f64 = 5.0;
    /// A point is an inlier up to this error, in pixels.
    const INLIER_PIXELS: f64 = 4.0;
    if points.len() < 4 {
        return from_control_points(camera, points, height);
    }
    let few = spread(points);
    let tried = pairs(few.len()).filter_map(|(i, j)| from_control_points(camera, &[few[i], few[j]], height));
    let all = from_control_points(camera, points, height);
    let scored = tried.chain(all).map(|camera| (median(errors(&camera, &few)), camera));
    let (_, best) = scored.min_by(|a, b| a.0.total_cmp(&b.0))?;
    let errors = errors(&best, points);
    let limit = (INLIER_RATIO * median(errors.clone())).max(INLIER_PIXELS);
    let inliers: Vec<ControlPoint> =
        points.iter().zip(&errors).filter(|(_, error)| **error <= limit).map(|(point, _)| *point).collect();
    from_control_points(camera, &inliers, height).or(Some(best))
}

/// As many points as tell a median well, spread over all of them.
fn spread(points: &[ControlPoint]) -> Vec<ControlPoint> {
    const ENOUGH: usize = 400;
    points.iter().step_by(points.len().div_ceil(ENOUGH).max(1)).copied().collect()
}

/// The pairs of so many that are tried, spread over all of them.
fn pairs(count: usize) -> impl Iterator<Item = (usize, usize)> {
    const MOST: usize = 60;
    let step = (count * (count - 1) / 2).div_ceil(MOST);
    (0..count).flat_map(move |i| (i + 1..count).map(move |j| (i, j))).step_by(step)
}

/// Reprojection errors of the points, in raw pixels.
fn errors(camera: &Camera, points: &[ControlPoint]) -> Vec<f64> {
    let error = |point: &ControlPoint| {
        camera
            .world_to_pixel(point.world)
            .map_or(f64::INFINITY, |reprojected| reprojected.distance(point.pixel))
    };
    points.iter().map(error).collect()
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}

/// The similarity of the floor that takes points to points and segments into lines.
///
/// With `a = s cos t`, `b = s sin t` for scale `s` and turn `t`, a point (x, y) of the camera's own floor
/// goes to `(a x - b y + x0, b x + a y + y0)`: two equations linear in a, b, x0, y0 for a point, and one,
/// their projection on the line's normal, for each end of a segment of a line.
fn by_points_and_lines(camera: &Camera, view: usize, landmarks: &[PlacedLandmark]) -> Option<Camera> {
    let rows = similarity_equations(camera, view, landmarks);
    if rows.len() < 4 {
        return None;
    }
    let matrix = DMatrix::from_fn(rows.len(), 4, |i, j| rows[i].0[j]);
    let right = DVector::from_fn(rows.len(), |i, _| rows[i].1);
    let svd = SVD::new(matrix, true, true);
    let (most, least) = (svd.singular_values.max(), svd.singular_values.min());
    let solution = (least > 1e-6 * most).then(|| svd.solve(&right, 0.0).ok()).flatten()?;
    let [a, b, x, y] = [solution[0], solution[1], solution[2], solution[3]];
    let scale = a.hypot(b);
    let position = WorldPoint::new(x, y, scale * camera.position.z);
    (scale > 1e-3).then_some(Camera { position, yaw: b.atan2(a), ..*camera })
}

/// Coefficients of a, b, x0, y0 and right-hand side of every equation.
fn similarity_equations(camera: &Camera, view: usize, landmarks: &[PlacedLandmark]) -> Vec<([f64; 4], f64)> {
    let mut rows = Vec::new();
    for (landmark, place) in landmarks {
        for seen in landmark.observations.iter().filter(|seen| seen.view == view) {
            let world = landmark.model.point(place, seen.point, &landmark.ground).0;
            let Some(FloorPoint { x, y }) = camera.pixel_to_floor(seen.pixel, world.z) else { continue };
            let normals: &[[f64; 2]] = match landmark.model {
                LandmarkModel::Line { .. } => &[[-place[1].sin(), place[1].cos()]],
                _ => &[[1.0, 0.0], [0.0, 1.0]],
            };
            rows.extend(
                normals
                    .iter()
                    .map(|[m, n]| ([m * x + n * y, n * x - m * y, *m, *n], m * world.x + n * world.y)),
            );
        }
    }
    rows
}
