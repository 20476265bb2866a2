//! Where the joint fit starts: cameras chained along a spanning tree of the best pairs, and what holds
//! every group of them in place.

use std::collections::{BTreeMap, BTreeSet, BinaryHeap};

use crate::bundle::floor_alignment::{bring_to_known, lay};
use crate::bundle::landmark::{APART, Gap, PLACE, Thing, Tie};
use crate::bundle::triangulation::{floor_gaps, is_known, is_shown, locate};
use crate::camera::{Camera, FloorPoint, WorldPoint};
use crate::floor::{ControlPoint, from_control_points};

/// How a camera stands before anything is refined.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Stand {
    /// At (0, 0), yaw 0.
    Nowhere,
    /// Where the operator put it.
    ByHand,
    /// Where the operator put it, and held there.
    Held,
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
    /// Ties that some camera that shows them cannot show where they should be.
    pub(crate) lost: Vec<usize>,
    /// Largest root mean square gap on the floor between two cameras that the tree does not join
    /// directly, in metres; `None` without loops.
    pub(crate) loop_closure: Option<f64>,
}

/// Moves cameras and ties to where the joint fit starts.
pub(crate) fn start(
    cameras: &mut [Camera],
    stands: &[Stand],
    ties: &mut [Tie],
    gaps: &[Gap],
    height_is_told: &[bool],
    held_heights: &[Option<f64>],
) -> Start {
    let mut is_placed: Vec<bool> = (0..cameras.len())
        .map(|view| {
            if stands[view] == Stand::Held {
                return true;
            }
            let points = control_points(
                view,
                ties.iter().filter(|tie| !tie.off && is_known(tie)).map(|tie| (tie, tie.place)),
            );
            let Some(found) = from_control_points(&cameras[view], &points, held_heights[view]) else {
                return false;
            };
            cameras[view] = found;
            true
        })
        .collect();
    let is_anchored = is_placed.clone();
    let mut components = components(cameras.len(), stands, ties, gaps);
    let mut tree = BTreeSet::new();
    for component in &mut components {
        let anchors: Vec<usize> = component.iter().copied().filter(|&view| is_placed[view]).collect();
        if anchors.is_empty() {
            let root = root(component, stands);
            is_placed[root] = true;
        }
        grow(component, cameras, held_heights, &mut is_placed, ties, &mut tree);
        for &view in component.iter() {
            is_placed[view] |= stands[view] == Stand::ByHand;
        }
    }
    let loop_closure = loop_closure(cameras, &is_placed, ties, &tree);
    let roots: BTreeSet<usize> = components.iter().map(|component| root(component, stands)).collect();
    let may_move: Vec<bool> = (0..cameras.len())
        .map(|view| is_placed[view] && !is_anchored[view] && !roots.contains(&view))
        .collect();
    lay(cameras, &may_move, ties);
    for component in components.iter().filter(|c| !c.iter().any(|&view| is_anchored[view])) {
        bring_to_known(component, cameras, ties);
    }
    for (camera, height) in cameras.iter_mut().zip(held_heights) {
        camera.position.z = height.unwrap_or(camera.position.z);
    }
    let lost = locate_all(ties, cameras, &is_placed);
    let gaps: Vec<Gap> = gaps
        .iter()
        .map(|gap| Gap { off: gap.off || gap.between.iter().any(|&tie| ties[tie].off), ..*gap })
        .collect();
    let unreached = (0..cameras.len())
        .filter(|&view| !is_placed[view] && components.iter().any(|component| component.contains(&view)))
        .collect();
    let describe = |views: Vec<usize>| describe(views, cameras, stands, ties, &gaps, height_is_told);
    Start { components: components.into_iter().map(describe).collect(), unreached, lost, loop_closure }
}

/// Puts every tie where its cameras have it; those that cannot be shown there are switched off and listed.
fn locate_all(ties: &mut [Tie], cameras: &[Camera], is_placed: &[bool]) -> Vec<usize> {
    let mut lost = Vec::new();
    for (index, tie) in ties.iter_mut().enumerate().filter(|(_, tie)| !tie.off) {
        tie.sightings.retain(|seen| is_placed[seen.view]);
        if let Some((thing, place)) = locate(tie, cameras, &|_| true) {
            (tie.thing, tie.place) = (thing, place);
            tie.off = !is_shown(tie, cameras);
        } else {
            tie.off = true;
        }
        if tie.off {
            lost.push(index);
        }
    }
    lost
}

/// The first camera that was placed, or the first.
fn root(component: &[usize], stands: &[Stand]) -> usize {
    let placed = component.iter().find(|&&view| stands[view] != Stand::Nowhere);
    placed.or(component.first()).copied().unwrap_or(0)
}

/// Groups of cameras that share a thing, a distance, or the base system; those that share nothing are
/// in none.
fn components(count: usize, stands: &[Stand], ties: &[Tie], gaps: &[Gap]) -> Vec<Vec<usize>> {
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
    let mut is_tied: Vec<bool> = stands.iter().map(|&stand| stand == Stand::Held).collect();
    let mut join_all = |views: &[usize], is_known: bool, is_tied: &mut Vec<bool>| {
        if views.len() > 1 || is_known {
            views.iter().for_each(|&view| is_tied[view] = true);
        }
        views.windows(2).for_each(|pair| join(pair[0], pair[1]));
        if let Some(&first) = views.first().filter(|_| is_known) {
            join(first, base);
        }
    };
    for tie in ties.iter().filter(|tie| !tie.off) {
        join_all(&tie.views(), is_known(tie), &mut is_tied);
    }
    for gap in gaps.iter().filter(|gap| !gap.off && gap.between.iter().all(|&tie| !ties[tie].off)) {
        let views: Vec<usize> = gap.between.iter().flat_map(|&tie| ties[tie].views()).collect();
        join_all(&views, false, &mut is_tied);
    }
    for view in (0..count).filter(|&view| stands[view] == Stand::Held) {
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
    ties: &[Tie],
    tree: &mut BTreeSet<[usize; 2]>,
) {
    let mut common: BTreeMap<usize, BTreeMap<usize, Vec<usize>>> = BTreeMap::new();
    for (index, tie) in ties.iter().enumerate().filter(|(_, tie)| !tie.off && !is_known(tie)) {
        let views = tie.views();
        for &a in &views {
            for &b in views.iter().filter(|&&b| b != a) {
                common.entry(a).or_default().entry(b).or_default().push(index);
            }
        }
    }
    let none = BTreeMap::new();
    let pairs = |a: usize| common.get(&a).unwrap_or(&none).iter().map(move |(&b, ties)| (ties.len(), a, b));
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
            let located = located(shared, ties, cameras, &|view| view == from);
            if let Some(found) = attach(&cameras[to], to, held_heights[to], &located) {
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
            let located = located(&shared, ties, cameras, &|view| is_placed[view]);
            Some((view, attach(&cameras[view], view, held_heights[view], &located)?))
        });
        let Some((view, found)) = next else { break };
        cameras[view] = found;
        is_placed[view] = true;
        push(&mut queue, view);
    }
}

/// These ties where some of the cameras that show them put them.
fn located(
    shared: &[usize],
    ties: &[Tie],
    cameras: &[Camera],
    by: &dyn Fn(usize) -> bool,
) -> Vec<(Tie, [f64; PLACE])> {
    let of = |&index: &usize| {
        let (thing, place) = locate(&ties[index], cameras, by)?;
        Some((Tie { thing, ..ties[index].clone() }, place))
    };
    shared.iter().filter_map(of).collect()
}

/// Points of the base system with the pixels of a camera that show them.
fn control_points<'a>(
    view: usize,
    located: impl Iterator<Item = (&'a Tie, [f64; PLACE])>,
) -> Vec<ControlPoint> {
    located
        .filter(|(tie, _)| !matches!(tie.thing, Thing::Line { .. }))
        .flat_map(|(tie, place)| {
            let seen = tie.sightings.iter().filter(move |seen| seen.view == view);
            seen.map(move |seen| ControlPoint {
                pixel: seen.pixel,
                world: tie.thing.point(&place, seen.point).0,
            })
            .collect::<Vec<_>>()
        })
        .collect()
}

/// A camera that shows these things where they are.
fn attach(
    camera: &Camera,
    view: usize,
    height: Option<f64>,
    located: &[(Tie, [f64; PLACE])],
) -> Option<Camera> {
    let points = control_points(view, located.iter().map(|(tie, place)| (tie, *place)));
    // Of two points the shape says which of two answers is right only with a third: all are tried.
    by_consensus(camera, &points, height).or_else(|| by_points_and_lines(camera, view, located))
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
            camera.world_to_pixel(point.world).map_or(f64::INFINITY, |shown| shown.distance(point.pixel))
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
fn by_points_and_lines(camera: &Camera, view: usize, located: &[(Tie, [f64; PLACE])]) -> Option<Camera> {
    let mut rows: Vec<([f64; 4], f64)> = Vec::new();
    for (tie, place) in located {
        for seen in tie.sightings.iter().filter(|seen| seen.view == view) {
            let world = tie.thing.point(place, seen.point).0;
            let Some(FloorPoint { x, y }) = camera.pixel_to_floor(seen.pixel, world.z) else { continue };
            let across: &[[f64; 2]] = match tie.thing {
                Thing::Line { .. } => &[[-place[1].sin(), place[1].cos()]],
                _ => &[[1.0, 0.0], [0.0, 1.0]],
            };
            rows.extend(
                across
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

/// Gap on the floor between cameras that share things but are not joined in the tree.
fn loop_closure(
    cameras: &[Camera],
    is_placed: &[bool],
    ties: &[Tie],
    tree: &BTreeSet<[usize; 2]>,
) -> Option<f64> {
    let mut gaps: BTreeMap<[usize; 2], (f64, f64)> = BTreeMap::new();
    for tie in ties.iter().filter(|tie| !tie.off && !is_known(tie)) {
        for ([a, b], square) in floor_gaps(tie, cameras) {
            if is_placed[a] && is_placed[b] && !tree.contains(&[a, b]) {
                let sum = gaps.entry([a, b]).or_default();
                sum.0 += square;
                sum.1 += 1.0;
            }
        }
    }
    gaps.into_values().map(|(sum, count)| (sum / count).sqrt()).max_by(f64::total_cmp)
}

/// What holds a group of cameras: known places, known turns, known lengths and heights.
fn describe(
    views: Vec<usize>,
    cameras: &[Camera],
    stands: &[Stand],
    ties: &[Tie],
    gaps: &[Gap],
    height_is_told: &[bool],
) -> Component {
    let is_ours =
        |tie: &&Tie| !tie.off && tie.sightings.iter().any(|seen| views.binary_search(&seen.view).is_ok());
    let ours: Vec<&Tie> = ties.iter().filter(is_ours).collect();
    let held: Vec<usize> = views.iter().copied().filter(|&view| stands[view] == Stand::Held).collect();
    let mut places: Vec<FloorPoint> = held.iter().map(|&view| cameras[view].position.on_floor()).collect();
    let known = ours.iter().filter(|tie| is_known(tie));
    for tie in known {
        let points: BTreeSet<usize> = tie.sightings.iter().map(|seen| seen.point).collect();
        places.extend(points.iter().map(|&point| tie.thing.point(&tie.place, point).0.on_floor()));
    }
    let is_turned = !held.is_empty() || places.iter().any(|place| place.distance(places[0]) > APART);
    let has_size = |tie: &&&Tie| match &tie.thing {
        Thing::Mark { points, .. } => {
            let seen: BTreeSet<usize> = tie.sightings.iter().map(|seen| seen.point).collect();
            let first = seen.first().and_then(|&point| points.get(point));
            seen.iter().any(|&point| points.get(point) != first)
        }
        Thing::Post => !tie.free[2] || !tie.beliefs.is_empty(),
        Thing::Point { .. } | Thing::Measured | Thing::Line { .. } => false,
    };
    // Two heights that differ are a length that is known; one alone is the floor of another building.
    let heights = ours.iter().flat_map(|tie| {
        let seen = tie.sightings.iter().filter(|seen| !(tie.thing == Thing::Post && seen.point > 0));
        seen.map(|seen| tie.thing.point(&tie.place, seen.point).0.z)
    });
    let (low, high) =
        heights.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), z| (low.min(z), high.max(z)));
    let is_measured = |gap: &Gap| !gap.off && gap.between.iter().all(|&tie| is_ours(&&ties[tie]));
    let is_scaled = is_turned
        || high - low > APART
        || ours.iter().any(|tie| has_size(&tie))
        || views.iter().any(|&view| height_is_told[view])
        || gaps.iter().any(is_measured);
    Component { root: root(&views, stands), is_held: !places.is_empty(), is_turned, is_scaled, views }
}
