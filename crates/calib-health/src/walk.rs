//! An acceptance test: one person walks through a site, and cameras that see them at the same times are held against
//! each other and against what they claim of themselves.
//!
//! A camera c puts the walker, who is at `p` at a moment, at `pc = p + Jc ec + n`: `ec` its errors, of which its calibration
//! claims the covariance `Cc`, and `n` the noise of the foot. With `p` eliminated the errors of all cameras have normal
//! equations; those of the others, held by their claims, are eliminated from those of one. What is left is `u = I ec +
//! noise` of the variance `I`, so that `u` is of the variance `S = I + I Cc I` where the claim holds. A fault is of one
//! parameter, mostly: of an error `d` of the parameter `k` the score is `I d ek`, and the matched filter `ek' I S^-1 u` over
//! its standard deviation is the clearest that can be said of it, a normal number where the claim holds. With `Cc = L L'`
//! and `L' I L = Q diag(l) Q'` it is computed direction by direction.

use nalgebra::{DMatrix, DVector, Matrix2, Vector2};

use crate::stature::Sighting;
use crate::views::{ERRORS, Errors, View, interpolated, of_one, place_of, view};
use calib_core::camera::{Camera, FloorPoint};
use calib_core::optimize::two_sided_quantile;

/// Seconds between moments: so far apart, feet err by themselves.
const STEP: f64 = 0.5;
/// Most sightings of a camera: two days of them.
const MOST: usize = 400_000;

/// Takes the sightings of a walk.
#[derive(Clone, Debug)]
pub struct Walk {
    cameras: Vec<(Camera, [f64; 2])>,
    seen: Vec<Vec<Sighting>>,
}

/// A camera that is not where it claims to be.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Disagreement {
    /// Index of the camera.
    pub camera: usize,
    /// How clear it is: as the sigmas of a normal number.
    pub sigmas_clear: f64,
    /// By how much it puts the walker too far along x and y, in metres, on average.
    pub shift: [f64; 2],
    /// The standard deviation of either.
    pub shift_sigma: f64,
    /// The error of one parameter that explains most of it, the others zero: of x, y and z in metres, of yaw, pitch and
    /// roll in radians, of the focal in pixels.
    pub errors: [f64; ERRORS],
}

/// Where the walker was at one moment.
#[derive(Clone, Debug, PartialEq)]
pub struct WalkMoment {
    /// Nanoseconds since 1970.
    pub at: i64,
    /// Where all cameras together put them.
    pub place: FloorPoint,
    /// By index, the cameras that saw them, and where each of them puts them.
    pub seen: Vec<(usize, FloorPoint)>,
}

/// What the walk shows.
#[derive(Clone, Debug, PartialEq)]
pub struct WalkResult {
    /// In order of time.
    pub moments: Vec<WalkMoment>,
    /// The worst first.
    pub disagreements: Vec<Disagreement>,
    /// Moments at which a camera saw the walker together with another.
    pub together: Vec<usize>,
    /// Moments at which a camera saw the walker.
    pub seen: Vec<usize>,
    /// Errors of every camera that would have been named, each by itself, in the order and units of
    /// [`Disagreement::errors`]; infinite where the walk tells nothing.
    pub smallest: Vec<[f64; ERRORS]>,
    /// How many times as large as usual the variance of feet was.
    pub noise: f64,
    /// Of every camera, how often it saw more than one person at a time: a walk is of one.
    pub crowded: Vec<usize>,
}

/// Normal equations of the errors of all cameras.
struct Equations {
    information: DMatrix<f64>,
    score: DVector<f64>,
    /// Of what cameras disagree by, before anything is fitted.
    chi2: f64,
    freedom: f64,
}

impl Walk {
    /// A walk before cameras with images of these widths and heights.
    #[must_use]
    pub fn new(cameras: &[(Camera, [f64; 2])]) -> Self {
        Self { cameras: cameras.to_vec(), seen: vec![Vec::new(); cameras.len()] }
    }

    /// Takes what a camera saw.
    pub fn see(&mut self, sighting: &Sighting) {
        if let (Some(seen), Some((_, size))) =
            (self.seen.get_mut(sighting.camera), self.cameras.get(sighting.camera))
            && seen.len() < MOST
            && !sighting.is_cut(*size)
        {
            seen.push(*sighting);
        }
    }

    /// What the walk shows.
    #[must_use]
    pub fn result(&self) -> WalkResult {
        let moments = self.moments();
        let claims: Vec<DMatrix<f64>> = self.cameras.iter().map(|(camera, _)| claim(camera)).collect();
        let (equations, noise) = self.equations(&moments, &claims);
        let disagreements = disagreements(&equations, &claims);
        let disagreements =
            disagreements.into_iter().map(|found| described(&found, &moments, noise)).collect();
        let count = |camera: usize, least: usize| {
            let is_in = |(_, views): &&(i64, Vec<View>)| {
                views.len() >= least && views.iter().any(|view| view.camera == camera)
            };
            moments.iter().filter(is_in).count()
        };
        let all = 0..self.cameras.len();
        let enough = clear_enough(&equations, claims.len());
        let smallest = |camera: usize| {
            let told = tested(&equations, &claims, camera, &[]).map_or([0.0; ERRORS], |found| found.told);
            told.map(|told| enough / told)
        };
        WalkResult {
            smallest: all.clone().map(smallest).collect(),
            disagreements,
            together: all.clone().map(|camera| count(camera, 2)).collect(),
            seen: all.map(|camera| count(camera, 1)).collect(),
            noise,
            crowded: self.seen.iter().map(|seen| crowded(seen)).collect(),
            moments: moments.iter().filter_map(|(at, views)| moment(*at, views)).collect(),
        }
    }

    /// Who saw the walker at moments that are [`STEP`] apart.
    fn moments(&self) -> Vec<(i64, Vec<View>)> {
        let step = (STEP * 1e9) as i64;
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
            .map(|(at, views)| (at, of_one(views)))
            .filter(|(_, views)| !views.is_empty())
            .collect()
    }

    /// The normal equations, and how many times as large as usual the variance of feet was: what the cameras still
    /// disagree by when their likeliest errors are taken out.
    fn equations(&self, moments: &[(i64, Vec<View>)], claims: &[DMatrix<f64>]) -> (Equations, f64) {
        let mut all = Equations::nothing(self.cameras.len() * ERRORS);
        moments.iter().for_each(|(_, views)| all.add(views));
        let held = held(claims, None);
        let Some(inverse) = (&all.information + held).cholesky().map(|all| all.inverse()) else {
            return (all, 1.0);
        };
        let fitted = (&inverse * &all.information).trace();
        let left = all.chi2 - all.score.dot(&(&inverse * &all.score));
        let freedom = all.freedom - fitted;
        /// Fewer moments tell no variance.
        const LEAST: f64 = 20.0;
        let noise = if freedom > LEAST { (left / freedom).max(0.1) } else { 1.0 };
        all.information /= noise;
        all.score /= noise;
        (all, noise)
    }
}

/// How many sightings of a camera are of a time that another one has.
fn crowded(seen: &[Sighting]) -> usize {
    let mut times: Vec<i64> = seen.iter().map(|sighting| sighting.at).collect();
    times.sort_unstable();
    times.windows(2).filter(|pair| pair[0] == pair[1]).count()
}

impl Equations {
    fn nothing(unknowns: usize) -> Self {
        let (information, score) = (DMatrix::zeros(unknowns, unknowns), DVector::zeros(unknowns));
        Self { information, score, chi2: 0.0, freedom: 0.0 }
    }

    /// One moment: `H = diag(J' W J) - (J' W) (sum W)^-1 (W J)`, and the same of the score, about the place that all
    /// cameras together give.
    fn add(&mut self, views: &[View]) {
        let Some((place, weights)) = place_of(views).filter(|_| views.len() > 1) else { return };
        let Some(shared) = weights.iter().sum::<Matrix2<f64>>().try_inverse() else { return };
        self.freedom += 2.0 * (views.len() as f64 - 1.0);
        for (a, weight) in views.iter().zip(&weights) {
            let residual = a.point - place;
            let by = a.slopes.transpose() * weight;
            self.chi2 += (residual.transpose() * weight * residual).x;
            let mut score = self.score.fixed_rows_mut::<ERRORS>(a.camera * ERRORS);
            score += by * residual;
            for (b, other) in views.iter().zip(&weights) {
                let mut block = by * shared * other * b.slopes * -1.0;
                if a.camera == b.camera {
                    block += by * a.slopes;
                }
                let mut at =
                    self.information.fixed_view_mut::<ERRORS, ERRORS>(a.camera * ERRORS, b.camera * ERRORS);
                at += block;
            }
        }
    }
}

/// What a camera claims of its errors: the covariance. Nobody knows a camera better than to two millimetres, a
/// hundredth of a degree and as small a share of the focal; of one that says nothing, little is assumed.
fn claim(camera: &Camera) -> DMatrix<f64> {
    let least = [0.002, 0.002, 0.002, 0.0002, 0.0002, 0.0002, 0.0002 * camera.focal];
    let unknown = [0.5, 0.5, 0.5, 0.05, 0.05, 0.05, 0.05 * camera.focal];
    let known = camera.covariance.is_known();
    DMatrix::from_fn(ERRORS, ERRORS, |i, j| {
        let claimed = if known { camera.covariance.0[i][j] } else { 0.0 };
        let own: f64 = if known { least[i] } else { unknown[i] };
        claimed + if i == j { own * own } else { 0.0 }
    })
}

/// Precisions of all errors by the claims; `free` claims nothing.
fn held(claims: &[DMatrix<f64>], free: Option<&[usize]>) -> DMatrix<f64> {
    let mut held = DMatrix::zeros(claims.len() * ERRORS, claims.len() * ERRORS);
    for (camera, claim) in claims.iter().enumerate() {
        let factor = if free.is_some_and(|free| free.contains(&camera)) { 1e-4 } else { 1.0 };
        if let Some(inverse) = claim.clone().try_inverse() {
            held.view_mut((camera * ERRORS, camera * ERRORS), (ERRORS, ERRORS))
                .copy_from(&(inverse * factor));
        }
    }
    held
}

/// A camera that disagrees with the others.
struct Found {
    camera: usize,
    clear: f64,
    /// The inverse of the standard deviation with which each error is told by itself.
    told: [f64; ERRORS],
    errors: DVector<f64>,
    covariance: DMatrix<f64>,
}

/// Cameras that do not keep what they claim: the one that explains most first, and then without it.
fn disagreements(equations: &Equations, claims: &[DMatrix<f64>]) -> Vec<Found> {
    let clear = clear_enough(equations, claims.len());
    let mut found: Vec<Found> = Vec::new();
    loop {
        let free: Vec<usize> = found.iter().map(|one| one.camera).collect();
        let open = (0..claims.len()).filter(|camera| !free.contains(camera));
        let worst = open
            .filter_map(|camera| tested(equations, claims, camera, &free))
            .filter(|one| one.clear > clear)
            .max_by(|a, b| a.clear.total_cmp(&b.clear));
        match worst {
            Some(worst) => found.push(worst),
            None => return found,
        }
    }
}

/// How clear a disagreement must be: one walk in twenty may accuse one of all the cameras that are right, of one of its
/// errors, of which seven that hang together are as many as four.
fn clear_enough(equations: &Equations, cameras: usize) -> f64 {
    const FALSE: f64 = 0.05;
    const TRIALS: f64 = 4.0;
    let is_seen = |camera: &usize| equations.information[(camera * ERRORS, camera * ERRORS)] > 0.0;
    let seen = (0..cameras).filter(is_seen).count() as f64;
    two_sided_quantile(FALSE / (TRIALS * seen))
}

/// One camera against what it claims; `free` are those of which nothing is claimed.
fn tested(equations: &Equations, claims: &[DMatrix<f64>], camera: usize, free: &[usize]) -> Option<Found> {
    /// Directions of which the walk tells less of what is claimed say nothing.
    const TOLD: f64 = 1e-6;
    let own: Vec<usize> = (camera * ERRORS..(camera + 1) * ERRORS).collect();
    let others: Vec<usize> = (0..equations.score.len()).filter(|i| !own.contains(i)).collect();
    let mut held = held(claims, Some(free));
    own.iter().for_each(|&i| own.iter().for_each(|&j| held[(i, j)] = 0.0));
    let all = &equations.information + held;
    let pick = |rows: &[usize], columns: &[usize]| all.select_rows(rows).select_columns(columns);
    let rest = pick(&others, &others).cholesky()?;
    let cross = pick(&own, &others);
    let information = pick(&own, &own) - &cross * rest.solve(&cross.transpose());
    let score =
        equations.score.select_rows(&own) - &cross * rest.solve(&equations.score.select_rows(&others));
    let root = claims[camera].clone().cholesky()?.l();
    let eigen = (root.transpose() * &information * &root).symmetric_eigen();
    let along = eigen.eigenvectors.transpose() * root.transpose() * &score;
    let by =
        eigen.eigenvectors.transpose() * root.solve_lower_triangular(&DMatrix::identity(ERRORS, ERRORS))?;
    let filtered = |parameter: usize| {
        let (mut score, mut told) = (0.0, 0.0);
        for (k, &l) in eigen.eigenvalues.iter().enumerate().filter(|(_, l)| **l > TOLD) {
            score += by[(k, parameter)] * along[k] / (1.0 + l);
            told += by[(k, parameter)].powi(2) * l / (1.0 + l);
        }
        (score, told.sqrt())
    };
    let filtered: [(f64, f64); ERRORS] = std::array::from_fn(filtered);
    let told = filtered.map(|(_, told)| told);
    // The one parameter that says most: by how much it is off, and how surely.
    let (mut clear, mut errors, mut covariance) =
        (0.0, DVector::zeros(ERRORS), DMatrix::zeros(ERRORS, ERRORS));
    for (parameter, (score, told)) in filtered.into_iter().enumerate().filter(|(_, (_, told))| *told > 0.0) {
        if score.abs() / told > clear {
            clear = score.abs() / told;
            (errors, covariance) = (DVector::zeros(ERRORS), DMatrix::zeros(ERRORS, ERRORS));
            errors[parameter] = score / (told * told);
            covariance[(parameter, parameter)] = (told * told).recip();
        }
    }
    Some(Found { camera, clear, told, errors, covariance })
}

/// A disagreement as what it does on the floor.
fn described(found: &Found, moments: &[(i64, Vec<View>)], noise: f64) -> Disagreement {
    let views = moments.iter().flat_map(|(_, views)| views).filter(|view| view.camera == found.camera);
    let (mut slopes, mut count) = (Errors::zeros(), 0.0_f64);
    for view in views {
        slopes += view.slopes;
        count += 1.0;
    }
    let slopes = slopes / count.max(1.0);
    let slopes = DMatrix::from_column_slice(2, ERRORS, slopes.as_slice());
    let shift = &slopes * &found.errors;
    let variance = (&slopes * &found.covariance * slopes.transpose()).trace();
    Disagreement {
        camera: found.camera,
        sigmas_clear: found.clear,
        shift: [shift[0], shift[1]],
        shift_sigma: (0.5 * variance * noise.max(1.0)).sqrt(),
        errors: std::array::from_fn(|i| found.errors[i]),
    }
}

fn moment(at: i64, views: &[View]) -> Option<WalkMoment> {
    let (place, _) = place_of(views)?;
    let point = |at: Vector2<f64>| FloorPoint::new(at.x, at.y);
    let seen = views.iter().map(|view| (view.camera, point(view.point))).collect();
    Some(WalkMoment { at, place: point(place), seen })
}
