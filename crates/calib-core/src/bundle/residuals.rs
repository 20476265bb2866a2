//! Residuals of the adjustment by kind, and their derivatives sorted into parameter blocks.
//!
//! Each is divided by its standard deviation, so that the sum of squares is a chi-square:
//!
//! - an annotation of stage 1, in pixels ([`Problem::each_residual`], with the formulas in
//!   `single/residual.rs`); these keep roll, pitch and focal determined by the drawings of every image;
//! - a point of a straight edge, its distance from the best line through the undistorted edge, in pixels;
//! - an observation: reprojected less observed pixel, two residuals; of a floor line one, the distance of
//!   the observed pixel from the reprojected line ([`LandmarkModel::reprojection_error`]);
//! - a prior on a parameter of a camera or a landmark: `value - prior`;
//! - a measured distance: `|A - B| - length`.
//!
//! [`Problem::each_residual`]: crate::single::Problem::each_residual
//! [`LandmarkModel::reprojection_error`]: crate::bundle::LandmarkModel::reprojection_error

use crate::bundle::camera::CAMERA_PARAMS;
use crate::bundle::landmark::{DistanceMeasurement, LANDMARK_PARAMS};
use crate::bundle::parameters::CameraLayout;
use crate::camera::{WorldPoint, dot};
use crate::optimize::{Dual, JacobianBlock};
use crate::single::{Constraints, Problem, Source, State};

/// What a residual belongs to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum ResidualKind {
    /// An annotation of a view.
    Annotation { view: usize, source: Source },
    /// A point of a straight edge.
    StraightEdge,
    /// A prior on a parameter of a camera.
    CameraPrior,
    /// An observation of a landmark.
    Observation { landmark: usize },
    /// A prior on a parameter of a landmark.
    LandmarkPrior { landmark: usize },
    /// A measured distance.
    Distance { distance: usize },
}

/// `(|A - B| - length) / sigma` with its derivatives by the parameters of both landmarks, of which
/// position and derivatives are given.
pub(crate) fn distance_residual(
    distance: &DistanceMeasurement,
    ends: &[(WorldPoint, [[f64; LANDMARK_PARAMS]; 3]); 2],
) -> (f64, [[f64; LANDMARK_PARAMS]; 2]) {
    let sigma = distance.length.sigma;
    let [a, b] = [ends[0].0, ends[1].0].map(<[f64; 3]>::from);
    let difference: [f64; 3] = std::array::from_fn(|i| a[i] - b[i]);
    let length = dot(&difference, &difference).sqrt();
    // The distance of two landmarks at one place has no derivative; 0 is taken.
    let direction = if length > 0.0 { difference.map(|component| component / length) } else { [0.0; 3] };
    let by = std::array::from_fn(|end| {
        let sign = if end == 0 { 1.0 } else { -1.0 };
        std::array::from_fn(|k| {
            let along: f64 = (0..3).map(|axis| direction[axis] * ends[end].1[axis][k]).sum();
            sign * along / sigma
        })
    });
    ((length - distance.length.value) / sigma, by)
}

/// The derivatives of a residual by the free parameters of a landmark.
pub(crate) fn of_free(by: &[f64; LANDMARK_PARAMS], free: &[bool; LANDMARK_PARAMS]) -> [f64; LANDMARK_PARAMS] {
    let mut packed = [0.0; LANDMARK_PARAMS];
    for (place, k) in (0..LANDMARK_PARAMS).filter(|&k| free[k]).enumerate() {
        packed[place] = by[k];
    }
    packed
}

/// The derivatives of a residual by the parameters of a camera, in the block of the camera and that of the
/// lens it shares.
#[derive(Clone, Copy, Debug)]
pub(crate) struct CameraJacobian {
    blocks: [(usize, [f64; CAMERA_PARAMS], usize); 2],
}

impl CameraJacobian {
    /// Sorts derivatives into blocks; `sizes` are those of all blocks.
    #[inline]
    pub(crate) fn new(by: &[f64; CAMERA_PARAMS], layout: &CameraLayout, sizes: &[usize]) -> Self {
        let mut blocks = [(usize::MAX, [0.0; CAMERA_PARAMS], 0); 2];
        for (parameter, derivative) in layout.iter().zip(by) {
            let Some((block, place)) = parameter else { continue };
            let which = usize::from(blocks[0].0 != usize::MAX && blocks[0].0 != *block);
            blocks[which].0 = *block;
            blocks[which].1[*place] = *derivative;
            blocks[which].2 = sizes[*block];
        }
        Self { blocks }
    }

    /// Calls `sink` with the blocks and that of a landmark or nuisance parameter.
    #[inline]
    pub(crate) fn with<'a>(&'a self, other: Option<JacobianBlock<'a>>, sink: impl FnOnce(&[JacobianBlock])) {
        let mut jacobian = [JacobianBlock { block: 0, by: &[] }; 3];
        let own = self.blocks.iter().filter(|(_, _, size)| *size > 0);
        let own = own.map(|(block, by, size)| JacobianBlock { block: *block, by: &by[..*size] });
        let mut count = 0;
        for block in own.chain(other) {
            jacobian[count] = block;
            count += 1;
        }
        sink(&jacobian[..count]);
    }
}

/// Residuals of stage 1: value in sigmas, derivatives by roll, pitch, log focal and log height, the index of
/// a nuisance parameter with the derivative by it, and source.
pub(crate) type Stage1Residuals = Vec<(f64, [f64; 4], Option<(usize, f64)>, Option<Source>)>;

/// All residuals of stage 1; of `constraints` in place of the problem's own where they are given.
pub(crate) fn stage_1_residuals(
    problem: &Problem,
    constraints: Option<&Constraints>,
    state: &State,
) -> Option<Stage1Residuals> {
    let mut residuals = Stage1Residuals::new();
    let mut sink = |residual: Dual, nuisance, source| {
        residuals.push((residual.value, residual.gradient, nuisance, source));
    };
    match constraints {
        Some(constraints) => Problem { constraints, ..problem.clone() }.each_residual(state, &mut sink)?,
        None => problem.each_residual(state, &mut sink)?,
    }
    Some(residuals)
}
