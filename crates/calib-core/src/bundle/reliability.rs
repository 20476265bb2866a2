//! Reliability of every observation: whether a gross error in it would be detected, and how far an undetected
//! error moves the floor (Baarda 1968, "A Testing Procedure for Use in Geodetic Networks"; Förstner 1987,
//! "Reliability Analysis of Parameter Estimation in Linear Models").
//!
//! Let J be the Jacobian of all residuals in standard deviations, and `C = (J'J)^-1` the covariance of the
//! unknowns. The rows `A` of J belong to one observation: one row for a line or a length, two rows for a pixel
//! or an upright. An error `e` of the observation, in standard deviations, has two effects:
//!
//! - It changes the residuals of the observation by `R e` with `R = I - A C A'`. The **redundancy number** of a
//!   single row is R itself, from 0 (not checked by other observations) to 1. The redundancy numbers of all
//!   rows, priors included, add up to the degrees of freedom. For two rows, other observations may check an
//!   error in one direction, but not in another. The redundancy number of the observation is then
//!   `e' R e / e' e` for the direction of the error that moves the floor most.
//! - It moves the unknowns by `C A' e`. With the mean `W` of `F'F` over points of the floor, where `F` is the
//!   Jacobian of a floor point, it moves the floor by `sqrt(e' G e)` metres with `G = A C W C A'`.
//!
//! An error is detected with a probability of 80 % in a test at a level of 0.1 % if `e' R e` exceeds
//! [`DETECTABLE`] squared. The largest undetected move of the floor is the maximum of `e' G e` under this
//! bound. A pixel error cannot exceed the diagonal of the image, which bounds `e` where R is singular.

use std::collections::HashMap;

use nalgebra::{DMatrix, DVector, Matrix2};

use crate::bundle::camera::CAMERA_PARAMS;
use crate::bundle::converged::Converged;
use crate::bundle::residuals::ResidualKind;
use crate::camera::{Camera, Covariance, FloorDerivatives, Pixel};
use crate::optimize::BlockCovariance;
use crate::single::Source;

/// Smallest detectable error of an observation with full redundancy, in standard deviations: level 0.1 % and
/// power 80 % (Baarda 1968).
const DETECTABLE: f64 = 4.13;

/// Reliability of one observation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reliability {
    /// Redundancy number, from 0 to 1, of the error with the largest effect on floor positions. At 0, no other
    /// observation checks this one.
    pub redundancy: f64,
    /// Largest root mean square displacement of the floor, in metres, that an undetected error of this observation
    /// causes. For a landmark it is the maximum over the floors of all cameras that observe it.
    pub undetectable: f64,
}

/// Annotation, or observation of a landmark, of a bundle problem.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Observed {
    /// Annotation of a view.
    Annotation { view: usize, source: Source },
    /// Observation of a landmark, by its index in the landmark.
    Landmark { landmark: usize, observation: usize },
}

impl Observed {
    const fn new(kind: ResidualKind) -> Option<Self> {
        match kind {
            ResidualKind::Annotation { view, source } => Some(Self::Annotation { view, source }),
            ResidualKind::Observation { landmark, observation } => {
                Some(Self::Landmark { landmark, observation })
            }
            _ => None,
        }
    }
}

/// Rows of the Jacobian of one observation, as pairs of block and derivatives.
type Rows = Vec<Vec<(usize, DVector<f64>)>>;

/// Computes the reliability of every observation at a minimum, ascending by observation. `inflation` contains
/// the factor of the standard deviations of each view.
pub(crate) fn reliabilities(
    converged: &Converged,
    covariance: &BlockCovariance,
    inflation: &[f64],
) -> Vec<(Observed, Reliability)> {
    let mut rows: Vec<(Observed, Rows)> = Vec::new();
    let _ = converged.problem.each_residual(converged.state(), |_, jacobian, kind| {
        let Some(observed) = Observed::new(kind) else { return };
        let row = jacobian.iter().map(|block| (block.block, DVector::from_column_slice(block.by))).collect();
        match rows.last_mut() {
            Some((last, rows)) if *last == observed => rows.push(row),
            _ => rows.push((observed, vec![row])),
        }
    });
    let views = converged.problem.views.len();
    let floors: Vec<DMatrix<f64>> = (0..views).map(|view| floor_weight(converged, view)).collect();
    let mut network = Network { converged, covariance, blocks: HashMap::new(), floors };
    let mut found: Vec<(Observed, Reliability)> = Vec::with_capacity(rows.len());
    let mut last_owner = None;
    for (observed, rows) in rows {
        // Observations of one landmark share blocks of the covariance.
        let owner = match observed {
            Observed::Annotation { view, .. } => (false, view),
            Observed::Landmark { landmark, .. } => (true, landmark),
        };
        if last_owner != Some(owner) {
            network.blocks.clear();
            last_owner = Some(owner);
        }
        let reliability = network.reliability(observed, &rows, inflation);
        found.extend(reliability.map(|reliability| (observed, reliability)));
    }
    found.sort_by_key(|(observed, _)| *observed);
    found
}

/// Covariance of the unknowns at a minimum, with the floor of every view.
struct Network<'a, 'b> {
    converged: &'a Converged<'b>,
    covariance: &'a BlockCovariance,
    /// Blocks of the covariance that are already computed.
    blocks: HashMap<[usize; 2], DMatrix<f64>>,
    /// Matrix W of every view: the mean of `F'F` over points of the floor. F is the Jacobian of a floor point with
    /// respect to the camera parameters.
    floors: Vec<DMatrix<f64>>,
}

impl Network<'_, '_> {
    /// Returns the reliability of an observation; `None` if the covariance is not finite.
    fn reliability(&mut self, observed: Observed, rows: &Rows, inflation: &[f64]) -> Option<Reliability> {
        let converged = self.converged;
        let problem = &converged.problem;
        let (own, sigma, views) = match observed {
            Observed::Annotation { view, source } => {
                (view, problem.views[view].stage_1.sigma_of(source), vec![view])
            }
            Observed::Landmark { landmark, observation } => {
                let landmark = &problem.landmarks[landmark];
                let seen = landmark.observations[observation];
                (seen.view, seen.sigma, landmark.views())
            }
        };
        let count = rows.len();
        let mut residuals = DMatrix::identity(count, count);
        for (j, row) in rows.iter().enumerate() {
            for (i, other) in rows.iter().enumerate() {
                residuals[(i, j)] -= other
                    .iter()
                    .map(|(block, by)| by.dot(&self.times_row(*block, by.len(), row)))
                    .sum::<f64>();
            }
        }
        let [width, height] = problem.views[own].size;
        let largest_error = width.hypot(height) / sigma;
        let mut worst = Reliability { redundancy: 1.0, undetectable: 0.0 };
        for view in views {
            let moves = self.moves(view, rows);
            let floor = moves.transpose() * &self.floors[view] * &moves;
            let found = Undetected::new(&residuals, &floor, largest_error)?;
            worst.redundancy = worst.redundancy.min(found.redundancy);
            worst.undetectable = worst.undetectable.max(found.length * inflation[own]);
        }
        Some(worst)
    }

    /// Returns the rows of a block of `C A'` for one row of A; `size` is the size of the block.
    fn times_row(&mut self, block: usize, size: usize, row: &[(usize, DVector<f64>)]) -> DVector<f64> {
        let mut sum = DVector::zeros(size);
        for (other, by) in row {
            sum += self.covariance_block([block, *other]) * by;
        }
        sum
    }

    /// Returns the moves `C A'` of the parameters of a view, in the order of [`Covariance`], for a unit error in each
    /// row of A.
    fn moves(&mut self, view: usize, rows: &Rows) -> DMatrix<f64> {
        let converged = self.converged;
        let problem = &converged.problem;
        let layout = problem.camera_layout(view);
        let mut moves = DMatrix::zeros(CAMERA_PARAMS, rows.len());
        for (column, row) in rows.iter().enumerate() {
            let mut known: Vec<(usize, DVector<f64>)> = Vec::new();
            for (parameter, slot) in layout.iter().enumerate() {
                let Some((block, index)) = *slot else { continue };
                let at = known.iter().position(|(other, _)| *other == block).unwrap_or_else(|| {
                    known.push((block, self.times_row(block, problem.blocks.sizes[block], row)));
                    known.len() - 1
                });
                moves[(parameter, column)] = known[at].1[index];
            }
        }
        moves
    }

    fn covariance_block(&mut self, pair: [usize; 2]) -> &DMatrix<f64> {
        let (covariance, blocks) = (self.covariance, &self.converged.problem.blocks);
        self.blocks.entry(pair).or_insert_with(|| covariance.block(blocks, pair[0], pair[1]))
    }
}

/// Largest undetected move of the floor due to an error of one observation.
#[derive(Clone, Copy, Debug)]
struct Undetected {
    /// Root mean square displacement of the floor, in metres.
    length: f64,
    /// Redundancy number of this error, from 0 to 1.
    redundancy: f64,
}

impl Undetected {
    /// Maximises `e' G e` under `e' R e <= DETECTABLE^2` and, approximately, `|e| <= largest_error`. R and G are
    /// 1 x 1 or 2 x 2.
    ///
    /// The bounds are joined to `e' S e <= DETECTABLE^2` with `S = R + (DETECTABLE / largest_error)^2 I`. With
    /// `e = S^-1/2 y`, the maximum belongs to the largest eigenvalue of `S^-1/2 G S^-1/2`, and y is its
    /// eigenvector. `None` if the matrices are not finite.
    fn new(r: &DMatrix<f64>, g: &DMatrix<f64>, largest_error: f64) -> Option<Self> {
        if !r.iter().chain(g).all(|value| value.is_finite()) {
            return None;
        }
        // An observation with one row gets a second row with redundancy 1 that does not move the floor.
        let entry = |matrix: &DMatrix<f64>, i: usize, j: usize| matrix.get((i, j)).copied();
        let r2 = Matrix2::from_fn(|i, j| entry(r, i, j).unwrap_or(if i == j { 1.0 } else { 0.0 }));
        let g2 = Matrix2::from_fn(|i, j| entry(g, i, j).unwrap_or(0.0));
        let bound = (DETECTABLE / largest_error).powi(2);
        let checked = r2.symmetric_eigen();
        // R is positive semidefinite, except for rounding errors.
        let roots = checked.eigenvalues.map(|value| (value.max(0.0) + bound).sqrt().recip());
        let inverse_root =
            checked.eigenvectors * Matrix2::from_diagonal(&roots) * checked.eigenvectors.transpose();
        let moved = (inverse_root * g2 * inverse_root).symmetric_eigen();
        let (index, largest) = moved.eigenvalues.argmax();
        let direction = inverse_root * moved.eigenvectors.column(index);
        // If no error moves the floor, all directions are equal, and the mean redundancy is used.
        let redundancy = if largest > 0.0 {
            (direction.transpose() * r2 * direction).x / direction.norm_squared()
        } else {
            r.trace() / r.nrows() as f64
        };
        Some(Self { length: DETECTABLE * largest.max(0.0).sqrt(), redundancy: redundancy.clamp(0.0, 1.0) })
    }
}

/// Returns the matrix W of a view, for the parameters of the state. W is the mean of `F'F` over a grid of pixels.
/// F is the Jacobian of the floor point at a pixel with respect to the camera parameters. Pixels whose floor
/// point is farther away than five camera heights are ignored.
fn floor_weight(converged: &Converged, view: usize) -> DMatrix<f64> {
    /// Number of grid pixels per side.
    const PER_SIDE: usize = 5;
    /// Largest distance of a floor point, in camera heights.
    const MAX_DISTANCE: f64 = 5.0;
    let camera: Camera = converged.camera(view);
    let [width, height] = converged.problem.views[view].size;
    let mut weight = DMatrix::zeros(CAMERA_PARAMS, CAMERA_PARAMS);
    let mut count = 0.0;
    for k in 0..PER_SIDE * PER_SIDE {
        let along = |index: usize, length: f64| (index as f64 + 0.5) / PER_SIDE as f64 * length;
        let pixel = Pixel::new(along(k % PER_SIDE, width), along(k / PER_SIDE, height));
        let Some(floor) = camera.pixel_to_floor(pixel, 0.0) else { continue };
        let [dx, dy] = [floor.x - camera.position.x, floor.y - camera.position.y];
        let Some(FloorDerivatives { by_camera: by, .. }) = camera.floor_derivatives(pixel) else { continue };
        if dx.hypot(dy) > MAX_DISTANCE * camera.position.z {
            continue;
        }
        // The state contains the focal length as its logarithm.
        let unit = |parameter: usize| if parameter == Covariance::FOCAL { camera.focal } else { 1.0 };
        let by = DMatrix::from_fn(CAMERA_PARAMS, 2, |k, axis| by[k][axis] * unit(k));
        weight += &by * by.transpose();
        count += 1.0;
    }
    if count > 0.0 { weight / count } else { weight }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bundle::{
        BundleAdjustment, BundleCamera, BundleSummary, InitialPose, Landmark, LandmarkModel, Observation,
    };
    use crate::camera::{Lens, WorldPoint};
    use crate::outcome::is_unchecked;

    const SIZE: [f64; 2] = [1920.0, 1080.0];

    fn camera(x: f64, y: f64, yaw: f64) -> Camera {
        Camera {
            position: WorldPoint::new(x, y, 4.0),
            yaw,
            pitch: 0.6,
            roll: 0.02,
            focal: 1200.0,
            lens: Lens::pinhole(Pixel::new(960.0, 540.0)),
            covariance: Covariance::EXACT,
        }
    }

    /// Solves a second camera from the links at these floor points. The pixel of the first link in the second
    /// camera is wrong by `error`.
    fn solved(places: &[(f64, f64)], error: [f64; 2]) -> BundleSummary {
        let truth = [camera(0.0, 0.0, 0.0), camera(3.0, 1.0, 0.5)];
        let landmark = |(index, &(x, y)): (usize, &(f64, f64))| {
            let seen = truth.iter().enumerate().map(|(view, camera)| {
                let pixel = camera.world_to_pixel(WorldPoint::new(x, y, 0.0)).expect("the point is visible");
                let [du, dv] = if (index, view) == (0, 1) { error } else { [0.0; 2] };
                Observation::new(view, Pixel::new(pixel.u + du, pixel.v + dv))
            });
            Landmark::new(LandmarkModel::Point { height: 0.0 }, seen.collect())
        };
        let landmarks = places.iter().enumerate().map(landmark).collect();
        let first = BundleCamera { initial_pose: InitialPose::Fixed, ..BundleCamera::new(truth[0], SIZE) };
        let cameras = vec![first, BundleCamera::new(camera(0.0, 0.0, 0.0), SIZE)];
        let adjustment =
            BundleAdjustment { cameras, landmarks, with_reliability: true, ..BundleAdjustment::default() };
        adjustment.solve().expect("valid input")
    }

    /// Returns the root mean square move of the floor from one solution of the second camera to another.
    fn floor_move(solutions: [&BundleSummary; 2]) -> f64 {
        let cameras = solutions.map(|found| found.cameras[1].as_ref().expect("connected").camera);
        let mut squares = Vec::new();
        for k in 0..25 {
            let along = |index: i32, length: f64| (f64::from(index) + 0.5) / 5.0 * length;
            let pixel = Pixel::new(along(k % 5, SIZE[0]), along(k / 5, SIZE[1]));
            let [Some(a), Some(b)] = cameras.map(|camera| camera.pixel_to_floor(pixel, 0.0)) else {
                continue;
            };
            if a.distance(cameras[0].position.on_floor()) <= 5.0 * cameras[0].position.z {
                squares.push(a.distance(b).powi(2));
            }
        }
        (squares.iter().sum::<f64>() / squares.len() as f64).sqrt()
    }

    /// Returns the reliability of the first link in the second camera.
    fn first_link(found: &BundleSummary) -> Reliability {
        let of_link = &found.landmark_reliabilities[0];
        of_link.iter().find(|(camera, _)| *camera == 1).expect("the link is used").1
    }

    const PLACES: [(f64, f64); 5] = [(0.5, 5.0), (-0.5, 7.0), (1.2, 6.0), (0.0, 8.0), (2.0, 7.0)];

    #[test]
    fn two_links_of_a_pair_are_not_checked_and_three_are() {
        for count in 2..=5 {
            let found = solved(&PLACES[..count], [0.0; 2]);
            let link = first_link(&found);
            let is_checked = !is_unchecked(link.redundancy, link.undetectable, 4.0);
            assert_eq!(is_checked, count > 2, "{count} links: {link:?}");
        }
        let link = first_link(&solved(&PLACES[..2], [0.0; 2]));
        assert!(link.redundancy < 1e-6, "{link:?}");
        assert!(link.undetectable > 1.0, "an error of many pixels turns the camera: {link:?}");
    }

    #[test]
    fn rounding_errors_do_not_hide_an_unchecked_direction() {
        let r = DMatrix::from_row_slice(2, 2, &[-1e-4, 0.0, 0.0, 0.5]);
        let found = Undetected::new(&r, &DMatrix::identity(2, 2), 2000.0).expect("finite matrices");
        assert_eq!(found.redundancy, 0.0);
        assert!(
            (found.length / 2000.0 - 1.0).abs() < 1e-9,
            "only the size of the image bounds the error: {found:?}"
        );
        assert!(Undetected::new(&(r * f64::NAN), &DMatrix::identity(2, 2), 2000.0).is_none());
    }

    /// The chi-square of a solution with a single error `e` and no noise is `e' R e`, so the prediction can be
    /// compared with solutions.
    #[test]
    fn undetectable_move_is_the_largest_move_of_solutions_with_one_error() {
        let exact = solved(&PLACES[..4], [0.0; 2]);
        let predicted = first_link(&exact);
        let (mut largest, mut redundancy) = (0.0, 0.0);
        for k in 0..90 {
            // Errors are so small that the solution is linear in them.
            let (sin, cos) = (f64::from(k) * 2_f64.to_radians()).sin_cos();
            let wrong = solved(&PLACES[..4], [1e-2 * cos, 1e-2 * sin]);
            let chi2 = wrong.cameras[1].as_ref().expect("connected").chi2;
            let moved = floor_move([&exact, &wrong]) * DETECTABLE / chi2.sqrt();
            if moved > largest {
                (largest, redundancy) = (moved, chi2 / 1e-4);
            }
        }
        assert!((predicted.undetectable / largest - 1.0).abs() < 0.01, "{predicted:?} and {largest}");
        assert!((predicted.redundancy / redundancy - 1.0).abs() < 0.05, "{predicted:?} and {redundancy}");
    }
}
