//! Computation of the light at a point: from sun, sky and lamps, and from reflections of walls and floors.

use crate::building::CEILING;
use crate::shape::Line;
use crate::stage::Lamp;
use crate::texture::chance;
use crate::vector::{Vec3, vec3};
use crate::world::World;

/// Part of the scene with its own light.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Room {
    Shop,
    Store,
    Barn,
    Outside,
}

/// Light that arrives at a surface point, relative to a well-lit white wall.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Light {
    /// Light from lamps, sky and surroundings that a white surface would reflect.
    pub(crate) diffuse: Vec3,
    /// Light from the direction of a mirror reflection.
    pub(crate) mirror: Vec3,
}

/// Surface point at which the light is computed.
#[derive(Clone, Copy, Debug)]
pub(crate) struct LightQuery {
    pub(crate) point: Vec3,
    pub(crate) normal: Vec3,
    /// Viewing direction: unit vector from the camera to the point.
    pub(crate) view: Vec3,
    /// Whether the mirror reflection is computed.
    pub(crate) mirrors: bool,
    /// Index that selects the ray directions. Neighbouring pixels use consecutive indices, so that their rays
    /// interleave.
    pub(crate) turn: u32,
}

impl LightQuery {
    /// Returns two numbers from 0 to 1 for the ray with this index (Roberts' sequence). For consecutive
    /// values of `turn` the pairs fill the square evenly, so the mean over neighbouring pixels has little
    /// noise.
    fn even(&self, ray: u32) -> [f32; 2] {
        let turn = self.turn as f32;
        [(0.754_877_7 * turn + chance(ray)).fract(), (0.569_840_3 * turn + chance(ray ^ 0xabcd)).fract()]
    }
}

/// Unit vector toward the sun, in world axes.
const SUN: Vec3 = vec3(-0.4194, 0.6990, 0.5791);
/// Colour of sunlight on a white surface perpendicular to the light, relative to a well-lit white wall.
const SUNLIGHT: Vec3 = vec3(2.5, 2.25, 1.85);
/// Distance of a ray's origin above the surface that it starts from, in metres.
const RAY_OFFSET: f32 = 1e-3;
/// Maximum length of a ray for indirect light, in metres. Longer rays return the mean light of the room.
const MAX_INDIRECT_DISTANCE: f32 = 2.6;
/// Distance that exceeds all distances in the scene, in metres.
const BEYOND_SCENE: f32 = 400.0;

/// Returns the room of a point; the space under the roof of the barn belongs to the barn.
pub(crate) fn room_at(p: Vec3) -> Room {
    let within = |x0: f32, x1: f32, y0: f32, y1: f32| p.x > x0 && p.x < x1 && p.y > y0 && p.y < y1;
    if p.z < -0.25 {
        Room::Outside
    } else if within(-0.12, 24.1, -0.1, 14.52) && p.z < CEILING + 0.1 {
        Room::Shop
    } else if within(24.1, 30.12, -0.1, 14.52) && p.z < CEILING {
        Room::Store
    } else if within(-0.12, 30.12, -12.35, -0.1) && p.z < 6.0 - 0.43 * (p.y + 6.25).abs() {
        Room::Barn
    } else {
        Room::Outside
    }
}

/// Returns the light of the sky from a direction.
pub(crate) fn sky(direction: Vec3) -> Vec3 {
    let up = direction.z.clamp(0.0, 1.0).sqrt();
    vec3(1.65, 1.72, 1.76).towards(vec3(0.75, 1.1, 1.7), up)
}

/// Returns the mean light from a direction in a room.
fn ambient(room: Room, direction: Vec3) -> Vec3 {
    let mixed = |low: Vec3, high: Vec3| low.towards(high, 0.5 + 0.5 * direction.z);
    match room {
        Room::Shop => {
            let daylight = vec3(0.16, 0.178, 0.195) * (0.5 + 0.5 * direction.y);
            mixed(vec3(0.20, 0.19, 0.175), vec3(0.27, 0.27, 0.265)) + daylight
        }
        Room::Store => mixed(vec3(0.21, 0.205, 0.195), vec3(0.32, 0.32, 0.315)),
        Room::Barn => {
            let gate = vec3(0.30, 0.32, 0.33) * direction.x.max(0.0);
            mixed(vec3(0.16, 0.145, 0.115), vec3(0.42, 0.44, 0.46)) + gate
        }
        Room::Outside if direction.z > 0.0 => sky(direction),
        Room::Outside => vec3(0.62, 0.64, 0.55),
    }
}

/// Returns the approximate light on a surface with this normal: unshadowed daylight outside, and the mean
/// light of the room inside.
fn mean_light(room: Room, normal: Vec3) -> Vec3 {
    match room {
        Room::Outside => vec3(0.95, 1.05, 1.2) + SUNLIGHT * SUN.dot(normal).max(0.0),
        room => ambient(room, normal) * 1.5,
    }
}

/// Returns the light along a ray, without shadows and up to `reach` metres, for indirect light and mirrors.
/// `lamps` is whether the full light of lamps is included; it is false if lamps are sampled separately.
fn trace_unshadowed(world: &World, line: &Line, reach: f32, home: Room, lamps: bool) -> Vec3 {
    match world.tree.nearest(line, reach) {
        None if reach < BEYOND_SCENE => {
            let end = room_at(line.at(reach));
            // Empty space between two rooms is a window or a gate.
            ambient(if end == home { home } else { end }, line.direction)
        }
        None => sky(line.direction),
        Some(hit) => {
            let solid = &world.solids[hit.solid as usize];
            let point = line.at(hit.distance);
            let normal = solid.shape.normal(point);
            let material = &solid.material;
            let room = room_at(point + normal * 0.02);
            let glow = if lamps { material.glow } else { material.glow.min(1.0) };
            material.colour * (mean_light(room, normal) + Vec3::grey(glow))
        }
    }
}

/// Computes the direct sunlight on a surface with one ray toward the sun, so that shadows are sharp.
pub(crate) fn sunlight(world: &World, point: Vec3, normal: Vec3) -> Vec3 {
    let slant = SUN.dot(normal);
    if slant <= 0.0 || !world.tree.is_clear(&Line::new(point + normal * RAY_OFFSET, SUN), BEYOND_SCENE) {
        return Vec3::ZERO;
    }
    SUNLIGHT * slant
}

/// Computes the light at a surface point. It traces `4 x rows` rays into the half space above the surface, and
/// at most one ray to each lamp of the room. The mirror reflection, if requested, needs more rays.
pub(crate) fn gather(world: &World, place: &LightQuery, rows: u32) -> Light {
    let LightQuery { normal, view, .. } = *place;
    let origin = place.point + normal * RAY_OFFSET;
    let home = room_at(place.point + normal * 0.02);
    if home == Room::Outside {
        return Light { diffuse: vec3(0.95, 1.05, 1.2), mirror: Vec3::ZERO };
    }
    let (tangent, other) = tangents(normal);
    let mut diffuse = Vec3::ZERO;
    for i in 0..rows {
        for j in 0..4 {
            let [a, b] = place.even(4 * i + j);
            let square = (i as f32 + a) / rows as f32;
            let turn = std::f32::consts::TAU * (j as f32 + b) / 4.0;
            let ((sin, cos), radius) = (turn.sin_cos(), square.sqrt());
            let direction =
                tangent * (radius * cos) + other * (radius * sin) + normal * (1.0 - square).sqrt();
            diffuse +=
                trace_unshadowed(world, &Line::new(origin, direction), MAX_INDIRECT_DISTANCE, home, false);
        }
    }
    diffuse = diffuse * (0.25 / rows as f32) + lamplight(world, origin, place, home);
    let mut mirror = Vec3::ZERO;
    if place.mirrors {
        /// Number of rays for the mirror reflection.
        const MIRROR_RAYS: u32 = 4;
        /// Width of the reflected directions on a rough surface, as a fraction of the ray length.
        const ROUGHNESS: f32 = 0.05;
        let ahead = view - normal * (2.0 * view.dot(normal));
        for i in 0..MIRROR_RAYS {
            let [a, b] = place.even(100 + i);
            let bent = tangent * (ROUGHNESS * (a - 0.5)) + other * (ROUGHNESS * (b - 0.5));
            mirror +=
                trace_unshadowed(world, &Line::new(origin, (ahead + bent).unit()), BEYOND_SCENE, home, true)
                    * (1.0 / MIRROR_RAYS as f32);
        }
    }
    Light { diffuse, mirror }
}

/// Computes the light of the lamps of a room. Faint lamps are sampled occasionally with a higher weight.
fn lamplight(world: &World, origin: Vec3, place: &LightQuery, home: Room) -> Vec3 {
    /// Brightness of a lamp's light above which the lamp is always sampled.
    const ALWAYS_SAMPLED_LIGHT: f32 = 0.025;
    let mut sum = Vec3::ZERO;
    for (i, lamp) in world.lamps.iter().enumerate().filter(|(_, lamp)| room_at(lamp.centre) == home) {
        let ray = 200 + 2 * i as u32;
        let (way, light) = lamp_sample(lamp, origin, place.normal, place.even(ray));
        let share = (light / ALWAYS_SAMPLED_LIGHT).min(1.0);
        if share <= 0.0 || place.even(ray + 1)[0] >= share {
            continue;
        }
        let length = way.length();
        if world.tree.is_clear(&Line::new(origin, way.unit()), length) {
            sum += lamp.radiance * (light / (share * lamp.radiance.luminance()));
        }
    }
    sum
}

/// Returns the vector from `origin` to a point of the lamp, and the brightness of its light without
/// occlusion. `a` and `b`, from 0 to 1, select the point of the lamp.
fn lamp_sample(lamp: &Lamp, origin: Vec3, normal: Vec3, [a, b]: [f32; 2]) -> (Vec3, f32) {
    let [hx, hy] = lamp.half;
    let off = vec3((2.0 * a - 1.0) * hx, (2.0 * b - 1.0) * hy, 0.0);
    let way = lamp.centre + off - origin;
    let square = way.dot(way);
    let area = 4.0 * hx * hy;
    let cosines = way.z.max(0.0) * normal.dot(way).max(0.0) / square;
    (way, lamp.radiance.luminance() * area * cosines / (square.max(0.04) * std::f32::consts::PI))
}

/// Returns two directions perpendicular to a normal and to each other.
fn tangents(normal: Vec3) -> (Vec3, Vec3) {
    let aside = if normal.x.abs() > 0.8 { vec3(0.0, 1.0, 0.0) } else { vec3(1.0, 0.0, 0.0) };
    let tangent = normal.cross(aside).unit();
    (tangent, normal.cross(tangent))
}
