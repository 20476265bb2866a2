//! Joint alignment of the floors of all cameras. It closes the loops of the spanning tree before the
//! adjustment starts.
//!
//! Roll, pitch and focal length of every camera are known from stage 1. The camera therefore observes the
//! floor up to a similarity: rotation `t`, scale `s` and translation `m`. As in global structure from motion,
//! rotations are averaged before translations are solved for:
//!
//! 1. Two cameras a and b that share points give the similarity between their floors, with relative rotation
//!    `t_ba` and log scale `l_ba`. The equations `t_a - t_b = t_ba` and `log s_a - log s_b = l_ba` for all
//!    pairs are a sparse linear least-squares problem. (Rotation averaging in the plane is linear as long as
//!    the initial errors are below 180°.)
//! 2. With rotations and scales fixed, `m_a + p_a = x` for every point x that camera a observes at `p_a`
//!    relative to itself. This is a sparse linear problem in the translations and the points, and the points
//!    are eliminated.
//!
//! Solving for all unknowns at once would be linear, too. But it would shrink floors, and distant floors the most,
//! because the noise in `p_a` multiplies the unknown scale.
//!
//! The similarity of two floors is estimated robustly by iteratively reweighted least squares with Cauchy
//! weights `1 / (1 + (e / c)^2)`. Here e is the error, and c is three times the median error.

use std::collections::BTreeMap;

use crate::bundle::landmark::{Landmark, LandmarkModel, Observation, SAME_POSITION_M};
use crate::bundle::triangulation::{floor_positions, is_known, is_known_point};
use crate::camera::{Camera, FloorPoint, WorldPoint};
use crate::optimize::{BlockStructure, JacobianBlock, NormalEquations};

/// Floor position of a point as computed from a camera, and its known position.
type PositionPair = ([f64; 2], FloorPoint);

/// Floor position of a point as computed from one camera.
#[derive(Clone, Copy, Debug)]
struct FloorSighting {
    view: usize,
    /// Position relative to the foot of the camera, in metres.
    at: [f64; 2],
    /// Floor point below the camera.
    foot: FloorPoint,
    /// Index of the point, the same for all cameras that observe it.
    point: usize,
    /// Resolution at the point: pixels per metre of floor, divided by the focal length in pixels.
    weight: f64,
}

/// Translates, rotates and scales the `free` cameras until their floors agree on the shared points.
pub(crate) fn align_floors(cameras: &mut [Camera], free: &[bool], landmarks: &[Landmark]) {
    let (sightings, _) = sightings(cameras, landmarks);
    let Some(turns) = solve_rotations(&sightings, free) else { return };
    for (view, [turn, log_scale]) in turns {
        cameras[view].yaw += turn;
        cameras[view].position.z *= log_scale.clamp(-2.0, 2.0).exp();
    }
    let (sightings, points) = self::sightings(cameras, landmarks);
    for (view, [x, y]) in solve_translations(&sightings, points, free).unwrap_or_default() {
        let WorldPoint { x: x0, y: y0, z } = cameras[view].position;
        cameras[view].position = WorldPoint { x: x0 + x, y: y0 + y, z };
    }
}

/// Aligns a component to the known positions that it observes. It is for components in which no camera alone observes
/// enough of them. The alignment is a similarity, or a translation if only one position is known.
pub(crate) fn align_to_known(component: &[usize], cameras: &mut [Camera], landmarks: &[Landmark]) {
    let pairs = known_positions(component, cameras, landmarks);
    if pairs.is_empty() {
        return;
    }
    let (from, to, [a, b]) = fit_similarity(&pairs);
    for &view in component {
        let WorldPoint { x, y, z } = cameras[view].position;
        let (x, y) = (x - from[0], y - from[1]);
        cameras[view].position =
            WorldPoint::new(to[0] + a * x - b * y, to[1] + b * x + a * y, z * a.hypot(b));
        cameras[view].yaw += b.atan2(a);
    }
}

/// Returns the known positions that a component observes, each as computed from a camera and as known.
fn known_positions(component: &[usize], cameras: &[Camera], landmarks: &[Landmark]) -> Vec<PositionPair> {
    let known = landmarks.iter().filter(|landmark| !landmark.off && is_known(landmark));
    let mut pairs = Vec::new();
    for landmark in known {
        let is_used =
            |seen: &&Observation| component.contains(&seen.view) && is_known_point(landmark, seen.point);
        for seen in landmark.observations.iter().filter(is_used) {
            let at = landmark.point(seen.point);
            if let Some(found) = cameras[seen.view].pixel_to_floor(seen.pixel, at.z) {
                pairs.push(([found.x, found.y], at.on_floor()));
            }
        }
    }
    pairs
}

/// Fits the least-squares similarity `q = to + [a, -b; b, a] (p - from)` from computed positions p to known
/// positions q. Returns the centroids `from` and `to`, and `[a, b]`. With complex numbers,
/// `a + i b = sum conj(p) q / sum |p|^2`, with p and q relative to their centroids. The result is a
/// translation if all positions coincide.
fn fit_similarity(pairs: &[PositionPair]) -> ([f64; 2], [f64; 2], [f64; 2]) {
    let count = pairs.len() as f64;
    let mean = |value: &dyn Fn(&PositionPair) -> f64| pairs.iter().map(value).sum::<f64>() / count;
    let (from, to) = ([mean(&|p| p.0[0]), mean(&|p| p.0[1])], [mean(&|p| p.1.x), mean(&|p| p.1.y)]);
    let first = pairs.first().map(|pair| pair.1).unwrap_or_default();
    if !pairs.iter().any(|pair| pair.1.distance(first) > SAME_POSITION_M) {
        return (from, to, [1.0, 0.0]);
    }
    let (mut dot, mut cross, mut square) = (0.0, 0.0, 0.0);
    for ([x, y], at) in pairs {
        let (x, y, u, v) = (x - from[0], y - from[1], at.x - to[0], at.y - to[1]);
        dot += x * u + y * v;
        cross += x * v - y * u;
        square += x * x + y * y;
    }
    let is_determined = square > 0.0 && dot.hypot(cross) > 0.0;
    (from, to, if is_determined { [dot / square, cross / square] } else { [1.0, 0.0] })
}

/// Two cameras, the rotation and log scale from the floor of the first to the floor of the second, and the
/// weight of both.
type RelativeSimilarity = ([usize; 2], [f64; 2], f64);

/// Returns the rotation (radians) and log scale of every free camera, with the index of the camera.
fn solve_rotations(sightings: &[FloorSighting], free: &[bool]) -> Option<Vec<(usize, [f64; 2])>> {
    let relative: Vec<RelativeSimilarity> = sightings_by_pair(sightings)
        .iter()
        .filter_map(|(&pair, points)| {
            robust_similarity(points).map(|(change, weight)| (pair, change, weight))
        })
        .collect();
    let free = |view: usize| free[view] && relative.iter().any(|(pair, ..)| pair.contains(&view));
    let coupled = relative.iter().map(|(pair, ..)| pair.to_vec());
    solve(&free, coupled, 0, |blocks, block_of, normal| {
        for (pair, change, weight) in &relative {
            for k in 0..2 {
                let mut by = [0.0; 2];
                by[k] = *weight;
                let back = by.map(|jacobian| -jacobian);
                let columns = [(pair[0], &by), (pair[1], &back)];
                let jacobian: Vec<JacobianBlock> = columns
                    .iter()
                    .filter_map(|(view, by)| Some(JacobianBlock { block: block_of[*view]?, by: *by }))
                    .collect();
                blocks.add(normal, -weight * change[k], &jacobian);
            }
        }
    })
}

/// Groups the sightings of shared points by pair of cameras, the lower index first.
fn sightings_by_pair(sightings: &[FloorSighting]) -> BTreeMap<[usize; 2], Vec<[FloorSighting; 2]>> {
    let mut pairs: BTreeMap<[usize; 2], Vec<[FloorSighting; 2]>> = BTreeMap::new();
    for same in sightings.chunk_by(|a, b| a.point == b.point) {
        for (i, a) in same.iter().enumerate() {
            for b in same[i + 1..].iter().filter(|b| b.view != a.view) {
                let (a, b) = if a.view < b.view { (a, b) } else { (b, a) };
                pairs.entry([a.view, b.view]).or_default().push([*a, *b]);
            }
        }
    }
    pairs
}

/// Returns the translation (metres) of every free camera, with the index of the camera.
fn solve_translations(
    sightings: &[FloorSighting],
    points: usize,
    free: &[bool],
) -> Option<Vec<(usize, [f64; 2])>> {
    let mut has_sighting = vec![false; free.len()];
    sightings.iter().for_each(|sighting| has_sighting[sighting.view] = true);
    let mut coupled: Vec<Vec<usize>> = vec![Vec::new(); points];
    sightings.iter().for_each(|sighting| coupled[sighting.point].push(sighting.view));
    let free = |view: usize| free[view] && has_sighting[view];
    solve(&free, coupled.into_iter(), points, |blocks, block_of, normal| {
        let first_point = block_of.iter().flatten().count();
        for sighting in sightings {
            let at = [sighting.foot.x + sighting.at[0], sighting.foot.y + sighting.at[1]];
            for k in 0..2 {
                let mut by = [0.0; 2];
                by[k] = sighting.weight;
                let back = by.map(|jacobian| -jacobian);
                let point = JacobianBlock { block: first_point + sighting.point, by: &back };
                let residual = sighting.weight * at[k];
                match block_of[sighting.view] {
                    Some(block) => blocks.add(normal, residual, &[JacobianBlock { block, by: &by }, point]),
                    None => blocks.add(normal, residual, &[point]),
                }
            }
        }
    })
}

/// Solves a linear least-squares problem with two unknowns for each free view and each of `points` points. The points
/// are eliminated. `coupled` lists the views that share a pair or point, and `fill` adds the equations. Returns the
/// index and the unknowns of each free view.
fn solve(
    free: &dyn Fn(usize) -> bool,
    coupled: impl Iterator<Item = Vec<usize>>,
    points: usize,
    fill: impl Fn(&BlockStructure, &[Option<usize>], &mut NormalEquations),
) -> Option<Vec<(usize, [f64; 2])>> {
    let coupled: Vec<Vec<usize>> = coupled.collect();
    let count = coupled.iter().flatten().max().map_or(0, |view| view + 1);
    let views: Vec<usize> = (0..count).filter(|&view| free(view)).collect();
    let mut block_of = vec![None; count];
    views.iter().enumerate().for_each(|(block, &view)| block_of[view] = Some(block));
    let sizes = vec![2; views.len() + points];
    let keep: Vec<bool> = (0..sizes.len()).map(|block| block < views.len()).collect();
    let groups = coupled.iter().enumerate().map(|(index, group)| {
        let own = (points > 0).then_some(views.len() + index);
        group.iter().filter_map(|&view| block_of[view]).chain(own).collect()
    });
    let blocks = BlockStructure::new(sizes, &keep, &groups.collect::<Vec<Vec<usize>>>());
    let mut normal = blocks.normal();
    fill(&blocks, &block_of, &mut normal);
    // The damping fixes undetermined unknowns.
    let (step, _) = blocks.step(&normal, 1e-9)?;
    Some(views.iter().enumerate().map(|(i, &view)| (view, [step[2 * i], step[2 * i + 1]])).collect())
}

/// Similarity from the floor of one camera to the floor of another: rotation (radians) and log scale about
/// the centroids of their shared points.
struct FloorSimilarity {
    turn: f64,
    log_scale: f64,
    centres: [[f64; 2]; 2],
    /// Square root of the weighted scatter of the points. It is the inverse standard deviation of rotation and log
    /// scale, up to a common factor.
    weight: f64,
}

impl FloorSimilarity {
    /// Fits the similarity to weighted pairs of sightings of the same points; `None` if all points of one
    /// floor coincide.
    fn new(points: &[[FloorSighting; 2]], weights: &[f64]) -> Option<Self> {
        let total: f64 = weights.iter().sum();
        let mean = |which: usize, axis: usize| {
            points.iter().zip(weights).map(|(pair, w)| w * pair[which].at[axis]).sum::<f64>() / total
        };
        let centres = [[mean(0, 0), mean(0, 1)], [mean(1, 0), mean(1, 1)]];
        let (mut dot, mut cross, mut first, mut second) = (0.0, 0.0, 0.0, 0.0);
        for (pair, w) in points.iter().zip(weights) {
            let ([x, y], [u, v]) = (from_centre(pair, &centres, 0), from_centre(pair, &centres, 1));
            dot += w * (x * u + y * v);
            cross += w * (x * v - y * u);
            first += w * (x * x + y * y);
            second += w * (u * u + v * v);
        }
        // The ratio of the scatters treats both floors symmetrically (Horn 1987).
        (first > 0.0 && second > 0.0).then(|| Self {
            turn: cross.atan2(dot),
            log_scale: 0.5 * (second / first).ln(),
            centres,
            weight: (first * second).sqrt().sqrt(),
        })
    }

    /// Returns the distance between the transformed first point and the second, in pixels divided by the
    /// focal length.
    fn error(&self, pair: &[FloorSighting; 2]) -> f64 {
        let (sin, cos) = self.turn.sin_cos();
        let scale = self.log_scale.exp();
        let ([x, y], [u, v]) = (from_centre(pair, &self.centres, 0), from_centre(pair, &self.centres, 1));
        (scale * (cos * x - sin * y) - u).hypot(scale * (sin * x + cos * y) - v) * pair[0].weight
    }
}

fn from_centre(pair: &[FloorSighting; 2], centres: &[[f64; 2]; 2], which: usize) -> [f64; 2] {
    [pair[which].at[0] - centres[which][0], pair[which].at[1] - centres[which][1]]
}

/// Estimates the rotation (radians) and the log scale that map floor coordinates of the first camera to floor
/// coordinates of the second. Also returns the weight of both values. The method is iteratively reweighted least
/// squares.
fn robust_similarity(points: &[[FloorSighting; 2]]) -> Option<([f64; 2], f64)> {
    /// Number of fits, the first of them without robust weights; further fits change little.
    const ITERATIONS: usize = 4;
    if points.len() < 2 {
        return None;
    }
    let by_distance: Vec<f64> = points.iter().map(|[a, b]| a.weight * b.weight).collect();
    let mut weights = by_distance.clone();
    let mut similarity = FloorSimilarity::new(points, &weights)?;
    for _ in 1..ITERATIONS {
        let errors: Vec<f64> = points.iter().map(|pair| similarity.error(pair)).collect();
        let mut sorted = errors.clone();
        sorted.sort_by(f64::total_cmp);
        let scale = 3.0 * sorted[sorted.len() / 2].max(1e-12);
        weights = by_distance.iter().zip(&errors).map(|(w, e)| w / (1.0 + (e / scale).powi(2))).collect();
        similarity = FloorSimilarity::new(points, &weights)?;
    }
    let FloorSimilarity { turn, log_scale, weight, .. } = similarity;
    (turn.is_finite() && log_scale.is_finite()).then_some(([turn, log_scale], weight))
}

/// Returns the sightings of all points that at least two cameras observe, sorted by point, and the number of
/// points.
fn sightings(cameras: &[Camera], landmarks: &[Landmark]) -> (Vec<FloorSighting>, usize) {
    let mut sightings: Vec<FloorSighting> = Vec::new();
    let mut count = 0;
    for landmark in landmarks.iter().filter(|landmark| is_alignable(landmark)) {
        let mut points: Vec<usize> = landmark.observations.iter().map(|seen| seen.point).collect();
        points.sort_unstable();
        points.dedup();
        // The height of the head of a post is not known yet.
        let is_head = |point: usize| landmark.model == LandmarkModel::Post && point > 0;
        for point in points.into_iter().filter(|&point| !is_head(point)) {
            let height = landmark.point(point).z;
            let seen = floor_positions(landmark, point, cameras);
            if seen.len() > 1 {
                let own =
                    seen.into_iter().map(|(view, at)| sighting(view, &cameras[view], at, height, count));
                sightings.extend(own);
                count += 1;
            }
        }
    }
    (sightings, count)
}

/// Whether a landmark can align floors. It must be active and at an unknown position, and it must have a point,
/// unlike a line.
fn is_alignable(landmark: &Landmark) -> bool {
    let is_point = !matches!(landmark.model, LandmarkModel::Line { .. } | LandmarkModel::Measured);
    !landmark.off && landmark.free[0] && is_point
}

/// Returns the sighting of a point at `height` metres by a camera.
///
/// Let h be the height of the camera above the point, d the floor distance of the point, and f the focal
/// length in pixels. A pixel covers `(d^2 + h^2) / (f h)` metres of floor along the ray.
fn sighting(view: usize, camera: &Camera, at: FloorPoint, height: f64, point: usize) -> FloorSighting {
    let foot = camera.position.on_floor();
    let at = [at.x - foot.x, at.y - foot.y];
    let drop = (camera.position.z - height).abs();
    let weight = drop / (at[0] * at[0] + at[1] * at[1] + drop * drop);
    FloorSighting { view, at, foot, point, weight }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bundle::landmark::Observation;
    use crate::camera::{Lens, Pixel};

    #[test]
    fn floors_that_differ_by_similarities_are_aligned_exactly() {
        let camera = |x: f64, yaw: f64, z: f64| Camera {
            position: WorldPoint::new(x, 0.0, z),
            yaw,
            pitch: 0.6,
            roll: 0.02,
            focal: 1200.0,
            lens: Lens::pinhole(Pixel::new(960.0, 540.0)),
            covariance: crate::camera::Covariance::EXACT,
        };
        let truth = [camera(0.0, 0.0, 3.0), camera(2.0, 0.3, 4.0), camera(4.0, 0.5, 3.5)];
        let places = [[0.5, 5.0], [1.0, 6.0], [-0.5, 7.0], [1.5, 5.5], [0.2, 8.0]];
        let landmarks: Vec<Landmark> = places
            .iter()
            .map(|&[x, y]| {
                let point = WorldPoint::new(x, y, 0.0);
                let seen = |(view, camera): (usize, &Camera)| {
                    Some(Observation::new(view, camera.world_to_pixel(point)?))
                };
                let observations = truth.iter().enumerate().filter_map(seen).collect();
                Landmark::new(LandmarkModel::Point { height: 0.0 }, observations)
            })
            .collect();
        let mut found = [truth[0], camera(2.5, 0.2, 3.6), camera(3.0, 0.9, 4.4)];
        align_floors(&mut found, &[false, true, true], &landmarks);
        for (found, truth) in found.iter().zip(&truth) {
            assert!(
                found.position.distance(truth.position) < 1e-6,
                "{:?} not {:?}",
                found.position,
                truth.position
            );
            assert!((found.yaw - truth.yaw).abs() < 1e-6);
        }
    }
}
