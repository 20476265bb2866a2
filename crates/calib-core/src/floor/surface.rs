//! Projection to a site with several planes: each pixel is mapped to the first plane that its ray meets.
//!
//! A plane is valid inside its region. A region below the floor is a pit, where the floor does not exist. A
//! region above the floor occludes the points behind it. The walls between a region and its surroundings are
//! not modelled. A ray that meets only a wall has no point.
//!
//! [`SurfaceProjector`] maps slices of pixels.

use crate::camera::{Camera, FloorCovariance, FloorPoint, Pixel, Plane, WorldPoint};
use crate::floor::extent::{Extent, Status};
use crate::floor::projector::FloorProjector;

/// Plane with the region in which it is valid.
#[derive(Clone, Debug, PartialEq)]
pub struct Surface {
    /// Height and slope of the plane.
    pub plane: Plane,
    /// Covariance of the height at the anchor (in metres) and of the slopes in x and y (in rise per metre).
    pub covariance: [[f64; 3]; 3],
    /// Polygon of the region on the plan, in metres; an empty polygon contains no points.
    pub region: Vec<FloorPoint>,
}

impl Surface {
    /// Whether the region contains a floor point (even-odd rule).
    #[must_use]
    pub fn is_valid_at(&self, at: FloorPoint) -> bool {
        let FloorPoint { x, y } = at;
        let edges = self.region.iter().zip(self.region.iter().cycle().skip(1));
        let crossed =
            edges.filter(|(a, b)| (a.y > y) != (b.y > y) && x < a.x + (y - a.y) / (b.y - a.y) * (b.x - a.x));
        crossed.count() % 2 == 1
    }

    /// Returns the standard deviations of the height, of the fall (the slope angle), and of the direction of
    /// the fall.
    #[must_use]
    pub fn sigmas(&self) -> SurfaceSigmas {
        let [[height, ..], [_, xx, xy], [_, _, yy]] = self.covariance;
        let [x, y] = self.plane.slope;
        let steepness = x.hypot(y);
        let along = |a: f64, b: f64| (a * a * xx + 2.0 * a * b * xy + b * b * yy).max(0.0).sqrt();
        let height = height.max(0.0).sqrt();
        // The fall is the arc tangent of the steepness. A level plane has no direction.
        if steepness == 0.0 {
            return SurfaceSigmas { height, fall: xx.max(yy).max(0.0).sqrt(), toward: None };
        }
        let (x, y) = (x / steepness, y / steepness);
        let fall = along(x, y) / (1.0 + steepness * steepness);
        SurfaceSigmas { height, fall, toward: Some(along(-y, x) / steepness) }
    }

    /// Returns the plane raised by `height` metres, if the camera sees it from above.
    pub(crate) fn below(&self, camera: &Camera, height: f64) -> Option<Plane> {
        let raised = self.plane.raised(height);
        (camera.position.z > raised.height_at(camera.position.on_floor())).then_some(raised)
    }

    /// Returns the intersection of the ray of a pixel with the plane raised by `height` metres. Returns
    /// `None` if the camera is not above that plane, or if the point is outside the region.
    fn intersection(&self, camera: &Camera, pixel: Pixel, height: f64) -> Option<WorldPoint> {
        let at = camera.pixel_to_plane(pixel, &self.below(camera, height)?)?;
        self.is_valid_at(at.on_floor()).then_some(at)
    }
}

/// Standard deviations of a plane.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SurfaceSigmas {
    /// Standard deviation of the height at the anchor, in metres.
    pub height: f64,
    /// Standard deviation of the angle of the fall, in radians.
    pub fall: f64,
    /// Standard deviation of the direction of the fall, in radians; `None` for a level plane.
    pub toward: Option<f64>,
}

/// Whether a surface is below the floor at this point, so that the floor does not exist there.
pub(crate) fn is_pit(surfaces: &[Surface], at: FloorPoint) -> bool {
    surfaces.iter().any(|surface| surface.plane.height_at(at) < 0.0 && surface.is_valid_at(at))
}

/// Point of the floor or of a surface that a pixel shows.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SurfacePoint {
    /// Index of the surface; `None` for the floor.
    pub surface: Option<usize>,
    /// World position of the point, in metres.
    pub at: WorldPoint,
}

impl SurfacePoint {
    /// Returns the nearer one of two points, `self` and `other`, on a ray from `eye`. At equal distance it
    /// returns `other`, which is later in the list of surfaces.
    pub(crate) fn first_on_ray(self, other: Self, eye: WorldPoint) -> Self {
        if self.at.distance(eye) < other.at.distance(eye) { self } else { other }
    }
}

impl Camera {
    /// Returns the first point on the ray of `pixel` that is `height` metres above the floor or a surface. Each
    /// surface is limited to its region.
    ///
    /// Returns `None` above the horizon, outside the lens, and on the wall of a pit.
    #[must_use]
    pub fn pixel_to_surface(&self, pixel: Pixel, height: f64, surfaces: &[Surface]) -> Option<SurfacePoint> {
        let met = surfaces.iter().enumerate().filter_map(|(index, surface)| {
            Some(SurfacePoint { surface: Some(index), at: surface.intersection(self, pixel, height)? })
        });
        let on_floor = self.pixel_to_floor(pixel, height).filter(|&at| !is_pit(surfaces, at));
        let on_floor = on_floor.map(|at| SurfacePoint { surface: None, at: at.at_height(height) });
        on_floor.into_iter().chain(met).reduce(|before, next| before.first_on_ray(next, self.position))
    }
}

/// Camera prepared to map many pixels to the floor and the surfaces of a site.
#[derive(Clone, Copy, Debug)]
pub struct SurfaceProjector<'a> {
    floor: FloorProjector,
    surfaces: &'a [Surface],
}

/// Number of pixels that are mapped together, in buffers on the stack.
const CHUNK: usize = 256;

impl<'a> SurfaceProjector<'a> {
    /// Prepares `camera` for the points `height` metres above the floor and above every surface.
    #[must_use]
    pub fn new(camera: &Camera, height: f64, surfaces: &'a [Surface]) -> Self {
        Self { floor: FloorProjector::new(camera, height), surfaces }
    }

    /// Maps raw pixels `(u, v)` to points as [`Camera::pixel_to_surface`] does, and computes their statuses.
    ///
    /// A pixel is inside the EFOV if the floor point on its ray is inside, even if a surface occludes the
    /// floor point.
    ///
    /// # Panics
    /// If the slices differ in length.
    pub fn pixels_to_surfaces(
        &self,
        extent: &Extent<'_>,
        [u, v]: [&[f64]; 2],
        points: &mut [Option<SurfacePoint>],
        status: &mut [Status],
    ) {
        assert!(u.len() == v.len() && u.len() == points.len(), "slices of equal length");
        assert!(status.len() == u.len(), "slices of equal length");
        let pixels = u.chunks(CHUNK).zip(v.chunks(CHUNK));
        let mapped = points.chunks_mut(CHUNK).zip(status.chunks_mut(CHUNK));
        for ((u, v), (points, status)) in pixels.zip(mapped) {
            self.map_floor(extent, [u, v], points, status);
            for (index, surface) in self.surfaces.iter().enumerate() {
                self.map_surface((index, surface), extent, [u, v], points, status);
            }
        }
    }

    /// Maps the pixels to the floor, except in pits.
    fn map_floor(
        &self,
        extent: &Extent<'_>,
        [u, v]: [&[f64]; 2],
        points: &mut [Option<SurfacePoint>],
        status: &mut [Status],
    ) {
        let (mut x, mut y) = ([0.0; CHUNK], [0.0; CHUNK]);
        let (x, y) = (&mut x[..u.len()], &mut y[..u.len()]);
        self.floor.pixels_to_floor_within(extent, [u, v], [x, y], status);
        for (((&x, &y), point), status) in x.iter().zip(&*y).zip(points).zip(status) {
            let at = FloorPoint { x, y };
            let is_hollow = at.is_finite() && is_pit(self.surfaces, at);
            let shown = SurfacePoint { surface: None, at: at.at_height(self.floor.height()) };
            *point = (at.is_finite() && !is_hollow).then_some(shown);
            *status = if is_hollow { Status::OnWall } else { *status };
        }
    }

    /// Maps the pixels to a surface if their rays meet it before the points found so far.
    fn map_surface(
        &self,
        (index, surface): (usize, &Surface),
        extent: &Extent<'_>,
        [u, v]: [&[f64]; 2],
        points: &mut [Option<SurfacePoint>],
        status: &mut [Status],
    ) {
        let camera = self.floor.camera();
        let Some(plane) = surface.below(camera, self.floor.height()) else { return };
        let (mut x, mut y) = ([0.0; CHUNK], [0.0; CHUNK]);
        let (x, y) = (&mut x[..u.len()], &mut y[..u.len()]);
        FloorProjector::on(camera, &plane).pixels_to_floor(u, v, x, y);
        let span = BoundingBox::of(&surface.region);
        for i in 0..u.len() {
            let at = FloorPoint { x: x[i], y: y[i] };
            if !(span.contains(at) && surface.is_valid_at(at)) {
                continue;
            }
            let met = SurfacePoint { surface: Some(index), at: at.at_height(plane.height_at(at)) };
            let first = points[i].map_or(met, |before| before.first_on_ray(met, camera.position));
            if points[i] != Some(first) {
                points[i] = Some(first);
                status[i] = extent.status_of(camera.position, Pixel { u: u[i], v: v[i] }, first.at);
            }
        }
    }

    /// Returns the covariance of the point of a raw pixel on a surface, or on the floor; see
    /// [`Camera::covariance_on`].
    #[must_use]
    pub fn covariance(
        &self,
        pixel: Pixel,
        pixel_sigma: f64,
        surface: Option<usize>,
    ) -> Option<FloorCovariance> {
        let (camera, height) = (self.floor.camera(), self.floor.height());
        match surface.map(|index| self.surfaces.get(index)) {
            None => camera.plane_covariance(pixel, pixel_sigma, height),
            Some(surface) => {
                let surface = surface?;
                camera.covariance_on(pixel, pixel_sigma, &surface.plane.raised(height), &surface.covariance)
            }
        }
    }

    /// Computes the covariances of the points that raw pixels `(u, v)` show: the first intersection of each ray with
    /// a surface or the floor. The pixel part and the calibration part have the layout of [`FloorCovariance::rows`].
    pub(super) fn covariances(
        &self,
        [u, v]: [&[f64]; 2],
        pixel_sigma: f64,
        [pixel, calibration]: [&mut [[f64; 4]]; 2],
    ) {
        let (camera, height) = (self.floor.camera(), self.floor.height());
        for (i, (&u, &v)) in u.iter().zip(v).enumerate() {
            let at = Pixel { u, v };
            let shown = camera.pixel_to_surface(at, height, self.surfaces);
            let found = shown.and_then(|shown| self.covariance(at, pixel_sigma, shown.surface));
            [pixel[i], calibration[i]] = found.unwrap_or(FloorCovariance::NAN).rows();
        }
    }
}

/// Bounding box of a region on the plan: its lowest and its highest x and y, in metres. It excludes most
/// points at low cost.
struct BoundingBox([FloorPoint; 2]);

impl BoundingBox {
    /// Computes the bounding box of a region.
    fn of(region: &[FloorPoint]) -> Self {
        let least = |value: fn(&FloorPoint) -> f64| region.iter().map(value).fold(f64::INFINITY, f64::min);
        let most = |value: fn(&FloorPoint) -> f64| region.iter().map(value).fold(f64::NEG_INFINITY, f64::max);
        let corner = |x, y| FloorPoint { x, y };
        Self([corner(least(|p| p.x), least(|p| p.y)), corner(most(|p| p.x), most(|p| p.y))])
    }

    fn contains(&self, at: FloorPoint) -> bool {
        let Self([low, high]) = self;
        low.x <= at.x && at.x <= high.x && low.y <= at.y && at.y <= high.y
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::{Covariance, Lens};

    fn square(x: f64, y: f64, half: f64, plane: Plane) -> Surface {
        let corner = |dx: f64, dy: f64| FloorPoint { x: x + dx * half, y: y + dy * half };
        let region = vec![corner(-1.0, -1.0), corner(1.0, -1.0), corner(1.0, 1.0), corner(-1.0, 1.0)];
        Surface { plane, covariance: [[0.0; 3]; 3], region }
    }

    fn camera() -> Camera {
        Camera {
            position: WorldPoint::new(0.0, 0.0, 4.0),
            yaw: 0.0,
            pitch: 0.5,
            roll: 0.0,
            focal: 1000.0,
            lens: Lens::pinhole(Pixel { u: 960.0, v: 540.0 }),
            covariance: Covariance::EXACT,
        }
    }

    #[test]
    fn a_platform_hides_the_floor_behind_it() {
        let surfaces = [square(0.0, 8.0, 1.0, Plane::level(1.0))];
        let shown = |at: WorldPoint| {
            let pixel = camera().world_to_pixel(at).unwrap();
            camera().pixel_to_surface(pixel, 0.0, &surfaces).unwrap()
        };
        let on_top = shown(WorldPoint::new(0.2, 8.0, 1.0));
        assert_eq!(on_top.surface, Some(0));
        assert!(on_top.at.distance(WorldPoint::new(0.2, 8.0, 1.0)) < 1e-9);
        let hidden = shown(WorldPoint::new(0.0, 11.0, 0.0));
        assert_eq!(hidden.surface, Some(0), "the platform stands before it");
        let beside = shown(WorldPoint::new(3.0, 8.0, 0.0));
        assert_eq!(beside.surface, None);
    }

    #[test]
    fn pit_has_no_floor() {
        let surfaces = [square(0.0, 6.0, 1.0, Plane::level(-1.0))];
        let pixel = |at: WorldPoint| camera().world_to_pixel(at).unwrap();
        let deep = camera().pixel_to_surface(pixel(WorldPoint::new(0.0, 6.5, -1.0)), 0.0, &surfaces);
        assert_eq!(deep.unwrap().surface, Some(0));
        // The far wall of the pit, half-way down.
        let wall = camera().pixel_to_surface(pixel(WorldPoint::new(0.0, 7.0, -0.5)), 0.0, &surfaces);
        assert_eq!(wall, None);
    }

    #[test]
    fn surface_sigmas_match_slope_covariance() {
        let plane = Plane::falling(0.4, 0.7, 0.1, FloorPoint::default());
        let ((sin, cos), [along, across]) = (0.7_f64.sin_cos(), [9e-4, 1e-4]);
        let (xx, yy) = (along * cos * cos + across * sin * sin, along * sin * sin + across * cos * cos);
        let xy = (along - across) * sin * cos;
        let covariance = [[4e-4, 0.0, 0.0], [0.0, xx, xy], [0.0, xy, yy]];
        let surface = Surface { plane, covariance, region: Vec::new() };
        let sigmas = surface.sigmas();
        assert!((sigmas.height - 0.02).abs() < 1e-12);
        // d atan(s) = ds / (1 + s^2); the direction changes by the slope across divided by the slope along.
        let steepness = 0.1_f64.tan();
        assert!((sigmas.fall - 0.03 / (1.0 + steepness * steepness)).abs() < 1e-12);
        assert!((sigmas.toward.unwrap() - 0.01 / steepness).abs() < 1e-12);
        let level = Surface { plane: Plane::level(0.0), ..surface };
        assert!(level.sigmas().toward.is_none());
    }

    #[test]
    fn mezzanine_above_the_camera_is_not_visible() {
        let surfaces = [square(0.0, 6.0, 5.0, Plane::level(6.0))];
        let up = camera().world_to_pixel(WorldPoint::new(0.0, 9.0, 5.0)).unwrap();
        assert_eq!(camera().pixel_to_surface(up, 0.0, &surfaces), None);
    }
}

#[cfg(test)]
mod surface_projector_tests {
    use proptest::prelude::*;

    use super::*;
    use crate::camera::{Covariance, Plane, WorldPoint, any_camera};

    const SIZE: [f64; 2] = [1920.0, 1080.0];

    fn rectangle([x, y]: [f64; 2], [half_x, half_y]: [f64; 2], plane: Plane) -> Surface {
        let corners = [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]];
        let region = corners.map(|[a, b]| FloorPoint { x: x + a * half_x, y: y + b * half_y }).to_vec();
        let plane = Plane { anchor: FloorPoint { x, y }, ..plane };
        Surface { plane, covariance: [[4e-4, 0.0, 0.0], [0.0, 1e-4, 0.0], [0.0, 0.0, 1e-4]], region }
    }

    /// Returns a platform, a pit, and a ramp that falls to the right.
    fn surfaces() -> Vec<Surface> {
        let ramp = Plane::falling(0.4, 0.0, 0.1, FloorPoint { x: 4.0, y: 8.0 });
        vec![
            rectangle([-3.0, 7.0], [2.0, 2.0], Plane::level(0.8)),
            rectangle([0.0, 5.0], [0.8, 1.5], Plane::level(-0.9)),
            rectangle([4.0, 8.0], [2.5, 3.0], ramp),
        ]
    }

    fn mapped(
        camera: &Camera,
        surfaces: &[Surface],
        pixels: &[(f64, f64)],
    ) -> Vec<(Option<SurfacePoint>, Status)> {
        let (u, v): (Vec<f64>, Vec<f64>) = pixels.iter().copied().unzip();
        let efov = crate::floor::efov::default_efov(camera, SIZE).polygon;
        let extent = Extent { size: SIZE, efov: &efov };
        let (mut points, mut status) = (vec![None; u.len()], vec![Status::Missing; u.len()]);
        SurfaceProjector::new(camera, 0.0, surfaces).pixels_to_surfaces(
            &extent,
            [&u, &v],
            &mut points,
            &mut status,
        );
        points.into_iter().zip(status).collect()
    }

    proptest! {
        #[test]
        fn slice_maps_like_single_pixels(
            camera in any_camera(),
            at in proptest::collection::vec((-100.0..2020.0_f64, 0.0..1100.0_f64), 1..600),
        ) {
            let surfaces = surfaces();
            for (&(u, v), (found, status)) in at.iter().zip(mapped(&camera, &surfaces, &at)) {
                let pixel = Pixel { u, v };
                let expected = camera.pixel_to_surface(pixel, 0.0, &surfaces);
                // On the edge of a region, the surface depends on rounding.
                let nudged = [(1e-5, 0.0), (-1e-5, 0.0), (0.0, 1e-5), (0.0, -1e-5)].map(|(du, dv)| {
                    camera.pixel_to_surface(Pixel { u: u + du, v: v + dv }, 0.0, &surfaces).map(|p| p.surface)
                });
                prop_assume!(nudged.iter().all(|other| *other == expected.map(|p| p.surface)));
                prop_assert_eq!(found.map(|p| p.surface), expected.map(|p| p.surface));
                prop_assert_eq!(found.is_none(), matches!(status, Status::AboveHorizon | Status::OnWall | Status::OutsideLens));
                if let (Some(found), Some(expected)) = (found, expected) {
                    let range = expected.at.distance(camera.position);
                    prop_assert!(range > 1e5 || found.at.distance(expected.at) < 1e-10 * (1.0 + range).powi(2));
                }
            }
        }

        #[test]
        fn without_surfaces_result_equals_floor_exactly(
            camera in any_camera(),
            at in proptest::collection::vec((-100.0..2020.0_f64, -100.0..1100.0_f64), 1..600),
        ) {
            let (u, v): (Vec<f64>, Vec<f64>) = at.iter().copied().unzip();
            let (mut x, mut y, mut status) = (vec![0.0; u.len()], vec![0.0; u.len()], vec![Status::Ok; u.len()]);
            let efov = crate::floor::efov::default_efov(&camera, SIZE).polygon;
            let extent = Extent { size: SIZE, efov: &efov };
            FloorProjector::new(&camera, 0.0)
                .pixels_to_floor_within(&extent, [&u, &v], [&mut x, &mut y], &mut status);
            for (i, (found, judged)) in mapped(&camera, &[], &at).into_iter().enumerate() {
                prop_assert_eq!(judged, status[i]);
                let floor = found.map(|point| (point.at.x, point.at.y));
                prop_assert_eq!(floor, (!x[i].is_nan()).then_some((x[i], y[i])));
            }
        }
    }

    fn camera() -> Camera {
        Camera {
            position: WorldPoint::new(0.0, 0.0, 4.0),
            yaw: 0.0,
            pitch: 0.5,
            roll: 0.0,
            focal: 1000.0,
            lens: crate::camera::Lens::pinhole(Pixel { u: 960.0, v: 540.0 }),
            covariance: Covariance::EXACT,
        }
    }

    #[test]
    fn pit_wall_has_status_on_wall() {
        let pixel = camera().world_to_pixel(WorldPoint::new(0.0, 6.5, -0.3)).unwrap();
        let found = mapped(&camera(), &surfaces(), &[(pixel.u, pixel.v)]);
        assert_eq!(found, [(None, Status::OnWall)]);
    }

    #[test]
    fn plane_covariance_propagates_to_points() {
        let (camera, surfaces) = (camera(), surfaces());
        let pixel = camera.world_to_pixel(WorldPoint::new(-3.0, 7.0, 0.8)).unwrap();
        let projector = SurfaceProjector::new(&camera, 0.0, &surfaces);
        let on = |surface| projector.covariance(pixel, 0.0, surface).unwrap().worst_sigma().unwrap();
        assert!(on(None) < 1e-9, "an exact camera and the floor");
        // A height error of 2 cm moves the point along its ray by 2 cm times its floor distance divided by
        // the drop.
        let along = (3.0_f64.hypot(7.0)) / (4.0 - 0.8);
        assert!((on(Some(0)) - 0.02 * along).abs() < 1e-9, "{}", on(Some(0)));
        assert!(projector.covariance(pixel, 1.0, Some(9)).is_none());
    }
}
