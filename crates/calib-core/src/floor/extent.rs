//! Extent of a camera (its image and its EFOV on the floor), and the status of a mapped pixel or point.

use crate::camera::{Camera, FloorPoint, MIN_DEPTH, Pixel, Plane, WorldPoint, dispatch};
use crate::floor::floor_covariances::{block, store};

/// Status of a mapped pixel or point.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[repr(u8)]
pub enum Status {
    /// The pixel or point is mapped, and is inside the EFOV or the image.
    Ok,
    /// The pixel is above the horizon of the plane and has no point.
    AboveHorizon,
    /// The pixel is mapped, but its floor point is outside the effective field of view.
    OutsideEfov,
    /// The pixel or point is mapped, but the pixel is outside the image.
    OutsideImage,
    /// The lens shows no ray at the pixel or toward the point, so it is not mapped.
    OutsideLens,
    /// The point is not in front of the camera and has no pixel.
    BehindCamera,
    /// A coordinate of the pixel or point is missing or not finite.
    Missing,
    /// No calibration is valid for the pixel or point.
    NoCalibration,
    /// The pixel shows the wall of a pit, between its plane and the floor, and has no point.
    OnWall,
}

impl Status {
    /// All statuses, in the order of their codes.
    pub const ALL: [Self; 9] = [
        Self::Ok,
        Self::AboveHorizon,
        Self::OutsideEfov,
        Self::OutsideImage,
        Self::OutsideLens,
        Self::BehindCamera,
        Self::Missing,
        Self::NoCalibration,
        Self::OnWall,
    ];

    /// Returns the status with this code; `None` for an unknown code.
    #[must_use]
    pub fn from_code(code: u8) -> Option<Self> {
        Self::ALL.get(usize::from(code)).copied()
    }

    /// Returns the name of the status, as in output tables.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Ok => "ok",
            Self::AboveHorizon => "above-horizon",
            Self::OutsideEfov => "outside-efov",
            Self::OutsideImage => "outside-image",
            Self::OutsideLens => "outside-lens",
            Self::BehindCamera => "behind-camera",
            Self::Missing => "missing",
            Self::NoCalibration => "no-calibration",
            Self::OnWall => "on-wall",
        }
    }
}

impl std::fmt::Display for Status {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(self.name())
    }
}

/// Extent of a camera: its image, and the polygon of its EFOV on the floor.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Extent<'a> {
    /// Width and height of the image, in pixels.
    pub size: [f64; 2],
    /// Corners of the EFOV on the floor (z = 0), in metres, in either orientation.
    pub efov: &'a [FloorPoint],
}

/// Number of points that are classified together. Each edge of the EFOV is prepared once for all of them.
const LANES: usize = 64;

impl Extent<'_> {
    /// Whether a pixel is inside the image, including its border.
    #[must_use]
    pub fn shows(&self, pixel: Pixel) -> bool {
        let [w, h] = self.size;
        (0.0..=w).contains(&pixel.u) && (0.0..=h).contains(&pixel.v)
    }

    /// Whether a floor point is inside the EFOV (even-odd rule).
    #[must_use]
    pub fn contains(&self, point: FloorPoint) -> bool {
        let mut inside = [0; 1];
        self.flip_inside_flags(&[point.x], &[point.y], &mut inside);
        inside == [1]
    }

    /// Returns the status of one pixel that a camera at `eye` maps to the point `at`; see [`Self::classify`].
    pub(crate) fn status_of(&self, eye: WorldPoint, pixel: Pixel, at: WorldPoint) -> Status {
        let mut status = [Status::Ok];
        let level = Plane::level(at.z);
        self.classify(eye, &level, [&[pixel.u], &[pixel.v]], [&[at.x], &[at.y]], &mut status);
        status[0]
    }

    /// Maps a world point to a pixel of a camera with this extent, and returns the status of the point.
    #[must_use]
    pub fn to_pixel(&self, camera: &Camera, point: WorldPoint) -> (Option<Pixel>, Status) {
        if !point.is_finite() {
            return (None, Status::Missing);
        }
        match camera.world_to_pixel(point) {
            Some(pixel) => (Some(pixel), self.status_of_pixel(pixel)),
            None if camera.in_camera(point)[2] > MIN_DEPTH => (None, Status::OutsideLens),
            None => (None, Status::BehindCamera),
        }
    }

    /// Returns the status of a point that is mapped to this pixel: inside or outside the image.
    #[inline]
    pub(crate) fn status_of_pixel(&self, pixel: Pixel) -> Status {
        if self.shows(pixel) { Status::Ok } else { Status::OutsideImage }
    }

    /// Iterates over the edges of the EFOV.
    fn edges(&self) -> impl Iterator<Item = [FloorPoint; 2]> {
        self.efov.iter().zip(self.efov.iter().cycle().skip(1)).map(|(&a, &b)| [a, b])
    }

    /// Flips the flag `inside` of every point (x, y), once for each edge of the EFOV on its right (toward
    /// +x).
    #[inline(always)]
    fn flip_inside_flags(&self, x: &[f64], y: &[f64], inside: &mut [u64]) {
        for [a, b] in self.edges() {
            // The value is not finite for an edge along x, but no point is between the ends of such an edge.
            let dx_by_dy = (b.x - a.x) / (b.y - a.y);
            for ((x, y), inside) in x.iter().zip(y).zip(inside.iter_mut()) {
                let between = (a.y > *y) != (b.y > *y);
                *inside ^= u64::from(between & (*x < a.x + (y - a.y) * dx_by_dy));
            }
        }
    }

    /// Computes the status of pixels (u, v) that are mapped to the points (x, y) of a plane, in metres. The
    /// status is `Ok` if the pixel is inside the image, and its floor point inside the EFOV. The floor point is
    /// on the ray from the camera at `eye` through the point of the plane. Pixels without a point count as
    /// above the horizon.
    pub(crate) fn classify(
        &self,
        eye: WorldPoint,
        plane: &Plane,
        [u, v]: [&[f64]; 2],
        [x, y]: [&[f64]; 2],
        status: &mut [Status],
    ) {
        dispatch(
            #[inline(always)]
            || {
                let mut spare = [[0.0; LANES]; 4];
                for (chunk, status) in status.chunks_mut(LANES).enumerate() {
                    let at = chunk * LANES..chunk * LANES + status.len();
                    let [s, t, p, q] = &mut spare;
                    let pixels = [block(&u[at.clone()], s), block(&v[at.clone()], t)];
                    let points = [block(&x[at.clone()], p), block(&y[at], q)];
                    let mut inside = [0; LANES];
                    if *plane == Plane::FLOOR {
                        self.flip_inside_flags(points[0], points[1], &mut inside);
                    } else {
                        let floor = on_floor(eye, plane, points);
                        self.flip_inside_flags(&floor[0], &floor[1], &mut inside);
                    }
                    store(&self.lane_statuses(pixels, points, &inside), status);
                }
            },
        );
    }

    /// Returns the status of `LANES` pixels. `inside` is 1 if the floor point of the pixel is inside the
    /// EFOV.
    #[inline(always)]
    fn lane_statuses(
        &self,
        [u, v]: [&[f64; LANES]; 2],
        [x, y]: [&[f64; LANES]; 2],
        inside: &[u64; LANES],
    ) -> [Status; LANES] {
        let [w, h] = self.size;
        let mut status = [Status::OutsideImage; LANES];
        for i in 0..LANES {
            // Without branches, all lanes are computed together.
            let shown = (u[i] >= 0.0) & (u[i] <= w) & (v[i] >= 0.0) & (v[i] <= h);
            let efov = if inside[i] == 1 { Status::Ok } else { Status::OutsideEfov };
            let mapped = if shown { efov } else { Status::OutsideImage };
            let is_point = (x[i].abs() < f64::INFINITY) & (y[i].abs() < f64::INFINITY);
            status[i] = if is_point { mapped } else { Status::AboveHorizon };
        }
        status
    }
}

/// Maps points of a plane to the floor, along the rays from the camera at `eye`. A point at or above the
/// height of the camera becomes NaN.
#[inline(always)]
fn on_floor(eye: WorldPoint, plane: &Plane, [x, y]: [&[f64; LANES]; 2]) -> [[f64; LANES]; 2] {
    // The ray through a point above the camera does not meet the floor.
    let stretch = |height: f64| if height < eye.z { eye.z / (eye.z - height) } else { f64::NAN };
    let (is_level, level) = (plane.slope == [0.0; 2], stretch(plane.height));
    let mut floor = [[0.0; LANES]; 2];
    for i in 0..LANES {
        let stretch = if is_level { level } else { stretch(plane.height_at([x[i], y[i]].into())) };
        floor[0][i] = eye.x + stretch * (x[i] - eye.x);
        floor[1][i] = eye.y + stretch * (y[i] - eye.y);
    }
    floor
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::{Covariance, Distortion, Lens};

    #[test]
    fn fisheye_has_pixels_for_points_beside_it() {
        let distortion = Distortion::KannalaBrandt { k: [-0.04, -0.002, 0.0008, 0.0] };
        let centre = Pixel::new(320.0, 200.0);
        let camera = Camera {
            position: WorldPoint::new(0.0, 0.0, 3.0),
            yaw: 0.0,
            pitch: 40_f64.to_radians(),
            roll: 0.0,
            focal: 188.0,
            lens: Lens { focal: 188.0, distortion, ..Lens::pinhole(centre) },
            covariance: Covariance::EXACT,
        };
        let extent = Extent { size: [640.0, 400.0], efov: &[] };
        // Rays of 88, 92 and 99 degrees from the axis.
        for pixel in [[535.0, 350.0], [543.0, 356.0], [559.0, 367.0]].map(Pixel::from) {
            let at = camera.pixel_to_floor(pixel, 0.0).unwrap();
            let (found, status) = extent.to_pixel(&camera, WorldPoint::new(at.x, at.y, 0.0));
            assert_eq!(status, Status::Ok);
            assert!(found.is_some_and(|found| found.distance(pixel) < 1e-6), "{found:?}");
        }
        let behind = WorldPoint::new(0.0, -40.0, 30.0);
        assert_eq!(extent.to_pixel(&camera, behind), (None, Status::BehindCamera));
    }

    #[test]
    fn status_codes_are_list_indices() {
        for (code, status) in (0..).zip(Status::ALL) {
            assert_eq!((status as u8, Status::from_code(code)), (code, Some(status)));
        }
        assert_eq!(Status::from_code(Status::ALL.len() as u8), None);
    }

    #[test]
    fn point_inside_polygon_is_contained() {
        let efov = [[0.0, 0.0], [4.0, 0.0], [4.0, 3.0], [2.0, 1.0], [0.0, 3.0]].map(FloorPoint::from);
        let extent = Extent { size: [100.0, 50.0], efov: &efov };
        let inside = [[1.0, 1.0], [3.0, 1.5], [0.5, 2.4]];
        let outside = [[2.0, 2.0], [-1.0, 1.0], [5.0, 1.0], [2.0, -0.1], [1.0, 4.0]];
        assert!(inside.iter().all(|&p| extent.contains(p.into())));
        assert!(!outside.iter().any(|&p| extent.contains(p.into())));
        assert!(!Extent { efov: &[], ..extent }.contains(FloorPoint { x: 1.0, y: 1.0 }));
        assert!(extent.shows(Pixel::new(100.0, 0.0)) && !extent.shows(Pixel::new(100.1, 0.0)));
    }
}
