//! Hand-over zones: floor that two cameras see, where a tracker passes a target from one camera to the other.
//!
//! Each camera computes the position of the target from its own pixel. The errors of the cameras differ, so the two
//! positions disagree. With the derivatives `g_a`, `g_b` of one coordinate with respect to the parameters of the cameras
//! a and b, and the covariances `C_aa`, `C_bb`, `C_ab` of these parameters, the variance of the difference is
//!
//! `g_a' C_aa g_a + g_b' C_bb g_b - 2 g_a' C_ab g_b`.
//!
//! The expected disagreement at a point is the square root of the sum of the variances for x and y (RMS of the
//! distance). It does not contain the errors of the detector.

use std::ops::Range;

use crate::camera::{Covariance, FloorPoint};
use crate::floor::coverage::{Coverage, CoverageCamera, FloorGrid};
use crate::floor::pixel_density::covariance_product;
use crate::floor::ruler::CameraCovariance;

/// Floor that two cameras see.
#[derive(Clone, Debug, PartialEq)]
pub struct HandOver {
    /// Indices of the cameras, in ascending order.
    pub cameras: [usize; 2],
    /// Number of grid points that both cameras see.
    pub points: usize,
    /// Point of the zone that is nearest to its centroid.
    pub middle: FloorPoint,
    /// Expected disagreement of the cameras, or the reason why it is unknown.
    pub disagreement: Result<Disagreement, UnknownDisagreement>,
}

/// Expected distance between the positions that two cameras compute for one target, in metres. It contains the
/// errors of the calibration, but not the errors of the detector.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Disagreement {
    /// RMS distance over a sample of points of the zone, in metres.
    pub rms: f64,
    /// Largest RMS distance at a single point, in metres. The tested points are the sample, and the points of
    /// the zone that are farthest in eight directions.
    pub worst: f64,
    /// Floor point with the largest expected disagreement.
    pub worst_at: FloorPoint,
}

/// Reason why a disagreement is unknown.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum UnknownDisagreement {
    /// The position or the yaw of the camera with this index was set by hand, so its uncertainty is unknown.
    PlacedByHand(usize),
    /// Another uncertainty of the camera with this index is unknown.
    Camera(usize),
    /// The correlation of the two cameras is unknown.
    Correlation,
}

/// Visible points of a zone, as runs of grid indices.
struct Zone {
    runs: Vec<Range<usize>>,
    points: usize,
}

impl Zone {
    /// Returns the points that are in both of two sorted lists of runs.
    fn new(a: &[Range<usize>], b: &[Range<usize>]) -> Self {
        let mut runs = Vec::new();
        let (mut i, mut j) = (0, 0);
        while let (Some(x), Some(y)) = (a.get(i), b.get(j)) {
            let run = x.start.max(y.start)..x.end.min(y.end);
            if !run.is_empty() {
                runs.push(run);
            }
            if x.end < y.end { i += 1 } else { j += 1 }
        }
        let points = runs.iter().map(ExactSizeIterator::len).sum();
        Self { runs, points }
    }

    /// Returns the grid index of the point with this number within the zone.
    fn point(&self, mut number: usize) -> Option<usize> {
        for run in &self.runs {
            match run.len() {
                length if number < length => return Some(run.start + number),
                length => number -= length,
            }
        }
        None
    }

    /// Returns the grid indices of at most `most` points, evenly spread over the zone. The positions in the list of
    /// all points are multiples of the golden ratio, modulo one. A constant distance in the list could select points
    /// in only a few columns of the grid.
    fn sample(&self, most: usize) -> Vec<usize> {
        const GOLDEN_RATIO: f64 = 0.618_033_988_749_894_9;
        if self.points <= most {
            return self.runs.iter().cloned().flatten().collect();
        }
        let number = |k: usize| ((k as f64 + 0.5) * GOLDEN_RATIO).fract() * self.points as f64;
        (0..most.max(1)).filter_map(|k| self.point(number(k) as usize)).collect()
    }

    /// Returns the points that are farthest in eight directions. The disagreement is usually largest at one of them.
    fn extremes(&self, grid: &FloorGrid) -> Vec<FloorPoint> {
        let ends = self.runs.iter().flat_map(|run| [run.start, run.end - 1]).map(|index| grid.point(index));
        let ends: Vec<FloorPoint> = ends.collect();
        let directions = [[1.0, 0.0], [1.0, 1.0], [0.0, 1.0], [-1.0, 1.0]];
        let both = directions.into_iter().flat_map(|[x, y]| [[x, y], [-x, -y]]);
        both.filter_map(|[x, y]| {
            let along = |at: &FloorPoint| x * at.x + y * at.y;
            ends.iter().copied().max_by(|a, b| along(a).total_cmp(&along(b)))
        })
        .collect()
    }

    /// Returns the point that is nearest to the centroid of the zone; `None` without points.
    fn middle(&self, grid: &FloorGrid) -> Option<FloorPoint> {
        let ends = |run: &Range<usize>| [grid.point(run.start), grid.point(run.end - 1)];
        let mut sum = [0.0; 2];
        for run in &self.runs {
            let [first, last] = ends(run);
            sum[0] += run.len() as f64 * 0.5 * (first.x + last.x);
            sum[1] += run.len() as f64 * first.y;
        }
        let [x, y] = sum.map(|sum| sum / self.points as f64);
        let nearest = |run: &Range<usize>| {
            let column = ((x - grid.point(run.start).x) / grid.step).round().max(0.0) as usize;
            grid.point(run.start + column.min(run.len() - 1))
        };
        let centroid = FloorPoint { x, y };
        let nearest = self.runs.iter().map(nearest);
        nearest.min_by(|a, b| a.distance(centroid).total_cmp(&b.distance(centroid)))
    }
}

impl Coverage {
    /// Returns the hand-over zones of all pairs of cameras, the largest first. `cameras`, `grid` and `height` (in metres)
    /// must be the arguments with which the coverage was computed; see [`Self::new`].
    ///
    /// The disagreement is computed at `points_per_zone` points of each zone, at least one. `covariance_between` returns
    /// the covariance between the parameters of two different cameras; `None` if it is unknown.
    #[must_use]
    pub fn hand_overs(
        &self,
        cameras: &[CoverageCamera<'_>],
        grid: &FloorGrid,
        height: f64,
        points_per_zone: usize,
        covariance_between: &dyn Fn(usize, usize) -> Option<CameraCovariance>,
    ) -> Vec<HandOver> {
        let mut zones = Vec::new();
        for (a, of_a) in self.visible.iter().enumerate() {
            for (b, of_b) in self.visible.iter().enumerate().skip(a + 1) {
                let zone = Zone::new(of_a, of_b);
                let Some(middle) = zone.middle(grid) else { continue };
                let sample = zone.sample(points_per_zone).into_iter().map(|index| grid.point(index));
                let sample: Vec<FloorPoint> = sample.collect();
                let pair = [cameras[a], cameras[b]];
                let disagreement = match [a, b].into_iter().zip(pair).find_map(unknown_error) {
                    Some(why) => Err(why),
                    None => covariance_between(a, b)
                        .and_then(|between| {
                            disagreement(pair, &between, (&sample, &zone.extremes(grid)), height)
                        })
                        .ok_or(UnknownDisagreement::Correlation),
                };
                zones.push(HandOver { cameras: [a, b], points: zone.points, middle, disagreement });
            }
        }
        zones.sort_by_key(|zone| std::cmp::Reverse(zone.points));
        zones
    }
}

/// Returns the reason why the uncertainty of a camera is unknown; `None` if it is known.
fn unknown_error((index, of): (usize, CoverageCamera<'_>)) -> Option<UnknownDisagreement> {
    let covariance = &of.camera.covariance;
    if covariance.is_known() {
        return None;
    }
    let is_placement = |k: usize| [Covariance::X, Covariance::Y, Covariance::YAW].contains(&k);
    let is_unknown = |k: &usize| !covariance.0[*k][*k].is_finite();
    Some(if (0..Covariance::SIZE).filter(is_unknown).all(is_placement) {
        UnknownDisagreement::PlacedByHand(index)
    } else {
        UnknownDisagreement::Camera(index)
    })
}

/// Computes the disagreement over a sample of floor points. The worst point can also be one of the `extremes`. Returns
/// `None` without points.
fn disagreement(
    pair: [CoverageCamera<'_>; 2],
    between: &CameraCovariance,
    (sample, extremes): (&[FloorPoint], &[FloorPoint]),
    height: f64,
) -> Option<Disagreement> {
    let (mut sum, mut count) = (0.0, 0_usize);
    let mut worst: Option<(f64, FloorPoint)> = None;
    for (index, &place) in sample.iter().chain(extremes).enumerate() {
        let Some(variance) = variance_at(pair, between, place, height) else { continue };
        if index < sample.len() {
            (sum, count) = (sum + variance, count + 1);
        }
        if worst.is_none_or(|(most, _)| variance > most) {
            worst = Some((variance, place));
        }
    }
    let (most, worst_at) = worst?;
    let rms = (sum / count.max(1) as f64).sqrt();
    Some(Disagreement { rms, worst: most.sqrt(), worst_at })
}

/// Returns the expected squared distance between the two positions of a target, in square metres. Returns `None` if a
/// camera does not show the target.
fn variance_at(
    pair: [CoverageCamera<'_>; 2],
    between: &CameraCovariance,
    place: FloorPoint,
    height: f64,
) -> Option<f64> {
    let [a, b] = pair.map(|of| {
        let pixel = of.camera.world_to_pixel(place.at_height(height))?;
        of.camera.plane_jacobian(pixel, height)
    });
    let (a, b) = (a?, b?);
    let [of_a, of_b] = pair.map(|of| &of.camera.covariance.0);
    let on_axis = |axis: usize| {
        let [a, b] = [a.map(|by| by[axis]), b.map(|by| by[axis])];
        covariance_product(&a, of_a, &a) + covariance_product(&b, of_b, &b)
            - 2.0 * covariance_product(&a, between, &b)
    };
    Some((on_axis(0) + on_axis(1)).max(0.0))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::{Camera, any_camera};
    use crate::floor::{Extent, Ruler, RulerPoint, default_efov};
    use proptest::prelude::*;
    use proptest::strategy::ValueTree as _;

    const SIZE: [f64; 2] = [1920.0, 1080.0];

    fn grid() -> FloorGrid {
        FloorGrid { origin: FloorPoint { x: -8.0, y: -4.0 }, step: 0.5, columns: 33, rows: 33 }
    }

    /// Standard deviations of position, yaw, pitch, roll and focal length, in metres, radians and pixels.
    const SIGMAS: [f64; 7] = [0.1, 0.07, 0.05, 0.01, 0.004, 0.006, 9.0];

    /// Returns the camera with correlated errors.
    fn with_errors(camera: Camera) -> Camera {
        let mut covariance = Covariance::EXACT;
        for (i, a) in SIGMAS.iter().enumerate() {
            for (j, b) in SIGMAS.iter().enumerate() {
                covariance.0[i][j] = a * b * if i == j { 1.0 } else { 0.1 };
            }
        }
        Camera { covariance, ..camera }
    }

    /// Returns the covariance between two cameras: `share` times the covariance of the first camera.
    fn common(camera: &Camera, share: f64) -> CameraCovariance {
        camera.covariance.0.map(|row| row.map(|value| share * value))
    }

    proptest! {
        #[test]
        fn zones_contain_the_points_that_both_cameras_see_and_agree_with_the_ruler(
            first in any_camera(), second in any_camera(), height in 0.0..2.0_f64, share in -0.5..0.5_f64,
        ) {
            let cameras = [first, second].map(with_errors);
            let efovs = cameras.each_ref().map(|camera| default_efov(camera, SIZE).polygon);
            let of: Vec<CoverageCamera<'_>> = cameras
                .iter()
                .zip(&efovs)
                .map(|(camera, efov)| CoverageCamera { camera, extent: Extent { size: SIZE, efov } })
                .collect();
            let between = |_: usize, _: usize| Some(common(&cameras[0], share));
            let coverage = Coverage::new(&of, &[], &grid(), height);
            let both = coverage.seen_by.iter().filter(|&&count| count == 2).count();
            let zones = coverage.hand_overs(&of, &grid(), height, usize::MAX, &between);
            prop_assert_eq!(zones.iter().map(|zone| zone.points).sum::<usize>(), both);
            let Some(zone) = zones.first() else { return Ok(()) };
            let found = zone.disagreement.unwrap();
            prop_assert!(found.rms > 0.0);
            prop_assert!(found.rms <= found.worst * (1.0 + 1e-12));
            // The ruler differentiates the positions numerically.
            let point = |camera: usize| {
                let pixel = cameras[camera].world_to_pixel(found.worst_at.at_height(height)).unwrap();
                RulerPoint { camera, pixel, height, sigma: 0.0 }
            };
            let ruler = Ruler { cameras: &cameras, covariance_between: &between };
            let (_, c) = ruler.positions(&[point(0), point(1)]).unwrap();
            let variance = c[(0, 0)] + c[(1, 1)] + c[(2, 2)] + c[(3, 3)] - 2.0 * (c[(0, 2)] + c[(1, 3)]);
            let expected = variance.max(0.0).sqrt();
            prop_assert!((found.worst - expected).abs() < 1e-3 * (1e-3 + c.diagonal().sum().sqrt()), "{} {expected}", found.worst);
        }
    }

    #[test]
    fn equal_errors_of_two_cameras_cancel_and_unknown_errors_are_reported() {
        let mut runner = proptest::test_runner::TestRunner::deterministic();
        let camera = loop {
            let camera = with_errors(any_camera().new_tree(&mut runner).unwrap().current());
            if default_efov(&camera, SIZE).polygon.len() > 2 {
                break camera;
            }
        };
        let efov = default_efov(&camera, SIZE).polygon;
        let of = |camera| CoverageCamera { camera, extent: Extent { size: SIZE, efov: &efov } };
        let low = efov.iter().fold([f64::INFINITY; 2], |low, at| [low[0].min(at.x), low[1].min(at.y)]);
        let origin = FloorPoint { x: low[0], y: low[1] };
        let grid = FloorGrid { origin, step: 0.25, columns: 80, rows: 80 };
        let zones = |pair: &[CoverageCamera<'_>], share: Option<f64>| {
            let between = |_: usize, _: usize| share.map(|share| common(&camera, share));
            let zones = Coverage::new(pair, &[], &grid, 0.0).hand_overs(pair, &grid, 0.0, 50, &between);
            zones[0].disagreement
        };
        let twins = [of(&camera), of(&camera)];
        let independent = zones(&twins, Some(0.0)).unwrap();
        assert!(independent.rms > 0.0);
        assert!(zones(&twins, Some(1.0)).unwrap().worst < 1e-6 * independent.worst);
        assert_eq!(zones(&twins, None), Err(UnknownDisagreement::Correlation));
        let mut by_hand = camera;
        by_hand.covariance.0[Covariance::X][Covariance::X] = f64::INFINITY;
        assert_eq!(zones(&[of(&camera), of(&by_hand)], Some(0.0)), Err(UnknownDisagreement::PlacedByHand(1)));
        let unknown = Camera { covariance: Covariance::UNKNOWN, ..camera };
        assert_eq!(zones(&[of(&unknown), of(&camera)], Some(0.0)), Err(UnknownDisagreement::Camera(0)));
    }
}
