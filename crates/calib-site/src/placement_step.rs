//! Stage 2 of one camera: placement by control points or by the operator, with its uncertainty.

use std::collections::BTreeSet;

use crate::camera_result::CameraResult;
use crate::document::{ControlPointEntry, HeldEntry, Site, SiteCamera};
use crate::solution::{Solution, Stage};
use calib_core::camera::{Camera, Covariance, WorldPoint};
use calib_core::floor::{ControlPoint, from_control_points, with_placement_covariance};
use calib_core::outcome::{Code, Finding, Residual, ResidualOf};
use calib_core::single::{BESIDE, floor_finding, grid, placed_floor_length_rel, placed_floor_shape_rel};

/// Relative standard deviation of a height by placement: of dragging and scaling a polygon over a plan.
const HAND: f64 = 0.02;

impl Site {
    /// By control points, by the operator's move, turn and scale, or not at all.
    pub(crate) fn place(
        &self,
        entry: &SiteCamera,
        first: Camera,
        findings: &mut Vec<Finding>,
    ) -> (Camera, Stage) {
        let fixed = entry.placement.as_ref().is_some_and(|placement| placement.fixed);
        let points = entry.control_points.iter().filter(|point| !point.off);
        let points = each_once(points.filter_map(|point| point.control_point(self.plan.as_ref())).collect());
        let fixed_height = entry.height_m.filter(|height| height.fixed).map(|height| height.value);
        if !fixed && let Some(placed) = from_control_points(&first, &points, fixed_height) {
            scale_conflict(&first, placed.position.z, fixed_height.is_some(), findings);
            let sigma = entry.sigma_px.unwrap_or(1.0);
            return (with_placement_covariance(&placed, &points, sigma), Stage::Placed);
        }
        if !fixed && !points.is_empty() {
            findings.push(Finding::TooFewControlPoints { count: points.len() });
        }
        let scale = entry.placement.as_ref().and_then(|placement| placement.scale);
        // Where lines contradict each other nothing is known of any error, that of a height that is given included.
        let height_is_known = entry.height_m.is_some()
            || first.covariance.sigma(Covariance::Z).is_some()
            || !first.covariance.is_known();
        if scale.is_none() && !height_is_known && !fixed {
            findings.push(Finding::ScaleAssumed { height: first.position.z });
        }
        match &entry.placement {
            Some(placement) => {
                let by_hand = placement.placement().apply(&first);
                if placement.scale.is_none() && !fixed {
                    let position = WorldPoint { z: first.position.z, ..by_hand.position };
                    return (Camera { position, ..by_hand }, Stage::Placed);
                }
                (join_heights(&first, by_hand, placement.fixed, fixed_height, findings), Stage::Placed)
            }
            None => (first, Stage::Partial),
        }
    }

    /// Whether a hand says where a camera at this stage stands, and nothing tells how well. A hand that placed the
    /// only camera of a site, with no plan and no known place, made the site's coordinates: there is nothing that it
    /// could be off from.
    pub(crate) fn is_placed_by_hand(&self, entry: &SiteCamera, camera: &Camera, stage: Stage) -> bool {
        let is_by_hand = entry.placement.as_ref().is_some_and(|placement| !placement.fixed);
        // Where lines contradict each other nothing is known of any number, wherever the place came from.
        let is_by_points =
            entry.control_points.iter().any(|point| !point.off) && !camera.covariance.is_known();
        is_by_hand
            && !is_by_points
            && stage == Stage::Placed
            && !entry.open_place(camera).is_empty()
            && self.is_measured_beside(entry)
    }

    /// Whether the site has coordinates that a camera did not make itself: by its plan, a known place, or another camera
    /// that stands in it.
    #[must_use]
    pub fn is_measured_beside(&self, entry: &SiteCamera) -> bool {
        let stands = |other: &SiteCamera| {
            other.placement.is_some() || !other.control_points.is_empty() || other.is_given()
        };
        self.plan.is_some()
            || self.georeference().is_some()
            || self.marks.iter().any(|mark| mark.fixed && !mark.off)
            || self.cameras.iter().any(|other| other.id != entry.id && stands(other))
    }

    pub(crate) fn add_control_residuals(
        &self,
        entry: &SiteCamera,
        camera: &Camera,
        result: &mut CameraResult,
    ) {
        let mut hidden = Vec::new();
        for (index, point) in entry.control_points.iter().enumerate() {
            let shown = point.control_point(self.plan.as_ref()).and_then(|p| camera.world_to_pixel(p.world));
            let Some(shown) = shown.filter(|shown| shown.is_finite()) else {
                if !point.off {
                    hidden.push(index);
                }
                continue;
            };
            result.solution.residuals.push(Residual {
                of: ResidualOf::ControlPoint,
                annotation: None,
                segment: None,
                id: Some(point.label(index)),
                px: shown.distance(point.px),
                outlier: false,
            });
        }
        if !hidden.is_empty() && result.solution.stage > Stage::Partial {
            result.findings.push(Finding::HiddenControlPoints { points: hidden });
        }
        let far = far_off(entry, &result.solution);
        result.findings.extend(far);
    }
}

impl SiteCamera {
    /// Which of x, y and yaw, by their index in [`Covariance`], are neither held nor estimated.
    pub(crate) fn open_place(&self, camera: &Camera) -> Vec<usize> {
        let held = self.placement.as_ref().map_or_else(HeldEntry::default, |placement| placement.held);
        let place = [(Covariance::X, held.x), (Covariance::Y, held.y), (Covariance::YAW, held.turn)];
        let is_open = |&(index, held): &(usize, bool)| !held && camera.covariance.sigma(index).is_none();
        place.into_iter().filter(is_open).map(|(index, _)| index).collect()
    }
}

/// Control points without those that show again what another one shows, beside the same pixel.
fn each_once(mut points: Vec<ControlPoint>) -> Vec<ControlPoint> {
    /// In metres: what is nearer is one point.
    const SAME: f64 = 0.01;
    points.sort_by(|a, b| a.pixel.u.total_cmp(&b.pixel.u));
    let mut once: Vec<ControlPoint> = Vec::new();
    for point in points {
        let mut near = once.iter().rev().take_while(|known| point.pixel.u - known.pixel.u <= BESIDE);
        let is_known = |known: &ControlPoint| {
            known.pixel.distance(point.pixel) <= BESIDE && known.world.distance(point.world) <= SAME
        };
        if !near.any(is_known) {
            once.push(point);
        }
    }
    once
}

/// Control points that are farther from their pixels than drawing explains.
fn far_off(entry: &SiteCamera, solution: &Solution) -> Option<Finding> {
    /// Root mean square, in sigmas; pitch and focal carry some of their own error into it.
    const MOST: f64 = 8.0;
    let used = entry.control_points.iter().enumerate().filter(|(_, point)| !point.off);
    let on: BTreeSet<String> = used.map(|(index, point)| point.label(index)).collect();
    let used =
        |r: &&Residual| r.of == ResidualOf::ControlPoint && r.id.as_ref().is_some_and(|id| on.contains(id));
    let points: Vec<&Residual> = solution.residuals.iter().filter(used).collect();
    let rms = (points.iter().map(|r| r.px * r.px).sum::<f64>() / points.len().max(1) as f64).sqrt();
    let worst = points.iter().max_by(|a, b| a.px.total_cmp(&b.px));
    let worst =
        worst.filter(|_| rms > MOST * entry.sigma_px.unwrap_or(1.0) && solution.stage == Stage::Placed)?;
    let is_worst = |(index, point): (usize, &ControlPointEntry)| worst.id == Some(point.label(index));
    Some(Finding::FarControlPoints {
        rms_px: rms,
        worst: entry.control_points.iter().enumerate().position(is_worst)?,
        worst_px: worst.px,
    })
}

/// The height by placement combined with the one that was entered or estimated from drawings, each weighted
/// by its information; that of a fixed placement is used as it is.
fn join_heights(
    first: &Camera,
    by_hand: Camera,
    fixed: bool,
    fixed_height: Option<f64>,
    findings: &mut Vec<Finding>,
) -> Camera {
    let hand = by_hand.position.z;
    let height_sigma = first.covariance.sigma(Covariance::Z);
    scale_conflict(first, hand, fixed_height.is_some(), findings);
    let (z, variance) = match (fixed_height, height_sigma) {
        _ if fixed => (hand, 0.0),
        (Some(height), _) => (height, 0.0),
        (None, Some(sigma)) => {
            let (a, b) = (sigma.powi(-2), (HAND * hand).powi(-2));
            ((a * first.position.z + b * hand) / (a + b), (a + b).recip())
        }
        (None, None) => (hand, 0.0),
    };
    let mut joined = by_hand;
    joined.position.z = z;
    for i in 0..Covariance::SIZE {
        joined.covariance.0[Covariance::Z][i] = 0.0;
        joined.covariance.0[i][Covariance::Z] = 0.0;
    }
    joined.covariance.0[Covariance::Z][Covariance::Z] = variance;
    joined
}

/// Reports a height, entered or estimated from drawings, that differs from the one by placement by over 3
/// sigma.
fn scale_conflict(first: &Camera, placed: f64, is_fixed: bool, findings: &mut Vec<Finding>) {
    let height_sigma = first.covariance.sigma(Covariance::Z);
    if height_sigma.is_none() && !is_fixed {
        return;
    }
    let sigma = height_sigma.unwrap_or(0.0).hypot(HAND * placed);
    let height = first.position.z;
    if (height - placed).abs() > 3.0 * sigma {
        findings.push(Finding::ScaleConflict { estimated: height, placed });
    }
}

/// Sigmas, covariance and floor error of a camera that was placed, in place of those of stage 1.
pub(crate) fn placed_uncertainty(entry: &SiteCamera, camera: &Camera, result: &mut CameraResult) {
    let grid = grid(camera, entry.efov_px.as_deref().unwrap_or_default(), entry.size());
    let rel = placed_floor_length_rel(camera, &grid);
    let shape = placed_floor_shape_rel(camera, &grid);
    result.solution.set_uncertainty(camera, rel);
    result.findings.retain(|finding| !matches!(finding.code(), Code::Weak | Code::Unusable));
    result.findings.extend(rel.and_then(|rel| floor_finding(rel, shape, result.suggestion())));
}
