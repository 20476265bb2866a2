//! Georeference of a site from points with both world and geographic coordinates.
//!
//! Let `e_i` be the position of a point toward east and north of the first point, and `w_i` its position in
//! world axes. `e_i = R(t) w_i + s` with noise `N(0, sigma_i^2)` in each coordinate. The weighted
//! least-squares rotation is `t = atan2(sum_i c_i w'_i x e'_i, sum_i c_i w'_i . e'_i)`, with `c_i = sigma_i^-2`
//! and the positions `w'`, `e'` relative to their weighted means (Kabsch 1976, in the plane). Its variance is
//! `1 / sum_i c_i |w'_i|^2`. The mean has the variance `1 / sum_i c_i`, independent of the rotation.

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
    /// Standard deviations of the origin toward east and north, in metres, and of the azimuth, in radians.
    pub sigmas: [f64; 3],
}

/// Point with its weight: world x and y, then east and north, in metres.
struct Weighted {
    coordinates: [f64; 4],
    weight: f64,
}

impl GeoreferenceFit {
    /// Fits the georeference to at least two points at different places; otherwise `None`.
    #[must_use]
    pub fn new(pairs: &[GeographicPair]) -> Option<Self> {
        let first = pairs.first()?.geographic;
        let plane = TangentPlane::new(Geographic { height: 0.0, ..first }, std::f64::consts::FRAC_PI_2);
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
        let azimuth_variance = square.recip();
        let along = |across: f64| (total.recip() + across * across * azimuth_variance).sqrt();
        Some(Self {
            origin: Geographic { height: 0.0, ..plane.to_geographic(origin.at_height(0.0)) },
            x_axis_azimuth: std::f64::consts::FRAC_PI_2 - turn,
            sigmas: [along(rotated[1]), along(rotated[0]), azimuth_variance.sqrt()],
        })
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
            for (square, (error, sigma)) in squares.iter_mut().zip(errors.iter().zip(found.sigmas)) {
                *square += (error / sigma).powi(2) / f64::from(TRIALS);
            }
        }
        assert!(squares.iter().all(|square| (0.9..1.1).contains(square)), "{squares:?}");
    }
}
