//! Light of sun, sky and lamps, reflections of walls and floors, and its computation at a point.

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

/// Light at a point, relative to a well-lit white wall.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Light {
    /// Light from lamps, sky and surroundings that a white surface would reflect.
    pub(crate) diffuse: Vec3,
    /// Light from the direction of a mirror reflection.
    pub(crate) mirror: Vec3,
}

/// Point of a surface whose light is computed.
#[derive(Clone, Copy, Debug)]
pub(crate) struct LightQuery {
    pub(crate) point: Vec3,
    pub(crate) normal: Vec3,
    /// Viewing direction.
    pub(crate) view: Vec3,
    /// Whether the mirror reflection is computed.
    pub(crate) mirrors: bool,
    /// Index that selects ray directions. Neighbours with consecutive numbers use directions between each
    /// other's.
    pub(crate) turn: u32,
}

impl LightQuery {
    /// Returns two numbers from 0 to 1 for the ray with this index. Over the values of `turn` of neighbours
    /// they fill the square evenly (Roberts' sequence), so the mean of neighbours has little noise.
    fn even(&self, ray: u32) -> [f32; 2] {
        let turn = self.turn as f32;
        [(0.754_877_7 * turn + chance(ray)).fract(), (0.569_840_3 * turn + chance(ray ^ 0xabcd)).fract()]
    }
}

/// Direction toward the sun.
const SUN: Vec3 = vec3(-0.4194, 0.6990, 0.5791);
/// Sunlight on a white surface perpendicular to it.
const SUNLIGHT: Vec3 = vec3(2.5, 2.25, 1.85);
/// Distance of ray origins above their surface, in metres.
const LIFT: f32 = 1e-3;
/// Distance above which surroundings are replaced by the mean of their room, in metres.
const REACH: f32 = 2.6;
/// Distance larger than any in the scene, in metres.
const FAR: f32 = 400.0;

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

/// Returns the light on a surface: unshadowed outside, the mean inside.
fn mean_light(room: Room, normal: Vec3) -> Vec3 {
    match room {
        Room::Outside => vec3(0.95, 1.05, 1.2) + SUNLIGHT * SUN.dot(normal).max(0.0),
        room => ambient(room, normal) * 1.5,
    }
}

/// Returns the light along a ray without shadows, which is sufficient for indirect light and mirrors. Lamps
/// are excluded if their light is computed separately.
fn trace_unshadowed(world: &World, line: &Line, reach: f32, home: Room, lamps: bool) -> Vec3 {
    match world.tree.nearest(line, reach) {
        None if reach < FAR => {
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

/// Computes direct sunlight on a surface with a separate ray, so that shadows are sharp.
pub(crate) fn sunlight(world: &World, point: Vec3, normal: Vec3) -> Vec3 {
    let slant = SUN.dot(normal);
    if slant <= 0.0 || !world.tree.is_clear(&Line::new(point + normal * LIFT, SUN), FAR) {
        return Vec3::ZERO;
    }
    SUNLIGHT * slant
}

/// Computes the light at a point with `4 x rows` rays into the half space above it, and one ray to most
/// lamps.
pub(crate) fn gather(world: &World, place: &LightQuery, rows: u32) -> Light {
    let LightQuery { normal, view, .. } = *place;
    let origin = place.point + normal * LIFT;
    let home = room_at(place.point + normal * 0.02);
    if home == Room::Outside {
        return Light { diffuse: vec3(0.95, 1.05, 1.2), mirror: Vec3::ZERO };
    }
    let (tangent, other) = axes(normal);
    let mut diffuse = Vec3::ZERO;
    for i in 0..rows {
        for j in 0..4 {
            let [a, b] = place.even(4 * i + j);
            let square = (i as f32 + a) / rows as f32;
            let turn = std::f32::consts::TAU * (j as f32 + b) / 4.0;
            let ((sin, cos), radius) = (turn.sin_cos(), square.sqrt());
            let direction =
                tangent * (radius * cos) + other * (radius * sin) + normal * (1.0 - square).sqrt();
            diffuse += trace_unshadowed(world, &Line::new(origin, direction), REACH, home, false);
        }
    }
    diffuse = diffuse * (0.25 / rows as f32) + lamplight(world, origin, place, home);
    let mut mirror = Vec3::ZERO;
    if place.mirrors {
        const RAYS: u32 = 4;
        const ROUGH: f32 = 0.05;
        let ahead = view - normal * (2.0 * view.dot(normal));
        for i in 0..RAYS {
            let [a, b] = place.even(100 + i);
            let bent = tangent * (ROUGH * (a - 0.5)) + other * (ROUGH * (b - 0.5));
            mirror += trace_unshadowed(world, &Line::new(origin, (ahead + bent).unit()), FAR, home, true)
                * (1.0 / RAYS as f32);
        }
    }
    Light { diffuse, mirror }
}

/// Computes the light of the lamps of a room. Faint lamps are sampled occasionally with a higher weight.
fn lamplight(world: &World, origin: Vec3, place: &LightQuery, home: Room) -> Vec3 {
    const ALWAYS: f32 = 0.025;
    let mut sum = Vec3::ZERO;
    for (i, lamp) in world.lamps.iter().enumerate().filter(|(_, lamp)| room_at(lamp.centre) == home) {
        let ray = 200 + 2 * i as u32;
        let (way, light) = from_lamp(lamp, origin, place.normal, place.even(ray));
        let share = (light / ALWAYS).min(1.0);
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

/// Returns the vector to a point of the lamp, and the brightness of its light without occlusion.
fn from_lamp(lamp: &Lamp, origin: Vec3, normal: Vec3, [a, b]: [f32; 2]) -> (Vec3, f32) {
    let [hx, hy] = lamp.half;
    let off = vec3((2.0 * a - 1.0) * hx, (2.0 * b - 1.0) * hy, 0.0);
    let way = lamp.centre + off - origin;
    let square = way.dot(way);
    let area = 4.0 * hx * hy;
    let cosines = way.z.max(0.0) * normal.dot(way).max(0.0) / square;
    (way, lamp.radiance.luminance() * area * cosines / (square.max(0.04) * std::f32::consts::PI))
}

/// Returns two directions perpendicular to a normal and to each other.
fn axes(normal: Vec3) -> (Vec3, Vec3) {
    let aside = if normal.x.abs() > 0.8 { vec3(0.0, 1.0, 0.0) } else { vec3(1.0, 0.0, 0.0) };
    let tangent = normal.cross(aside).unit();
    (tangent, normal.cross(tangent))
}
