//! What a pixel shows of a site of several planes: the first that its ray meets.
//!
//! A plane holds inside its region. A region below the floor is a pit: the floor is not there. A region above
//! it hides what lies behind it. Walls between a region and what surrounds it are no plane: where a ray meets
//! only them, there is no point.

use crate::camera::{Camera, FloorPoint, Pixel, Plane, WorldPoint};

/// A plane with the region where it holds.
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

    /// How well height, fall and the direction of the fall are known.
    #[must_use]
    pub fn sigmas(&self) -> SurfaceSigmas {
        let [[height, ..], [_, xx, xy], [_, _, yy]] = self.covariance;
        let [x, y] = self.plane.slope;
        let steepness = x.hypot(y);
        let along = |a: f64, b: f64| (a * a * xx + 2.0 * a * b * xy + b * b * yy).max(0.0).sqrt();
        let height = height.max(0.0).sqrt();
        // The fall is the arc tangent of the steepness; nothing points where there is none.
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

    /// Where the ray of a pixel meets the plane raised by `height` metres from above, inside the region.
    fn met(&self, camera: &Camera, pixel: Pixel, height: f64) -> Option<WorldPoint> {
        let at = camera.pixel_to_plane(pixel, &self.below(camera, height)?)?;
        self.holds_at(at.on_floor()).then_some(at)
    }
}

/// How well a plane is known, as standard deviations.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SurfaceSigmas {
    /// Of its height at its anchor, in metres.
    pub height: f64,
    /// Of the angle by which it falls, in radians.
    pub fall: f64,
    /// Of the direction that it falls toward, in radians; `None` of a level plane.
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
    /// Where it is, in metres.
    pub at: WorldPoint,
}

impl SurfacePoint {
    /// Of two points of one ray, the one that the ray from `eye` meets first: where a plane lies on
    /// the floor or on another plane it is `other`, which is later in the list.
    pub(crate) fn or_before(self, other: Self, eye: WorldPoint) -> Self {
        if self.at.distance(eye) < other.at.distance(eye) { self } else { other }
    }
}

impl Camera {
    /// The point that `pixel` shows `height` metres above the floor or a surface, whichever its ray meets first.
    ///
    /// `None` where it meets none: above the horizon, outside the lens, or on the wall of a pit.
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
