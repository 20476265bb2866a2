//! Stage 2 of one camera: by control points, by the operator's hand, and what that does to its sigmas.

use std::collections::BTreeSet;

use crate::camera::{Camera, Covariance};
use crate::finding::{Code, Residual, ResidualOf, Warning};
use crate::floor::{ControlPoint, from_control_points, with_placement_covariance};
use crate::single::{floor_warning, grid, placed_floor_length_rel};
use crate::site::document::{Site, SiteCamera};
use crate::site::solution::{CovarianceEntry, Sigmas, Solution, Stage};

/// Relative: what a hand can tell of a camera's height by dragging a polygon over a plan.
const HAND: f64 = 0.02;

impl Site {
    /// By control points, by the operator's move, turn and scale, or not at all.
    pub(crate) fn place(
        &self,
        entry: &SiteCamera,
        first: Camera,
        warnings: &mut Vec<Warning>,
    ) -> (Camera, Stage) {
        let fixed = entry.placement.as_ref().is_some_and(|placement| placement.fixed);
        let points: Vec<ControlPoint> = entry
            .control_points
            .iter()
            .filter(|point| !point.off)
            .filter_map(|point| point.control_point(self.plan.as_ref()))
            .collect();
        let held = entry.height_m.filter(|height| height.fixed).map(|height| height.value);
        if !fixed && let Some(placed) = from_control_points(&first, &points, held) {
            scale_conflict(&first, placed.position.z, held.is_some(), warnings);
            let sigma = entry.sigma_px.unwrap_or(1.0);
            return (with_placement_covariance(&placed, &points, sigma), Stage::Placed);
        }
        if !fixed && !points.is_empty() {
            warnings.push(Warning::new(
                Code::UnusedAnnotation,
                format!("{} control point(s) do not place the camera.", points.len()),
                "Two points far apart inside the lens are needed, and more make it sure.",
            ));
        }
        match &entry.placement {
            Some(placement) => {
                let by_hand = placement.placement().apply(&first);
                (join_heights(&first, by_hand, placement.fixed, held, warnings), Stage::Placed)
            }
            None => (first, Stage::Partial),
        }
    }

    pub(crate) fn add_control_residuals(&self, entry: &SiteCamera, camera: &Camera, solution: &mut Solution) {
        let mut lost = Vec::new();
        for (index, point) in entry.control_points.iter().enumerate() {
            let id = point.label(index);
            let shown = point.control_point(self.plan.as_ref()).and_then(|p| camera.world_to_pixel(p.world));
            let Some(shown) = shown.filter(|shown| shown.is_finite()) else {
                if !point.off {
                    lost.push(id);
                }
                continue;
            };
            solution.residuals.push(Residual {
                of: ResidualOf::ControlPoint,
                annotation: None,
                segment: None,
                id: Some(id),
                px: shown.distance(point.px),
                outlier: false,
            });
        }
        if !lost.is_empty() && solution.stage > Stage::Partial {
            solution.warnings.push(Warning::new(
                Code::Misfit,
                format!("The camera does not show control points {} where it stands now.", lost.join(", ")),
                "Check their coordinates and pixels.",
            ));
        }
        far_off(entry, solution);
    }
}

/// Control points that are farther from their pixels than drawing explains.
fn far_off(entry: &SiteCamera, solution: &mut Solution) {
    /// Root mean square, in sigmas; pitch and focal carry some of their own error into it.
    const MOST: f64 = 8.0;
    let used = entry.control_points.iter().enumerate().filter(|(_, point)| !point.off);
    let on: BTreeSet<String> = used.map(|(index, point)| point.label(index)).collect();
    let used =
        |r: &&Residual| r.of == ResidualOf::ControlPoint && r.id.as_ref().is_some_and(|id| on.contains(id));
    let points: Vec<&Residual> = solution.residuals.iter().filter(used).collect();
    let rms = (points.iter().map(|r| r.px * r.px).sum::<f64>() / points.len().max(1) as f64).sqrt();
    let worst = points.iter().max_by(|a, b| a.px.total_cmp(&b.px));
    if let Some(worst) =
        worst.filter(|_| rms > MOST * entry.sigma_px.unwrap_or(1.0) && solution.stage == Stage::Placed)
    {
        let name = worst.id.as_deref().unwrap_or_default();
        let message =
            format!("The control points are {rms:.1} px rms off; the worst is {name}: {:.1} px.", worst.px);
        let advice = "Check the worst one's coordinates and pixel, or switch it off and look again.";
        solution.warnings.push(Warning::new(Code::Misfit, message, advice));
    }
}

/// The height that the hand gave joined with the one that was entered or told by lines; a fixed
/// placement wins.
fn join_heights(
    first: &Camera,
    by_hand: Camera,
    fixed: bool,
    held: Option<f64>,
    warnings: &mut Vec<Warning>,
) -> Camera {
    let hand = by_hand.position.z;
    let told = first.covariance.sigma(Covariance::Z);
    scale_conflict(first, hand, held.is_some(), warnings);
    let (z, variance) = match (held, told) {
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

/// A height that was entered or told by lines and the one that placement gave must be of one opinion.
fn scale_conflict(first: &Camera, placed: f64, is_held: bool, warnings: &mut Vec<Warning>) {
    let told = first.covariance.sigma(Covariance::Z);
    if told.is_none() && !is_held {
        return;
    }
    let sigma = told.unwrap_or(0.0).hypot(HAND * placed);
    let height = first.position.z;
    if (height - placed).abs() > 3.0 * sigma {
        let message = format!(
            "The camera is {height:.2} m high by what was entered and drawn, and {placed:.2} m as it is placed."
        );
        let advice =
            "Check the scale of the plan, the heights and lengths, and the size of the EFOV polygon.";
        warnings.push(Warning::new(Code::ScaleConflict, message, advice));
    }
}

/// Sigmas, covariance and floor error of a camera that was placed, in place of those of stage 1.
pub(crate) fn placed_uncertainty(entry: &SiteCamera, camera: &Camera, solution: &mut Solution) {
    let grid = grid(camera, entry.efov_px.as_deref().unwrap_or_default(), entry.size());
    let rel = placed_floor_length_rel(camera, &grid);
    solution.sigma = Some(Sigmas::of(camera, rel));
    solution.covariance = CovarianceEntry::of(camera);
    solution.warnings.retain(|warning| !matches!(warning.code, Code::Weak | Code::Unusable));
    let next = solution.draw_next.as_ref().map(|next| next.message.clone());
    solution.warnings.extend(floor_warning(
        rel,
        next.as_deref().unwrap_or("Draw lines elsewhere and in other directions."),
    ));
}
