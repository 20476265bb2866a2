//! View graph: cameras are its nodes, and shared landmarks and distances are its edges. Its components are adjusted
//! independently. For each component, this file determines which values fix the gauge in the base system.
//!
//! The floor and the vertical are known from stage 1. The gauge freedom of a component that shares only
//! unknown landmarks is therefore a similarity of the floor. It consists of a translation, a rotation about
//! the vertical, and a scale. Control points, fixed cameras and marks at known positions fix the translation
//! and rotation. Known lengths and heights fix the scale. The placement of one camera, the root, fixes the
//! rest ([`Gauge`]).
//!
//! # Resection
//!
//! The initialisation proceeds along the view graph by resection of one more camera from triangulated
//! landmarks. Its roll, pitch, focal length and lens are known from stage 1; its position and yaw are
//! unknown. Observed points are used as control points. If there are too few, points and floor lines together
//! determine a similarity of the floor.

use std::collections::{BTreeMap, BTreeSet};

use nalgebra::{DMatrix, DVector, SVD};

use crate::bundle::camera::{BundleCamera, Gauge, InitialPose};
use crate::bundle::landmark::{
    DistanceMeasurement, LANDMARK_PARAMS, Landmark, LandmarkModel, SAME_POSITION_M,
};
use crate::bundle::triangulation::{is_known, is_known_point};
use crate::camera::{Camera, FloorPoint, WorldPoint};
use crate::floor::{ControlPoint, from_control_points};

/// Cameras connected by shared landmarks or distances, or by known positions in the base system.
#[derive(Clone, Debug, PartialEq)]
pub struct Component {
    /// Indices of the cameras, ascending.
    pub views: Vec<usize>,
    /// Index of the camera whose placement fixes the rest of the gauge.
    pub root: usize,
    /// Whether known values determine the position in the base system.
    pub is_located: bool,
    /// Whether known values determine the yaw in the base system.
    pub is_oriented: bool,
    /// Whether known values determine the scale: a length, a height, or two positions.
    pub is_scaled: bool,
    /// Part of the gauge that the placement of the root fixes.
    pub(crate) root_gauge: Gauge,
}

impl Component {
    /// Returns the part of the gauge that the placement of a camera fixes.
    pub(crate) fn gauge(&self, camera: usize) -> Gauge {
        if camera == self.root { self.root_gauge } else { Gauge::default() }
    }
}

/// Fixed part of a similarity of the floor, as an orthonormal basis of the fixed directions among its
/// generators.
///
/// The generators are translations along x and y, a rotation and a scaling about the root. A fixed coordinate
/// fixes the direction along which the generators change it. A camera at (a, b) from the root changes in x by
/// (1, 0, -b, a), in y by (0, 1, a, b) and in yaw by (0, 0, 1, 0). Lengths are in units of the component's
/// size.
#[derive(Debug, Default)]
struct FixedGauge(Vec<[f64; 4]>);

impl FixedGauge {
    /// Direction of a rotation about the root, among the generators.
    const YAW: [f64; 4] = [0.0, 0.0, 1.0, 0.0];
    /// Direction of a scaling about the root, among the generators.
    const SCALE: [f64; 4] = [0.0, 0.0, 0.0, 1.0];

    /// Returns the derivatives of x and y of a point at `[a, b]` with respect to the generators.
    fn position_directions([a, b]: [f64; 2]) -> [[f64; 4]; 2] {
        [[1.0, 0.0, -b, a], [0.0, 1.0, a, b]]
    }

    /// Returns the part of a direction that is not fixed yet (Gram-Schmidt), normalised; `None` if it is
    /// close to zero.
    fn unfixed_part(&self, direction: [f64; 4]) -> Option<[f64; 4]> {
        /// Minimum sine of the angle to the fixed directions; below it a direction adds no constraint.
        const MIN_SINE: f64 = 1e-3;
        let norm = |of: &[f64; 4]| of.iter().map(|value| value * value).sum::<f64>().sqrt();
        let mut rest = direction.map(|value| value / norm(&direction));
        for fixed in &self.0 {
            let along: f64 = (0..4).map(|i| fixed[i] * rest[i]).sum();
            rest = std::array::from_fn(|i| rest[i] - along * fixed[i]);
        }
        let left = norm(&rest);
        (left > MIN_SINE).then(|| rest.map(|value| value / left))
    }

    /// Fixes a direction and returns whether it was not fixed before.
    fn fix(&mut self, direction: [f64; 4]) -> bool {
        let open = self.unfixed_part(direction);
        self.0.extend(open);
        open.is_some()
    }
}

/// Disjoint sets of nodes, merged edge by edge (union-find with path halving).
struct DisjointSets(Vec<usize>);

impl DisjointSets {
    fn new(count: usize) -> Self {
        Self((0..count).collect())
    }

    /// Returns the lowest node of the set that contains `node`.
    fn find(&mut self, mut node: usize) -> usize {
        while self.0[node] != node {
            self.0[node] = self.0[self.0[node]];
            node = self.0[node];
        }
        node
    }

    /// Merges the sets that contain two nodes.
    fn union(&mut self, a: usize, b: usize) {
        let (a, b) = (self.find(a), self.find(b));
        self.0[a.max(b)] = a.min(b);
    }
}

/// Returns the connected components of the view graph, without isolated cameras. The base system is a node:
/// cameras that observe known positions are connected through it.
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

/// Returns the root of a component: among the cameras with an initial pose, the camera with the most fixed
/// coordinates. Without initial poses it is the first camera.
pub(crate) fn root(component: &[usize], cameras: &[BundleCamera]) -> usize {
    let posed = component.iter().filter(|&&view| cameras[view].initial_pose != InitialPose::Unknown);
    // `max_by_key` returns the last maximum, so the reversed order gives the first camera on a tie.
    let posed = posed.rev().max_by_key(|&&view| cameras[view].fixed_pose.count());
    posed.or(component.first()).copied().unwrap_or(0)
}

/// Determines the gauge of a component with its cameras and landmarks at the initial state.
pub(crate) fn determine_gauge(
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
    let mut positions = fixed.clone();
    positions
        .extend(ours.iter().filter(|landmark| is_known(landmark)).flat_map(|known| known_positions(known)));
    let is_oriented = !fixed.is_empty()
        || positions.iter().any(|position| position.distance(positions[0]) > SAME_POSITION_M);
    let is_measured = |distance: &DistanceMeasurement| {
        !distance.off && distance.between.iter().all(|&landmark| is_ours(&landmarks[landmark]))
    };
    let is_sized = is_oriented
        || spread_of_heights(&ours) > SAME_POSITION_M
        || ours.iter().any(|landmark| has_size(landmark))
        || views.iter().any(|&view| cameras[view].height_is_known())
        || distances.iter().any(is_measured);
    let root = root(&views, cameras);
    let origin = poses[root].position.on_floor();
    let size = views.iter().map(|&view| poses[view].position.on_floor().distance(origin)).fold(1.0, f64::max);
    let from_root = |at: FloorPoint| [(at.x - origin.x) / size, (at.y - origin.y) / size];
    let mut fixed = FixedGauge::default();
    // Two separate positions also determine the rotation and the scale.
    let position = positions.first().map(|&position| FixedGauge::position_directions(from_root(position)));
    position.into_iter().flatten().for_each(|by| _ = fixed.fix(by));
    for (&view, fixed_axes) in views.iter().map(|view| (view, cameras[*view].fixed_pose)) {
        let [by_x, by_y] = FixedGauge::position_directions(from_root(poses[view].position.on_floor()));
        let fixed_axes = [(fixed_axes.x, by_x), (fixed_axes.y, by_y), (fixed_axes.yaw, FixedGauge::YAW)];
        fixed_axes.into_iter().filter(|(is_fixed, _)| *is_fixed).for_each(|(_, by)| _ = fixed.fix(by));
    }
    for (_, by) in [(is_oriented, FixedGauge::YAW), (is_sized, FixedGauge::SCALE)].iter().filter(|of| of.0) {
        fixed.fix(*by);
    }
    let is_open = |by| fixed.unfixed_part(by).is_some();
    let (is_oriented, is_scaled) = (!is_open(FixedGauge::YAW), !is_open(FixedGauge::SCALE));
    let [along_x, along_y] = FixedGauge::position_directions([0.0; 2]);
    let is_located =
        !positions.is_empty() || views.iter().any(|&view| cameras[view].fixed_pose.has_fixed_position());
    let root_gauge = Gauge {
        yaw: fixed.fix(FixedGauge::YAW),
        scale: fixed.fix(FixedGauge::SCALE),
        x: fixed.fix(along_x),
        y: fixed.fix(along_y),
    };
    Component { root, is_located, is_oriented, is_scaled, root_gauge, views }
}

/// Returns the floor positions of the observed points of a known landmark.
fn known_positions(landmark: &Landmark) -> Vec<FloorPoint> {
    let points: BTreeSet<usize> = landmark.observations.iter().map(|seen| seen.point).collect();
    let known = points.iter().filter(|&&point| is_known_point(landmark, point));
    known.map(|&point| landmark.point(point).on_floor()).collect()
}

/// Whether the observed points of a landmark have a known size: two points of a mark, or a post of known
/// length.
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

/// Returns the difference between the highest and the lowest known height, in metres. Two heights give a
/// known length. One height alone may be the floor of another storey and fixes no scale.
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

/// Returns the clusters of cameras; every cluster is adjusted as one problem. Cameras are in the same cluster
/// if they are in one component or share a lens. Unreached and unconnected cameras are included only if they
/// share a lens or estimate lens parameters. Indices are ascending.
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
        if camera.shared_lens.is_some() || camera.fits_lens() {
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

/// Landmark with its triangulated parameters.
pub(crate) type TriangulatedLandmark = (Landmark, [f64; LANDMARK_PARAMS]);

/// Estimates the pose of the camera with index `view` from triangulated points, with a fixed `height` (metres)
/// if given. If the points are not sufficient, points and floor lines are used, and `height` is ignored.
pub(crate) fn attach(
    camera: &Camera,
    view: usize,
    height: Option<f64>,
    landmarks: &[TriangulatedLandmark],
) -> Option<Camera> {
    let points = control_points(view, landmarks.iter().map(|(landmark, params)| (landmark, *params)));
    resect_from_points(camera, &points, height)
        .or_else(|| resect_from_points_and_lines(camera, view, landmarks))
}

/// Returns the landmark points that a camera observes, in the base system, with their pixels. Lines, and points of
/// unknown position on known landmarks, are left out.
pub(crate) fn control_points<'a>(
    view: usize,
    landmarks: impl Iterator<Item = (&'a Landmark, [f64; LANDMARK_PARAMS])>,
) -> Vec<ControlPoint> {
    let points = landmarks.filter(|(landmark, _)| !matches!(landmark.model, LandmarkModel::Line { .. }));
    let seen = points.flat_map(|(landmark, params)| {
        let is_placed = |point: usize| !is_known(landmark) || is_known_point(landmark, point);
        let own = landmark.observations.iter().filter(move |seen| seen.view == view && is_placed(seen.point));
        own.map(move |seen| (seen.pixel, landmark.model.point(&params, seen.point, &landmark.ground).0))
    });
    seen.map(|(pixel, world)| ControlPoint { pixel, world }).collect()
}

/// Estimates the pose from points, robustly against outliers. Candidates are the poses from pairs of points
/// and from all points. The candidate with the least median error (least median of squares, Rousseeuw 1984)
/// is fitted again to its inliers.
fn resect_from_points(camera: &Camera, points: &[ControlPoint], height: Option<f64>) -> Option<Camera> {
    /// Largest error of an inlier, as a multiple of the median error.
    const MAX_INLIER_ERROR_RATIO: f64 = 5.0;
    /// Largest error that is always accepted as an inlier, in pixels.
    const MIN_INLIER_LIMIT_PX: f64 = 4.0;
    if points.len() < 4 {
        return from_control_points(camera, points, height);
    }
    let few = sample_points(points);
    let tried =
        sample_pairs(few.len()).filter_map(|(i, j)| from_control_points(camera, &[few[i], few[j]], height));
    let all = from_control_points(camera, points, height);
    let scored = tried.chain(all).map(|camera| (median(errors(&camera, &few)), camera));
    let (_, best) = scored.min_by(|a, b| a.0.total_cmp(&b.0))?;
    let errors = errors(&best, points);
    let limit = (MAX_INLIER_ERROR_RATIO * median(errors.clone())).max(MIN_INLIER_LIMIT_PX);
    let inliers: Vec<ControlPoint> =
        points.iter().zip(&errors).filter(|(_, error)| **error <= limit).map(|(point, _)| *point).collect();
    from_control_points(camera, &inliers, height).or(Some(best))
}

/// Selects enough points for a reliable median, spread evenly over the list.
fn sample_points(points: &[ControlPoint]) -> Vec<ControlPoint> {
    const MAX_SAMPLED_POINTS: usize = 400;
    points.iter().step_by(points.len().div_ceil(MAX_SAMPLED_POINTS).max(1)).copied().collect()
}

/// Selects pairs of indices below `count`, spread evenly over all pairs.
fn sample_pairs(count: usize) -> impl Iterator<Item = (usize, usize)> {
    const MAX_SAMPLED_PAIRS: usize = 60;
    let step = (count * (count - 1) / 2).div_ceil(MAX_SAMPLED_PAIRS);
    (0..count).flat_map(move |i| (i + 1..count).map(move |j| (i, j))).step_by(step)
}

/// Returns the reprojection errors of the points, in raw pixels.
fn errors(camera: &Camera, points: &[ControlPoint]) -> Vec<f64> {
    let error = |point: &ControlPoint| {
        camera
            .world_to_pixel(point.world)
            .map_or(f64::INFINITY, |reprojected| reprojected.distance(point.pixel))
    };
    points.iter().map(error).collect()
}

/// Returns the median; the upper one for an even number of values.
fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}

/// Estimates the pose of a camera from the similarity of its floor that maps points to points and segments
/// onto lines.
///
/// Let s be the scale, t the rotation, `a = s cos t` and `b = s sin t`. A point (x, y) of the camera's own
/// floor maps to `(a x - b y + x0, b x + a y + y0)`. A point gives two equations that are linear in a, b, x0,
/// y0. Each end of a segment of a line gives one equation: the projection of the two equations on the line's
/// normal.
fn resect_from_points_and_lines(
    camera: &Camera,
    view: usize,
    landmarks: &[TriangulatedLandmark],
) -> Option<Camera> {
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

/// Returns the equations of [`resect_from_points_and_lines`], which defines a, b, x0 and y0. Each item contains
/// the coefficients of these unknowns and the right-hand side.
fn similarity_equations(
    camera: &Camera,
    view: usize,
    landmarks: &[TriangulatedLandmark],
) -> Vec<([f64; 4], f64)> {
    let mut rows = Vec::new();
    for (landmark, params) in landmarks {
        for seen in landmark.observations.iter().filter(|seen| seen.view == view) {
            let world = landmark.model.point(params, seen.point, &landmark.ground).0;
            let Some(FloorPoint { x, y }) = camera.pixel_to_floor(seen.pixel, world.z) else { continue };
            let normals: &[[f64; 2]] = match landmark.model {
                LandmarkModel::Line { .. } => &[[-params[1].sin(), params[1].cos()]],
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
