//! Residuals of the adjustment by kind, and their derivatives sorted into parameter blocks.
//!
//! Each residual is divided by its standard deviation, so that the sum of squares is a chi-square:
//!
//! - An annotation of stage 1, in pixels ([`Problem::each_residual`], with the formulas in `single/residual.rs`).
//!   With these residuals, the annotations of an image continue to constrain roll, pitch and focal length of its
//!   camera.
//! - A point of a straight edge: its distance from the best line through the undistorted edge, in pixels.
//! - An observation: reprojected minus observed pixel, two residuals. A floor line has one residual, the
//!   distance of the observed pixel from the reprojected line ([`LandmarkModel::reprojection_error`]).
//! - A prior on a parameter of a camera, a plane or a landmark: `value - prior`.
//! - A measured distance: `|A - B| - length`.
//!
//! [`Problem::each_residual`]: crate::single::Problem::each_residual
//! [`LandmarkModel::reprojection_error`]: crate::bundle::LandmarkModel::reprojection_error

use crate::bundle::camera::CAMERA_PARAMS;
use crate::bundle::landmark::{DistanceMeasurement, LANDMARK_PARAMS};
use crate::bundle::parameters::CameraLayout;
use crate::camera::{Lens, WorldPoint, dot};
use crate::optimize::{ByLens, Dual, Gradient, JacobianBlock, NuisanceJacobian};
use crate::single::{Constraints, Problem, Source, State};

/// Kind of a residual, with the index of its view, landmark or distance.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum ResidualKind {
    /// Annotation of a view (residual of stage 1).
    Annotation { view: usize, source: Source },
    /// Point of a straight edge.
    StraightEdge,
    /// Prior on a parameter of a camera.
    CameraPrior,
    /// Observation of a landmark, by its index in the landmark.
    Observation { landmark: usize, observation: usize },
    /// Prior on a parameter of a plane.
    PlanePrior,
    /// Prior on a parameter of a landmark.
    LandmarkPrior { landmark: usize },
    /// Measured distance between two landmarks.
    Distance { distance: usize },
}

/// Computes `(|A - B| - length) / sigma` and its derivatives with respect to the parameters of both landmarks
/// and the height of A. `ends` contains the positions of A and B and their derivatives.
pub(crate) fn distance_residual(
    distance: &DistanceMeasurement,
    ends: &[(WorldPoint, [[f64; LANDMARK_PARAMS]; 3]); 2],
) -> (f64, [[f64; LANDMARK_PARAMS]; 2], f64) {
    let sigma = distance.length.sigma;
    let [a, b] = [ends[0].0, ends[1].0].map(<[f64; 3]>::from);
    let difference: [f64; 3] = std::array::from_fn(|i| a[i] - b[i]);
    let length = dot(&difference, &difference).sqrt();
    // The distance of two landmarks at the same position has no derivative; 0 is used.
    let direction = if length > 0.0 { difference.map(|component| component / length) } else { [0.0; 3] };
    let by = std::array::from_fn(|end| {
        let sign = if end == 0 { 1.0 } else { -1.0 };
        std::array::from_fn(|k| {
            let along: f64 = (0..3).map(|axis| direction[axis] * ends[end].1[axis][k]).sum();
            sign * along / sigma
        })
    });
    ((length - distance.length.value) / sigma, by, direction[2] / sigma)
}

/// Packs the derivatives with respect to the free parameters of a landmark to the front.
pub(crate) fn pack_free(
    by: &[f64; LANDMARK_PARAMS],
    free: &[bool; LANDMARK_PARAMS],
) -> [f64; LANDMARK_PARAMS] {
    let mut packed = [0.0; LANDMARK_PARAMS];
    for (index, k) in (0..LANDMARK_PARAMS).filter(|&k| free[k]).enumerate() {
        packed[index] = by[k];
    }
    packed
}

/// Derivatives of a residual with respect to the parameters of a camera, in the block of the camera and the
/// block of its shared lens.
#[derive(Clone, Copy, Debug)]
pub(crate) struct CameraJacobian {
    /// Index, derivatives and size of the camera's own block and of its shared lens block; size 0 if unused.
    blocks: [(usize, [f64; CAMERA_PARAMS], usize); 2],
}

impl CameraJacobian {
    /// Sorts the derivatives `by` with respect to all camera parameters into the blocks of `layout`. `sizes`
    /// are the sizes of all parameter blocks.
    #[inline]
    pub(crate) fn new(by: &[f64; CAMERA_PARAMS], layout: &CameraLayout, sizes: &[usize]) -> Self {
        let mut blocks = [(usize::MAX, [0.0; CAMERA_PARAMS], 0); 2];
        for (parameter, derivative) in layout.iter().zip(by) {
            let Some((block, index)) = parameter else { continue };
            let which = usize::from(blocks[0].0 != usize::MAX && blocks[0].0 != *block);
            blocks[which].0 = *block;
            blocks[which].1[*index] = *derivative;
            blocks[which].2 = sizes[*block];
        }
        Self { blocks }
    }

    /// Calls `sink` with these blocks and at most three blocks of landmark, plane, tilt or nuisance
    /// parameters.
    #[inline]
    pub(crate) fn with<'a>(&'a self, others: &[JacobianBlock<'a>], sink: impl FnOnce(&[JacobianBlock])) {
        let mut jacobian = [JacobianBlock { block: 0, by: &[] }; 5];
        let own = self.blocks.iter().filter(|(_, _, size)| *size > 0);
        let own = own.map(|(block, by, size)| JacobianBlock { block: *block, by: &by[..*size] });
        let mut count = 0;
        for (slot, block) in jacobian.iter_mut().zip(own.chain(others.iter().copied())) {
            *slot = block;
            count += 1;
        }
        sink(&jacobian[..count]);
    }
}

/// Residuals of stage 1. The tuple contains the value in standard deviations, the derivatives with respect to
/// roll, pitch, log focal length and log height (the entries of the tilts are not used), the derivatives with
/// respect to nuisance parameters, and the source.
pub(crate) type Stage1Residuals = Vec<(f64, Gradient, NuisanceJacobian, Option<Source>)>;

/// Returns all residuals of stage 1.
pub(crate) fn stage_1_residuals(problem: &Problem, state: &State) -> Option<Stage1Residuals> {
    let mut residuals = Stage1Residuals::new();
    problem.each_residual(state, |residual: Dual, nuisance, source| {
        residuals.push((residual.value, residual.gradient, nuisance, source));
    })?;
    Some(residuals)
}

/// Returns the derivatives of the residuals of stage 1, in their order, with respect to the lens parameters. A change
/// of a lens parameter moves the ends of a segment, and changes the covariance of their noise and the spread of a
/// polyline.
pub(crate) fn stage_1_by_lens(
    problem: &Problem,
    constraints: &Constraints<ByLens>,
    state: &State,
) -> Option<Vec<[f64; Lens::PARAMETERS]>> {
    let mut gradients = Vec::new();
    problem
        .with_constraints(constraints)
        .each_residual(state, |residual: ByLens, _, _| gradients.push(residual.gradient))?;
    Some(gradients)
}

/// Moves the blocks that are present to the front of the array, and returns their number.
pub(crate) fn compact_blocks<const N: usize>(
    blocks: [Option<JacobianBlock<'_>>; N],
) -> ([JacobianBlock<'_>; N], usize) {
    let mut listed = [JacobianBlock { block: 0, by: &[] }; N];
    let mut count = 0;
    for block in blocks.into_iter().flatten() {
        listed[count] = block;
        count += 1;
    }
    (listed, count)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::{BrownConrady, Distortion, Pixel};
    use crate::single::{Annotation, FixedParameters, Kind, Known, Priors, Repeats, SceneErrors};
    use proptest::prelude::*;

    const SCENE: SceneErrors = SceneErrors { floor_tilt: 0.02, crossfall: 0.03, angle: 0.01, length: 0.01 };

    fn any_lens() -> impl Strategy<Value = Lens> {
        let brown = (-0.3..0.1_f64, -0.05..0.05_f64, -0.01..0.01_f64, -0.003..0.003_f64, -0.003..0.003_f64)
            .prop_map(|(k1, k2, k3, p1, p2)| Distortion::BrownConrady(BrownConrady { k1, k2, k3, p1, p2 }));
        let division = (-0.2..0.1_f64).prop_map(|lambda| Distortion::Division { lambda });
        let fisheye = [-0.05..0.05_f64, -0.01..0.01_f64]
            .prop_map(|[a, b]| Distortion::KannalaBrandt { k: [a, b, 0.0, 0.0] });
        let distortions = prop_oneof![Just(Distortion::None), brown, division, fisheye];
        (distortions, 0.7..1.4_f64).prop_map(|(distortion, pixel_aspect)| Lens {
            principal_point: Pixel::new(960.0, 540.0),
            focal: 1100.0,
            distortion,
            image_circle: None,
            pixel_aspect,
        })
    }

    /// Generates annotations of all kinds, on the lower half of the image.
    fn any_annotations() -> impl Strategy<Value = Vec<Annotation>> {
        let pixel = || [100.0..1800.0_f64, 620.0..1060.0_f64].prop_map(|[u, v]| Pixel::new(u, v));
        let segments = proptest::collection::vec(proptest::collection::vec(pixel(), 2..6), 2..4);
        let directions = (segments.clone(), segments.clone(), segments.clone());
        let drawn = (directions, segments.clone(), segments, pixel(), pixel());
        drawn.prop_map(|((verticals, parallels, corner), lengths, known, foot, head)| {
            let of = Annotation::from_segments;
            vec![
                of(Kind::Vertical, verticals),
                of(Kind::Parallel, parallels),
                of(Kind::Perpendicular, corner[..2].to_vec()),
                of(Kind::EqualLength, lengths),
                Annotation { length_m: Some(2.0), ..of(Kind::KnownLength, known) },
                Annotation {
                    foot: Some(foot),
                    head: Some(head),
                    height_m: Some(Known::prior(1.7, 0.05)),
                    ..of(Kind::Upright, Vec::new())
                },
            ]
        })
    }

    proptest! {
        #[test]
        fn lens_derivatives_match_finite_differences(
            lens in any_lens(), annotations in any_annotations(), roll in -0.2..0.2_f64, pitch in 0.5..1.2_f64,
        ) {
            const STEP: f64 = 1e-5;
            let constraints = Constraints::new(&annotations, &lens, SCENE);
            // The number of repeated annotations of an edge is not differentiated, because it does not depend
            // on the lens.
            prop_assume!(constraints.repeats == Repeats::NONE);
            let problem = Problem::new(&constraints, FixedParameters::default(), Priors::default(), 0.7, 1920.0);
            let state = problem.state_at([roll, pitch, 1100.0_f64.ln(), 3.0_f64.ln()]);
            prop_assume!(state.is_some());
            let Some(state) = state else { return Ok(()) };
            let by = stage_1_by_lens(&problem, &Constraints::in_charts_of(&lens, &annotations, &lens, SCENE, &[]), &state);
            let values = |moved: &Lens| -> Option<Vec<f64>> {
                let constraints = Constraints::in_charts_of(&lens, &annotations, moved, SCENE, &[]);
                let residuals = stage_1_residuals(&problem.with_constraints(&constraints), &state)?;
                Some(residuals.iter().map(|residual| residual.0).collect())
            };
            let both = by.zip(values(&lens));
            prop_assume!(both.is_some());
            let Some((by, here)) = both else { return Ok(()) };
            prop_assert_eq!(by.len(), here.len());
            for k in 0..Lens::PARAMETERS {
                let central = |step: f64| {
                    let (ahead, behind) = (values(&lens.nudged(k, step))?, values(&lens.nudged(k, -step))?);
                    Some(ahead.iter().zip(&behind).map(|(a, b)| (a - b) / (2.0 * step)).collect::<Vec<f64>>())
                };
                let Some((whole, half)) = central(STEP).zip(central(0.5 * STEP)) else { continue };
                // At the rim of the lens a perturbation can remove an end point.
                if whole.len() < by.len() || half.len() < by.len() {
                    continue;
                }
                for (i, by) in by.iter().enumerate() {
                    let numeric = (4.0 * half[i] - whole[i]) / 3.0;
                    // A function with strong curvature within the step has no accurate difference quotient.
                    if (whole[i] - half[i]).abs() < 1e-5 * (1.0 + half[i].abs()) {
                        let most = 1e-4 * (1.0 + by[k].abs() + here[i].abs());
                        prop_assert!((numeric - by[k]).abs() < most, "residual {i} of {} by {k}: {numeric} {}", here[i], by[k]);
                    }
                }
            }
        }
    }
}
