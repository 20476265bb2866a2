//! Acceptance test by a walker: one person walks through a site. Cameras that see this person at the same
//! time are compared with each other and with their claimed uncertainty.
//!
//! Let `p` be the floor position of the walker. Camera c measures `pc = p + Jc ec + n`. Here `ec` are the
//! errors of the camera, with the covariance `Cc` claimed by its calibration. `Jc` are the derivatives of the
//! position with respect to these errors, and `n` is the noise of the foot. The elimination of `p` leaves
//! normal equations of the errors of all cameras. The errors of the other cameras, with their claims as
//! priors, are then eliminated from the equations of camera c. The remaining information is `I`, and the
//! remaining score is `u = I ec + noise`, with noise of variance `I`. If the claim is correct, `u` has the
//! variance `S = I + I Cc I`.
//!
//! Most faults change one parameter. An error `d` of the parameter `k` changes the score by `I d ek`, with
//! `ek` the unit vector of the parameter. The most powerful test is the matched filter `ek' I S^-1 u`,
//! divided by its standard deviation. The result is a standard normal variable if the claim is correct. Let
//! `L` be the Cholesky factor of `Cc = L L'`, and `L' I L = Q diag(l) Q'` with the eigenvalues `l`. The
//! filter is a sum over the eigenvectors `Q`.

use nalgebra::{DMatrix, DVector, Matrix2, Vector2};

use crate::stature::Sighting;
use crate::views::{ERROR_PARAMS, ErrorJacobian, View, consistent_views, fused_position, interpolated, view};
use calib_core::camera::{Camera, FloorPoint};
use calib_core::optimize::two_sided_quantile;

/// Time between two evaluated moments, in seconds; errors of the foot are independent at this spacing.
const STEP_S: f64 = 0.5;
/// Largest number of stored sightings of a camera: about two days at two sightings a second.
const MAX_SIGHTINGS: usize = 400_000;

/// Sightings of a walk.
#[derive(Clone, Debug)]
pub struct Walk {
    /// Cameras, each with the width and height of its image, in pixels.
    cameras: Vec<(Camera, [f64; 2])>,
    /// Sightings, by camera.
    seen: Vec<Vec<Sighting>>,
}

/// Camera that contradicts its claimed uncertainty.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Disagreement {
    /// Index of the camera.
    pub camera: usize,
    /// Significance of the contradiction, in standard deviations of a normal variable.
    pub significance: f64,
    /// Mean error of the walker's position along x and y, in metres.
    pub shift: [f64; 2],
    /// Standard deviation of each component of `shift`, in metres.
    pub shift_sigma: f64,
    /// Error of the single parameter that explains most of the disagreement; the others are zero. The
    /// parameters are x, y and z in metres, yaw, pitch and roll in radians, and the focal length in pixels.
    pub errors: [f64; ERROR_PARAMS],
}

/// Position of the walker at one moment.
#[derive(Clone, Debug, PartialEq)]
pub struct WalkMoment {
    /// Time, in nanoseconds since 1970.
    pub at: i64,
    /// Floor position from all cameras together.
    pub position: FloorPoint,
    /// Indices of the cameras that saw the walker, each with the floor position from this camera
    /// alone.
    pub seen: Vec<(usize, FloorPoint)>,
}

/// Result of a walk.
#[derive(Clone, Debug, PartialEq)]
pub struct WalkResult {
    /// Moments, in order of time.
    pub moments: Vec<WalkMoment>,
    /// Cameras that contradict their claimed uncertainty, the most significant first.
    pub disagreements: Vec<Disagreement>,
    /// For each camera, the number of moments when it and at least one other camera saw the walker.
    pub shared_moments: Vec<usize>,
    /// For each camera, the number of moments when it saw the walker.
    pub seen: Vec<usize>,
    /// Smallest detectable error of each parameter of every camera, in the order and units of
    /// [`Disagreement::errors`]; infinite if undetermined.
    pub smallest_detectable: Vec<[f64; ERROR_PARAMS]>,
    /// Ratio of the measured to the assumed noise variance of the walker's feet in the images.
    pub noise_ratio: f64,
    /// For each camera, the number of sightings beyond the first one at the same time. A walk with only one
    /// person has none.
    pub crowded_moments: Vec<usize>,
}

/// Normal equations of the errors of all cameras.
struct Equations {
    information: DMatrix<f64>,
    score: DVector<f64>,
    /// Chi-square of the disagreements before the fit.
    chi2: f64,
    /// Degrees of freedom of `chi2`.
    freedom: f64,
}

impl Walk {
    /// Creates an empty walk for cameras, each with the width and height of its image, in pixels.
    #[must_use]
    pub fn new(cameras: &[(Camera, [f64; 2])]) -> Self {
        Self { cameras: cameras.to_vec(), seen: vec![Vec::new(); cameras.len()] }
    }

    /// Adds a sighting. Sightings of unknown cameras and boxes cut by the image border are ignored.
    pub fn add_sighting(&mut self, sighting: &Sighting) {
        if let (Some(seen), Some((_, size))) =
            (self.seen.get_mut(sighting.camera), self.cameras.get(sighting.camera))
            && seen.len() < MAX_SIGHTINGS
            && !sighting.is_cut(*size)
        {
            seen.push(*sighting);
        }
    }

    /// Computes the result of the walk.
    #[must_use]
    pub fn result(&self) -> WalkResult {
        let moments = self.moments();
        let claims: Vec<DMatrix<f64>> = self.cameras.iter().map(|(camera, _)| claim(camera)).collect();
        let (equations, noise) = self.equations(&moments, &claims);
        let disagreements = disagreements(&equations, &claims);
        let disagreements =
            disagreements.into_iter().map(|found| to_disagreement(&found, &moments, noise)).collect();
        let count = |camera: usize, least: usize| {
            let is_in = |(_, views): &&(i64, Vec<View>)| {
                views.len() >= least && views.iter().any(|view| view.camera == camera)
            };
            moments.iter().filter(is_in).count()
        };
        let all = 0..self.cameras.len();
        let threshold = significance_threshold(&equations, claims.len());
        let smallest = |camera: usize| {
            let inverse_sigmas = test_camera(&equations, &claims, camera, &[])
                .map_or([0.0; ERROR_PARAMS], |found| found.inverse_sigmas);
            inverse_sigmas.map(|inverse_sigma| threshold / inverse_sigma)
        };
        WalkResult {
            smallest_detectable: all.clone().map(smallest).collect(),
            disagreements,
            shared_moments: all.clone().map(|camera| count(camera, 2)).collect(),
            seen: all.map(|camera| count(camera, 1)).collect(),
            noise_ratio: noise,
            crowded_moments: self.seen.iter().map(|seen| crowded(seen)).collect(),
            moments: moments.iter().filter_map(|(at, views)| moment(*at, views)).collect(),
        }
    }

    /// Returns the views of the walker at moments [`STEP_S`] apart.
    fn moments(&self) -> Vec<(i64, Vec<View>)> {
        let step = (STEP_S * 1e9) as i64;
        let mut moments: std::collections::BTreeMap<i64, Vec<View>> = std::collections::BTreeMap::new();
        for (index, (camera, _)) in self.cameras.iter().enumerate() {
            let mut seen = self.seen[index].clone();
            seen.sort_by_key(|sighting| sighting.at);
            seen.dedup_by_key(|sighting| sighting.at);
            let alone = seen.iter().filter(|one| one.at % step == 0).map(|one| (one.at, *one));
            let between = seen.windows(2).flat_map(|pair| interpolated(pair[0], pair[1], step));
            let at_moments: std::collections::BTreeMap<i64, Sighting> = between.chain(alone).collect();
            for (at, sighting) in at_moments {
                moments.entry(at).or_default().extend(view(index, camera, &sighting));
            }
        }
        moments
            .into_iter()
            .map(|(at, views)| (at, consistent_views(views)))
            .filter(|(_, views)| !views.is_empty())
            .collect()
    }

    /// Returns the normal equations of the camera errors, and the ratio of the measured to the assumed noise
    /// variance of the walker's feet. The ratio is estimated from the disagreement that remains after the fit
    /// of all errors. The equations are divided by this ratio.
    fn equations(&self, moments: &[(i64, Vec<View>)], claims: &[DMatrix<f64>]) -> (Equations, f64) {
        let mut all = Equations::zeros(self.cameras.len() * ERROR_PARAMS);
        moments.iter().for_each(|(_, views)| all.add(views));
        let precisions = claim_precisions(claims, None);
        let Some(inverse) = (&all.information + precisions).cholesky().map(|all| all.inverse()) else {
            return (all, 1.0);
        };
        let fitted = (&inverse * &all.information).trace();
        let left = all.chi2 - all.score.dot(&(&inverse * &all.score));
        let freedom = all.freedom - fitted;
        /// Minimum degrees of freedom for an estimate of the variance.
        const MIN_FREEDOM: f64 = 20.0;
        let noise = if freedom > MIN_FREEDOM { (left / freedom).max(0.1) } else { 1.0 };
        all.information /= noise;
        all.score /= noise;
        (all, noise)
    }
}

/// Returns the number of sightings of a camera beyond the first one at the same time.
fn crowded(seen: &[Sighting]) -> usize {
    let mut times: Vec<i64> = seen.iter().map(|sighting| sighting.at).collect();
    times.sort_unstable();
    times.windows(2).filter(|pair| pair[0] == pair[1]).count()
}

impl Equations {
    fn zeros(unknowns: usize) -> Self {
        let (information, score) = (DMatrix::zeros(unknowns, unknowns), DVector::zeros(unknowns));
        Self { information, score, chi2: 0.0, freedom: 0.0 }
    }

    /// Adds one moment: the information `H = diag(J' W J) - (J' W) (sum W)^-1 (W J)` and the corresponding
    /// score. `J` are the derivatives of the views, and `W` their weights (inverse covariances). The
    /// residuals are relative to the position from all cameras.
    fn add(&mut self, views: &[View]) {
        let Some((position, weights)) = fused_position(views).filter(|_| views.len() > 1) else { return };
        let Some(shared) = weights.iter().sum::<Matrix2<f64>>().try_inverse() else { return };
        self.freedom += 2.0 * (views.len() as f64 - 1.0);
        for (a, weight) in views.iter().zip(&weights) {
            let residual = a.point - position;
            let by = a.slopes.transpose() * weight;
            self.chi2 += (residual.transpose() * weight * residual).x;
            let mut score = self.score.fixed_rows_mut::<ERROR_PARAMS>(a.camera * ERROR_PARAMS);
            score += by * residual;
            for (b, other) in views.iter().zip(&weights) {
                let mut block = by * shared * other * b.slopes * -1.0;
                if a.camera == b.camera {
                    block += by * a.slopes;
                }
                let mut at = self.information.fixed_view_mut::<ERROR_PARAMS, ERROR_PARAMS>(
                    a.camera * ERROR_PARAMS,
                    b.camera * ERROR_PARAMS,
                );
                at += block;
            }
        }
    }
}

/// Returns the covariance that the calibration of a camera claims for its errors. Each standard deviation is
/// at least 2 mm, 0.0002 rad (0.01°) and 0.02 % of the focal length. A camera without a covariance gets a
/// wide prior.
fn claim(camera: &Camera) -> DMatrix<f64> {
    let least = [0.002, 0.002, 0.002, 0.0002, 0.0002, 0.0002, 0.0002 * camera.focal];
    let unknown = [0.5, 0.5, 0.5, 0.05, 0.05, 0.05, 0.05 * camera.focal];
    let known = camera.covariance.is_known();
    DMatrix::from_fn(ERROR_PARAMS, ERROR_PARAMS, |i, j| {
        let claimed = if known { camera.covariance.0[i][j] } else { 0.0 };
        let own: f64 = if known { least[i] } else { unknown[i] };
        claimed + if i == j { own * own } else { 0.0 }
    })
}

/// Returns the prior precisions (inverse covariances) of the errors of all cameras from their claims. The
/// precisions of the `free` cameras are reduced to almost zero.
fn claim_precisions(claims: &[DMatrix<f64>], free: Option<&[usize]>) -> DMatrix<f64> {
    let mut precisions = DMatrix::zeros(claims.len() * ERROR_PARAMS, claims.len() * ERROR_PARAMS);
    for (camera, claim) in claims.iter().enumerate() {
        let factor = if free.is_some_and(|free| free.contains(&camera)) { 1e-4 } else { 1.0 };
        if let Some(inverse) = claim.clone().try_inverse() {
            precisions
                .view_mut((camera * ERROR_PARAMS, camera * ERROR_PARAMS), (ERROR_PARAMS, ERROR_PARAMS))
                .copy_from(&(inverse * factor));
        }
    }
    precisions
}

/// Result of the test of one camera against the other cameras.
struct CameraTest {
    camera: usize,
    /// Significance of the most significant parameter, in standard deviations.
    significance: f64,
    /// Inverse standard deviation of each error, if it is the only error of the camera.
    inverse_sigmas: [f64; ERROR_PARAMS],
    /// Estimated error of the most significant parameter; the others are zero.
    errors: DVector<f64>,
    covariance: DMatrix<f64>,
}

/// Returns the cameras that contradict their claims, the most significant first. The claim of each such
/// camera is ignored in the following tests.
fn disagreements(equations: &Equations, claims: &[DMatrix<f64>]) -> Vec<CameraTest> {
    let threshold = significance_threshold(equations, claims.len());
    let mut found: Vec<CameraTest> = Vec::new();
    loop {
        let free: Vec<usize> = found.iter().map(|one| one.camera).collect();
        let open = (0..claims.len()).filter(|camera| !free.contains(camera));
        let worst = open
            .filter_map(|camera| test_camera(equations, claims, camera, &free))
            .filter(|one| one.significance > threshold)
            .max_by(|a, b| a.significance.total_cmp(&b.significance));
        match worst {
            Some(worst) => found.push(worst),
            None => return found,
        }
    }
}

/// Returns the significance above which a camera is reported. At most one walk in twenty reports a correct camera.
/// The seven errors of a camera are correlated and count as four independent tests.
fn significance_threshold(equations: &Equations, cameras: usize) -> f64 {
    /// Probability that a walk reports at least one correct camera.
    const FALSE_ALARM_RATE: f64 = 0.05;
    /// Number of independent tests for each camera.
    const INDEPENDENT_TESTS: f64 = 4.0;
    let is_seen =
        |camera: &usize| equations.information[(camera * ERROR_PARAMS, camera * ERROR_PARAMS)] > 0.0;
    let seen = (0..cameras).filter(is_seen).count() as f64;
    two_sided_quantile(FALSE_ALARM_RATE / (INDEPENDENT_TESTS * seen))
}

/// Tests one camera against its claim; the claims of the `free` cameras are ignored.
fn test_camera(
    equations: &Equations,
    claims: &[DMatrix<f64>],
    camera: usize,
    free: &[usize],
) -> Option<CameraTest> {
    /// Smallest information of an eigenvector, relative to its claim; eigenvectors below it are ignored.
    const MIN_INFORMATION_RATIO: f64 = 1e-6;
    let own: Vec<usize> = (camera * ERROR_PARAMS..(camera + 1) * ERROR_PARAMS).collect();
    let others: Vec<usize> = (0..equations.score.len()).filter(|i| !own.contains(i)).collect();
    let mut precisions = claim_precisions(claims, Some(free));
    own.iter().for_each(|&i| own.iter().for_each(|&j| precisions[(i, j)] = 0.0));
    let all = &equations.information + precisions;
    let pick = |rows: &[usize], columns: &[usize]| all.select_rows(rows).select_columns(columns);
    let rest = pick(&others, &others).cholesky()?;
    let cross = pick(&own, &others);
    let information = pick(&own, &own) - &cross * rest.solve(&cross.transpose());
    let score =
        equations.score.select_rows(&own) - &cross * rest.solve(&equations.score.select_rows(&others));
    let root = claims[camera].clone().cholesky()?.l();
    let eigen = (root.transpose() * &information * &root).symmetric_eigen();
    let along = eigen.eigenvectors.transpose() * root.transpose() * &score;
    let by = eigen.eigenvectors.transpose()
        * root.solve_lower_triangular(&DMatrix::identity(ERROR_PARAMS, ERROR_PARAMS))?;
    let filtered = |parameter: usize| {
        let (mut score, mut inverse_sigma) = (0.0, 0.0);
        for (k, &l) in eigen.eigenvalues.iter().enumerate().filter(|(_, l)| **l > MIN_INFORMATION_RATIO) {
            score += by[(k, parameter)] * along[k] / (1.0 + l);
            inverse_sigma += by[(k, parameter)].powi(2) * l / (1.0 + l);
        }
        (score, inverse_sigma.sqrt())
    };
    let filtered: [(f64, f64); ERROR_PARAMS] = std::array::from_fn(filtered);
    let inverse_sigmas = filtered.map(|(_, inverse_sigma)| inverse_sigma);
    // The most significant parameter, with its error and its variance.
    let (mut significance, mut errors, mut covariance) =
        (0.0, DVector::zeros(ERROR_PARAMS), DMatrix::zeros(ERROR_PARAMS, ERROR_PARAMS));
    for (parameter, (score, inverse_sigma)) in
        filtered.into_iter().enumerate().filter(|(_, (_, inverse_sigma))| *inverse_sigma > 0.0)
    {
        if score.abs() / inverse_sigma > significance {
            significance = score.abs() / inverse_sigma;
            (errors, covariance) = (DVector::zeros(ERROR_PARAMS), DMatrix::zeros(ERROR_PARAMS, ERROR_PARAMS));
            errors[parameter] = score / (inverse_sigma * inverse_sigma);
            covariance[(parameter, parameter)] = (inverse_sigma * inverse_sigma).recip();
        }
    }
    Some(CameraTest { camera, significance, inverse_sigmas, errors, covariance })
}

/// Converts the test of a camera to a disagreement, with the mean shift of floor positions from the estimated error.
/// `noise` is the ratio of the measured to the assumed noise variance.
fn to_disagreement(found: &CameraTest, moments: &[(i64, Vec<View>)], noise: f64) -> Disagreement {
    let views = moments.iter().flat_map(|(_, views)| views).filter(|view| view.camera == found.camera);
    let (mut slopes, mut count) = (ErrorJacobian::zeros(), 0.0_f64);
    for view in views {
        slopes += view.slopes;
        count += 1.0;
    }
    let slopes = slopes / count.max(1.0);
    let slopes = DMatrix::from_column_slice(2, ERROR_PARAMS, slopes.as_slice());
    let shift = &slopes * &found.errors;
    let variance = (&slopes * &found.covariance * slopes.transpose()).trace();
    Disagreement {
        camera: found.camera,
        significance: found.significance,
        shift: [shift[0], shift[1]],
        shift_sigma: (0.5 * variance * noise.max(1.0)).sqrt(),
        errors: std::array::from_fn(|i| found.errors[i]),
    }
}

/// Returns the position of the walker at a time, in nanoseconds since 1970, from the views of all cameras.
fn moment(at: i64, views: &[View]) -> Option<WalkMoment> {
    let (position, _) = fused_position(views)?;
    let point = |at: Vector2<f64>| FloorPoint::new(at.x, at.y);
    let seen = views.iter().map(|view| (view.camera, point(view.point))).collect();
    Some(WalkMoment { at, position: point(position), seen })
}
