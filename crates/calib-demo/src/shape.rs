//! Shapes of the scene and their intersection with rays.
//!
//! The file also computes the rays of an image: exactly at the nodes of a mesh, and by interpolation between
//! the nodes.

use calib_core::{Camera, Lens, Pixel};

use crate::vector::{Vec3, greater, lesser, vec3};

/// Ray of the renderer.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Line {
    pub(crate) origin: Vec3,
    /// Direction: unit vector in world axes.
    pub(crate) direction: Vec3,
    /// Reciprocals of the coordinates of the direction.
    pub(crate) inverse: Vec3,
}

impl Line {
    pub(crate) fn new(origin: Vec3, direction: Vec3) -> Self {
        Self { origin, direction, inverse: direction.map(f32::recip) }
    }

    pub(crate) fn at(&self, distance: f32) -> Vec3 {
        self.origin + self.direction * distance
    }
}

/// Box along the world axes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Bounds {
    pub(crate) min: Vec3,
    pub(crate) max: Vec3,
}

impl Bounds {
    pub(crate) const EMPTY: Self =
        Self { min: Vec3::grey(f32::INFINITY), max: Vec3::grey(f32::NEG_INFINITY) };

    pub(crate) fn union(self, other: Self) -> Self {
        Self { min: self.min.min(other.min), max: self.max.max(other.max) }
    }

    pub(crate) fn middle(self) -> Vec3 {
        (self.min + self.max) * 0.5
    }

    pub(crate) fn size(self) -> Vec3 {
        self.max - self.min
    }

    /// Returns half the surface area, in square metres.
    pub(crate) fn half_area(self) -> f32 {
        let s = self.size();
        s.x * s.y + s.y * s.z + s.z * s.x
    }

    /// Returns the distances along the ray, in metres, where it enters and leaves the box. The ray misses the
    /// box if the first distance is greater.
    #[inline]
    pub(crate) fn span(&self, line: &Line) -> (f32, f32) {
        let a = (self.min - line.origin) * line.inverse;
        let b = (self.max - line.origin) * line.inverse;
        let (near, far) = (a.min(b), a.max(b));
        (greater(greater(near.x, near.y), near.z), lesser(lesser(far.x, far.y), far.z))
    }
}

/// Geometry of a solid.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Shape {
    /// Box along the world axes.
    Box(Bounds),
    /// Rotated box with its axes (unit vectors) and half lengths.
    RotatedBox { centre: Vec3, axes: [Vec3; 3], half: Vec3 },
    /// Hull of two balls (a tapering rod with round ends), or a single ball.
    Cone { from: Vec3, to: Vec3, radii: [f32; 2] },
    /// Cylinder with flat ends.
    Drum { from: Vec3, to: Vec3, radius: f32 },
}

/// Smallest accepted distance of an intersection along a ray, in metres. A nearer intersection belongs to the
/// surface on which the ray starts.
const NEAREST: f32 = 1e-4;

impl Shape {
    pub(crate) const fn ball(centre: Vec3, radius: f32) -> Self {
        Self::Cone { from: centre, to: centre, radii: [radius, radius] }
    }

    pub(crate) fn bounds(&self) -> Bounds {
        match *self {
            Self::Box(bounds) => bounds,
            Self::RotatedBox { centre, axes, half } => {
                let reach =
                    |i: usize| axes.iter().enumerate().map(|(k, a)| a.axis(i).abs() * half.axis(k)).sum();
                let reach = vec3(reach(0), reach(1), reach(2));
                Bounds { min: centre - reach, max: centre + reach }
            }
            Self::Cone { from, to, radii } => {
                let ball = |c: Vec3, r: f32| Bounds { min: c - Vec3::grey(r), max: c + Vec3::grey(r) };
                ball(from, radii[0]).union(ball(to, radii[1]))
            }
            Self::Drum { from, to, radius } => {
                let axis = (to - from).unit();
                let reach = axis.map(|a| radius * (1.0 - a * a).max(0.0).sqrt());
                Bounds { min: from.min(to) - reach, max: from.max(to) + reach }
            }
        }
    }

    /// Returns the distance along the ray, in metres, to the first intersection with the surface; `None` if
    /// it is not between 0 and `limit`.
    pub(crate) fn hit(&self, line: &Line, limit: f32) -> Option<f32> {
        let distance = match *self {
            Self::Box(bounds) => {
                let (near, far) = bounds.span(line);
                (near <= far).then_some(near)
            }
            Self::RotatedBox { centre, axes, half } => {
                let from = line.origin - centre;
                let own = |v: Vec3| vec3(v.dot(axes[0]), v.dot(axes[1]), v.dot(axes[2]));
                let (near, far) =
                    Bounds { min: -half, max: half }.span(&Line::new(own(from), own(line.direction)));
                (near <= far).then_some(near)
            }
            Self::Cone { from, to, radii } => hit_cone(line, from, to, radii),
            Self::Drum { from, to, radius } => hit_drum(line, from, to, radius),
        };
        distance.filter(|&t| t > NEAREST && t < limit)
    }

    /// Returns the outward normal at a point of the surface.
    pub(crate) fn normal(&self, point: Vec3) -> Vec3 {
        match *self {
            Self::Box(bounds) => box_normal(point - bounds.middle(), bounds.size() * 0.5),
            Self::RotatedBox { centre, axes, half } => {
                let v = point - centre;
                let n = box_normal(vec3(v.dot(axes[0]), v.dot(axes[1]), v.dot(axes[2])), half);
                axes[0] * n.x + axes[1] * n.y + axes[2] * n.z
            }
            Self::Cone { from, to, radii } => cone_normal(point, from, to, radii),
            Self::Drum { from, to, radius } => {
                let (axis, v) = ((to - from).unit(), point - from);
                let along = v.dot(axis);
                let out = v - axis * along;
                let rim = 1e-3 * radius;
                if out.length() > radius - rim && along > rim && along < (to - from).length() - rim {
                    return out.unit();
                }
                if along < 0.5 * (to - from).length() { -axis } else { axis }
            }
        }
    }
}

/// Returns the normal of the nearest face of a box with the half lengths `half`. The point `v` is relative to
/// the centre of the box.
fn box_normal(v: Vec3, half: Vec3) -> Vec3 {
    let depth = vec3(half.x - v.x.abs(), half.y - v.y.abs(), half.z - v.z.abs());
    if depth.x < depth.y && depth.x < depth.z {
        vec3(v.x.signum(), 0.0, 0.0)
    } else if depth.y < depth.z {
        vec3(0.0, v.y.signum(), 0.0)
    } else {
        vec3(0.0, 0.0, v.z.signum())
    }
}

/// Moves the origin of a ray along the ray, close to the centre `middle` of a shape. Returns the distance and the
/// new origin. Squares of long distances would lose digits in single precision.
fn shift_origin(line: &Line, middle: Vec3) -> (f32, Vec3) {
    let shift = (middle - line.origin).dot(line.direction);
    (shift, line.at(shift))
}

/// Intersects the hull of two balls in closed form: its flank between the balls, otherwise the nearer ball.
fn hit_cone(line: &Line, from: Vec3, to: Vec3, [ra, rb]: [f32; 2]) -> Option<f32> {
    let (shift, origin) = shift_origin(line, (from + to) * 0.5);
    let (ba, oa, ob, rd) = (to - from, origin - from, origin - to, line.direction);
    let ball = |o: Vec3, r: f32| {
        let b = o.dot(rd);
        let h = b * b - o.dot(o) + r * r;
        (h > 0.0).then(|| shift - b - h.sqrt())
    };
    let m0 = ba.dot(ba);
    if m0 == 0.0 {
        return ball(oa, ra);
    }
    let rr = ra - rb;
    let (m1, m2, m3, m5) = (ba.dot(oa), ba.dot(rd), rd.dot(oa), oa.dot(oa));
    let d2 = m0 - rr * rr;
    let k2 = d2 - m2 * m2;
    let k1 = d2 * m3 - m1 * m2 + m2 * rr * ra;
    let k0 = d2 * m5 - m1 * m1 + m1 * rr * ra * 2.0 - m0 * ra * ra;
    let h = k1 * k1 - k0 * k2;
    if h < 0.0 {
        return None;
    }
    let t = (-h.sqrt() - k1) / k2;
    let y = m1 - ra * rr + t * m2;
    if y > 0.0 && y < d2 {
        return Some(shift + t);
    }
    match (ball(oa, ra), ball(ob, rb)) {
        (Some(a), Some(b)) => Some(a.min(b)),
        (a, b) => a.or(b),
    }
}

fn cone_normal(point: Vec3, from: Vec3, to: Vec3, [ra, rb]: [f32; 2]) -> Vec3 {
    let (ba, pa) = (to - from, point - from);
    let d2 = ba.dot(ba) - (ra - rb) * (ra - rb);
    let y = ba.dot(pa) - ra * (ra - rb);
    if y <= 0.0 {
        pa.unit()
    } else if y >= d2 {
        (point - to).unit()
    } else {
        (pa * d2 - ba * y).unit()
    }
}

fn hit_drum(line: &Line, from: Vec3, to: Vec3, radius: f32) -> Option<f32> {
    let (shift, origin) = shift_origin(line, (from + to) * 0.5);
    let length = (to - from).length();
    let axis = (to - from) * length.recip();
    let oa = origin - from;
    let (along, climb) = (oa.dot(axis), line.direction.dot(axis));
    let (o, d) = (oa - axis * along, line.direction - axis * climb);
    let (a, b, c) = (d.dot(d), o.dot(d), o.dot(o) - radius * radius);
    let h = b * b - a * c;
    if h < 0.0 {
        return None;
    }
    let flank = if a > 1e-12 { (-b - h.sqrt()) / a } else { f32::NEG_INFINITY };
    let z = along + flank * climb;
    if a > 1e-12 && z > 0.0 && z < length {
        return Some(shift + flank);
    }
    let end = if climb > 0.0 { 0.0 } else { length };
    let t = (end - along) / climb;
    let p = o + d * t;
    (t.is_finite() && p.dot(p) < radius * radius).then_some(shift + t)
}

/// Distance between neighbouring nodes of the mesh of rays, in pixels. Interpolation between the nodes has
/// errors below 0.01 pixels for the lenses of the demonstration.
const PITCH: usize = 4;

/// Rays of one camera, interpolated between the nodes of a mesh.
#[derive(Debug)]
pub(crate) struct Rays {
    origin: Vec3,
    /// Ray directions at the nodes, row by row; NaN outside the lens.
    nodes: Vec<Vec3>,
    columns: usize,
    /// Centre and radius of the image circle of a fisheye, in pixels.
    rim: Option<[f32; 3]>,
}

impl Rays {
    pub(crate) fn new(camera: &Camera, [width, height]: [u32; 2]) -> Self {
        let columns = width as usize / PITCH + 2;
        let rows = height as usize / PITCH + 2;
        let node = |i: usize| Pixel::new(((i % columns) * PITCH) as f64, ((i / columns) * PITCH) as f64);
        // Cells at the border of the image circle need nodes outside it.
        let beyond = Camera { lens: Lens { image_circle: None, ..camera.lens }, ..*camera };
        let direction = |i: usize| {
            let [x, y, z] = beyond.pixel_to_ray(node(i))?.direction;
            // Directions are scaled to equal depth (coordinate along the optical axis), because these
            // interpolate linearly. Rays of a fisheye stay unit vectors, because rays to its side have no
            // depth.
            let ahead = camera.rotation()[2];
            let depth = x * ahead[0] + y * ahead[1] + z * ahead[2];
            let depth = if camera.lens.distortion.is_wide() { 1.0 } else { depth };
            Some(Vec3 { x: (x / depth) as f32, y: (y / depth) as f32, z: (z / depth) as f32 })
        };
        let nowhere = Vec3::grey(f32::NAN);
        let nodes = (0..columns * rows).map(|i| direction(i).unwrap_or(nowhere)).collect();
        let rim = camera.lens.image_circle.map(|circle| <[f64; 3]>::from(circle).map(|side| side as f32));
        Self { origin: camera.position.into(), nodes, columns, rim }
    }

    /// Returns the ray through a point of the image, in pixels; `None` outside the lens.
    pub(crate) fn through(&self, u: f32, v: f32) -> Option<Line> {
        if self.rim.is_some_and(|[cu, cv, radius]| (u - cu).hypot(v - cv) > radius) {
            return None;
        }
        let (x, y) = (u / PITCH as f32, v / PITCH as f32);
        let (i, j) = (x as usize, y as usize);
        let (fx, fy) = (x - i as f32, y - j as f32);
        let at = |di: usize, dj: usize| self.nodes[(j + dj) * self.columns + i + di];
        let upper = at(0, 0).towards(at(1, 0), fx);
        let lower = at(0, 1).towards(at(1, 1), fx);
        let direction = upper.towards(lower, fy).unit();
        (!direction.x.is_nan()).then(|| Line::new(self.origin, direction))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_shape_is_hit_on_its_surface_and_faces_the_ray() {
        let third = 1.0 / 3_f32.sqrt();
        let axes = [vec3(0.6, 0.8, 0.0), vec3(-0.8, 0.6, 0.0), Vec3::UP];
        let shapes = [
            Shape::Box(Bounds { min: vec3(1.0, 1.0, 0.0), max: vec3(2.0, 2.5, 1.5) }),
            Shape::RotatedBox { centre: vec3(1.5, 1.5, 1.0), axes, half: vec3(0.5, 0.4, 0.6) },
            Shape::Cone { from: vec3(1.2, 1.4, 0.5), to: vec3(1.5, 1.5, 1.8), radii: [0.5, 0.4] },
            Shape::ball(vec3(1.5, 1.5, 1.5), 0.5),
            Shape::Drum { from: vec3(1.5, 1.5, 0.5), to: vec3(1.5, 1.4, 1.9), radius: 0.4 },
        ];
        let origin = vec3(-10.0, -10.0, -10.0);
        let line = Line::new(origin, vec3(third, third, third));
        for shape in shapes {
            let t = shape.hit(&line, 100.0).unwrap_or_else(|| panic!("the ray misses {shape:?}"));
            let point = line.at(t);
            let normal = shape.normal(point);
            assert!((normal.length() - 1.0).abs() < 1e-4 && normal.dot(line.direction) < 0.0, "{shape:?}");
            let bounds = shape.bounds();
            let slack = Vec3::grey(1e-3);
            let inside = point.max(bounds.min - slack) == point && point.min(bounds.max + slack) == point;
            assert!(inside, "{point:?} of {shape:?} outside its bounds");
            assert_eq!(shape.hit(&line, t - 0.01), None, "the limit holds");
            assert_eq!(shape.hit(&Line::new(origin, vec3(-third, third, third)), 100.0), None, "{shape:?}");
        }
    }

    #[test]
    fn mesh_rays_match_the_camera() {
        for (_, camera, size) in crate::site::cameras() {
            let rays = Rays::new(&camera, size);
            for i in 0..200 {
                let (u, v) = (9.37 * i as f64 % f64::from(size[0]), 5.11 * i as f64 % f64::from(size[1]));
                if camera.lens.image_circle.is_some_and(|circle| !circle.contains(Pixel::new(u, v))) {
                    assert!(rays.through(u as f32, v as f32).is_none());
                    continue;
                }
                let exact = camera.pixel_to_ray(Pixel::new(u, v)).unwrap().direction;
                let exact = Vec3 { x: exact[0] as f32, y: exact[1] as f32, z: exact[2] as f32 };
                let off = (rays.through(u as f32, v as f32).unwrap().direction - exact).length();
                assert!(off * (camera.focal as f32) < 0.01, "{off} at {u}, {v}");
            }
        }
    }
}
