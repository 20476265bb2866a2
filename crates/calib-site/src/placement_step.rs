//! Stage 2 for one camera: placement by control points or by the operator, with its uncertainty.

use std::collections::BTreeSet;

use crate::camera_result::CameraResult;
use crate::document::{ControlPointEntry, FixedEntry, Site, SiteCamera};
use crate::solution::{Solution, Stage};
use calib_core::camera::{Camera, Covariance, WorldPoint};
use calib_core::floor::{ControlPoint, ControlPointNoise, from_control_points, with_placement_covariance};
use calib_core::outcome::{Code, Finding, Residual, ResidualOf};
use calib_core::single::{
    MAX_OVERLAP_DISTANCE_PX, floor_finding, grid, placed_floor_length_rel, placed_floor_shape_rel,
};

/// Relative standard deviation of a camera height from a placement, for which the operator drags and scales a polygon
/// on a plan.
const PLACED_HEIGHT_SIGMA_REL: f64 = 0.02;

impl Site {
    /// Places a camera by control points, except the suspects among them, or by the operator's placement, if
    /// available.
    pub(crate) fn place(
        &self,
        entry: &SiteCamera,
        first: Camera,
        suspects: &[usize],
        findings: &mut Vec<Finding>,
    ) -> (Camera, Stage) {
        let fixed = entry.placement.as_ref().is_some_and(|placement| placement.fixed);
        let points = entry.control_points.iter().enumerate();
        let points =
            points.filter(|(index, point)| !point.off && !suspects.contains(index)).map(|(_, point)| point);
        let sigma = entry.sigma_px.unwrap_or(1.0);
        let noisy = |point: &ControlPointEntry| Some((point.control_point(self)?, point.noise(sigma)));
        let noisy = without_duplicates(points.filter_map(noisy).collect());
        let points: Vec<ControlPoint> = noisy.iter().map(|(point, _)| *point).collect();
        let fixed_height = entry.height_m.filter(|height| height.fixed).map(|height| height.value);
        if !fixed && let Some(placed) = from_control_points(&first, &points, fixed_height) {
            scale_conflict(&first, placed.position.z, fixed_height.is_some(), findings);
            return (with_placement_covariance(&placed, &noisy, fixed_height.is_some()), Stage::Placed);
        }
        if !fixed && !points.is_empty() {
            findings.push(Finding::TooFewControlPoints { count: points.len() });
        }
        let scale = entry.placement.as_ref().and_then(|placement| placement.scale);
        // If the lines contradict each other, no uncertainty is known, not even of an entered height.
        let height_is_known = entry.height_m.is_some()
            || first.covariance.sigma(Covariance::Z).is_some()
            || !first.covariance.is_known();
        if scale.is_none() && !height_is_known && !fixed {
            findings.push(Finding::ScaleAssumed { height: first.position.z });
        }
        match &entry.placement {
            Some(placement) => {
                let by_hand = placement.placement().apply(&first);
                // A scale from a joint solve is not independent evidence: its inputs are already used, or were
                // deleted.
                let has_no_evidence = placement.scale.is_none() || placement.estimated && height_is_known;
                if has_no_evidence && !fixed {
                    let position = WorldPoint { z: first.position.z, ..by_hand.position };
                    return (Camera { position, ..by_hand }, Stage::Placed);
                }
                (join_heights(&first, by_hand, placement.fixed, fixed_height, findings), Stage::Placed)
            }
            None => (first, Stage::Partial),
        }
    }

    /// Whether a camera at this stage was placed by hand and the uncertainty of its position is unknown. The
    /// only camera of a site without a plan or known positions is exact: its placement defines the coordinate
    /// system.
    pub(crate) fn is_placed_by_hand(&self, entry: &SiteCamera, camera: &Camera, stage: Stage) -> bool {
        let is_by_hand = entry.placement.as_ref().is_some_and(|placement| !placement.fixed);
        // If the lines contradict each other, no uncertainty is known, even for a position from control
        // points.
        let is_by_points =
            entry.control_points.iter().any(|point| !point.off) && !camera.covariance.is_known();
        is_by_hand
            && !is_by_points
            && stage == Stage::Placed
            && !entry.unknown_pose_parameters(camera).is_empty()
            && self.has_reference_coordinates(entry)
    }

    /// Whether the site has coordinates independent of this camera: a plan, a georeference, a fixed mark, or
    /// another camera with a position.
    #[must_use]
    pub fn has_reference_coordinates(&self, entry: &SiteCamera) -> bool {
        let has_position = |other: &SiteCamera| {
            other.placement.is_some() || !other.control_points.is_empty() || other.is_given()
        };
        self.plan.is_some()
            || self.georeference().is_some()
            || self.marks.iter().any(|mark| mark.fixed && !mark.off)
            || self.cameras.iter().any(|other| other.id != entry.id && has_position(other))
    }

    pub(crate) fn add_control_residuals(
        &self,
        entry: &SiteCamera,
        camera: &Camera,
        result: &mut CameraResult,
    ) {
        let mut hidden = Vec::new();
        for (index, point) in entry.control_points.iter().enumerate() {
            // A point on the map has no position in the site while the georeference is unknown.
            let Some(known) = point.control_point(self) else { continue };
            let shown = camera.world_to_pixel(known.world);
            let Some(shown) = shown.filter(|shown| shown.is_finite()) else {
                if !point.off {
                    hidden.push(index);
                }
                continue;
            };
            result.solution.residuals.push(Residual {
                id: Some(point.label(index)),
                ..Residual::new(ResidualOf::ControlPoint, shown.distance(point.px))
            });
        }
        if !hidden.is_empty() && result.solution.stage > Stage::Partial {
            result.findings.push(Finding::HiddenControlPoints { points: hidden });
        }
        let far = control_point_misfit(entry, &result.solution);
        result.findings.extend(far);
    }
}

impl SiteCamera {
    /// Returns the indices in [`Covariance`] of x, y and yaw that are neither fixed nor estimated.
    pub(crate) fn unknown_pose_parameters(&self, camera: &Camera) -> Vec<usize> {
        let held = self.placement.as_ref().map_or_else(FixedEntry::default, |placement| placement.held);
        let place = [(Covariance::X, held.x), (Covariance::Y, held.y), (Covariance::YAW, held.turn)];
        let is_open = |&(index, held): &(usize, bool)| !held && camera.covariance.sigma(index).is_none();
        place.into_iter().filter(is_open).map(|(index, _)| index).collect()
    }
}

/// Removes control points that repeat another one at the same pixel.
fn without_duplicates(
    mut points: Vec<(ControlPoint, ControlPointNoise)>,
) -> Vec<(ControlPoint, ControlPointNoise)> {
    /// Distance below which two control points count as the same point, in metres.
    const MAX_DUPLICATE_DISTANCE_M: f64 = 0.01;
    points.sort_by(|(a, _), (b, _)| a.pixel.u.total_cmp(&b.pixel.u));
    let mut once: Vec<(ControlPoint, ControlPointNoise)> = Vec::new();
    for (point, noise) in points {
        let mut near = once
            .iter()
            .rev()
            .take_while(|(known, _)| point.pixel.u - known.pixel.u <= MAX_OVERLAP_DISTANCE_PX);
        let is_known = |(known, _): &(ControlPoint, ControlPointNoise)| {
            known.pixel.distance(point.pixel) <= MAX_OVERLAP_DISTANCE_PX
                && known.world.distance(point.world) <= MAX_DUPLICATE_DISTANCE_M
        };
        if !near.any(is_known) {
            once.push((point, noise));
        }
    }
    once
}

/// Reports control points whose residuals are larger than annotation noise explains.
fn control_point_misfit(entry: &SiteCamera, solution: &Solution) -> Option<Finding> {
    /// Largest accepted RMS residual, in standard deviations. It allows for errors of pitch and focal length.
    const MAX_RMS_SIGMAS: f64 = 8.0;
    let used = entry.control_points.iter().enumerate().filter(|(_, point)| !point.off);
    let on: BTreeSet<String> = used.map(|(index, point)| point.label(index)).collect();
    let used =
        |r: &&Residual| r.of == ResidualOf::ControlPoint && r.id.as_ref().is_some_and(|id| on.contains(id));
    let points: Vec<&Residual> = solution.residuals.iter().filter(used).collect();
    let rms = (points.iter().map(|r| r.px * r.px).sum::<f64>() / points.len().max(1) as f64).sqrt();
    let worst = points.iter().max_by(|a, b| a.px.total_cmp(&b.px));
    let worst = worst.filter(|_| {
        rms > MAX_RMS_SIGMAS * entry.sigma_px.unwrap_or(1.0) && solution.stage == Stage::Placed
    })?;
    let is_worst = |(index, point): (usize, &ControlPointEntry)| worst.id == Some(point.label(index));
    Some(Finding::FarControlPoints {
        rms_px: rms,
        worst: entry.control_points.iter().enumerate().position(is_worst)?,
        worst_px: worst.px,
    })
}

/// Combines the height from placement with the estimated height, weighted by their information. The height of a fixed
/// placement is used unchanged; otherwise a fixed entered height is used unchanged.
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
            let (a, b) = (sigma.powi(-2), (PLACED_HEIGHT_SIGMA_REL * hand).powi(-2));
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

/// Reports an entered or estimated height that differs from the height by placement by more than 3 standard
/// deviations.
fn scale_conflict(first: &Camera, placed: f64, is_fixed: bool, findings: &mut Vec<Finding>) {
    let height_sigma = first.covariance.sigma(Covariance::Z);
    if height_sigma.is_none() && !is_fixed {
        return;
    }
    let sigma = height_sigma.unwrap_or(0.0).hypot(PLACED_HEIGHT_SIGMA_REL * placed);
    let height = first.position.z;
    if (height - placed).abs() > 3.0 * sigma {
        findings.push(Finding::ScaleConflict { estimated: height, placed });
    }
}

/// Replaces the standard deviations, the covariance and the floor error of stage 1 by those of the placed
/// camera.
pub(crate) fn placed_uncertainty(entry: &SiteCamera, camera: &Camera, result: &mut CameraResult) {
    let grid = grid(camera, entry.efov_px.as_deref().unwrap_or_default(), entry.size());
    let rel = placed_floor_length_rel(camera, &grid);
    let shape = placed_floor_shape_rel(camera, &grid);
    result.solution.set_uncertainty(camera, rel);
    result.findings.retain(|finding| !matches!(finding.code(), Code::Weak | Code::Unusable));
    result.findings.extend(rel.and_then(|rel| floor_finding(rel, shape, result.suggestion())));
}
