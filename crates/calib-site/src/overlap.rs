//! Overlaps: pairs of cameras that share landmarks or show the same floor, and their disagreement on the
//! floor.

use std::collections::{BTreeMap, BTreeSet};

use crate::bundle_step::BundleResult;
use crate::camera_result::CameraResult;
use crate::document::Site;
use crate::observations::LandmarkSource;
use crate::site_solution::Overlap;
use crate::solution::Stage;
use calib_core::bundle::floor_disagreements;
use calib_core::camera::{Camera, Covariance, FloorPoint};
use calib_core::floor::Extent;
use calib_core::outcome::Failure;

impl Site {
    /// Returns the pairs of cameras that share landmarks or floor, with their disagreement.
    pub(crate) fn overlaps(
        &self,
        bundle: &BundleResult,
        solutions: &[(usize, Result<CameraResult, Failure>)],
    ) -> Vec<Overlap> {
        let all = bundle.connected_cameras();
        let mut measured: BTreeMap<[usize; 2], (f64, f64)> = BTreeMap::new();
        let known = bundle
            .landmarks
            .iter()
            .filter(|(of, landmark)| !landmark.off && !matches!(of, LandmarkSource::ControlPoint { .. }));
        for (_, landmark) in known {
            let is_tied =
                |&view: &usize| bundle.cameras[view].as_ref().is_some_and(|joined| joined.is_connected);
            for (pair, square) in floor_disagreements(landmark, &all) {
                if !pair.iter().all(is_tied) {
                    continue;
                }
                let sum = measured.entry(pair).or_default();
                sum.0 += square;
                sum.1 += 1.0;
            }
        }
        let mut predicted = self.predicted_overlaps(bundle, solutions);
        let pairs: BTreeSet<[usize; 2]> = measured.keys().chain(predicted.keys()).copied().collect();
        pairs
            .into_iter()
            .map(|pair| Overlap {
                cameras: pair.map(|camera| self.cameras[camera].id.clone()),
                floor_rms_m: measured.get(&pair).map(|(sum, count)| (sum / count).sqrt()),
                floor_sigma_m: predicted.remove(&pair),
            })
            .collect()
    }

    /// Returns the predicted standard deviation of the disagreement, in metres, for pairs whose EFOVs
    /// overlap.
    fn predicted_overlaps(
        &self,
        bundle: &BundleResult,
        solutions: &[(usize, Result<CameraResult, Failure>)],
    ) -> BTreeMap<[usize; 2], f64> {
        struct FloorView {
            index: usize,
            camera: Camera,
            polygon: Vec<FloorPoint>,
            bounds: [f64; 4],
        }
        let seen = |(index, solution): &(usize, Result<CameraResult, Failure>)| {
            let solution = &solution.as_ref().ok().filter(|s| s.solution.stage > Stage::Partial)?.solution;
            let polygon = solution.efov_m.clone();
            let fold = |value: &dyn Fn(&FloorPoint) -> f64, pick: fn(f64, f64) -> f64, start: f64| {
                polygon.iter().map(value).fold(start, pick)
            };
            let bounds = [
                fold(&|p| p.x, f64::min, f64::INFINITY),
                fold(&|p| p.y, f64::min, f64::INFINITY),
                fold(&|p| p.x, f64::max, f64::NEG_INFINITY),
                fold(&|p| p.y, f64::max, f64::NEG_INFINITY),
            ];
            Some(FloorView { index: *index, camera: solution.camera()?, polygon, bounds })
        };
        /// Largest number of pairs that are evaluated. It bounds the time for a hostile site with many
        /// cameras at the same position.
        const MAX_PAIRS: usize = 20_000;
        let all: Vec<FloorView> = solutions.iter().filter_map(seen).collect();
        let mut found = BTreeMap::new();
        for (k, a) in all.iter().enumerate() {
            for b in &all[k + 1..] {
                if found.len() >= MAX_PAIRS {
                    return found;
                }
                let low = [a.bounds[0].max(b.bounds[0]), a.bounds[1].max(b.bounds[1])];
                let high = [a.bounds[2].min(b.bounds[2]), a.bounds[3].min(b.bounds[3])];
                if low[0] >= high[0] || low[1] >= high[1] {
                    continue;
                }
                let common = common_points(low, high, &a.polygon, &b.polygon);
                let cross_covariance = bundle.pairs.get(&[a.index, b.index]).map(|block| &**block);
                let variances: Vec<f64> = common
                    .iter()
                    .filter_map(|&at| disagreement_variance(at, &a.camera, &b.camera, cross_covariance))
                    .collect();
                if !variances.is_empty() {
                    let mean = variances.iter().sum::<f64>() / variances.len() as f64;
                    found.insert([a.index, b.index], mean.max(0.0).sqrt());
                }
            }
        }
        found
    }
}

/// Returns the points of a grid over a box (metres) that are inside both polygons.
fn common_points(low: [f64; 2], high: [f64; 2], a: &[FloorPoint], b: &[FloorPoint]) -> Vec<FloorPoint> {
    /// Number of grid points along each side of the box.
    const GRID_SIDE_POINTS: usize = 4;
    let share = |i: usize| (i as f64 + 0.5) / GRID_SIDE_POINTS as f64;
    let grid = (0..GRID_SIDE_POINTS * GRID_SIDE_POINTS).map(|k| FloorPoint {
        x: low[0] + share(k % GRID_SIDE_POINTS) * (high[0] - low[0]),
        y: low[1] + share(k / GRID_SIDE_POINTS) * (high[1] - low[1]),
    });
    let [a, b] = [a, b].map(|efov| Extent { size: [0.0; 2], efov });
    grid.filter(|&at| a.contains(at) && b.contains(at)).collect()
}

/// Returns the predicted variance, in square metres, of the distance between the floor positions of one point
/// as computed from two cameras. The variance is the trace of
/// `Ja Caa Ja' + Jb Cbb Jb' - Ja Cab Jb' - Jb Cab' Ja'`. `J` is the Jacobian of the floor point with respect
/// to a camera's parameters, `C` is the covariance of these parameters. A prime marks the transpose.
fn disagreement_variance(
    at: FloorPoint,
    a: &Camera,
    b: &Camera,
    cross_covariance: Option<&[[f64; Covariance::SIZE]; Covariance::SIZE]>,
) -> Option<f64> {
    let jacobian = |camera: &Camera| camera.floor_jacobian(camera.world_to_pixel(at.at_height(0.0))?);
    let (ja, jb) = (jacobian(a)?, jacobian(b)?);
    let own = |camera: &Camera, jacobian| {
        let [[xx, _], [_, yy]] = camera.covariance.propagate(jacobian)?;
        Some(xx + yy)
    };
    let mut common = 0.0;
    if let Some(cross_covariance) = cross_covariance {
        for (i, row) in cross_covariance.iter().enumerate() {
            for (j, value) in row.iter().enumerate() {
                common += value * (ja[i][0] * jb[j][0] + ja[i][1] * jb[j][1]);
            }
        }
    }
    Some(own(a, &ja)? + own(b, &jb)? - 2.0 * common)
}
