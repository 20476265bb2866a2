//! The floors of all cameras laid together at once: what closes the loops of a chain before the joint
//! fit starts.
//!
//! First turns and scales: of two cameras that share points, the one floor is the other turned and
//! scaled, `turn_a - turn_b` and `log scale_a - log scale_b` are known, and all of them together are a
//! sparse linear system. Then, with those held, the moves: another one. (All at once would be linear,
//! too, and would shrink every floor a little with its distance from the first.)

use std::collections::BTreeMap;

use crate::bundle::landmark::{APART, Landmark, LandmarkModel};
use crate::bundle::triangulation::is_known;
use crate::camera::{Camera, FloorPoint, WorldPoint};
use crate::optimize::{BlockStructure, JacobianBlock};

/// A place as a camera puts it, and where it is known to be.
type Seen = ([f64; 2], FloorPoint);

/// What one camera puts on the floor.
#[derive(Clone, Copy, Debug)]
struct FloorSighting {
    view: usize,
    /// Relative to the foot of the camera.
    at: [f64; 2],
    foot: FloorPoint,
    point: usize,
    /// Pixels per metre there, but for the focal.
    weight: f64,
}

/// Moves, turns and scales the cameras that are `free` until their floors agree on the points they share.
pub(crate) fn align_floors(cameras: &mut [Camera], free: &[bool], landmarks: &[Landmark]) {
    let (observations, _) = observations(cameras, landmarks);
    let Some(turned) = solve_rotations(&observations, free) else { return };
    for (view, [turn, log_scale]) in turned {
        cameras[view].yaw += turn;
        cameras[view].position.z *= log_scale.clamp(-2.0, 2.0).exp();
    }
    let (observations, points) = self::observations(cameras, landmarks);
    for (view, [x, y]) in solve_translations(&observations, points, free).unwrap_or_default() {
        let WorldPoint { x: x0, y: y0, z } = cameras[view].position;
        cameras[view].position = WorldPoint { x: x0 + x, y: y0 + y, z };
    }
}

/// Moves a chain whose cameras each show too little that is known to where all of it together lies: by a
/// similarity, or by a move where one place is all that is known.
pub(crate) fn align_to_known(component: &[usize], cameras: &mut [Camera], landmarks: &[Landmark]) {
    let mut pairs: Vec<Seen> = Vec::new();
    for landmark in landmarks.iter().filter(|landmark| !landmark.off && is_known(landmark)) {
        for seen in landmark.observations.iter().filter(|seen| component.contains(&seen.view)) {
            let at = landmark.model.point(&landmark.place, seen.point).0;
            if let Some(found) = cameras[seen.view].pixel_to_floor(seen.pixel, at.z) {
                pairs.push(([found.x, found.y], at.on_floor()));
            }
        }
    }
    let Some(first) = pairs.first().map(|pair| pair.1) else { return };
    let count = pairs.len() as f64;
    let mean = |value: &dyn Fn(&Seen) -> f64| pairs.iter().map(value).sum::<f64>() / count;
    let (from, to) = ([mean(&|p| p.0[0]), mean(&|p| p.0[1])], [mean(&|p| p.1.x), mean(&|p| p.1.y)]);
    let (mut a, mut b) = (1.0, 0.0);
    if pairs.iter().any(|pair| pair.1.distance(first) > APART) {
        let (mut along, mut cross_covariance, mut square) = (0.0, 0.0, 0.0);
        for ([x, y], at) in &pairs {
            let (x, y, u, v) = (x - from[0], y - from[1], at.x - to[0], at.y - to[1]);
            along += x * u + y * v;
            cross_covariance += x * v - y * u;
            square += x * x + y * y;
        }
        if square > 0.0 && along.hypot(cross_covariance) > 0.0 {
            (a, b) = (along / square, cross_covariance / square);
        }
    }
    for &view in component {
        let WorldPoint { x, y, z } = cameras[view].position;
        let (x, y) = (x - from[0], y - from[1]);
        cameras[view].position =
            WorldPoint::new(to[0] + a * x - b * y, to[1] + b * x + a * y, z * a.hypot(b));
        cameras[view].yaw += b.atan2(a);
    }
}

/// Turn and log scale of every camera that is free.
fn solve_rotations(observations: &[FloorSighting], free: &[bool]) -> Option<Vec<(usize, [f64; 2])>> {
    let mut pairs: BTreeMap<[usize; 2], Vec<[FloorSighting; 2]>> = BTreeMap::new();
    for group in observations.chunk_by(|a, b| a.point == b.point) {
        for (i, a) in group.iter().enumerate() {
            for b in group[i + 1..].iter().filter(|b| b.view != a.view) {
                let (a, b) = if a.view < b.view { (a, b) } else { (b, a) };
                pairs.entry([a.view, b.view]).or_default().push([*a, *b]);
            }
        }
    }
    let similar: Vec<([usize; 2], [f64; 2], f64)> = pairs
        .iter()
        .filter_map(|(&pair, points)| similarity(points).map(|(change, weight)| (pair, change, weight)))
        .collect();
    let free = |view: usize| free[view] && similar.iter().any(|(pair, ..)| pair.contains(&view));
    let coupled = similar.iter().map(|(pair, ..)| pair.to_vec());
    solve(&free, coupled, 0, |blocks, block_of, normal| {
        for (pair, change, weight) in &similar {
            for k in 0..2 {
                let mut by = [0.0; 2];
                by[k] = *weight;
                let back = by.map(|jacobian| -jacobian);
                let rows = [(pair[0], &by), (pair[1], &back)];
                let jacobian: Vec<JacobianBlock> = rows
                    .iter()
                    .filter_map(|(view, by)| Some(JacobianBlock { block: block_of[*view]?, by: *by }))
                    .collect();
                blocks.add(normal, -weight * change[k], &jacobian);
            }
        }
    })
}

/// Move of every camera that is free.
fn solve_translations(
    observations: &[FloorSighting],
    points: usize,
    free: &[bool],
) -> Option<Vec<(usize, [f64; 2])>> {
    let mut seen = vec![false; free.len()];
    observations.iter().for_each(|put| seen[put.view] = true);
    let mut common: Vec<Vec<usize>> = vec![Vec::new(); points];
    observations.iter().for_each(|put| common[put.point].push(put.view));
    solve(&|view| free[view] && seen[view], common.into_iter(), points, |blocks, block_of, normal| {
        let first = block_of.iter().flatten().count();
        for put in observations {
            let at = [put.foot.x + put.at[0], put.foot.y + put.at[1]];
            for k in 0..2 {
                let mut by = [0.0; 2];
                by[k] = put.weight;
                let back = by.map(|jacobian| -jacobian);
                let point = JacobianBlock { block: first + put.point, by: &back };
                match block_of[put.view] {
                    Some(block) => {
                        blocks.add(normal, put.weight * at[k], &[JacobianBlock { block, by: &by }, point])
                    }
                    None => blocks.add(normal, put.weight * at[k], &[point]),
                }
            }
        }
    })
}

/// Solves for two unknowns of every free view, with points of two unknowns beside them; `common` lists
/// the views that a pair or a point joins.
fn solve(
    free: &dyn Fn(usize) -> bool,
    common: impl Iterator<Item = Vec<usize>>,
    points: usize,
    fill: impl Fn(&BlockStructure, &[Option<usize>], &mut crate::optimize::NormalEquations),
) -> Option<Vec<(usize, [f64; 2])>> {
    let common: Vec<Vec<usize>> = common.collect();
    let count = common.iter().flatten().max().map_or(0, |view| view + 1);
    let views: Vec<usize> = (0..count).filter(|&view| free(view)).collect();
    let mut block_of = vec![None; count];
    views.iter().enumerate().for_each(|(block, &view)| block_of[view] = Some(block));
    let sizes = vec![2; views.len() + points];
    let keep: Vec<bool> = (0..sizes.len()).map(|block| block < views.len()).collect();
    let joined = common.iter().enumerate().map(|(index, group)| {
        let own = (points > 0).then_some(views.len() + index);
        group.iter().filter_map(|&view| block_of[view]).chain(own).collect()
    });
    let blocks = BlockStructure::new(sizes, &keep, &joined.collect::<Vec<Vec<usize>>>());
    let mut normal = blocks.normal();
    fill(&blocks, &block_of, &mut normal);
    // What shares too little to be told is held by the damping.
    let (step, _) = blocks.step(&normal, 1e-9)?;
    Some(views.iter().enumerate().map(|(i, &view)| (view, [step[2 * i], step[2 * i + 1]])).collect())
}

/// Turn and log scale that take the first floor to the second, and how well they are told (the root of
/// the weighted scatter of the points). Points that are far off lose their say.
fn similarity(points: &[[FloorSighting; 2]]) -> Option<([f64; 2], f64)> {
    /// Rounds with new weights; the last ones change little.
    const ROUNDS: usize = 4;
    if points.len() < 2 {
        return None;
    }
    let mut trust: Vec<f64> = points.iter().map(|[a, b]| a.weight * b.weight).collect();
    let base = trust.clone();
    let (mut turn, mut log_scale, mut told) = (0.0, 0.0, 0.0);
    for _ in 0..ROUNDS {
        let total: f64 = trust.iter().sum();
        let mean = |which: usize, axis: usize| {
            points.iter().zip(&trust).map(|(pair, w)| w * pair[which].at[axis]).sum::<f64>() / total
        };
        let centre = [[mean(0, 0), mean(0, 1)], [mean(1, 0), mean(1, 1)]];
        let from = |pair: &[FloorSighting; 2], which: usize| {
            [pair[which].at[0] - centre[which][0], pair[which].at[1] - centre[which][1]]
        };
        let (mut along, mut cross_covariance, mut first, mut second) = (0.0, 0.0, 0.0, 0.0);
        for (pair, w) in points.iter().zip(&trust) {
            let ([x, y], [u, v]) = (from(pair, 0), from(pair, 1));
            along += w * (x * u + y * v);
            cross_covariance += w * (x * v - y * u);
            first += w * (x * x + y * y);
            second += w * (u * u + v * v);
        }
        if first <= 0.0 || second <= 0.0 {
            return None;
        }
        // The ratio of the scatters has no side that it favours.
        (turn, log_scale, told) =
            (cross_covariance.atan2(along), 0.5 * (second / first).ln(), (first * second).sqrt().sqrt());
        let (sin, cos) = turn.sin_cos();
        let scale = log_scale.exp();
        let errors: Vec<f64> = points
            .iter()
            .map(|pair| {
                let ([x, y], [u, v]) = (from(pair, 0), from(pair, 1));
                (scale * (cos * x - sin * y) - u).hypot(scale * (sin * x + cos * y) - v) * pair[0].weight
            })
            .collect();
        let mut sorted = errors.clone();
        sorted.sort_by(f64::total_cmp);
        let usual = 3.0 * sorted[sorted.len() / 2].max(1e-12);
        trust = base.iter().zip(&errors).map(|(w, e)| w / (1.0 + (e / usual).powi(2))).collect();
    }
    (turn.is_finite() && log_scale.is_finite()).then_some(([turn, log_scale], told))
}

/// Everything that cameras put on the floor, and the number of points.
fn observations(cameras: &[Camera], landmarks: &[Landmark]) -> (Vec<FloorSighting>, usize) {
    let mut found: Vec<FloorSighting> = Vec::new();
    let mut points = 0;
    for landmark in landmarks.iter().filter(|landmark| {
        !landmark.off
            && landmark.free[0]
            && !matches!(landmark.model, LandmarkModel::Line { .. } | LandmarkModel::Measured)
    }) {
        let mut names: Vec<usize> = landmark.observations.iter().map(|seen| seen.point).collect();
        names.sort_unstable();
        names.dedup();
        for name in names {
            // How high the head of a post is, is not known yet.
            if landmark.model == LandmarkModel::Post && name > 0 {
                continue;
            }
            let height = landmark.model.point(&landmark.place, name).0.z;
            let mut own: Vec<FloorSighting> = Vec::new();
            for seen in landmark.observations.iter().filter(|seen| seen.point == name) {
                let camera = &cameras[seen.view];
                let Some(floor) = camera.pixel_to_floor(seen.pixel, height) else { continue };
                let foot = camera.position.on_floor();
                let at = [floor.x - foot.x, floor.y - foot.y];
                let drop = (camera.position.z - height).abs();
                let weight = drop / (at[0] * at[0] + at[1] * at[1] + drop * drop);
                own.push(FloorSighting { view: seen.view, at, foot, point: points, weight });
            }
            if own.len() > 1 {
                found.extend(own);
                points += 1;
            }
        }
    }
    (found, points)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bundle::landmark::Observation;
    use crate::camera::{Lens, Pixel};

    #[test]
    fn floors_that_agree_but_for_a_similarity_are_laid_exactly() {
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
            .map(|&[x, y]| Landmark {
                model: LandmarkModel::Point { height: 0.0 },
                place: [0.0; 3],
                free: [true, true, false],
                priors: Vec::new(),
                observations: truth
                    .iter()
                    .enumerate()
                    .filter_map(|(view, camera)| {
                        let pixel = camera.world_to_pixel(WorldPoint::new(x, y, 0.0))?;
                        Some(Observation { view, point: 0, pixel, sigma: 1.0 })
                    })
                    .collect(),
                keep: false,
                off: false,
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
