//! Where the adjustment starts: cameras placed one after the other along a spanning tree of the view
//! graph, floors aligned to close its loops, landmarks triangulated.

use std::cmp::Reverse;
use std::collections::{BTreeMap, BTreeSet, BinaryHeap};

use crate::bundle::attachment::{PlacedLandmark, attach, control_points};
use crate::bundle::camera::{BundleCamera, InitialPose};
use crate::bundle::floor_alignment::{align_floors, align_to_known};
use crate::bundle::landmark::{DistanceMeasurement, Landmark};
use crate::bundle::triangulation::{floor_disagreements, is_known, is_visible, triangulate};
use crate::bundle::view_graph::{Component, components, describe, root};
use crate::camera::Camera;
use crate::floor::from_control_points;

/// The start of an adjustment.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Initialization {
    pub(crate) poses: Vec<Camera>,
    /// Triangulated, with the observations of cameras that have a pose only.
    pub(crate) landmarks: Vec<Landmark>,
    /// Switched off where an end of them is.
    pub(crate) distances: Vec<DistanceMeasurement>,
    pub(crate) components: Vec<Component>,
    /// Cameras of components that share too little with the others to be placed.
    pub(crate) unreached: Vec<usize>,
    /// Landmarks that are switched off because a camera that observes them cannot show their triangulated
    /// place.
    pub(crate) unobservable: Vec<usize>,
    /// Largest root mean square disagreement on the floor between two cameras that are not joined by an edge
    /// of the tree, in metres; `None` without loops.
    pub(crate) loop_closure: Option<f64>,
}

/// The spanning tree as it grows: the poses found so far, and the edges that gave them.
struct SpanningTree<'a> {
    cameras: &'a [BundleCamera<'a>],
    landmarks: &'a [Landmark],
    poses: Vec<Camera>,
    has_pose: Vec<bool>,
    /// Pairs of cameras of which the one placed the other.
    edges: BTreeSet<[usize; 2]>,
}

/// The neighbours of every camera in the view graph, with the landmarks of unknown place that both observe.
type Neighbours = BTreeMap<usize, BTreeMap<usize, Vec<usize>>>;

/// Initialises cameras and landmarks.
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
        *pose = camera.held.put(&camera.camera, *pose);
    }
    let mut landmarks = landmarks.to_vec();
    let unobservable = triangulate_all(&mut landmarks, &poses, &has_pose);
    let distances = distances_between(distances, &landmarks);
    let is_unreached = |view: &usize| !has_pose[*view] && components.iter().any(|c| c.contains(view));
    let unreached = (0..cameras.len()).filter(is_unreached).collect();
    let components = components
        .into_iter()
        .map(|views| describe(views, cameras, &poses, &landmarks, &distances))
        .collect();
    Initialization { poses, landmarks, distances, components, unreached, unobservable, loop_closure }
}

/// Distances, switched off where one of their landmarks is.
fn distances_between(distances: &[DistanceMeasurement], landmarks: &[Landmark]) -> Vec<DistanceMeasurement> {
    let without_end =
        |distance: &DistanceMeasurement| distance.between.iter().any(|&landmark| landmarks[landmark].off);
    let used = |distance: &DistanceMeasurement| DistanceMeasurement {
        off: distance.off || without_end(distance),
        ..*distance
    };
    distances.iter().map(used).collect()
}

/// Triangulates every landmark; those that an observing camera cannot show there are switched off, and their
/// indices returned.
fn triangulate_all(landmarks: &mut [Landmark], poses: &[Camera], has_pose: &[bool]) -> Vec<usize> {
    let mut unobservable = Vec::new();
    for (index, landmark) in landmarks.iter_mut().enumerate().filter(|(_, landmark)| !landmark.off) {
        landmark.observations.retain(|seen| has_pose[seen.view]);
        if let Some((model, place)) = triangulate(landmark, poses, &|_| true) {
            (landmark.model, landmark.place) = (model, place);
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
    /// The cameras placed in the base system by themselves: fixed ones, and those that observe enough known
    /// places.
    fn from_known(cameras: &'a [BundleCamera<'a>], landmarks: &'a [Landmark]) -> Self {
        let mut poses: Vec<Camera> = cameras.iter().map(|camera| camera.camera).collect();
        let mut has_pose = vec![false; cameras.len()];
        let known: Vec<&Landmark> = landmarks.iter().filter(|l| !l.off && is_known(l)).collect();
        for (view, camera) in cameras.iter().enumerate() {
            if camera.initial_pose == InitialPose::Fixed {
                has_pose[view] = true;
                continue;
            }
            let points = control_points(view, known.iter().map(|landmark| (*landmark, landmark.place)));
            if let Some(pose) = from_control_points(&camera.camera, &points, camera.fixed_height()) {
                poses[view] = pose;
                has_pose[view] = true;
            }
        }
        Self { cameras, landmarks, poses, has_pose, edges: BTreeSet::new() }
    }

    /// Places the cameras of a component, each by the placed camera that shares most landmarks with it; from
    /// the root where none has a pose.
    fn grow(&mut self, component: &[usize]) {
        if !component.iter().any(|&view| self.has_pose[view]) {
            self.has_pose[root(component, self.cameras)] = true;
        }
        let neighbours = self.neighbours();
        let mut queue = BinaryHeap::new();
        let placed = component.iter().filter(|&&view| self.has_pose[view]);
        placed.for_each(|&view| extend(&mut queue, view, &neighbours));
        loop {
            self.grow_tree(&mut queue, &neighbours);
            // Where no single neighbour shares enough, all placed neighbours together may.
            let Some((view, pose)) = self.place_by_all(component, &neighbours) else { break };
            self.poses[view] = pose;
            self.has_pose[view] = true;
            extend(&mut queue, view, &neighbours);
        }
        for &view in component {
            self.has_pose[view] |= self.cameras[view].initial_pose == InitialPose::Approximate;
        }
    }

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

    /// Places cameras as long as one placed camera is enough for the next.
    fn grow_tree(&mut self, queue: &mut BinaryHeap<Edge>, neighbours: &Neighbours) {
        while let Some((_, Reverse((from, to)))) = queue.pop() {
            let shared = neighbours.get(&from).and_then(|near| near.get(&to));
            let Some(shared) = shared.filter(|_| !self.has_pose[to]) else { continue };
            if let Some(pose) = self.attached(to, shared, &|view| view == from) {
                self.poses[to] = pose;
                self.has_pose[to] = true;
                self.edges.insert([from.min(to), from.max(to)]);
                extend(queue, to, neighbours);
            }
        }
    }

    /// The first camera that can be placed by all placed cameras together.
    fn place_by_all(&self, component: &[usize], neighbours: &Neighbours) -> Option<(usize, Camera)> {
        component.iter().copied().filter(|&view| !self.has_pose[view]).find_map(|view| {
            let shared: BTreeSet<usize> = neighbours.get(&view)?.values().flatten().copied().collect();
            let shared: Vec<usize> = shared.into_iter().collect();
            Some((view, self.attached(view, &shared, &|other| self.has_pose[other])?))
        })
    }

    /// A camera placed by landmarks triangulated from the cameras that `by` picks.
    fn attached(&self, view: usize, shared: &[usize], by: &dyn Fn(usize) -> bool) -> Option<Camera> {
        let placed = |&index: &usize| {
            let landmark = &self.landmarks[index];
            let (model, place) = triangulate(landmark, &self.poses, by)?;
            Some((Landmark { model, ..landmark.clone() }, place))
        };
        let landmarks: Vec<PlacedLandmark> = shared.iter().filter_map(placed).collect();
        attach(&self.poses[view], view, self.cameras[view].fixed_height(), &landmarks)
    }

    /// Largest root mean square disagreement on the floor, in metres, between cameras that share landmarks
    /// but are not joined in the tree.
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

/// An edge of the view graph from a placed camera to another, with the number of landmarks that both
/// observe: the heap pops the one of most landmarks, of equals the one of the lowest indices.
type Edge = (usize, Reverse<(usize, usize)>);

/// Adds the edges of a camera that has been placed.
fn extend(queue: &mut BinaryHeap<Edge>, from: usize, neighbours: &Neighbours) {
    let near = neighbours.get(&from).into_iter().flatten();
    queue.extend(near.map(|(&to, shared)| (shared.len(), Reverse((from, to)))));
}
