//! Initial state of the adjustment: camera poses and landmark positions. Cameras are placed one after the
//! other along a spanning tree of the view graph. Floors are then aligned to close the loops of the graph,
//! and landmarks are triangulated.
//!
//! # Shared tilt
//!
//! The tilt of the floor against the verticals, shared by several views, has two parameters in the base
//! system. Every view observes its components to the right and ahead.
//!
//! With yaw y, right on the floor is `(cos y, sin y)` and ahead is `(-sin y, cos y)`. A tilt t is therefore
//! observed as `(right . t, ahead . t)`, with the derivatives `(ahead . t, -right . t)` with respect to y.
//! With a separate tilt for each view, two views would count as twice the evidence.

use std::cmp::Reverse;
use std::collections::{BTreeMap, BTreeSet, BinaryHeap};

use crate::bundle::camera::{BundleCamera, InitialPose};
use crate::bundle::floor_alignment::{align_floors, align_to_known};
use crate::bundle::landmark::{DistanceMeasurement, Landmark};
use crate::bundle::triangulation::{floor_disagreements, is_known, is_visible, triangulate};
use crate::bundle::view_graph::{
    Component, TriangulatedLandmark, attach, components, control_points, determine_gauge, root,
};
use crate::camera::Camera;
use crate::floor::from_control_points;
use crate::optimize::NuisanceJacobian;

/// Initial state of an adjustment.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Initialization {
    pub(crate) poses: Vec<Camera>,
    /// Triangulated landmarks, with observations only of cameras that have a pose.
    pub(crate) landmarks: Vec<Landmark>,
    /// Measured distances. A distance is switched off if one of its landmarks is switched off.
    pub(crate) distances: Vec<DistanceMeasurement>,
    pub(crate) components: Vec<Component>,
    /// Cameras that share too few landmarks with the other cameras of their component to be placed.
    pub(crate) unreached: Vec<usize>,
    /// Landmarks that are switched off: they cannot be triangulated, or their position is not visible in an
    /// observing camera.
    pub(crate) unobservable: Vec<usize>,
    /// Largest root mean square disagreement on the floor, in metres, between two cameras that close a loop;
    /// `None` without loops. Such cameras share landmarks, but no edge of the spanning tree.
    pub(crate) loop_closure: Option<f64>,
}

/// Growing spanning tree: the poses computed so far, and the edges from which they were computed.
struct SpanningTree<'a> {
    cameras: &'a [BundleCamera<'a>],
    landmarks: &'a [Landmark],
    poses: Vec<Camera>,
    has_pose: Vec<bool>,
    /// Pairs of cameras in which one camera placed the other.
    edges: BTreeSet<[usize; 2]>,
}

/// Neighbours of every camera in the view graph, with the landmarks of unknown position that both observe.
type Neighbours = BTreeMap<usize, BTreeMap<usize, Vec<usize>>>;

/// Computes the initial poses of all cameras and the initial positions of all landmarks.
pub(crate) fn initialize(
    cameras: &[BundleCamera],
    landmarks: &[Landmark],
    distances: &[DistanceMeasurement],
) -> Initialization {
    let mut tree = SpanningTree::from_known(cameras, landmarks);
    let is_located = tree.has_pose.clone();
    let components = components(cameras, landmarks, distances);
    for component in &components {
        tree.grow(component);
    }
    let loop_closure = tree.loop_closure();
    let SpanningTree { mut poses, has_pose, .. } = tree;
    let roots: BTreeSet<usize> = components.iter().map(|component| root(component, cameras)).collect();
    let is_free: Vec<bool> = (0..cameras.len())
        .map(|view| has_pose[view] && !is_located[view] && !roots.contains(&view))
        .collect();
    align_floors(&mut poses, &is_free, landmarks);
    for component in components.iter().filter(|c| !c.iter().any(|&view| is_located[view])) {
        align_to_known(component, &mut poses, landmarks);
    }
    for (pose, camera) in poses.iter_mut().zip(cameras) {
        pose.position.z = camera.fixed_height().unwrap_or(pose.position.z);
        *pose = camera.fixed_pose.restore(&camera.camera, *pose);
    }
    let mut landmarks = landmarks.to_vec();
    let unobservable = triangulate_all(&mut landmarks, &poses, &has_pose);
    let distances = distances_between(distances, &landmarks);
    let is_unreached = |view: &usize| !has_pose[*view] && components.iter().any(|c| c.contains(view));
    let unreached = (0..cameras.len()).filter(is_unreached).collect();
    let components = components
        .into_iter()
        .map(|views| determine_gauge(views, cameras, &poses, &landmarks, &distances))
        .collect();
    Initialization { poses, landmarks, distances, components, unreached, unobservable, loop_closure }
}

/// Copies the distances. A distance is switched off if one of its landmarks is switched off.
fn distances_between(distances: &[DistanceMeasurement], landmarks: &[Landmark]) -> Vec<DistanceMeasurement> {
    let without_end =
        |distance: &DistanceMeasurement| distance.between.iter().any(|&landmark| landmarks[landmark].off);
    let used = |distance: &DistanceMeasurement| DistanceMeasurement {
        off: distance.off || without_end(distance),
        ..*distance
    };
    distances.iter().map(used).collect()
}

/// Triangulates every landmark. Switches off the landmarks that cannot be triangulated or are not visible in an
/// observing camera, and returns their indices.
fn triangulate_all(landmarks: &mut [Landmark], poses: &[Camera], has_pose: &[bool]) -> Vec<usize> {
    let mut unobservable = Vec::new();
    for (index, landmark) in landmarks.iter_mut().enumerate().filter(|(_, landmark)| !landmark.off) {
        landmark.observations.retain(|seen| has_pose[seen.view]);
        if let Some((model, params)) = triangulate(landmark, poses, &|_| true) {
            (landmark.model, landmark.params) = (model, params);
            landmark.off = !is_visible(landmark, poses);
        } else {
            landmark.off = true;
        }
        if landmark.off {
            unobservable.push(index);
        }
    }
    unobservable
}

impl<'a> SpanningTree<'a> {
    /// Creates the tree with the cameras that do not depend on other cameras: fixed cameras, and cameras that
    /// observe enough known positions.
    fn from_known(cameras: &'a [BundleCamera<'a>], landmarks: &'a [Landmark]) -> Self {
        let mut poses: Vec<Camera> = cameras.iter().map(|camera| camera.camera).collect();
        let mut has_pose = vec![false; cameras.len()];
        let known: Vec<&Landmark> =
            landmarks.iter().filter(|l| !(l.off || l.is_suspect) && is_known(l)).collect();
        for (view, camera) in cameras.iter().enumerate() {
            if camera.initial_pose == InitialPose::Fixed {
                has_pose[view] = true;
                continue;
            }
            let points = control_points(view, known.iter().map(|landmark| (*landmark, landmark.params)));
            if let Some(pose) = from_control_points(&camera.camera, &points, camera.fixed_height()) {
                poses[view] = pose;
                has_pose[view] = true;
            }
        }
        Self { cameras, landmarks, poses, has_pose, edges: BTreeSet::new() }
    }

    /// Places the cameras of a component one by one, each from the placed camera with which it shares the most
    /// landmarks. If no single camera is sufficient, all placed cameras are used together. Starts from the root if no
    /// camera has a pose.
    fn grow(&mut self, component: &[usize]) {
        if !component.iter().any(|&view| self.has_pose[view]) {
            self.has_pose[root(component, self.cameras)] = true;
        }
        let neighbours = self.neighbours();
        let mut queue = BinaryHeap::new();
        let placed = component.iter().filter(|&&view| self.has_pose[view]);
        placed.for_each(|&view| queue_edges(&mut queue, view, &neighbours));
        loop {
            self.grow_tree(&mut queue, &neighbours);
            // If no single neighbour shares enough landmarks, all placed neighbours together may.
            let Some((view, pose)) = self.place_from_all_neighbours(component, &neighbours) else { break };
            self.poses[view] = pose;
            self.has_pose[view] = true;
            queue_edges(&mut queue, view, &neighbours);
        }
        for &view in component {
            self.has_pose[view] |= self.cameras[view].initial_pose == InitialPose::Approximate;
        }
    }

    /// Returns the neighbours of every camera, with the shared landmarks of unknown position.
    fn neighbours(&self) -> Neighbours {
        let mut neighbours = Neighbours::new();
        let is_unknown = |landmark: &Landmark| !landmark.off && !is_known(landmark);
        for (index, landmark) in self.landmarks.iter().enumerate().filter(|(_, l)| is_unknown(l)) {
            let views = landmark.views();
            for &a in &views {
                for &b in views.iter().filter(|&&b| b != a) {
                    neighbours.entry(a).or_default().entry(b).or_default().push(index);
                }
            }
        }
        neighbours
    }

    /// Places the cameras in the queue, each from the landmarks that it shares with a single placed camera.
    fn grow_tree(&mut self, queue: &mut BinaryHeap<Edge>, neighbours: &Neighbours) {
        while let Some((_, Reverse((from, to)))) = queue.pop() {
            let shared = neighbours.get(&from).and_then(|near| near.get(&to));
            let Some(shared) = shared.filter(|_| !self.has_pose[to]) else { continue };
            if let Some(pose) = self.pose_from_landmarks(to, shared, &|view| view == from) {
                self.poses[to] = pose;
                self.has_pose[to] = true;
                self.edges.insert([from.min(to), from.max(to)]);
                queue_edges(queue, to, neighbours);
            }
        }
    }

    /// Returns the first camera that can be placed from the landmarks of all placed cameras together, with
    /// its pose.
    fn place_from_all_neighbours(
        &self,
        component: &[usize],
        neighbours: &Neighbours,
    ) -> Option<(usize, Camera)> {
        component.iter().copied().filter(|&view| !self.has_pose[view]).find_map(|view| {
            let shared: BTreeSet<usize> = neighbours.get(&view)?.values().flatten().copied().collect();
            let shared: Vec<usize> = shared.into_iter().collect();
            Some((view, self.pose_from_landmarks(view, &shared, &|other| self.has_pose[other])?))
        })
    }

    /// Returns the pose of a camera from landmarks triangulated by the cameras that `by` selects.
    fn pose_from_landmarks(
        &self,
        view: usize,
        shared: &[usize],
        by: &dyn Fn(usize) -> bool,
    ) -> Option<Camera> {
        let placed = |&index: &usize| {
            let landmark = &self.landmarks[index];
            let (model, params) = triangulate(landmark, &self.poses, by)?;
            Some((Landmark { model, ..landmark.clone() }, params))
        };
        let landmarks: Vec<TriangulatedLandmark> = shared.iter().filter_map(placed).collect();
        attach(&self.poses[view], view, self.cameras[view].fixed_height(), &landmarks)
    }

    /// Returns the largest root mean square disagreement on the floor, in metres, between cameras that share
    /// landmarks but are not joined in the tree.
    fn loop_closure(&self) -> Option<f64> {
        let mut disagreements: BTreeMap<[usize; 2], (f64, f64)> = BTreeMap::new();
        for landmark in self.landmarks.iter().filter(|landmark| !landmark.off && !is_known(landmark)) {
            for ([a, b], square) in floor_disagreements(landmark, &self.poses) {
                if self.has_pose[a] && self.has_pose[b] && !self.edges.contains(&[a, b]) {
                    let sum = disagreements.entry([a, b]).or_default();
                    *sum = (sum.0 + square, sum.1 + 1.0);
                }
            }
        }
        disagreements.into_values().map(|(sum, count)| (sum / count).sqrt()).max_by(f64::total_cmp)
    }
}

/// Edge of the view graph from a placed camera to another, with the number of landmarks that both observe.
/// The heap pops the edge with the most landmarks, on a tie with the lowest indices.
type Edge = (usize, Reverse<(usize, usize)>);

/// Adds the edges from a placed camera to all of its neighbours to the queue.
fn queue_edges(queue: &mut BinaryHeap<Edge>, from: usize, neighbours: &Neighbours) {
    let near = neighbours.get(&from).into_iter().flatten();
    queue.extend(near.map(|(&to, shared)| (shared.len(), Reverse((from, to)))));
}

/// Parameters of the tilt of the floor that several views share.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct CommonTilt {
    /// Block of the two tilt parameters.
    pub(crate) block: usize,
    /// View whose residuals include the prior on the tilt.
    pub(crate) prior_view: usize,
}

/// Returns the unit vectors on the floor to the right and ahead of a camera with this yaw (radians).
fn axes(yaw: f64) -> [[f64; 2]; 2] {
    let (sin, cos) = yaw.sin_cos();
    [[cos, sin], [-sin, cos]]
}

/// Transforms a tilt from the base system to the axes of a view (right, ahead) with this yaw, in radians.
pub(crate) fn base_to_view([x, y]: [f64; 2], yaw: f64) -> [f64; 2] {
    axes(yaw).map(|[a, b]| a * x + b * y)
}

/// Transforms derivatives from the axes of a view with this yaw to the base system.
pub(crate) fn view_to_base([right, ahead]: [f64; 2], yaw: f64) -> [f64; 2] {
    let [[rx, ry], [ax, ay]] = axes(yaw);
    [right * rx + ahead * ax, right * ry + ahead * ay]
}

/// Returns the derivatives of a residual with respect to the shared tilt `lean` in the base system, and to the yaw.
/// `nuisance` contains the derivatives with respect to the tilt in the axes of the view, and `tilt` is the index of
/// the first one. Returns `None` if the residual does not depend on the tilt.
pub(crate) fn common_tilt_derivatives(
    nuisance: &NuisanceJacobian,
    tilt: usize,
    lean: [f64; 2],
    yaw: f64,
) -> Option<([f64; 2], f64)> {
    let mut by = [0.0; 2];
    let entries = nuisance.entries().iter().filter(|(index, _)| (tilt..tilt + 2).contains(index));
    for &(index, derivative) in entries.clone() {
        by[index - tilt] += derivative;
    }
    entries.clone().next()?;
    let [right, ahead] = base_to_view(lean, yaw);
    Some((view_to_base(by, yaw), by[0] * ahead - by[1] * right))
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn derivatives_match_finite_differences(
            lean in [-0.1..0.1_f64, -0.1..0.1_f64], yaw in -3.0..3.0_f64, by in [-9.0..9.0_f64, -9.0..9.0_f64],
        ) {
            const STEP: f64 = 1e-5;
            let residual = |lean, yaw| base_to_view(lean, yaw).iter().zip(by).map(|(lean, by)| lean * by).sum::<f64>();
            let jacobian = NuisanceJacobian::new(4, by[0]).with_derivative(5, by[1]);
            let (by_lean, by_yaw) = common_tilt_derivatives(&jacobian, 4, lean, yaw).unwrap();
            let central = |at: &dyn Fn(f64) -> f64| (at(STEP) - at(-STEP)) / (2.0 * STEP);
            prop_assert!((central(&|step| residual([lean[0] + step, lean[1]], yaw)) - by_lean[0]).abs() < 1e-8);
            prop_assert!((central(&|step| residual([lean[0], lean[1] + step], yaw)) - by_lean[1]).abs() < 1e-8);
            prop_assert!((central(&|step| residual(lean, yaw + step)) - by_yaw).abs() < 1e-8);
        }

        #[test]
        fn residual_without_tilt_has_no_tilt_derivatives(yaw in -3.0..3.0_f64) {
            prop_assert_eq!(common_tilt_derivatives(&NuisanceJacobian::new(1, 2.0), 4, [0.1, 0.2], yaw), None);
        }
    }
}
