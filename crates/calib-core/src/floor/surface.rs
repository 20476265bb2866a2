//! Sites with several planes: a pixel shows the first plane that its ray meets.
//!
//! A plane is valid inside its region. A region below the floor is a pit, where the floor is absent. A region
//! above the floor hides the floor behind it. Walls between a region and its surroundings are not planes: a
//! ray that meets only a wall has no point. Slices of pixels are mapped to the first plane on each ray.

use crate::camera::{Camera, FloorCovariance, FloorPoint, Pixel, Plane, WorldPoint};
use crate::floor::extent::{Extent, Status};
use crate::floor::projector::FloorProjector;

/// Plane with the region in which it is valid.
#[derive(Clone, Debug, PartialEq)]
pub struct Surface {
    /// Height and slope.
    pub plane: Plane,
    /// Covariance of height and slope, in square metres and squares of rise per metre.
    pub covariance: [[f64; 3]; 3],
    /// The polygon on the plan inside which the plane holds, in metres; nowhere if empty.
    pub region: Vec<FloorPoint>,
}

impl Surface {
    /// Whether the plane holds above or below a point of the floor (even-odd rule).
    #[must_use]
    pub fn holds_at(&self, at: FloorPoint) -> bool {
        let FloorPoint { x, y } = at;
        let edges = self.region.iter().zip(self.region.iter().cycle().skip(1));
        let crossed =
            edges.filter(|(a, b)| (a.y > y) != (b.y > y) && x < a.x + (y - a.y) / (b.y - a.y) * (b.x - a.x));
        crossed.count() % 2 == 1
    }

    /// Returns the standard deviations of height, slope and slope direction.
    #[must_use]
    pub fn sigmas(&self) -> SurfaceSigmas {
        let [[height, ..], [_, xx, xy], [_, _, yy]] = self.covariance;
        let [x, y] = self.plane.slope;
        let steepness = x.hypot(y);
        let along = |a: f64, b: f64| (a * a * xx + 2.0 * a * b * xy + b * b * yy).max(0.0).sqrt();
        let height = height.max(0.0).sqrt();
        // The slope angle is the arc tangent of the steepness; a level plane has no slope direction.
        if steepness == 0.0 {
            return SurfaceSigmas { height, fall: xx.max(yy).max(0.0).sqrt(), toward: None };
        }
        let (x, y) = (x / steepness, y / steepness);
        let fall = along(x, y) / (1.0 + steepness * steepness);
        SurfaceSigmas { height, fall, toward: Some(along(-y, x) / steepness) }
    }

    /// The plane raised by `height` metres, if the camera looks at it from above.
    pub(crate) fn below(&self, camera: &Camera, height: f64) -> Option<Plane> {
        let raised = self.plane.raised(height);
        (camera.position.z > raised.height_at(camera.position.on_floor())).then_some(raised)
    }

    /// Returns the intersection of a pixel's ray with the plane raised by `height` metres, from above and
    /// inside the region.
    fn met(&self, camera: &Camera, pixel: Pixel, height: f64) -> Option<WorldPoint> {
        let at = camera.pixel_to_plane(pixel, &self.below(camera, height)?)?;
        self.holds_at(at.on_floor()).then_some(at)
    }
}

/// Uncertainty of a plane, as standard deviations.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SurfaceSigmas {
    /// Standard deviation of the height at the anchor, in metres.
    pub height: f64,
    /// Standard deviation of the slope angle, in radians.
    pub fall: f64,
    /// Standard deviation of the slope direction, in radians; `None` for a level plane.
    pub toward: Option<f64>,
}

/// Whether a surface lies below the floor there, so that the floor is not.
pub(crate) fn is_pit(surfaces: &[Surface], at: FloorPoint) -> bool {
    surfaces.iter().any(|surface| surface.plane.height_at(at) < 0.0 && surface.holds_at(at))
}

/// A point of the site that a pixel shows.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SurfacePoint {
    /// Index of the surface; `None` of the floor.
    pub surface: Option<usize>,
    /// Position, in metres.
    pub at: WorldPoint,
}

impl SurfacePoint {
    /// Returns the first of two points on one ray from `eye`. If planes coincide, it is `other`, the later
    /// one in the list.
    pub(crate) fn or_before(self, other: Self, eye: WorldPoint) -> Self {
        if self.at.distance(eye) < other.at.distance(eye) { self } else { other }
    }
}

impl Camera {
    /// Returns the point of a pixel `height` metres above the floor or above the surface that its ray meets
    /// first.
    ///
    /// `None` above the horizon, outside the lens, or on the wall of a pit.
    #[must_use]
    pub fn pixel_to_surface(&self, pixel: Pixel, height: f64, surfaces: &[Surface]) -> Option<SurfacePoint> {
        let met = surfaces.iter().enumerate().filter_map(|(index, surface)| {
            Some(SurfacePoint { surface: Some(index), at: surface.met(self, pixel, height)? })
        });
        let on_floor = self.pixel_to_floor(pixel, height).filter(|&at| !is_pit(surfaces, at));
        let on_floor = on_floor.map(|at| SurfacePoint { surface: None, at: at.at_height(height) });
        on_floor.into_iter().chain(met).reduce(|before, next| before.or_before(next, self.position))
    }
}

/// A camera prepared for mapping many pixels to the floor and the surfaces of a site.
#[derive(Clone, Copy, Debug)]
pub struct SurfaceProjector<'a> {
    floor: FloorProjector,
    surfaces: &'a [Surface],
}

/// Number of pixels per chunk, so that nothing is allocated.
const CHUNK: usize = 256;

impl<'a> SurfaceProjector<'a> {
    /// Prepares `camera` for the points `height` metres above the floor and above every surface.
    #[must_use]
    pub fn new(camera: &Camera, height: f64, surfaces: &'a [Surface]) -> Self {
        Self { floor: FloorProjector::new(camera, height), surfaces }
    }

    /// Maps raw pixels `(u, v)` like [`Camera::pixel_to_surface`], with their status.
    ///
    /// A pixel is inside the EFOV if the floor point on its ray is, even if a surface hides it.
    ///
    /// # Panics
    /// When the slices differ in length.
    pub fn pixels_to_surfaces(
        &self,
        extent: &Extent<'_>,
        [u, v]: [&[f64]; 2],
        points: &mut [Option<SurfacePoint>],
        status: &mut [Status],
    ) {
        assert!(u.len() == v.len() && u.len() == points.len(), "slices of one length");
        assert!(status.len() == u.len(), "slices of one length");
        let pixels = u.chunks(CHUNK).zip(v.chunks(CHUNK));
        let mapped = points.chunks_mut(CHUNK).zip(status.chunks_mut(CHUNK));
        for ((u, v), (points, status)) in pixels.zip(mapped) {
            self.map_floor(extent, [u, v], points, status);
            for (index, surface) in self.surfaces.iter().enumerate() {
                self.map_surface((index, surface), extent, [u, v], points, status);
            }
        }
    }

    /// Maps pixels to the floor, outside pits.
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

    /// Maps pixels to a surface, if it is nearer than the current point.
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
        let span = Span::of(&surface.region);
        for i in 0..u.len() {
            let at = FloorPoint { x: x[i], y: y[i] };
            if !(span.contains(at) && surface.holds_at(at)) {
                continue;
            }
            let met = SurfacePoint { surface: Some(index), at: at.at_height(plane.height_at(at)) };
            let first = points[i].map_or(met, |before| before.or_before(met, camera.position));
            if points[i] != Some(first) {
                points[i] = Some(first);
                status[i] = extent.status_of(camera.position, Pixel { u: u[i], v: v[i] }, first.at);
            }
        }
    }

    /// Returns the covariance of the point of a raw pixel on a surface or on the floor; see
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

    /// Computes the covariances of the first points on the rays of raw pixels `(u, v)`, of the pixel and of
    /// the calibration, like [`FloorCovariance::rows`].
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

/// The rectangle about a region: most points lie outside it, and outside of few corners.
struct Span([FloorPoint; 2]);

impl Span {
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
    fn there_is_no_floor_where_a_pit_is() {
        let surfaces = [square(0.0, 6.0, 1.0, Plane::level(-1.0))];
        let pixel = |at: WorldPoint| camera().world_to_pixel(at).unwrap();
        let deep = camera().pixel_to_surface(pixel(WorldPoint::new(0.0, 6.5, -1.0)), 0.0, &surfaces);
        assert_eq!(deep.unwrap().surface, Some(0));
        // The far wall of the pit, half way down.
        let wall = camera().pixel_to_surface(pixel(WorldPoint::new(0.0, 7.0, -0.5)), 0.0, &surfaces);
        assert_eq!(wall, None);
    }

    #[test]
    fn what_is_known_of_fall_and_direction_gives_the_slope_it_came_from() {
        let plane = Plane::falling(0.4, 0.7, 0.1, FloorPoint::default());
        let ((sin, cos), [along, across]) = (0.7_f64.sin_cos(), [9e-4, 1e-4]);
        let (xx, yy) = (along * cos * cos + across * sin * sin, along * sin * sin + across * cos * cos);
        let xy = (along - across) * sin * cos;
        let covariance = [[4e-4, 0.0, 0.0], [0.0, xx, xy], [0.0, xy, yy]];
        let surface = Surface { plane, covariance, region: Vec::new() };
        let sigmas = surface.sigmas();
        assert!((sigmas.height - 0.02).abs() < 1e-12);
        // d atan(s) = ds / (1 + s^2), and the direction turns by the slope across over the slope along.
        let steepness = 0.1_f64.tan();
        assert!((sigmas.fall - 0.03 / (1.0 + steepness * steepness)).abs() < 1e-12);
        assert!((sigmas.toward.unwrap() - 0.01 / steepness).abs() < 1e-12);
        let level = Surface { plane: Plane::level(0.0), ..surface };
        assert!(level.sigmas().toward.is_none());
    }

    #[test]
    fn a_mezzanine_above_the_camera_shows_it_nothing() {
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

    /// A platform, a pit, and a ramp that falls to the right.
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
        fn a_slice_maps_as_its_pixels_do(
            camera in any_camera(),
            at in proptest::collection::vec((-100.0..2020.0_f64, 0.0..1100.0_f64), 1..600),
        ) {
            let surfaces = surfaces();
            for (&(u, v), (found, status)) in at.iter().zip(mapped(&camera, &surfaces, &at)) {
                let pixel = Pixel { u, v };
                let expected = camera.pixel_to_surface(pixel, 0.0, &surfaces);
                // On the edge of a region a rounding decides.
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
        fn without_surfaces_there_is_the_floor_bit_by_bit(
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
    fn a_wall_of_a_pit_is_called_one() {
        let pixel = camera().world_to_pixel(WorldPoint::new(0.0, 6.5, -0.3)).unwrap();
        let found = mapped(&camera(), &surfaces(), &[(pixel.u, pixel.v)]);
        assert_eq!(found, [(None, Status::OnWall)]);
    }

    #[test]
    fn what_is_not_known_of_a_plane_is_not_known_of_its_points() {
        let (camera, surfaces) = (camera(), surfaces());
        let pixel = camera.world_to_pixel(WorldPoint::new(-3.0, 7.0, 0.8)).unwrap();
        let projector = SurfaceProjector::new(&camera, 0.0, &surfaces);
        let on = |surface| projector.covariance(pixel, 0.0, surface).unwrap().worst_sigma().unwrap();
        assert!(on(None) < 1e-9, "an exact camera and the floor");
        // 2 cm of height move the point along its ray by the horizontal distance per metre of drop.
        let along = (3.0_f64.hypot(7.0)) / (4.0 - 0.8);
        assert!((on(Some(0)) - 0.02 * along).abs() < 1e-9, "{}", on(Some(0)));
        assert!(projector.covariance(pixel, 1.0, Some(9)).is_none());
    }
}
