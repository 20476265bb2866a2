//! Where the joint fit starts: cameras chained along a spanning tree of the best pairs, and what holds
//! every group of them in place.

use std::collections::{BTreeMap, BTreeSet, BinaryHeap};

use crate::bundle::floor_alignment::{align_floors, align_to_known};
use crate::bundle::landmark::{APART, DistanceMeasurement, LANDMARK_PARAMS, Landmark, LandmarkModel};
use crate::bundle::triangulation::{floor_disagreements, is_known, is_shown, triangulate};
use crate::camera::{Camera, FloorPoint, WorldPoint};
use crate::floor::{ControlPoint, from_control_points};

/// How a camera stands before anything is refined.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum InitialPose {
    /// At (0, 0), yaw 0.
    Unknown,
    /// Where the operator put it.
    ByHand,
    /// Where the operator put it, and held there.
    Fixed,
}

/// Cameras that hang together.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Component {
    /// Indices in ascending order.
    pub(crate) views: Vec<usize>,
    /// The camera whose placement holds what nothing else does.
    pub(crate) root: usize,
    /// Something holds it in place.
    pub(crate) is_held: bool,
    /// Something holds its turn.
    pub(crate) is_turned: bool,
    /// Something gives its scale.
    pub(crate) is_scaled: bool,
}

/// The start of a joint fit.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Start {
    /// Every group of cameras that share something, or that something of the base system is known to.
    pub(crate) components: Vec<Component>,
    /// Cameras that are tied to others by too little to be placed.
    pub(crate) unreached: Vec<usize>,
    /// Landmarks that some camera that shows them cannot show where they should be.
    pub(crate) lost: Vec<usize>,
    /// Largest root mean square gap on the floor between two cameras that the tree does not join
    /// directly, in metres; `None` without loops.
    pub(crate) loop_closure: Option<f64>,
}

/// Moves cameras and landmarks to where the joint fit starts.
pub(crate) fn start(
    cameras: &mut [Camera],
    initial_poses: &[InitialPose],
    landmarks: &mut [Landmark],
    measurements: &[DistanceMeasurement],
    height_is_told: &[bool],
    held_heights: &[Option<f64>],
) -> Start {
    let mut is_placed: Vec<bool> = (0..cameras.len())
        .map(|view| {
            if initial_poses[view] == InitialPose::Fixed {
                return true;
            }
            let points = control_points(
                view,
                landmarks
                    .iter()
                    .filter(|landmark| !landmark.off && is_known(landmark))
                    .map(|landmark| (landmark, landmark.place)),
            );
            let Some(found) = from_control_points(&cameras[view], &points, held_heights[view]) else {
                return false;
            };
            cameras[view] = found;
            true
        })
        .collect();
    let is_anchored = is_placed.clone();
    let mut components = components(cameras.len(), initial_poses, landmarks, measurements);
    let mut tree = BTreeSet::new();
    for component in &mut components {
        let anchors: Vec<usize> = component.iter().copied().filter(|&view| is_placed[view]).collect();
        if anchors.is_empty() {
            let root = root(component, initial_poses);
            is_placed[root] = true;
        }
        grow(component, cameras, held_heights, &mut is_placed, landmarks, &mut tree);
        for &view in component.iter() {
            is_placed[view] |= initial_poses[view] == InitialPose::ByHand;
        }
    }
    let loop_closure = loop_closure(cameras, &is_placed, landmarks, &tree);
    let roots: BTreeSet<usize> = components.iter().map(|component| root(component, initial_poses)).collect();
    let may_move: Vec<bool> = (0..cameras.len())
        .map(|view| is_placed[view] && !is_anchored[view] && !roots.contains(&view))
        .collect();
    align_floors(cameras, &may_move, landmarks);
    for component in components.iter().filter(|c| !c.iter().any(|&view| is_anchored[view])) {
        align_to_known(component, cameras, landmarks);
    }
    for (camera, height) in cameras.iter_mut().zip(held_heights) {
        camera.position.z = height.unwrap_or(camera.position.z);
    }
    let lost = triangulate_all(landmarks, cameras, &is_placed);
    let measurements: Vec<DistanceMeasurement> = measurements
        .iter()
        .map(|measurement| DistanceMeasurement {
            off: measurement.off || measurement.between.iter().any(|&landmark| landmarks[landmark].off),
            ..*measurement
        })
        .collect();
    let unreached = (0..cameras.len())
        .filter(|&view| !is_placed[view] && components.iter().any(|component| component.contains(&view)))
        .collect();
    let describe =
        |views: Vec<usize>| describe(views, cameras, initial_poses, landmarks, &measurements, height_is_told);
    Start { components: components.into_iter().map(describe).collect(), unreached, lost, loop_closure }
}

/// Puts every landmark where its cameras have it; those that cannot be shown there are switched off and listed.
fn triangulate_all(landmarks: &mut [Landmark], cameras: &[Camera], is_placed: &[bool]) -> Vec<usize> {
    let mut lost = Vec::new();
    for (index, landmark) in landmarks.iter_mut().enumerate().filter(|(_, landmark)| !landmark.off) {
        landmark.observations.retain(|seen| is_placed[seen.view]);
        if let Some((model, place)) = triangulate(landmark, cameras, &|_| true) {
            (landmark.model, landmark.place) = (model, place);
            landmark.off = !is_shown(landmark, cameras);
        } else {
            landmark.off = true;
        }
        if landmark.off {
            lost.push(index);
        }
    }
    lost
}

/// The first camera that was placed, or the first.
fn root(component: &[usize], initial_poses: &[InitialPose]) -> usize {
    let placed = component.iter().find(|&&view| initial_poses[view] != InitialPose::Unknown);
    placed.or(component.first()).copied().unwrap_or(0)
}

/// Groups of cameras that share a landmark, a distance, or the base system; those that share nothing are
/// in none.
fn components(
    count: usize,
    initial_poses: &[InitialPose],
    landmarks: &[Landmark],
    measurements: &[DistanceMeasurement],
) -> Vec<Vec<usize>> {
    let mut parent: Vec<usize> = (0..=count).collect();
    let base = count;
    fn find(parent: &mut [usize], mut node: usize) -> usize {
        while parent[node] != node {
            parent[node] = parent[parent[node]];
            node = parent[node];
        }
        node
    }
    let mut join = |a: usize, b: usize| {
        let (a, b) = (find(&mut parent, a), find(&mut parent, b));
        parent[a.max(b)] = a.min(b);
    };
    let mut is_tied: Vec<bool> =
        initial_poses.iter().map(|&initial_pose| initial_pose == InitialPose::Fixed).collect();
    let mut join_all = |views: &[usize], is_known: bool, is_tied: &mut Vec<bool>| {
        if views.len() > 1 || is_known {
            views.iter().for_each(|&view| is_tied[view] = true);
        }
        views.windows(2).for_each(|pair| join(pair[0], pair[1]));
        if let Some(&first) = views.first().filter(|_| is_known) {
            join(first, base);
        }
    };
    for landmark in landmarks.iter().filter(|landmark| !landmark.off) {
        join_all(&landmark.views(), is_known(landmark), &mut is_tied);
    }
    for measurement in measurements.iter().filter(|measurement| {
        !measurement.off && measurement.between.iter().all(|&landmark| !landmarks[landmark].off)
    }) {
        let views: Vec<usize> =
            measurement.between.iter().flat_map(|&landmark| landmarks[landmark].views()).collect();
        join_all(&views, false, &mut is_tied);
    }
    for view in (0..count).filter(|&view| initial_poses[view] == InitialPose::Fixed) {
        join_all(&[view], true, &mut is_tied);
    }
    let mut groups: BTreeMap<usize, Vec<usize>> = BTreeMap::new();
    for view in (0..count).filter(|&view| is_tied[view]) {
        groups.entry(find(&mut parent, view)).or_default().push(view);
    }
    groups.into_values().collect()
}

/// Places cameras one after the other, each by the camera that shares most with it.
fn grow(
    component: &[usize],
    cameras: &mut [Camera],
    held_heights: &[Option<f64>],
    is_placed: &mut [bool],
    landmarks: &[Landmark],
    tree: &mut BTreeSet<[usize; 2]>,
) {
    let mut common: BTreeMap<usize, BTreeMap<usize, Vec<usize>>> = BTreeMap::new();
    for (index, landmark) in
        landmarks.iter().enumerate().filter(|(_, landmark)| !landmark.off && !is_known(landmark))
    {
        let views = landmark.views();
        for &a in &views {
            for &b in views.iter().filter(|&&b| b != a) {
                common.entry(a).or_default().entry(b).or_default().push(index);
            }
        }
    }
    let none = BTreeMap::new();
    let pairs =
        |a: usize| common.get(&a).unwrap_or(&none).iter().map(move |(&b, landmarks)| (landmarks.len(), a, b));
    let mut queue: BinaryHeap<(usize, std::cmp::Reverse<(usize, usize)>)> = BinaryHeap::new();
    let push = |queue: &mut BinaryHeap<_>, a: usize| {
        queue.extend(pairs(a).map(|(count, a, b)| (count, std::cmp::Reverse((a, b)))));
    };
    component.iter().filter(|&&view| is_placed[view]).for_each(|&view| push(&mut queue, view));
    loop {
        while let Some((_, std::cmp::Reverse((from, to)))) = queue.pop() {
            let Some(shared) = common.get(&from).and_then(|near| near.get(&to)).filter(|_| !is_placed[to])
            else {
                continue;
            };
            let triangulated = triangulated(shared, landmarks, cameras, &|view| view == from);
            if let Some(found) = attach(&cameras[to], to, held_heights[to], &triangulated) {
                cameras[to] = found;
                is_placed[to] = true;
                tree.insert([from.min(to), from.max(to)]);
                push(&mut queue, to);
            }
        }
        // What one neighbour is too little for, all together may do.
        let next = component.iter().copied().filter(|&view| !is_placed[view]).find_map(|view| {
            let shared: Vec<usize> =
                common.get(&view)?.values().flatten().copied().collect::<BTreeSet<_>>().into_iter().collect();
            let triangulated = triangulated(&shared, landmarks, cameras, &|view| is_placed[view]);
            Some((view, attach(&cameras[view], view, held_heights[view], &triangulated)?))
        });
        let Some((view, found)) = next else { break };
        cameras[view] = found;
        is_placed[view] = true;
        push(&mut queue, view);
    }
}

/// These landmarks where some of the cameras that show them put them.
fn triangulated(
    shared: &[usize],
    landmarks: &[Landmark],
    cameras: &[Camera],
    by: &dyn Fn(usize) -> bool,
) -> Vec<(Landmark, [f64; LANDMARK_PARAMS])> {
    let of = |&index: &usize| {
        let (model, place) = triangulate(&landmarks[index], cameras, by)?;
        Some((Landmark { model, ..landmarks[index].clone() }, place))
    };
    shared.iter().filter_map(of).collect()
}

/// Points of the base system with the pixels of a camera that show them.
fn control_points<'a>(
    view: usize,
    triangulated: impl Iterator<Item = (&'a Landmark, [f64; LANDMARK_PARAMS])>,
) -> Vec<ControlPoint> {
    triangulated
        .filter(|(landmark, _)| !matches!(landmark.model, LandmarkModel::Line { .. }))
        .flat_map(|(landmark, place)| {
            let seen = landmark.observations.iter().filter(move |seen| seen.view == view);
            seen.map(move |seen| ControlPoint {
                pixel: seen.pixel,
                world: landmark.model.point(&place, seen.point).0,
            })
            .collect::<Vec<_>>()
        })
        .collect()
}

/// A camera that shows these landmarks where they are.
fn attach(
    camera: &Camera,
    view: usize,
    height: Option<f64>,
    triangulated: &[(Landmark, [f64; LANDMARK_PARAMS])],
) -> Option<Camera> {
    let points = control_points(view, triangulated.iter().map(|(landmark, place)| (landmark, *place)));
    // Of two points the shape says which of two answers is right only with a third: all are tried.
    by_consensus(camera, &points, height).or_else(|| by_points_and_lines(camera, view, triangulated))
}

/// The placement that most of the points agree with: a wrong link must not lead the chain astray.
fn by_consensus(camera: &Camera, points: &[ControlPoint], height: Option<f64>) -> Option<Camera> {
    /// Of the median: beyond it a point does not belong.
    const FAR: f64 = 5.0;
    /// Pixels within which any points agree.
    const NEAR: f64 = 4.0;
    /// Pairs that are tried.
    const MOST: usize = 60;
    if points.len() < 4 {
        return from_control_points(camera, points, height);
    }
    let off = |camera: &Camera| -> Vec<f64> {
        let off = |point: &ControlPoint| {
            camera
                .world_to_pixel(point.world)
                .map_or(f64::INFINITY, |reprojected| reprojected.distance(point.pixel))
        };
        points.iter().map(off).collect()
    };
    let median = |mut values: Vec<f64>| {
        values.sort_by(f64::total_cmp);
        values[values.len() / 2]
    };
    let count = points.len();
    let pairs = (0..count).flat_map(|i| (i + 1..count).map(move |j| (i, j)));
    // Spread over all pairs, however many there are.
    let step = (count * (count - 1) / 2).div_ceil(MOST);
    let tried =
        pairs.step_by(step).filter_map(|(i, j)| from_control_points(camera, &[points[i], points[j]], height));
    let all = from_control_points(camera, points, height);
    let best = tried.chain(all).min_by(|a, b| median(off(a)).total_cmp(&median(off(b))))?;
    let errors = off(&best);
    let limit = (FAR * median(errors.clone())).max(NEAR);
    let agreeing: Vec<ControlPoint> =
        points.iter().zip(&errors).filter(|(_, error)| **error <= limit).map(|(point, _)| *point).collect();
    from_control_points(camera, &agreeing, height).or(Some(best))
}

/// The similarity of the floor that takes points to points and segments into lines: with
/// `a = s cos, b = s sin`, every point gives two equations linear in a, b and the move, and each end
/// of a segment one.
fn by_points_and_lines(
    camera: &Camera,
    view: usize,
    triangulated: &[(Landmark, [f64; LANDMARK_PARAMS])],
) -> Option<Camera> {
    let mut rows: Vec<([f64; 4], f64)> = Vec::new();
    for (landmark, place) in triangulated {
        for seen in landmark.observations.iter().filter(|seen| seen.view == view) {
            let world = landmark.model.point(place, seen.point).0;
            let Some(FloorPoint { x, y }) = camera.pixel_to_floor(seen.pixel, world.z) else { continue };
            let cross_covariance: &[[f64; 2]] = match landmark.model {
                LandmarkModel::Line { .. } => &[[-place[1].sin(), place[1].cos()]],
                _ => &[[1.0, 0.0], [0.0, 1.0]],
            };
            rows.extend(
                cross_covariance
                    .iter()
                    .map(|[m, n]| ([m * x + n * y, n * x - m * y, *m, *n], m * world.x + n * world.y)),
            );
        }
    }
    if rows.len() < 4 {
        return None;
    }
    let matrix = nalgebra::DMatrix::from_fn(rows.len(), 4, |i, j| rows[i].0[j]);
    let right = nalgebra::DVector::from_fn(rows.len(), |i, _| rows[i].1);
    let svd = nalgebra::SVD::new(matrix, true, true);
    let (most, least) = (svd.singular_values.max(), svd.singular_values.min());
    let found = (least > 1e-6 * most).then(|| svd.solve(&right, 0.0).ok()).flatten()?;
    let [a, b, x, y] = [found[0], found[1], found[2], found[3]];
    let scale = a.hypot(b);
    let position = WorldPoint::new(x, y, scale * camera.position.z);
    (scale > 1e-3).then_some(Camera { position, yaw: b.atan2(a), ..*camera })
}

/// Gap on the floor between cameras that share landmarks but are not joined in the tree.
fn loop_closure(
    cameras: &[Camera],
    is_placed: &[bool],
    landmarks: &[Landmark],
    tree: &BTreeSet<[usize; 2]>,
) -> Option<f64> {
    let mut measurements: BTreeMap<[usize; 2], (f64, f64)> = BTreeMap::new();
    for landmark in landmarks.iter().filter(|landmark| !landmark.off && !is_known(landmark)) {
        for ([a, b], square) in floor_disagreements(landmark, cameras) {
            if is_placed[a] && is_placed[b] && !tree.contains(&[a, b]) {
                let sum = measurements.entry([a, b]).or_default();
                sum.0 += square;
                sum.1 += 1.0;
            }
        }
    }
    measurements.into_values().map(|(sum, count)| (sum / count).sqrt()).max_by(f64::total_cmp)
}

/// What holds a group of cameras: known places, known turns, known lengths and heights.
fn describe(
    views: Vec<usize>,
    cameras: &[Camera],
    initial_poses: &[InitialPose],
    landmarks: &[Landmark],
    measurements: &[DistanceMeasurement],
    height_is_told: &[bool],
) -> Component {
    let is_ours = |landmark: &&Landmark| {
        !landmark.off && landmark.observations.iter().any(|seen| views.binary_search(&seen.view).is_ok())
    };
    let ours: Vec<&Landmark> = landmarks.iter().filter(is_ours).collect();
    let held: Vec<usize> =
        views.iter().copied().filter(|&view| initial_poses[view] == InitialPose::Fixed).collect();
    let mut places: Vec<FloorPoint> = held.iter().map(|&view| cameras[view].position.on_floor()).collect();
    let known = ours.iter().filter(|landmark| is_known(landmark));
    for landmark in known {
        let points: BTreeSet<usize> = landmark.observations.iter().map(|seen| seen.point).collect();
        places.extend(points.iter().map(|&point| landmark.model.point(&landmark.place, point).0.on_floor()));
    }
    let is_turned = !held.is_empty() || places.iter().any(|place| place.distance(places[0]) > APART);
    let has_size = |landmark: &&&Landmark| match &landmark.model {
        LandmarkModel::Mark { points, .. } => {
            let seen: BTreeSet<usize> = landmark.observations.iter().map(|seen| seen.point).collect();
            let first = seen.first().and_then(|&point| points.get(point));
            seen.iter().any(|&point| points.get(point) != first)
        }
        LandmarkModel::Post => !landmark.free[2] || !landmark.priors.is_empty(),
        LandmarkModel::Point { .. } | LandmarkModel::Measured | LandmarkModel::Line { .. } => false,
    };
    // Two heights that differ are a length that is known; one alone is the floor of another building.
    let heights = ours.iter().flat_map(|landmark| {
        let seen = landmark
            .observations
            .iter()
            .filter(|seen| !(landmark.model == LandmarkModel::Post && seen.point > 0));
        seen.map(|seen| landmark.model.point(&landmark.place, seen.point).0.z)
    });
    let (low, high) =
        heights.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), z| (low.min(z), high.max(z)));
    let is_measured = |measurement: &DistanceMeasurement| {
        !measurement.off && measurement.between.iter().all(|&landmark| is_ours(&&landmarks[landmark]))
    };
    let is_scaled = is_turned
        || high - low > APART
        || ours.iter().any(|landmark| has_size(&landmark))
        || views.iter().any(|&view| height_is_told[view])
        || measurements.iter().any(is_measured);
    Component { root: root(&views, initial_poses), is_held: !places.is_empty(), is_turned, is_scaled, views }
}
