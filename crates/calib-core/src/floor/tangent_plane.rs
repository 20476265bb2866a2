//! Geographic coordinates of a site: the plane that touches the WGS84 ellipsoid at world (0, 0).
//!
//! World axes are rotated about the vertical from east and north, and have scale 1. Coordinates are converted
//! through earth-centred coordinates, so they are exact at any distance. A projected grid has a scale factor and
//! a convergence, and is not a tangent plane.
//!
//! Source: B. Hofmann-Wellenhof, H. Lichtenegger and E. Wasle, "GNSS", 2008, section 8.2. The latitude of a point
//! is computed by the method of B. R. Bowring, "Transformation from spatial to geographical coordinates", Survey
//! Review 23, 1976.

use crate::camera::{FloorPoint, WorldPoint, sin_cos};

/// Semi-major axis of the ellipsoid, in metres.
const SEMI_MAJOR_AXIS: f64 = 6_378_137.0;
/// Flattening of the ellipsoid.
const FLATTENING: f64 = 1.0 / 298.257_223_563;
/// Semi-minor axis of the ellipsoid, in metres.
const SEMI_MINOR_AXIS: f64 = SEMI_MAJOR_AXIS * (1.0 - FLATTENING);
/// Squared eccentricity of the ellipsoid.
const ECCENTRICITY_2: f64 = FLATTENING * (2.0 - FLATTENING);

/// Point in geographic coordinates of WGS84.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Geographic {
    /// Latitude, in radians, positive to the north.
    pub latitude: f64,
    /// Longitude, in radians, positive to the east.
    pub longitude: f64,
    /// Height above the ellipsoid, in metres. It is not the height above sea level.
    pub height: f64,
}

impl Geographic {
    /// Returns the earth-centred coordinates, in metres: x toward longitude 0, z toward the north pole.
    fn earth_centred(self) -> [f64; 3] {
        let ((sin, cos), (sin_lon, cos_lon)) = (sin_cos(self.latitude), sin_cos(self.longitude));
        let normal = SEMI_MAJOR_AXIS / (1.0 - ECCENTRICITY_2 * sin * sin).sqrt();
        let level = (normal + self.height) * cos;
        [level * cos_lon, level * sin_lon, (normal * (1.0 - ECCENTRICITY_2) + self.height) * sin]
    }

    /// Returns the point with these earth-centred coordinates.
    fn from_earth_centred([x, y, z]: [f64; 3]) -> Self {
        /// Number of iterations. The error of the latitude decreases by a factor of 1e-9 in each.
        const ITERATIONS: usize = 3;
        let level = x.hypot(y);
        let second_eccentricity_2 = ECCENTRICITY_2 / (1.0 - ECCENTRICITY_2);
        // Latitude on a sphere that is stretched to the ellipsoid.
        let mut reduced = (z * SEMI_MAJOR_AXIS).atan2(level * SEMI_MINOR_AXIS);
        let mut latitude = reduced;
        for _ in 0..ITERATIONS {
            let (sin, cos) = sin_cos(reduced);
            latitude = (z + second_eccentricity_2 * SEMI_MINOR_AXIS * sin.powi(3))
                .atan2(level - ECCENTRICITY_2 * SEMI_MAJOR_AXIS * cos.powi(3));
            let (sin, cos) = sin_cos(latitude);
            reduced = (SEMI_MINOR_AXIS * sin).atan2(SEMI_MAJOR_AXIS * cos);
        }
        let (sin, cos) = sin_cos(latitude);
        let height = level * cos + z * sin - SEMI_MAJOR_AXIS * (1.0 - ECCENTRICITY_2 * sin * sin).sqrt();
        Self { latitude, longitude: y.atan2(x), height }
    }
}

/// Floor plane through the world origin, parallel to the tangent plane of the WGS84 ellipsoid there.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TangentPlane {
    /// Earth-centred coordinates of the world origin, in metres.
    origin: [f64; 3],
    /// Unit vectors of world x, y and z in earth-centred coordinates.
    axes: [[f64; 3]; 3],
    /// Sine and cosine of the azimuth of world +x.
    azimuth: (f64, f64),
    /// Height of the floor above the ellipsoid, in metres.
    height: f64,
}

impl TangentPlane {
    /// Creates the plane at the world origin. `x_axis_azimuth` is the direction of world +x, in radians
    /// clockwise from north.
    #[must_use]
    pub fn new(origin: Geographic, x_axis_azimuth: f64) -> Self {
        let ((sin, cos), (sin_lon, cos_lon)) = (sin_cos(origin.latitude), sin_cos(origin.longitude));
        let east = [-sin_lon, cos_lon, 0.0];
        let north = [-sin * cos_lon, -sin * sin_lon, cos];
        let up = [cos * cos_lon, cos * sin_lon, sin];
        let (sin, cos) = sin_cos(x_axis_azimuth);
        let x = std::array::from_fn(|i| sin * east[i] + cos * north[i]);
        let y = std::array::from_fn(|i| -cos * east[i] + sin * north[i]);
        Self { origin: origin.earth_centred(), axes: [x, y, up], azimuth: (sin, cos), height: origin.height }
    }

    /// Maps a world point to geographic coordinates.
    #[must_use]
    pub fn to_geographic(&self, WorldPoint { x, y, z }: WorldPoint) -> Geographic {
        let [along_x, along_y, up] = self.axes;
        Geographic::from_earth_centred(std::array::from_fn(|i| {
            self.origin[i] + x * along_x[i] + y * along_y[i] + z * up[i]
        }))
    }

    /// Maps geographic coordinates to a world point.
    #[must_use]
    pub fn to_world(&self, point: Geographic) -> WorldPoint {
        let at = point.earth_centred();
        let offset: [f64; 3] = std::array::from_fn(|i| at[i] - self.origin[i]);
        let [x, y, z] = self.axes.map(|axis| (0..3).map(|i| axis[i] * offset[i]).sum());
        WorldPoint { x, y, z }
    }

    /// Returns the floor point at a latitude and longitude, in degrees. The point is assumed to be on the floor.
    #[must_use]
    pub fn floor_of_degrees(&self, [latitude, longitude]: [f64; 2]) -> FloorPoint {
        let (latitude, longitude) = (latitude.to_radians(), longitude.to_radians());
        // A height error h moves a point at the distance d by only h d / R, with the earth radius R.
        self.to_world(Geographic { latitude, longitude, height: self.height }).on_floor()
    }

    /// Returns the standard deviations toward east and north of a point with the standard deviations `x` and
    /// `y` (metres) and the correlation `rho` in world axes.
    #[must_use]
    pub fn east_north_sigmas(&self, [x, y, rho]: [f64; 3]) -> [f64; 2] {
        let (sin, cos) = self.azimuth;
        let covariance = rho * x * y;
        // Rounding can make a zero variance negative. An unknown variance stays NaN.
        let along = |a: f64, b: f64| {
            let variance = a * a * x * x + b * b * y * y + 2.0 * a * b * covariance;
            if variance < 0.0 { 0.0 } else { variance.sqrt() }
        };
        [along(sin, -cos), along(cos, sin)]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn at(latitude_deg: f64, longitude_deg: f64, height: f64) -> Geographic {
        Geographic { latitude: latitude_deg.to_radians(), longitude: longitude_deg.to_radians(), height }
    }

    proptest! {
        #[test]
        fn conversion_to_geographic_and_back_is_exact(
            latitude in -89.0..89.0_f64, longitude in -180.0..180.0_f64, height in -100.0..4000.0_f64,
            azimuth in -4.0..4.0_f64, x in -5e3..5e3_f64, y in -5e3..5e3_f64, z in -20.0..200.0_f64,
        ) {
            let plane = TangentPlane::new(at(latitude, longitude, height), azimuth);
            let point = WorldPoint::new(x, y, z);
            let back = plane.to_world(plane.to_geographic(point));
            prop_assert!(back.distance(point) < 1e-6, "{back:?} {point:?}");
        }

        #[test]
        fn small_steps_agree_with_the_radii_of_curvature(
            latitude in -80.0..80.0_f64, longitude in -179.0..179.0_f64, azimuth in -4.0..4.0_f64,
        ) {
            let origin = at(latitude, longitude, 0.0);
            let plane = TangentPlane::new(origin, azimuth);
            let w = 1.0 - ECCENTRICITY_2 * origin.latitude.sin().powi(2);
            let across = SEMI_MAJOR_AXIS / w.sqrt();
            let along = SEMI_MAJOR_AXIS * (1.0 - ECCENTRICITY_2) / w.powf(1.5);
            let found = plane.to_geographic(WorldPoint::new(10.0, 0.0, 0.0));
            let north = (found.latitude - origin.latitude) * along;
            let east = (found.longitude - origin.longitude) * across * origin.latitude.cos();
            prop_assert!((north - 10.0 * azimuth.cos()).abs() < 1e-3, "{north}");
            prop_assert!((east - 10.0 * azimuth.sin()).abs() < 1e-3, "{east}");
        }
    }

    #[test]
    fn east_and_north_are_those_of_the_azimuth() {
        let plane = TangentPlane::new(at(48.0, 11.0, 0.0), 90_f64.to_radians());
        let [east, north] = plane.east_north_sigmas([3.0, 1.0, 0.5]);
        assert!((east - 3.0).abs() < 1e-12 && (north - 1.0).abs() < 1e-12, "{east} {north}");
        let plane = TangentPlane::new(at(48.0, 11.0, 0.0), 0.0);
        let [east, north] = plane.east_north_sigmas([3.0, 1.0, 0.5]);
        assert!((east - 1.0).abs() < 1e-12 && (north - 3.0).abs() < 1e-12, "{east} {north}");
    }

    #[test]
    fn five_kilometres_follow_the_curvature() {
        // A point of the plane 5 km away is 5000^2 / (2 R) = 1.96 m above the ellipsoid.
        let plane = TangentPlane::new(at(48.0, 11.0, 0.0), 90_f64.to_radians());
        let far = plane.to_geographic(WorldPoint::new(5000.0, 0.0, 0.0));
        assert!((far.height - 1.957).abs() < 0.01, "{}", far.height);
    }
}
