//! Georeference of a site from points with both world and geographic coordinates.
//!
//! Let `e_i` be the position of a point toward east and north of the first point, and `w_i` its position in
//! world axes. `e_i = R(t) w_i + s` with noise `N(0, sigma_i^2)` in each coordinate. The weighted
//! least-squares rotation is `t = atan2(sum_i c_i w'_i x e'_i, sum_i c_i w'_i . e'_i)`, with `c_i = sigma_i^-2`
//! and the positions `w'`, `e'` relative to their weighted means (Kabsch 1976, in the plane). Its variance is
//! `1 / sum_i c_i |w'_i|^2`. The mean has the variance `1 / sum_i c_i`, independent of the rotation.
//!
//! If the world positions have errors, too, with the joint covariance C, the residuals `e_i - R(t) w_i - s` have
//! the covariance `R C R^T + diag(sigma_i^2)`. The generalized least-squares estimate is iterated from the
//! estimate above. If C comes from a joint solve, a joint solve with these points would give the same result.

use nalgebra::{DMatrix, DVector, Matrix3};

use super::tangent_plane::{Geographic, TangentPlane};
use crate::camera::FloorPoint;

/// Point with world and geographic coordinates.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GeographicPair {
    /// World coordinates, in metres.
    pub world: FloorPoint,
    /// Geographic coordinates.
    pub geographic: Geographic,
    /// Standard deviation of each geographic coordinate, in metres.
    pub sigma: f64,
}

/// Georeference with standard deviations.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GeoreferenceFit {
    /// Geographic coordinates of world (0, 0), on the ellipsoid.
    pub origin: Geographic,
    /// Azimuth of world +x, clockwise from north, in radians.
    pub x_axis_azimuth: f64,
    /// Covariance of the origin toward east and north (metres), and of the azimuth (radians).
    pub covariance: [[f64; 3]; 3],
}

/// Returns the covariance of the geographic position of a world point, in square metres. Rows and columns are east
/// and north. Only the errors of the georeference are included: `covariance` is [`GeoreferenceFit::covariance`], and
/// `azimuth` is the azimuth of world +x, in radians.
///
/// With the point at (e, n) from the world origin, `d(east) = d(east_0) + n da` and `d(north) = d(north_0) - e da`.
#[must_use]
pub fn georeference_covariance(covariance: &[[f64; 3]; 3], azimuth: f64, point: FloorPoint) -> [[f64; 2]; 2] {
    let (sin, cos) = azimuth.sin_cos();
    let (east, north) = (sin * point.x - cos * point.y, cos * point.x + sin * point.y);
    let by = [[1.0, 0.0, north], [0.0, 1.0, -east]];
    std::array::from_fn(|i| {
        std::array::from_fn(|j| {
            let row = |k: usize| (0..3).map(|l| covariance[k][l] * by[j][l]).sum::<f64>();
            (0..3).map(|k| by[i][k] * row(k)).sum()
        })
    })
}

/// Number of iterations of the generalized least squares. The start differs from the result by less than the
/// noise.
const ITERATIONS: usize = 4;

/// Point with its weight. The coordinates are world x and y, then east and north, in metres.
struct Weighted {
    coordinates: [f64; 4],
    weight: f64,
}

impl GeoreferenceFit {
    /// Fits the georeference to at least two points at different places; otherwise `None`.
    #[must_use]
    pub fn new(pairs: &[GeographicPair]) -> Option<Self> {
        /// Number of repetitions of the fit. Each uses the tangent plane at the last estimate of the origin.
        /// Meridians converge, so north at another point differs from north at the origin.
        const REPETITIONS: usize = 3;
        let mut found = Self::in_plane(pairs, pairs.first()?.geographic)?;
        for _ in 0..REPETITIONS {
            found = Self::in_plane(pairs, found.origin)?;
        }
        Some(found)
    }

    /// Fits the georeference in the plane that touches the ellipsoid at `touching`.
    fn in_plane(pairs: &[GeographicPair], touching: Geographic) -> Option<Self> {
        let plane = TangentPlane::new(Geographic { height: 0.0, ..touching }, std::f64::consts::FRAC_PI_2);
        let weighted = |pair: &GeographicPair| {
            let at = plane.to_world(Geographic { height: 0.0, ..pair.geographic });
            Weighted { coordinates: [pair.world.x, pair.world.y, at.x, at.y], weight: pair.sigma.powi(-2) }
        };
        let points: Vec<Weighted> = pairs.iter().map(weighted).collect();
        let total: f64 = points.iter().map(|point| point.weight).sum();
        let means: [f64; 4] = std::array::from_fn(|k| {
            points.iter().map(|point| point.weight * point.coordinates[k]).sum::<f64>() / total
        });
        let ([world_x, world_y], earth) = ([means[0], means[1]], [means[2], means[3]]);
        let (mut cross, mut dot, mut square) = (0.0, 0.0, 0.0);
        for Weighted { coordinates, weight } in &points {
            let [x, y, east, north] = std::array::from_fn(|k| coordinates[k] - means[k]);
            cross += weight * (x * north - y * east);
            dot += weight * (x * east + y * north);
            square += weight * (x * x + y * y);
        }
        // Points at one place do not determine the rotation.
        if !(total.is_finite() && square.is_finite() && square > 1e-9 && cross.hypot(dot) > 0.0) {
            return None;
        }
        let turn = cross.atan2(dot);
        let (sin, cos) = turn.sin_cos();
        let rotated = [cos * world_x - sin * world_y, sin * world_x + cos * world_y];
        let origin = FloorPoint { x: earth[0] - rotated[0], y: earth[1] - rotated[1] };
        // An error of the azimuth rotates the origin about the mean.
        let azimuth_variance = square.recip();
        let by_azimuth = [-rotated[1], rotated[0], 1.0];
        let of_mean = total.recip();
        let covariance = std::array::from_fn(|i| {
            std::array::from_fn(|j| {
                let own = if i == j && i < 2 { of_mean } else { 0.0 };
                own + by_azimuth[i] * by_azimuth[j] * azimuth_variance
            })
        });
        Some(Self {
            origin: Geographic { height: 0.0, ..plane.to_geographic(origin.at_height(0.0)) },
            x_axis_azimuth: std::f64::consts::FRAC_PI_2 - turn,
            covariance,
        })
    }

    /// Fits the georeference to points whose world coordinates have errors.
    ///
    /// `world_covariance` is the joint covariance of the world coordinates (x and y of the first point, then of
    /// the next), in square metres. Returns `None` with fewer than two points at different places, or if the
    /// covariance has another size or is not positive definite.
    #[must_use]
    pub fn with_world_errors(pairs: &[GeographicPair], world_covariance: &DMatrix<f64>) -> Option<Self> {
        let size = 2 * pairs.len();
        if world_covariance.shape() != (size, size) {
            return None;
        }
        let first = Self::new(pairs)?;
        // Coordinates toward east and north from the first estimate of the world origin.
        let plane = TangentPlane::new(first.origin, std::f64::consts::FRAC_PI_2);
        let earth: Vec<[f64; 2]> = pairs
            .iter()
            .map(|pair| plane.to_world(Geographic { height: 0.0, ..pair.geographic }))
            .map(|at| [at.x, at.y])
            .collect();
        let [mut east, mut north] = [0.0; 2];
        let mut turn = std::f64::consts::FRAC_PI_2 - first.x_axis_azimuth;
        let mut covariance = Matrix3::zeros();
        for _ in 0..ITERATIONS {
            let (sin, cos) = turn.sin_cos();
            let mut rotation = DMatrix::zeros(size, size);
            let (mut residuals, mut by) = (DVector::zeros(size), DMatrix::zeros(size, 3));
            for (i, (pair, at)) in pairs.iter().zip(&earth).enumerate() {
                let FloorPoint { x, y } = pair.world;
                let rotated = [cos * x - sin * y, sin * x + cos * y];
                let rows = [[cos, -sin], [sin, cos]];
                for k in 0..2 {
                    residuals[2 * i + k] = at[k] - rotated[k] - [east, north][k];
                    by[(2 * i + k, k)] = 1.0;
                    by[(2 * i + k, 2)] = [-rotated[1], rotated[0]][k];
                    (0..2).for_each(|j| rotation[(2 * i + k, 2 * i + j)] = rows[k][j]);
                }
            }
            let mut noise = &rotation * world_covariance * rotation.transpose();
            for (i, pair) in pairs.iter().enumerate() {
                (0..2).for_each(|k| noise[(2 * i + k, 2 * i + k)] += pair.sigma * pair.sigma);
            }
            let factor = noise.cholesky()?;
            let weighted = factor.solve(&by);
            let information = by.transpose() * &weighted;
            covariance = Matrix3::from_fn(|i, j| information[(i, j)]).try_inverse()?;
            let gradient = weighted.transpose() * residuals;
            let step = covariance * nalgebra::Vector3::from_fn(|i, _| gradient[i]);
            east += step[0];
            north += step[1];
            turn += step[2];
        }
        if !covariance.iter().all(|value| value.is_finite()) {
            return None;
        }
        // The azimuth runs clockwise, the angle of the estimate counter-clockwise.
        let sign = |k: usize| if k == 2 { -1.0 } else { 1.0 };
        let origin = FloorPoint { x: east, y: north };
        Some(Self {
            origin: Geographic { height: 0.0, ..plane.to_geographic(origin.at_height(0.0)) },
            x_axis_azimuth: std::f64::consts::FRAC_PI_2 - turn,
            covariance: std::array::from_fn(|i| {
                std::array::from_fn(|j| sign(i) * sign(j) * covariance[(i, j)])
            }),
        })
    }

    /// Returns, for every point, the distance between its geographic coordinates and its world coordinates
    /// under this georeference, in metres.
    #[must_use]
    pub fn distances(&self, pairs: &[GeographicPair]) -> Vec<f64> {
        let plane = TangentPlane::new(self.origin, self.x_axis_azimuth);
        let distance = |pair: &GeographicPair| {
            plane.to_world(Geographic { height: 0.0, ..pair.geographic }).on_floor().distance(pair.world)
        };
        pairs.iter().map(distance).collect()
    }

    /// Returns the standard deviations of the origin toward east and north, in metres, and of the azimuth, in
    /// radians.
    #[must_use]
    pub fn sigmas(&self) -> [f64; 3] {
        std::array::from_fn(|k| self.covariance[k][k].sqrt())
    }
}

#[cfg(test)]
mod tests {
    use rand::{Rng as _, SeedableRng as _};
    use rand_chacha::ChaCha8Rng;

    use super::*;

    fn truth() -> (Geographic, f64) {
        let origin = Geographic { latitude: 0.84, longitude: 0.2, height: 0.0 };
        (origin, 0.9)
    }

    fn pairs(random: &mut ChaCha8Rng, sigmas: &[f64]) -> Vec<GeographicPair> {
        let (origin, azimuth) = truth();
        let plane = TangentPlane::new(origin, azimuth);
        let mut normal = || (0..12).map(|_| random.random_range(-0.5..0.5_f64)).sum::<f64>();
        let pair = |&sigma: &f64| {
            let world = FloorPoint { x: 60.0 + 40.0 * normal(), y: 40.0 * normal() };
            let noisy = FloorPoint { x: world.x + sigma * normal(), y: world.y + sigma * normal() };
            GeographicPair { world, geographic: plane.to_geographic(noisy.at_height(0.0)), sigma }
        };
        sigmas.iter().map(pair).collect()
    }

    #[test]
    fn exact_points_give_the_georeference_exactly() {
        let mut random = ChaCha8Rng::seed_from_u64(1);
        let exact: Vec<GeographicPair> = pairs(&mut random, &[0.0; 3])
            .into_iter()
            .map(|pair| GeographicPair { sigma: 0.1, ..pair })
            .collect();
        let found = GeoreferenceFit::new(&exact).unwrap();
        let (origin, azimuth) = truth();
        let off = TangentPlane::new(origin, 0.0).to_world(found.origin);
        assert!(off.x.hypot(off.y) < 1e-3 && (found.x_axis_azimuth - azimuth).abs() < 1e-5, "{found:?}");
        assert_eq!(GeoreferenceFit::new(&exact[..1]), None);
    }

    #[test]
    fn errors_with_common_world_errors_are_as_large_as_stated() {
        let mut random = ChaCha8Rng::seed_from_u64(3);
        let (origin, azimuth) = truth();
        let north_up = TangentPlane::new(origin, std::f64::consts::FRAC_PI_2);
        let sigmas = [0.5, 0.5, 1.0, 2.0];
        // A common shift, a rotation, and independent noise.
        let [common, turned, own] = [1.0, 0.02, 0.3];
        let mut squares = [0.0; 3];
        const TRIALS: u32 = 2_000;
        for _ in 0..TRIALS {
            let mut pairs = pairs(&mut random, &sigmas);
            let mut normal = || (0..12).map(|_| random.random_range(-0.5..0.5_f64)).sum::<f64>();
            let ([dx, dy], turn) = ([common * normal(), common * normal()], turned * normal());
            let mut modes = DMatrix::zeros(2 * pairs.len(), 3);
            for (i, pair) in pairs.iter_mut().enumerate() {
                let FloorPoint { x, y } = pair.world;
                modes[(2 * i, 0)] = common;
                modes[(2 * i + 1, 1)] = common;
                (modes[(2 * i, 2)], modes[(2 * i + 1, 2)]) = (-turned * y, turned * x);
                pair.world = FloorPoint {
                    x: x + dx - turn * y + own * normal(),
                    y: y + dy + turn * x + own * normal(),
                };
            }
            let mut covariance = &modes * modes.transpose();
            covariance.fill_diagonal(0.0);
            let variances: Vec<f64> = modes.row_iter().map(|row| row.norm_squared() + own * own).collect();
            variances.into_iter().enumerate().for_each(|(i, variance)| covariance[(i, i)] = variance);
            let found = GeoreferenceFit::with_world_errors(&pairs, &covariance).unwrap();
            let off = north_up.to_world(found.origin);
            let errors = [off.x, off.y, found.x_axis_azimuth - azimuth];
            for (square, (error, sigma)) in squares.iter_mut().zip(errors.iter().zip(found.sigmas())) {
                *square += (error / sigma).powi(2) / f64::from(TRIALS);
            }
        }
        assert!(squares.iter().all(|square| (0.9..1.1).contains(square)), "{squares:?}");
    }

    #[test]
    fn exact_world_coordinates_need_no_covariance() {
        let mut random = ChaCha8Rng::seed_from_u64(4);
        let pairs = pairs(&mut random, &[4.0, 0.5, 2.0]);
        let direct = GeoreferenceFit::new(&pairs).unwrap();
        let general = GeoreferenceFit::with_world_errors(&pairs, &DMatrix::zeros(6, 6)).unwrap();
        assert!((direct.x_axis_azimuth - general.x_axis_azimuth).abs() < 1e-9);
        for (a, b) in direct.covariance.as_flattened().iter().zip(general.covariance.as_flattened()) {
            assert!((a - b).abs() < 1e-6 * (1e-3 + a.abs()), "{direct:?} {general:?}");
        }
    }

    #[test]
    fn errors_are_as_large_as_stated() {
        let mut random = ChaCha8Rng::seed_from_u64(2);
        let (origin, azimuth) = truth();
        let north_up = TangentPlane::new(origin, std::f64::consts::FRAC_PI_2);
        let mut squares = [0.0; 3];
        const TRIALS: u32 = 2_000;
        for _ in 0..TRIALS {
            let found = GeoreferenceFit::new(&pairs(&mut random, &[4.0, 4.0, 0.5, 0.5, 2.0])).unwrap();
            let off = north_up.to_world(found.origin);
            let errors = [off.x, off.y, found.x_axis_azimuth - azimuth];
            for (square, (error, sigma)) in squares.iter_mut().zip(errors.iter().zip(found.sigmas())) {
                *square += (error / sigma).powi(2) / f64::from(TRIALS);
            }
        }
        assert!(squares.iter().all(|square| (0.9..1.1).contains(square)), "{squares:?}");
    }
}
