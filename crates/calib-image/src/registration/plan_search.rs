//! Search for the place of a group of cameras on a floor plan.
//!
//! The relative poses of the group are known, up to a similarity. For a pose of the group, the plan predicts the end of
//! each ray of the floor scans: its first obstacle. The likelihood of the measured ends is the beam model of a range
//! finder (Thrun, Burgard and Fox, *Probabilistic Robotics*, 2005, section 6.3). With the measured distance r and the
//! predicted distance p, it is a mixture of
//!
//! - a hit: r is normal about p;
//! - an obstacle that is not on the plan, such as a person: r is uniform below p;
//! - ink that is no obstacle, such as the arc of a door, or a wall with the colour of the floor: r - p is exponential;
//! - an arbitrary distance.
//!
//! The score is the logarithm of the likelihood relative to uniform distances, divided by the number of neighbouring
//! rays that share their errors. The search tries all positions on a grid, with the yaws for which the floor edges have
//! the direction of the lines on the plan. The best poses are refined. A pose is accepted only if it is much more likely
//! than all others. The relative poses of a group have errors. Therefore each camera of a group is also refined alone, near
//! its pose in the group, and the scores of the refined cameras decide.

use std::f64::consts::{FRAC_PI_2, PI};

use calib_core::{Camera, FloorPoint, Placement};

use crate::registration::floor_scan::{FloorRay, FloorScan};
use crate::registration::pattern_search::PatternSearch;
use crate::registration::plan_obstacles::PlanObstacles;
use crate::registration::relative_pose::wrapped;

/// Smallest probability of an accepted pose.
const MIN_PROBABILITY: f64 = 0.95;
/// Smallest score of an accepted pose: the log likelihood relative to uniform distances.
const MIN_SCORE: f64 = 2.0;
/// Smallest number of rays that end at an obstacle, for an accepted pose.
const MIN_BLOCKED: usize = 12;
/// Number of neighbouring rays that share their errors: they end at the same object.
const SHARED_RAYS: f64 = 6.0;
/// Number of poses that are refined.
const REFINED: usize = 12;
/// Largest deviation from the given heights, in standard deviations.
const MAX_SCALE_DEVIATION: f64 = 2.5;
/// Range of uniform distances, in heights of the camera. It must be proportional to the scale: otherwise small scales, at
/// which all distances are small, would be likely on every plan.
const SPAN: f64 = 2.0;
/// Standard deviation of the ends of rays due to the errors of the relative poses of a group, in metres.
const RELATIVE_SIGMA_M: f64 = 0.3;
/// Distance in metres, and angle in radians, below which two poses are the same.
const SAME: [f64; 2] = [0.8, 0.2];

/// Camera of a group with its visible floor.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ScannedCamera<'a> {
    /// Pose in the frame of the group, in metres.
    pub(crate) camera: &'a Camera,
    pub(crate) scan: &'a FloorScan,
}

/// Result of the search for the place of a group on the plan.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum PlanPose {
    /// Cameras of the group in the frame of the plan.
    Found(Vec<Camera>),
    /// Several poses on the plan agree with the visible floor.
    Ambiguous,
    /// No pose on the plan agrees with the visible floor.
    NotFound,
}

/// Ray over the floor, in metres. The origin of its frame is the middle of the floor that the group observes.
struct GroupRay {
    /// Floor point below the camera.
    from: [f64; 2],
    /// Direction, counter-clockwise from the y axis, in radians.
    heading: f64,
    start: f64,
    end: f64,
    is_blocked: bool,
    /// Range of uniform distances.
    span: f64,
}

/// Similarity from the frame of the rays to the frame of the plan, with its score.
#[derive(Clone, Copy, Debug)]
struct Pose {
    score: f64,
    /// Rotation, in radians.
    turn: f64,
    log_scale: f64,
    /// Position of the origin of the rays on the plan, in metres.
    at: [f64; 2],
}

impl Pose {
    fn is_same(&self, other: &Self) -> bool {
        let distance = (self.at[0] - other.at[0]).hypot(self.at[1] - other.at[1]);
        distance < SAME[0] && wrapped(self.turn - other.turn).abs() < SAME[1]
    }

    fn parameters(&self) -> [f64; 4] {
        [self.turn, self.log_scale, self.at[0], self.at[1]]
    }
}

/// Search for the place of one group.
struct PlanSearch<'a> {
    plan: &'a PlanObstacles,
    rays: Vec<GroupRay>,
    /// Origin of the rays in the frame of the group.
    origin: [f64; 2],
    /// Direction of the floor edges modulo 90 degrees, in the frame of the group.
    direction: Option<f64>,
    /// Standard deviation of the log scale.
    scale_sigma: f64,
    /// Standard deviations of rotation (radians) and position (metres), if the given pose is approximately known in the
    /// frame of the plan.
    pose_sigmas: Option<[f64; 2]>,
    /// Standard deviation of the ends of the rays due to the relative poses of the group, in metres.
    relative_sigma_m: f64,
}

/// Searches for the pose of a group of cameras on the plan. `scale_sigma` is the standard deviation of the log of their
/// heights. `progress` receives the completed fraction, 0 to 1, and returns `false` to cancel. Returns `None` if it was
/// cancelled.
pub(crate) fn locate(
    plan: &PlanObstacles,
    cameras: &[ScannedCamera],
    scale_sigma: f64,
    progress: &mut dyn FnMut(f64) -> bool,
) -> Option<PlanPose> {
    let search = PlanSearch::new(plan, cameras, scale_sigma);
    if search.rays.iter().filter(|ray| ray.is_blocked).count() < MIN_BLOCKED {
        return Some(PlanPose::NotFound);
    }
    let mut refined: Vec<(Pose, Vec<Camera>)> = Vec::new();
    for start in search.coarse_maxima(progress)? {
        let (pose, placed) = search.place_cameras(cameras, search.refine(start));
        match refined.iter_mut().find(|(other, _)| other.is_same(&pose)) {
            Some((other, cameras)) if other.score < pose.score => (*other, *cameras) = (pose, placed),
            Some(_) => {}
            None => refined.push((pose, placed)),
        }
    }
    let Some(best) = refined.iter().max_by(|a, b| a.0.score.total_cmp(&b.0.score)) else {
        return Some(PlanPose::NotFound);
    };
    let score = best.0.score;
    let probability = 1.0 / refined.iter().map(|(pose, _)| (pose.score - score).exp()).sum::<f64>();
    Some(match () {
        () if score < MIN_SCORE => PlanPose::NotFound,
        () if probability < MIN_PROBABILITY => PlanPose::Ambiguous,
        () => PlanPose::Found(best.1.clone()),
    })
}

/// Returns the camera after a similarity of the floor.
pub(crate) fn moved(camera: &Camera, by: &Placement) -> Camera {
    let position = by.map_point(camera.position.on_floor()).at_height(by.scale * camera.position.z);
    Camera { position, yaw: wrapped(camera.yaw + by.turn), ..*camera }
}

impl<'a> PlanSearch<'a> {
    fn new(plan: &'a PlanObstacles, cameras: &[ScannedCamera], scale_sigma: f64) -> Self {
        let ray = |camera: &Camera, ray: &FloorRay| {
            let height = camera.position.z;
            GroupRay {
                from: [camera.position.x, camera.position.y],
                heading: ray.heading + camera.yaw,
                start: ray.start * height,
                end: ray.end * height,
                is_blocked: ray.is_blocked,
                span: SPAN * height,
            }
        };
        let mut rays: Vec<GroupRay> =
            cameras.iter().flat_map(|one| one.scan.rays.iter().map(|own| ray(one.camera, own))).collect();
        let mut origin = [0.0; 2];
        for ray in &rays {
            let middle = 0.5 * (ray.start + ray.end);
            let at = [ray.from[0] - middle * ray.heading.sin(), ray.from[1] + middle * ray.heading.cos()];
            (0..2).for_each(|i| origin[i] += at[i] / rays.len() as f64);
        }
        rays.iter_mut().for_each(|ray| (0..2).for_each(|i| ray.from[i] -= origin[i]));
        let directions: Vec<f64> =
            cameras.iter().filter_map(|one| Some(one.scan.edge_direction? + one.camera.yaw)).collect();
        // Mean modulo a quarter turn.
        let [sin, cos] =
            [f64::sin, f64::cos].map(|of| directions.iter().map(|angle| of(4.0 * angle)).sum::<f64>());
        let direction = (!directions.is_empty()).then(|| sin.atan2(cos) / 4.0);
        let relative_sigma_m = if cameras.len() > 1 { RELATIVE_SIGMA_M } else { 0.0 };
        Self { plan, rays, origin, direction, scale_sigma, pose_sigmas: None, relative_sigma_m }
    }

    /// Returns the cameras of a group at a pose, each refined near its pose in the group. The new score of the pose is
    /// the sum of the scores of the cameras, minus the cost of the pose under its prior.
    fn place_cameras(&self, cameras: &[ScannedCamera], pose: Pose) -> (Pose, Vec<Camera>) {
        /// Standard deviation of the log of the heights within a group.
        const HEIGHT_SIGMA: f64 = 0.05;
        /// Standard deviations of the yaw (radians) and the position (metres) within a group.
        const POSE_SIGMAS: [f64; 2] = [0.02, 0.25];
        let frame = self.placement(&pose);
        let on_plan: Vec<Camera> = cameras.iter().map(|one| moved(one.camera, &frame)).collect();
        if cameras.len() < 2 {
            return (pose, on_plan);
        }
        let mut score = -self.prior(pose.parameters());
        let refined = on_plan.iter().zip(cameras).map(|(camera, ScannedCamera { scan, .. })| {
            let alone = Self::new(self.plan, &[ScannedCamera { camera, scan }], HEIGHT_SIGMA);
            let search = Self { pose_sigmas: Some(POSE_SIGMAS), ..alone };
            let start = Pose { score: 0.0, turn: 0.0, log_scale: 0.0, at: search.origin };
            let best = search.refine(start);
            score += best.score;
            moved(camera, &search.placement(&best))
        });
        let refined = refined.collect();
        (Pose { score, ..pose }, refined)
    }

    /// Returns the rotations that are tried.
    fn turns(&self) -> Vec<f64> {
        /// Number of rotations without a known direction.
        const COUNT: usize = 72;
        match self.direction.zip(self.plan.direction) {
            Some((own, plan)) => (0..4).map(|quarter| plan - own + f64::from(quarter) * FRAC_PI_2).collect(),
            None => (0..COUNT).map(|index| index as f64 * 2.0 * PI / COUNT as f64).collect(),
        }
    }

    /// Returns the logs of the scales that are tried.
    fn log_scales(&self) -> Vec<f64> {
        /// Distance between two log scales.
        const STEP: f64 = 0.06;
        let count = (MAX_SCALE_DEVIATION * self.scale_sigma / STEP).floor() as i32;
        (-count..=count).map(|index| f64::from(index) * STEP).collect()
    }

    /// Returns the best poses on a grid, without poses that are close to a better one; `None` if the search was
    /// cancelled.
    fn coarse_maxima(&self, progress: &mut dyn FnMut(f64) -> bool) -> Option<Vec<Pose>> {
        /// Number of rays in the coarse search.
        const RAYS: usize = 30;
        /// Smallest distance between two positions, in metres.
        const MIN_STEP_M: f64 = 0.3;
        /// Largest number of rays that are predicted for all poses together. It limits the number of positions.
        const MAX_WORK: f64 = 6e7;
        /// Number of the best positions that are compared further, for each rotation and scale.
        const KEPT: usize = 25;
        let (turns, scales) = (self.turns(), self.log_scales());
        let stride = self.rays.len().div_ceil(RAYS).max(1);
        let rays: Vec<&GroupRay> = self.rays.iter().step_by(stride).collect();
        let [width, height] = self.plan.extent();
        let work = width * height * (turns.len() * scales.len() * rays.len()) as f64;
        let step = MIN_STEP_M.max((work / MAX_WORK).sqrt());
        let [columns, rows] = [width, height].map(|side| (side / step).ceil() as usize);
        let positions: Vec<[f64; 2]> = (0..columns * rows)
            .map(|index| {
                [(index % columns) as f64 + 0.5, -((index / columns) as f64 + 0.5)].map(|at| at * step)
            })
            .collect();
        let mut kept: Vec<Pose> = Vec::new();
        let total = (turns.len() * scales.len()) as f64;
        let pairs = turns.iter().flat_map(|&turn| scales.iter().map(move |&scale| (turn, scale)));
        for (index, (turn, log_scale)) in pairs.enumerate() {
            let score = |&at: &[f64; 2]| {
                let score =
                    stride as f64 * self.rays_score(rays.iter().copied(), [turn, log_scale, at[0], at[1]]);
                Pose { score: score - self.prior([turn, log_scale, at[0], at[1]]), turn, log_scale, at }
            };
            let mut poses: Vec<Pose> = positions.iter().map(score).collect();
            poses.sort_by(|a, b| b.score.total_cmp(&a.score));
            kept.extend(poses.into_iter().take(KEPT));
            progress((index + 1) as f64 / total).then_some(())?;
        }
        kept.sort_by(|a, b| b.score.total_cmp(&a.score));
        let mut maxima: Vec<Pose> = Vec::new();
        for pose in kept {
            if maxima.len() < REFINED && maxima.iter().all(|other| !other.is_same(&pose)) {
                maxima.push(pose);
            }
        }
        Some(maxima)
    }

    /// Maximises the score from a start pose.
    fn refine(&self, start: Pose) -> Pose {
        /// First steps of rotation, log scale and position.
        const STEPS: [f64; 4] = [0.04, 0.05, 0.15, 0.15];
        const SEARCH: PatternSearch = PatternSearch { rounds: 6, sweeps: 12, repeats_moves: true };
        let score =
            |parameters: [f64; 4]| self.rays_score(self.rays.iter(), parameters) - self.prior(parameters);
        let (score, [turn, log_scale, x, y]) = SEARCH.maximise(score, start.parameters(), STEPS);
        Pose { score, turn, log_scale, at: [x, y] }
    }

    /// Returns the cost of the parameters under their prior; infinite for implausible heights.
    fn prior(&self, [turn, log_scale, x, y]: [f64; 4]) -> f64 {
        if log_scale.abs() > MAX_SCALE_DEVIATION * self.scale_sigma {
            return f64::INFINITY;
        }
        let of_scale = 0.5 * (log_scale / self.scale_sigma).powi(2);
        self.pose_sigmas.map_or(of_scale, |[turn_sigma, sigma_m]| {
            let [dx, dy] = [x - self.origin[0], y - self.origin[1]];
            of_scale + 0.5 * (turn / turn_sigma).powi(2) + 0.5 * (dx.hypot(dy) / sigma_m).powi(2)
        })
    }

    /// Returns the sum of the scores of rays, divided by the number of rays that share their errors.
    fn rays_score<'r>(
        &self,
        rays: impl Iterator<Item = &'r GroupRay>,
        [turn, log_scale, x, y]: [f64; 4],
    ) -> f64 {
        /// Largest predicted distance beyond the measured end, in metres.
        const BEYOND_M: f64 = 6.0;
        let scale = log_scale.exp();
        let (sin, cos) = turn.sin_cos();
        let one = |ray: &GroupRay| {
            let [a, b] = ray.from;
            let from = [x + scale * (cos * a - sin * b), y + scale * (sin * a + cos * b)];
            let (along_sin, along_cos) = (ray.heading + turn).sin_cos();
            let along = [-along_sin, along_cos];
            let [start, end] = [ray.start, ray.end].map(|at| at * scale);
            let first = [from[0] + start * along[0], from[1] + start * along[1]];
            let predicted = start + self.plan.range(first, along, end - start + BEYOND_M);
            ray_score(end, predicted, (ray.is_blocked, scale * ray.span), self.relative_sigma_m)
        };
        rays.map(one).sum::<f64>() / SHARED_RAYS
    }

    /// Returns the similarity from the frame of the group to the frame of the plan.
    fn placement(&self, pose: &Pose) -> Placement {
        let turned = Placement { turn: pose.turn, scale: pose.log_scale.exp(), ..Placement::NONE };
        let origin = turned.map_point(FloorPoint::from(self.origin));
        Placement { by: FloorPoint::new(pose.at[0] - origin.x, pose.at[1] - origin.y), ..turned }
    }
}

/// Returns the log likelihood of the measured end of a ray, relative to uniform distances up to `span`. `is_blocked` is
/// whether an obstacle ends the ray. `added_sigma` is added to the standard deviation of a hit, in quadrature. All
/// lengths are in metres.
fn ray_score(measured: f64, predicted: f64, (is_blocked, span): (bool, f64), added_sigma: f64) -> f64 {
    /// Standard deviation of a hit: constant in metres, and relative to the distance.
    const HIT_SIGMA: [f64; 2] = [0.10, 0.04];
    /// Weights of a hit, an unexpected obstacle, ink that is no obstacle, and an arbitrary distance.
    const WEIGHTS: [f64; 4] = [0.6, 0.25, 0.1, 0.05];
    /// Mean distance beyond ink that is no obstacle, in metres.
    const BEYOND_M: f64 = 3.0;
    /// Likelihood ratios of a free ray whose predicted end is beyond the measured one, and before it.
    const FREE_RATIOS: [f64; 2] = [1.16, 0.52];
    let sigma = (HIT_SIGMA[0] + HIT_SIGMA[1] * measured).hypot(added_sigma);
    let excess = measured - predicted;
    if !is_blocked {
        return FREE_RATIOS[usize::from(excess > sigma)].ln();
    }
    let hit = (-0.5 * (excess / sigma).powi(2)).exp() / (sigma * (2.0 * PI).sqrt());
    let short = if excess < 0.0 { 1.0 / predicted.max(1.0) } else { 0.0 };
    let beyond = if excess >= 0.0 { (-excess / BEYOND_M).exp() / BEYOND_M } else { 0.0 };
    let terms = [hit, short, beyond, 1.0 / span];
    (span * WEIGHTS.iter().zip(terms).map(|(weight, term)| weight * term).sum::<f64>()).ln()
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use calib_core::{Covariance, Lens, Pixel, WorldPoint};
    use image::{Rgb, RgbImage};

    /// Returns a camera that looks down by 0.5 radians.
    pub(crate) fn camera(x: f64, y: f64, z: f64, yaw: f64) -> Camera {
        let lens = Lens::pinhole(Pixel::new(320.0, 240.0));
        let position = WorldPoint::new(x, y, z);
        Camera { position, yaw, pitch: 0.5, roll: 0.0, focal: 500.0, lens, covariance: Covariance::EXACT }
    }

    /// Draws a plan of 12 by 9 m at 0.025 m per pixel: a room with boxes (left, top, right, bottom, in metres).
    fn plan(boxes: &[[f64; 4]]) -> PlanObstacles {
        let is_ink = |x: f64, y: f64| {
            let is_wall = !(0.2..=11.8).contains(&x) || !(0.2..=8.8).contains(&y);
            is_wall || boxes.iter().any(|[x0, y0, x1, y1]| (*x0..*x1).contains(&x) && (*y0..*y1).contains(&y))
        };
        let image = RgbImage::from_fn(480, 360, |x, y| {
            let at = |i: u32| (f64::from(i) + 0.5) * 0.025;
            Rgb([if is_ink(at(x), at(y)) { 50 } else { 255 }; 3])
        });
        PlanObstacles::new(&image, 0.025).unwrap()
    }

    /// Returns the scan that the plan predicts for a camera.
    fn scan(plan: &PlanObstacles, camera: &Camera, direction: Option<f64>) -> FloorScan {
        let height = camera.position.z;
        let ray = |index: i32| {
            let heading = (1.5 * f64::from(index)).to_radians();
            let (sin, cos) = (heading + camera.yaw).sin_cos();
            let first = [camera.position.x - height * sin, camera.position.y + height * cos];
            let range = plan.range(first, [-sin, cos], 3.0 * height);
            FloorRay { heading, start: 1.0, end: 1.0 + range / height, is_blocked: range < 2.99 * height }
        };
        FloorScan { rays: (-25..=25).map(ray).collect(), edge_direction: direction }
    }

    const BOXES: [[f64; 4]; 4] =
        [[3.0, 2.0, 4.2, 2.6], [7.5, 1.5, 8.1, 4.0], [5.0, 5.5, 6.0, 7.2], [9.5, 6.0, 11.8, 6.8]];

    #[test]
    fn a_camera_is_found_with_an_unknown_height() {
        let plan = plan(&BOXES);
        let truth = camera(1.0, -8.0, 2.6, -0.6);
        // The camera is given at height 3, at the origin, and with yaw 0.
        let given = camera(0.0, 0.0, 3.0, 0.0);
        for direction in [Some(0.6), None] {
            let scan = scan(&plan, &truth, direction);
            let cameras = [ScannedCamera { camera: &given, scan: &scan }];
            let PlanPose::Found(found) = locate(&plan, &cameras, 0.2, &mut |_| true).unwrap() else {
                panic!("not found")
            };
            let off = found[0].position.on_floor().distance(FloorPoint::new(1.0, -8.0));
            // The prior of the height shifts the camera by less than its uncertainty.
            assert!(off < 0.4 && wrapped(found[0].yaw + 0.6).abs() < 0.02, "{found:?}");
            assert!((found[0].position.z - 2.6).abs() < 0.15, "{found:?}");
        }
        let scan = scan(&plan, &truth, None);
        assert_eq!(
            locate(&plan, &[ScannedCamera { camera: &given, scan: &scan }], 0.2, &mut |_| false),
            None
        );
    }

    #[test]
    fn a_room_with_two_equal_halves_is_ambiguous() {
        let plan = plan(&[[3.0, 4.0, 9.0, 5.0]]);
        let truth = camera(1.0, -8.0, 2.6, -0.6);
        let scan = scan(&plan, &truth, Some(0.6));
        let given = camera(0.0, 0.0, 2.6, 0.0);
        let found = locate(&plan, &[ScannedCamera { camera: &given, scan: &scan }], 0.2, &mut |_| true);
        assert_eq!(found, Some(PlanPose::Ambiguous));
    }

    #[test]
    fn a_scan_of_another_room_is_not_found() {
        let own = plan(&[[1.0, 1.0, 2.0, 5.0], [4.0, 3.0, 5.5, 4.0], [8.0, 5.0, 9.0, 8.8]]);
        let truth = camera(11.0, -8.0, 2.6, 0.7);
        let scan = scan(&own, &truth, Some(-0.7));
        let given = camera(0.0, 0.0, 2.6, 0.0);
        let found =
            locate(&plan(&BOXES), &[ScannedCamera { camera: &given, scan: &scan }], 0.2, &mut |_| true);
        assert!(!matches!(found, Some(PlanPose::Found(_))), "{found:?}");
    }

    #[test]
    fn a_group_is_found_by_all_its_cameras() {
        let plan = plan(&BOXES);
        let truths = [camera(1.0, -8.0, 2.6, -0.6), camera(11.0, -1.0, 3.1, 2.3)];
        let scans = truths.each_ref().map(|truth| scan(&plan, truth, None));
        // The group has the first camera at its origin with yaw 0, and a scale of 1.2. The second camera has errors.
        let (sin, cos) = 0.6_f64.sin_cos();
        let apart = [10.0 * 1.2, 7.0 * 1.2];
        let second = [cos * apart[0] - sin * apart[1] + 0.2, sin * apart[0] + cos * apart[1] - 0.15];
        let given = [camera(0.0, 0.0, 2.6 * 1.2, 0.0), camera(second[0], second[1], 3.2 * 1.2, 2.91)];
        let cameras = [0, 1].map(|i| ScannedCamera { camera: &given[i], scan: &scans[i] });
        let PlanPose::Found(found) = locate(&plan, &cameras, 0.2, &mut |_| true).unwrap() else {
            panic!("not found")
        };
        for (found, truth) in found.iter().zip(&truths) {
            let off = found.position.on_floor().distance(truth.position.on_floor());
            assert!(off < 0.3 && wrapped(found.yaw - truth.yaw).abs() < 0.03, "{found:?}");
            assert!((found.position.z / truth.position.z - 1.0).abs() < 0.04, "{found:?}");
        }
    }
}
