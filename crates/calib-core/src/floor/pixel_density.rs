//! Pixel density: the number of pixels that show one metre of a vertical target.
//!
//! A vertical target at the point X has the directions *across* (level, perpendicular to the line of sight)
//! and *up*. With the Jacobian J of the image with respect to these two directions, in pixels per metre, the
//! pixel density is the smaller singular value of J. It is the density in the worst direction on the target.
//!
//! The levels and their limits come from IEC 62676-4:2014 (EN 62676-4:2015), "Video surveillance systems for use
//! in security applications: application guidelines".

use crate::camera::{Camera, Covariance, Pixel, WorldPoint, dot};

/// Task of an operator for which a pixel density is sufficient, as defined in IEC 62676-4.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub enum DensityLevel {
    /// See the number, direction and speed of people whose presence is known.
    Monitor,
    /// Determine whether a person is present.
    Detect,
    /// See details of a person, such as clothing.
    Observe,
    /// Determine whether a known person is the one in the image.
    Recognise,
    /// Determine the identity of a person beyond reasonable doubt.
    Identify,
}

impl DensityLevel {
    /// All levels, from the smallest density to the largest.
    pub const ALL: [Self; 5] = [Self::Monitor, Self::Detect, Self::Observe, Self::Recognise, Self::Identify];

    /// Returns the name of the level, as in files.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Monitor => "monitor",
            Self::Detect => "detect",
            Self::Observe => "observe",
            Self::Recognise => "recognise",
            Self::Identify => "identify",
        }
    }

    /// Returns the level with this name; `None` for an unknown name.
    #[must_use]
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|level| level.name() == name)
    }
}

/// Smallest pixel density of each level, in pixels per metre, in the order of [`DensityLevel::ALL`]. By default,
/// these are the limits of IEC 62676-4.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LevelLimits(pub [f64; DensityLevel::ALL.len()]);

impl Default for LevelLimits {
    fn default() -> Self {
        Self([12.5, 25.0, 62.5, 125.0, 250.0])
    }
}

impl LevelLimits {
    /// Returns the smallest pixel density of a level, in pixels per metre.
    #[must_use]
    pub const fn of(&self, level: DensityLevel) -> f64 {
        self.0[level as usize]
    }

    /// Returns the highest level that a pixel density reaches; `None` below all levels.
    #[must_use]
    pub fn reached_by(&self, density: f64) -> Option<DensityLevel> {
        DensityLevel::ALL.into_iter().rev().find(|&level| density >= self.of(level))
    }
}

/// Camera with its rotation matrix, for the pixel densities of many points.
#[derive(Clone, Copy, Debug)]
pub(crate) struct DensityCamera<'a> {
    camera: &'a Camera,
    /// Rotation matrix from world vectors to camera axes.
    rotation: [[f64; 3]; 3],
}

impl<'a> DensityCamera<'a> {
    pub(crate) fn new(camera: &'a Camera) -> Self {
        Self { camera, rotation: camera.rotation() }
    }

    /// Returns the pixel of a point and the pixel density there, in pixels per metre. Returns `None` if the
    /// camera does not show the point.
    pub(crate) fn at(&self, point: WorldPoint) -> Option<(Pixel, f64)> {
        let eye = self.camera.position;
        let sight = [point.x - eye.x, point.y - eye.y, point.z - eye.z];
        let in_camera = self.rotation.map(|row| dot(&row, &sight));
        let pixel = self.camera.project(in_camera)?;
        let level = sight[0].hypot(sight[1]);
        // Below or above the camera every level direction is perpendicular to the line of sight.
        let across = if level > 0.0 { [-sight[1] / level, sight[0] / level, 0.0] } else { [1.0, 0.0, 0.0] };
        let moved = [across, [0.0, 0.0, 1.0]].map(|direction| self.rotation.map(|row| dot(&row, &direction)));
        let [[a, c], [b, d]] = if self.camera.lens.distortion.is_wide() {
            let [first, second] = moved.map(|moved| self.by_bearing(pixel, in_camera, moved));
            [first?, second?]
        } else {
            let jacobian = self.by_undistorted(in_camera);
            moved.map(jacobian)
        };
        Some((pixel, smaller_singular_value([[a, b], [c, d]])))
    }

    /// Returns a function that maps displacements of the point (x, y, z) to derivatives of its pixel, for a
    /// lens that is not wide. Point and displacements are in camera axes, in metres.
    ///
    /// The undistorted pixel is `f [x / z, y / z]`. The Jacobian of the distortion follows (chain rule).
    fn by_undistorted(&self, [x, y, z]: [f64; 3]) -> impl Fn([f64; 3]) -> [f64; 2] {
        let Camera { lens, focal, .. } = self.camera;
        let jacobian = lens.distort_jacobian(self.camera.undistorted_from_normalised([x / z, y / z]));
        let scale = focal / (z * z);
        move |moved| {
            let change = [scale * (moved[0] * z - x * moved[2]), scale * (moved[1] * z - y * moved[2])];
            jacobian.map(|row| row[0] * change[0] + row[1] * change[1])
        }
    }

    /// Returns the derivative of the pixel for a displacement `moved` of the point `at`, for any lens. Point
    /// and displacement are in camera axes, in metres.
    ///
    /// The bearing `b` of the pixel is a multiple `s B(at)` of the bearing of the point. A change `d`
    /// of the pixel changes `b` by `J d`, and the displacement changes it by `s B(moved)`. The two changes agree
    /// up to a multiple of `b`, which does not move the pixel. The cross product with `b` removes this multiple.
    fn by_bearing(&self, pixel: Pixel, at: [f64; 3], moved: [f64; 3]) -> Option<[f64; 2]> {
        let (bearing, jacobian) = self.camera.lens.bearing_with_jacobian(pixel)?;
        let of_point = self.camera.bearing(at);
        let scale = dot(&bearing, &of_point) / dot(&of_point, &of_point);
        let change = self.camera.bearing(moved).map(|value| scale * value);
        let [by_u, by_v] = [0, 1].map(|k| jacobian.map(|row| row[k]));
        let [without_u, without_v] = [by_u, by_v].map(|column| cross(&column, &bearing));
        let of = |normal: &[f64; 3], column: &[f64; 3]| dot(normal, &change) / dot(normal, column);
        let found = [of(&without_v, &by_u), of(&without_u, &by_v)];
        found.iter().all(|value| value.is_finite()).then_some(found)
    }
}

impl Camera {
    /// Returns the pixel density of a vertical target at a point: pixels per metre in the worst direction on
    /// the target.
    ///
    /// Returns `None` if the lens cannot show the point. The result does not depend on the size of the image.
    #[must_use]
    pub fn pixel_density(&self, point: WorldPoint) -> Option<f64> {
        DensityCamera::new(self).at(point).map(|(_, density)| density)
    }

    /// Returns the standard deviation of the pixel density at a point, in pixels per metre, caused by the
    /// errors of the calibration. Returns `None` if the lens cannot show the point, or if the density depends on
    /// a parameter whose uncertainty is unknown.
    #[must_use]
    pub fn pixel_density_sigma(&self, point: WorldPoint) -> Option<f64> {
        Some(self.variance_of(|camera| camera.pixel_density(point))?.sqrt())
    }

    /// Returns the variance of a quantity, caused by the errors of the camera. Returns `None` if the quantity
    /// does not exist, or depends on a parameter whose uncertainty is unknown.
    pub(crate) fn variance_of(&self, quantity: impl Fn(&Self) -> Option<f64>) -> Option<f64> {
        let gradient = self.without_unknown_errors(self.gradient_of(quantity)?)?;
        Some(covariance_product(&gradient, &self.covariance.0, &gradient).max(0.0))
    }

    /// Returns the derivatives of a quantity, with exact zeros for the parameters whose uncertainty is unknown.
    /// Returns `None` if the quantity depends on such a parameter.
    pub(crate) fn without_unknown_errors(
        &self,
        mut gradient: [f64; Covariance::SIZE],
    ) -> Option<[f64; Covariance::SIZE]> {
        /// Largest derivative that rounding can cause, per metre, radian or pixel.
        const MAX_ROUNDING: f64 = 1e-5;
        for (index, by) in gradient.iter_mut().enumerate() {
            if self.covariance.0[index][index].is_infinite() {
                if by.abs() > MAX_ROUNDING {
                    return None;
                }
                *by = 0.0;
            }
        }
        Some(gradient)
    }

    /// Returns the derivatives of a quantity with respect to every parameter of [`Covariance`], by central
    /// differences. They are zero for parameters that were not estimated. Returns `None` if the quantity does
    /// not exist for this camera, or for a camera with a slightly different parameter.
    pub(crate) fn gradient_of(
        &self,
        quantity: impl Fn(&Self) -> Option<f64>,
    ) -> Option<[f64; Covariance::SIZE]> {
        /// Step, as a share of the parameter's standard deviation. The quantity is almost linear over it.
        const SHARE: f64 = 1e-3;
        /// Step of a parameter whose uncertainty is unknown, in the unit of the parameter.
        const STEP: f64 = 1e-4;
        let mut gradient = [0.0; Covariance::SIZE];
        for (index, by) in gradient.iter_mut().enumerate() {
            let variance = self.covariance.0[index][index];
            let step = if variance.is_finite() { SHARE * variance.max(0.0).sqrt() } else { STEP };
            if step == 0.0 {
                continue;
            }
            let at = |by: f64| quantity(&self.nudged(index, by));
            *by = (at(step)? - at(-step)?) / (2.0 * step);
        }
        Some(gradient)
    }
}

/// Returns `a' C b` for two vectors of derivatives with respect to camera parameters.
pub(crate) fn covariance_product(
    a: &[f64; Covariance::SIZE],
    covariance: &[[f64; Covariance::SIZE]; Covariance::SIZE],
    b: &[f64; Covariance::SIZE],
) -> f64 {
    // Unknown variances are infinite. The derivatives for these parameters are zero.
    let times = |c: f64, by: f64| if by == 0.0 { 0.0 } else { c * by };
    let row = |row: &[f64; Covariance::SIZE]| row.iter().zip(b).map(|(c, b)| times(*c, *b)).sum::<f64>();
    a.iter().zip(covariance).map(|(a, c)| times(row(c), *a)).sum()
}

/// Returns the smaller singular value of a 2 x 2 matrix, which is its determinant divided by the larger one.
fn smaller_singular_value([[a, b], [c, d]]: [[f64; 2]; 2]) -> f64 {
    let larger = 0.5 * ((a + d).hypot(b - c) + (a - d).hypot(b + c));
    if larger > 0.0 { (a * d - b * c).abs() / larger } else { 0.0 }
}

fn cross(a: &[f64; 3], b: &[f64; 3]) -> [f64; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::any_camera;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn density_is_the_shortest_image_of_a_short_stick(
            camera in any_camera(), u in 0.0..1920.0_f64, v in 0.0..1080.0_f64, height in 0.0..1.9_f64,
        ) {
            /// Length of the stick, in metres.
            const STICK: f64 = 1e-4;
            let Some(at) = camera.pixel_to_floor(Pixel { u, v }, height) else { return Ok(()) };
            let sight = [at.x - camera.position.x, at.y - camera.position.y];
            let level = sight[0].hypot(sight[1]);
            prop_assume!(level > 0.1 && level < 50.0);
            let Some(found) = camera.pixel_density(at.at_height(height)) else { return Ok(()) };
            let end = |across: f64, up: f64| {
                let (x, y) = (at.x - across * sight[1] / level, at.y + across * sight[0] / level);
                camera.world_to_pixel(WorldPoint::new(x, y, height + up))
            };
            let mut shortest = f64::INFINITY;
            for step in 0..3600 {
                let (sin, cos) = (f64::from(step) * std::f64::consts::PI / 3600.0).sin_cos();
                let half = 0.5 * STICK;
                let (Some(a), Some(b)) = (end(half * cos, half * sin), end(-half * cos, -half * sin)) else {
                    return Ok(());
                };
                shortest = shortest.min(a.distance(b) / STICK);
            }
            prop_assert!((shortest - found).abs() < 1e-3 * (1.0 + found), "{shortest} {found}");
        }

        #[test]
        fn density_sigma_matches_the_change_of_one_parameter(
            camera in any_camera(), u in 200.0..1700.0_f64, v in 300.0..1000.0_f64,
        ) {
            let Some(at) = camera.pixel_to_floor(Pixel { u, v }, 0.0) else { return Ok(()) };
            let target = at.at_height(0.0);
            prop_assume!(target.on_floor().distance(camera.position.on_floor()) < 50.0);
            let mut covariance = Covariance::EXACT;
            covariance.0[Covariance::Z][Covariance::Z] = 0.01 * 0.01;
            let camera = Camera { covariance, ..camera };
            let (Some(sigma), Some(density)) =
                (camera.pixel_density_sigma(target), camera.pixel_density(target)) else { return Ok(()) };
            let Some(higher) = camera.nudged(Covariance::Z, 1e-4).pixel_density(target) else { return Ok(()) };
            let expected = (higher - density).abs() / 1e-4 * 0.01;
            prop_assert!((sigma - expected).abs() < 1e-2 * (sigma + 1e-3 * density), "{sigma} {expected}");
        }
    }

    #[test]
    fn levels_are_reached_in_order() {
        let limits = LevelLimits::default();
        assert_eq!(limits.reached_by(12.4), None);
        for level in DensityLevel::ALL {
            assert_eq!(limits.reached_by(limits.of(level)), Some(level));
        }
        assert_eq!(limits.reached_by(124.9), Some(DensityLevel::Observe));
    }
}
