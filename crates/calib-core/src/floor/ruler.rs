//! Ruler: lengths, areas and heights between annotated pixels, with their standard deviations.
//!
//! A measured quantity `q` is a function of the pixels and of the cameras. Its variance to first order is
//!
//! `sum_i (dq/du_i)^2 s_i^2 + (dq/dv_i)^2 s_i^2  +  sum_ab g_a' C_ab g_b`,
//!
//! where `s_i` is the standard deviation of the coordinates of pixel i, `g_a` contains the derivatives with
//! respect to the parameters of camera a, and `C_ab` is the covariance between the parameters of the cameras a
//! and b. Errors of one camera move all its points together, so they mostly cancel in a short length.

use nalgebra::DMatrix;

use crate::camera::{Camera, Covariance, FloorPoint, Pixel, WorldPoint, dot};
use crate::floor::pixel_density::covariance_product;

/// Point of a measurement: a pixel of one camera.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RulerPoint {
    /// Index of the camera in [`Ruler::cameras`].
    pub camera: usize,
    /// Raw pixel.
    pub pixel: Pixel,
    /// Height of the point above the floor, in metres.
    pub height: f64,
    /// Standard deviation of each coordinate of the pixel, in pixels.
    pub sigma: f64,
}

/// Measured quantity with its standard deviation, in metres or square metres.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Measured {
    /// Measured value, in metres or square metres.
    pub value: f64,
    /// Standard deviation of the value; `None` if it depends on an unknown uncertainty of a camera.
    pub sigma: Option<f64>,
}

/// Covariance between the parameters of two cameras; rows belong to the first.
pub type CameraCovariance = [[f64; Covariance::SIZE]; Covariance::SIZE];

/// Calibrated cameras of one site, for measurements in their images.
pub struct Ruler<'a> {
    /// Cameras that [`RulerPoint::camera`] refers to.
    pub cameras: &'a [Camera],
    /// Returns the covariance between the parameters of two different cameras; `None` if it is unknown.
    pub covariance_between: &'a dyn Fn(usize, usize) -> Option<CameraCovariance>,
}

impl std::fmt::Debug for Ruler<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Ruler").field("cameras", &self.cameras).finish_non_exhaustive()
    }
}

impl Ruler<'_> {
    /// Measures the length of the line through points of known heights. Returns `None` with fewer than two
    /// points, or if a pixel does not show a point at its height.
    ///
    /// Only errors along the line change its length to first order. If the line is shorter than about three
    /// standard deviations, its direction is unknown. The standard deviation then contains the errors in all
    /// directions. A standing object therefore has an uncertain speed, and not 0 ± 0.
    #[must_use]
    pub fn length(&self, points: &[RulerPoint]) -> Option<Measured> {
        /// Length below which the direction of a line is not known, in standard deviations.
        const MIN_SIGMAS: f64 = 3.0;
        let [from, .., to] = points else { return None };
        let along = self.measure(points, |cameras, points| {
            let world = points.iter().map(|point| world_point(cameras, point)).collect::<Option<Vec<_>>>()?;
            Some(world.windows(2).map(|pair| pair[0].distance(pair[1])).sum())
        })?;
        let ends = [*from, *to];
        let on_axis = |axis: usize| {
            let component = self.measure(&ends, |cameras, points| {
                let [a, b] = [world_point(cameras, &points[0])?, world_point(cameras, &points[1])?];
                Some([b.x - a.x, b.y - a.y][axis])
            })?;
            Some(component.sigma.map(|sigma| sigma * sigma))
        };
        // An unknown yaw makes the components uncertain, but not the length.
        let [Some(x), Some(y)] = [on_axis(0)?, on_axis(1)?] else { return Some(along) };
        // The sum of the variances in x and y is at least the larger eigenvalue of the covariance matrix.
        let worst = (x + y).sqrt();
        let sigma = if along.value < MIN_SIGMAS * worst { Some(worst) } else { along.sigma };
        Some(Measured { sigma, ..along })
    }

    /// Measures the area of a polygon, seen from above. Returns `None` with fewer than three points, or if a
    /// pixel does not show a point at its height.
    #[must_use]
    pub fn area(&self, points: &[RulerPoint]) -> Option<Measured> {
        if points.len() < 3 {
            return None;
        }
        let signed = self.measure(points, |cameras, points| {
            let floor = points
                .iter()
                .map(|point| world_point(cameras, point).map(WorldPoint::on_floor))
                .collect::<Option<Vec<FloorPoint>>>()?;
            // Relative to the first corner, because large coordinates lose digits.
            let first = floor[0];
            let relative = |point: &FloorPoint| [point.x - first.x, point.y - first.y];
            let edges = floor.iter().zip(floor.iter().cycle().skip(1));
            let cross =
                edges.map(|(a, b)| (relative(a), relative(b))).map(|(a, b)| a[0] * b[1] - a[1] * b[0]);
            Some(0.5 * cross.sum::<f64>())
        })?;
        Some(Measured { value: signed.value.abs(), ..signed })
    }

    /// Measures the vertical distance from a foot to the head vertically above it, in metres. The foot is at
    /// its [`RulerPoint::height`]. The field `height` of the head is not used. Returns `None` if the pixel of
    /// the foot shows no point at its height, if the ray of the head is vertical, or if the pixel of the head
    /// is too far from the image of the vertical.
    ///
    /// The head is the point of the vertical that is nearest to the ray of its pixel.
    #[must_use]
    pub fn height(&self, foot: &RulerPoint, head: &RulerPoint) -> Option<Measured> {
        /// Largest distance of the head from the vertical, as a share of the length of the image of the
        /// vertical. People lean and stride by less.
        const MAX_LEAN: f64 = 0.25;
        /// Largest distance of the head from the vertical, in standard deviations of the pixels.
        const MAX_SIGMAS: f64 = 5.0;
        let measured = self.measure(&[*foot, *head], |cameras, points| {
            let foot = world_point(cameras, &points[0])?;
            head_height(&cameras[points[1].camera], foot, points[1].pixel)
        })?;
        let camera = &self.cameras[head.camera];
        let base = world_point(self.cameras, foot)?;
        let image = |height: f64| camera.world_to_pixel(WorldPoint { z: base.z + height, ..base });
        let (top, bottom) = (image(measured.value)?, image(0.0)?);
        let most = MAX_LEAN * top.distance(bottom) + MAX_SIGMAS * foot.sigma.hypot(head.sigma);
        (top.distance(head.pixel) <= most).then_some(measured)
    }

    /// Returns the floor positions of the points, in metres, and their joint covariance, in square metres. The
    /// rows of the covariance are x and y of the first point, then of the next. Returns `None` if a pixel does
    /// not show a point at its height, or if the covariance of two cameras is unknown. Also returns `None` if the
    /// uncertainty of the height, pitch, roll, focal length or lens of a camera is unknown.
    ///
    /// Unknown errors of a camera's placement by hand are not contained: the placement on the plan counts as exact.
    #[must_use]
    pub fn positions(&self, points: &[RulerPoint]) -> Option<(Vec<FloorPoint>, DMatrix<f64>)> {
        let mut positions = Vec::new();
        // For each coordinate of each point: its camera, and its derivatives with respect to the camera.
        let mut gradients: Vec<(usize, [f64; Covariance::SIZE])> = Vec::new();
        let mut covariance = DMatrix::zeros(2 * points.len(), 2 * points.len());
        for (i, point) in points.iter().enumerate() {
            let camera = &self.cameras[point.camera];
            positions.push(world_point(self.cameras, point)?.on_floor());
            for axis in 0..2 {
                let coordinate = |camera: &Camera| {
                    let floor = camera.pixel_to_floor(point.pixel, point.height)?;
                    Some([floor.x, floor.y][axis])
                };
                let mut gradient = camera.gradient_of(coordinate)?;
                for k in [Covariance::X, Covariance::Y, Covariance::YAW] {
                    if camera.covariance.sigma(k).is_none() {
                        gradient[k] = 0.0;
                    }
                }
                let gradient = camera.without_unknown_errors(gradient)?;
                gradients.push((point.camera, gradient));
            }
            let own = camera.plane_covariance(point.pixel, point.sigma, point.height)?.pixel;
            (0..2).for_each(|a| (0..2).for_each(|b| covariance[(2 * i + a, 2 * i + b)] = own[a][b]));
        }
        for (i, (a, by_a)) in gradients.iter().enumerate() {
            for (j, (b, by_b)) in gradients.iter().enumerate() {
                covariance[(i, j)] += if a == b {
                    covariance_product(by_a, &self.cameras[*a].covariance.0, by_b)
                } else {
                    covariance_product(by_a, &(self.covariance_between)(*a, *b)?, by_b)
                };
            }
        }
        Some((positions, covariance))
    }

    /// Computes a quantity and propagates the errors of the pixels and of the cameras to it.
    fn measure(
        &self,
        points: &[RulerPoint],
        quantity: impl Fn(&[Camera], &[RulerPoint]) -> Option<f64>,
    ) -> Option<Measured> {
        let value = quantity(self.cameras, points)?;
        let variance = self.pixel_variance(points, &quantity)?;
        let mut used: Vec<usize> = points.iter().map(|point| point.camera).collect();
        used.sort_unstable();
        used.dedup();
        let of_cameras = self.camera_variance(points, &used, &quantity);
        Some(Measured { value, sigma: of_cameras.map(|cameras| (variance + cameras).max(0.0).sqrt()) })
    }

    /// Returns the variance of a quantity that the errors of the pixels cause.
    fn pixel_variance(
        &self,
        points: &[RulerPoint],
        quantity: &impl Fn(&[Camera], &[RulerPoint]) -> Option<f64>,
    ) -> Option<f64> {
        /// Step of the central differences, in pixels.
        const STEP: f64 = 1e-3;
        let mut variance = 0.0;
        for index in 0..points.len() {
            for (du, dv) in [(STEP, 0.0), (0.0, STEP)] {
                let at = |share: f64| {
                    let mut moved = points.to_vec();
                    moved[index].pixel.u += share * du;
                    moved[index].pixel.v += share * dv;
                    quantity(self.cameras, &moved)
                };
                let by = (at(1.0)? - at(-1.0)?) / (2.0 * STEP);
                variance += (by * points[index].sigma).powi(2);
            }
        }
        Some(variance)
    }

    /// Returns the variance of a quantity that the errors of the cameras `used` cause. Returns `None` if the
    /// quantity depends on an unknown uncertainty.
    fn camera_variance(
        &self,
        points: &[RulerPoint],
        used: &[usize],
        quantity: &impl Fn(&[Camera], &[RulerPoint]) -> Option<f64>,
    ) -> Option<f64> {
        let gradient = |index: usize| {
            let of = |changed: &Camera| {
                let mut cameras = self.cameras.to_vec();
                cameras[index] = *changed;
                quantity(&cameras, points)
            };
            self.cameras[index].without_unknown_errors(self.cameras[index].gradient_of(of)?)
        };
        let gradients = used.iter().map(|&index| gradient(index)).collect::<Option<Vec<_>>>()?;
        let mut variance = 0.0;
        for (i, &a) in used.iter().enumerate() {
            variance += covariance_product(&gradients[i], &self.cameras[a].covariance.0, &gradients[i]);
            for (j, &b) in used.iter().enumerate().skip(i + 1) {
                let between = (self.covariance_between)(a, b)?;
                variance += 2.0 * covariance_product(&gradients[i], &between, &gradients[j]);
            }
        }
        Some(variance)
    }
}

/// Returns the height above the foot at which the vertical through the foot is nearest to the ray of a pixel. Returns
/// `None` if the ray is vertical, or if the nearest point is behind the camera.
///
/// The vertical is `foot + z up`, the ray `eye + t d` with a unit vector d. With `w = eye - foot`, the two lines are
/// nearest for `z - t d_z = w_z` and `z d_z - t = w . d`.
fn head_height(camera: &Camera, foot: WorldPoint, pixel: Pixel) -> Option<f64> {
    /// Smallest accepted squared sine of the angle between the ray and the vertical.
    const MIN_LEVEL: f64 = 1e-6;
    let ray = camera.pixel_to_ray(pixel)?;
    let from_foot = [ray.origin.x - foot.x, ray.origin.y - foot.y, ray.origin.z - foot.z];
    let up = ray.direction[2];
    let level = 1.0 - up * up;
    let along = dot(&from_foot, &ray.direction);
    let height = (from_foot[2] - along * up) / level;
    (level > MIN_LEVEL && height * up - along > 0.0).then_some(height)
}

/// Returns the world point of a pixel at its height.
fn world_point(cameras: &[Camera], point: &RulerPoint) -> Option<WorldPoint> {
    let floor = cameras[point.camera].pixel_to_floor(point.pixel, point.height)?;
    Some(floor.at_height(point.height))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::any_camera;
    use proptest::prelude::*;

    fn alone(_: usize, _: usize) -> Option<CameraCovariance> {
        Some([[0.0; Covariance::SIZE]; Covariance::SIZE])
    }

    /// Returns the observation of a point; `None` if its pixel is outside any image. Far outside, a change of one
    /// pixel is below the rounding error.
    fn sees(camera: &Camera, index: usize, at: WorldPoint) -> Option<RulerPoint> {
        const LARGEST_SIDE: f64 = 65_536.0;
        let is_in_image = |pixel: &Pixel| pixel.u.abs().max(pixel.v.abs()) < LARGEST_SIDE;
        let pixel = camera.world_to_pixel(at).filter(is_in_image)?;
        Some(RulerPoint { camera: index, pixel, height: at.z, sigma: 1.0 })
    }

    proptest! {
        #[test]
        fn measurements_of_exact_pixels_are_exact(
            first in any_camera(), second in any_camera(), a in [-3.0..3.0_f64, 4.0..9.0_f64],
            b in [-3.0..3.0_f64, 4.0..9.0_f64], tall in 0.3..1.9_f64,
        ) {
            let cameras = [first, second];
            let ruler = Ruler { cameras: &cameras, covariance_between: &alone };
            let [a, b] = [a, b].map(|[x, y]| FloorPoint { x, y });
            // Both orders and both cameras: the length of a line does not depend on who observes its ends.
            for (one, other) in [(0, 0), (0, 1), (1, 1)] {
                let ends = (
                    sees(&cameras[one], one, a.at_height(0.0)),
                    sees(&cameras[other], other, b.at_height(0.0)),
                );
                let (Some(from), Some(to)) = ends else { continue };
                let Some(found) = ruler.length(&[from, to]) else { continue };
                prop_assert!((found.value - a.distance(b)).abs() < 1e-5 * (1.0 + found.value));
                prop_assert!(found.sigma.is_some_and(|sigma| sigma > 0.0));
                let Some(head) = sees(&cameras[other], other, a.at_height(tall)) else { continue };
                let Some(height) = ruler.height(&from, &head) else { continue };
                prop_assert!((height.value - tall).abs() < 1e-4, "{} {}", height.value, tall);
            }
        }
    }

    /// Returns a camera 4 m above the origin, with errors of height, pitch and focal length.
    fn street() -> Camera {
        let mut covariance = Covariance::EXACT;
        for (index, sigma) in [(Covariance::Z, 0.05), (Covariance::PITCH, 0.004), (Covariance::FOCAL, 20.0)] {
            covariance.0[index][index] = sigma * sigma;
        }
        Camera {
            position: WorldPoint::new(0.0, 0.0, 4.0),
            yaw: 0.0,
            pitch: 25_f64.to_radians(),
            roll: 0.02,
            focal: 1400.0,
            lens: crate::camera::Lens::pinhole([960.0, 540.0].into()),
            covariance,
        }
    }

    #[test]
    fn errors_of_the_position_cancel_in_lengths_of_one_camera() {
        let camera = street();
        let by_hand = Camera {
            covariance: camera.covariance.with_unknown(&[Covariance::X, Covariance::Y, Covariance::YAW]),
            ..camera
        };
        let points = [[-1.0, 6.0], [1.5, 9.0], [0.5, 12.0]]
            .map(|[x, y]| sees(&camera, 0, WorldPoint::new(x, y, 0.0)).unwrap());
        let of = |camera: Camera| {
            let cameras = [camera];
            let ruler = Ruler { cameras: &cameras, covariance_between: &alone };
            [ruler.length(&points), ruler.area(&points)].map(|found| found.unwrap().sigma)
        };
        for (known, unknown) in of(camera).into_iter().zip(of(by_hand)) {
            assert!((known.unwrap() - unknown.unwrap()).abs() < 1e-6, "{known:?} {unknown:?}");
        }
        let assumed = Camera { covariance: camera.covariance.with_unknown(&[Covariance::Z]), ..camera };
        assert_eq!(of(assumed), [None, None], "with an unknown scale no length has a standard deviation");
    }

    #[test]
    fn a_standing_object_has_an_uncertain_displacement() {
        let cameras = [street()];
        let ruler = Ruler { cameras: &cameras, covariance_between: &alone };
        let at = sees(&cameras[0], 0, WorldPoint::new(0.0, 8.0, 0.0)).unwrap();
        let found = ruler.length(&[at, at]).unwrap();
        assert!(found.value < 1e-9 && found.sigma.is_some_and(|sigma| sigma > 0.01), "{found:?}");
    }

    #[test]
    fn head_beside_the_foot_has_no_height() {
        let cameras = [street()];
        let ruler = Ruler { cameras: &cameras, covariance_between: &alone };
        let foot = sees(&cameras[0], 0, WorldPoint::new(0.0, 8.0, 0.0)).unwrap();
        let head = |x: f64| sees(&cameras[0], 0, WorldPoint::new(x, 8.0, 1.7)).unwrap();
        assert!(ruler.height(&foot, &head(0.1)).is_some());
        assert_eq!(ruler.height(&foot, &head(1.5)), None);
    }

    #[test]
    fn common_errors_of_two_cameras_cancel() {
        let camera = street();
        let cameras = [camera, camera];
        let both = |_: usize, _: usize| Some(camera.covariance.0);
        let points = [[-1.0, 7.0], [-0.5, 7.2]].map(|[x, y]| WorldPoint::new(x, y, 0.0));
        let ends =
            |second: usize| [sees(&camera, 0, points[0]).unwrap(), sees(&camera, second, points[1]).unwrap()];
        let sigma = |covariance_between: &dyn Fn(usize, usize) -> Option<CameraCovariance>, second: usize| {
            let ruler = Ruler { cameras: &cameras, covariance_between };
            ruler.length(&ends(second)).unwrap().sigma.unwrap()
        };
        let (own, joint, apart) = (sigma(&both, 0), sigma(&both, 1), sigma(&alone, 1));
        assert!((own - joint).abs() < 1e-6 && apart > 1.2 * own, "{own} {joint} {apart}");
    }

    #[test]
    fn area_of_a_square_is_its_side_squared() {
        let camera = street();
        let corners = [[0.0, 6.0], [2.0, 6.0], [2.0, 8.0], [0.0, 8.0]]
            .map(|[x, y]| sees(&camera, 0, WorldPoint::new(x, y, 0.0)).unwrap());
        let cameras = [camera];
        let ruler = Ruler { cameras: &cameras, covariance_between: &alone };
        let found = ruler.area(&corners).unwrap();
        assert!((found.value - 4.0).abs() < 1e-9);
        // Only the scale is uncertain: an error of 1 % of the height changes the area by 2 %.
        let mut covariance = Covariance::EXACT;
        covariance.0[Covariance::Z][Covariance::Z] = 0.04 * 0.04;
        let exact = corners.map(|corner| RulerPoint { sigma: 0.0, ..corner });
        let cameras = [Camera { covariance, ..camera }];
        let ruler = Ruler { cameras: &cameras, covariance_between: &alone };
        let sigma = ruler.area(&exact).unwrap().sigma.unwrap();
        assert!((sigma - 0.08).abs() < 1e-4, "{sigma}");
    }
}
