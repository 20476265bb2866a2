//! Rendering of an image: visible surfaces, then light, colours and edges.
//!
//! Soft light is computed at every fourth pixel of every fourth row, and shared by pixels of the same
//! surface. Textures, sunlight and edges are computed for every pixel.
//!
//! The conversion of light to image bytes applies a tone curve, vignetting and sensor noise.
//!
//! Rows are rendered in parallel on all threads, and in the browser on one.

use calib_core::Camera;
use image::{Rgb, RgbImage};

use crate::light::{Light, LightQuery, gather, sky, sunlight};
use crate::material::Surface;
use crate::shape::Line;
use crate::shape::Rays;
use crate::texture::{cell, chance, mix};
use crate::tree::Hit;
use crate::vector::{Vec3, vec3};
use crate::world::{World, world, world_later};

/// Computes an image of `width x height`. `fill` computes each row independently, so the result does not
/// depend on the number of threads.
#[cfg(not(target_arch = "wasm32"))]
pub(crate) fn render_rows<T, F>(width: usize, height: usize, fill: F) -> Vec<T>
where
    T: Clone + Default + Send,
    F: Fn(usize, &mut [T]) + Sync,
{
    use std::sync::Mutex;

    let mut all = vec![T::default(); width * height];
    let threads = std::thread::available_parallelism().map_or(1, usize::from);
    // Rows have different costs, so each thread takes the next row when it is free.
    let rows = Mutex::new(all.chunks_mut(width.max(1)).enumerate());
    let next = || rows.lock().ok().and_then(|mut rows| rows.next());
    let work = || {
        while let Some((y, row)) = next() {
            fill(y, row);
        }
    };
    std::thread::scope(|scope| {
        for _ in 1..threads {
            scope.spawn(work);
        }
        work();
    });
    all
}

/// Computes an image of `width x height`; `fill` computes each row.
#[cfg(target_arch = "wasm32")]
pub(crate) fn render_rows<T, F>(width: usize, height: usize, fill: F) -> Vec<T>
where
    T: Clone + Default + Send,
    F: Fn(usize, &mut [T]) + Sync,
{
    let mut all = vec![T::default(); width * height];
    for (y, row) in all.chunks_mut(width.max(1)).enumerate() {
        fill(y, row);
    }
    all
}

/// Applies a film-like tone curve, from linear light to display values: it keeps shadows and compresses
/// highlights.
pub(crate) fn tone(light: Vec3) -> Vec3 {
    /// Factor of the light before the tone curve.
    const EXPOSURE: f32 = 1.28;
    // Narkowicz's fit to the ACES reference curve.
    let curve = |x: f32| {
        let x = x * EXPOSURE;
        ((x * (2.51 * x + 0.03)) / (x * (2.43 * x + 0.59) + 0.14)).clamp(0.0, 1.0).sqrt()
    };
    let shown = light.map(curve);
    // Camera colours are less saturated than paints, so a part of every pixel is grey.
    Vec3::grey(shown.luminance()).towards(shown, 0.82)
}

/// Converts display values of all pixels, row by row, to image bytes: adds vignetting and sensor noise.
pub(crate) fn develop(picture: &[Vec3], [width, height]: [u32; 2]) -> RgbImage {
    RgbImage::from_fn(width, height, |x, y| {
        let colour = picture[(y * width + x) as usize];
        let (dx, dy) = ((x as f32 + 0.5) / width as f32 - 0.5, (y as f32 + 0.5) / height as f32 - 0.5);
        let corner = 1.0 - 0.22 * (dx * dx + dy * dy);
        let seed = mix(x ^ mix(y));
        let shown = colour * corner + noise(seed, colour.luminance());
        let byte = |value: f32| (value.clamp(0.0, 1.0) * 255.0 + 0.5) as u8;
        Rgb([byte(shown.x), byte(shown.y), byte(shown.z)])
    })
}

/// Computes sensor noise, mainly in brightness, and stronger in shadows.
fn noise(seed: u32, brightness: f32) -> Vec3 {
    let amount = 0.012 - 0.007 * brightness.clamp(0.0, 1.0);
    // The sum of three uniform numbers approximates a normal distribution.
    let bell = |s: u32| chance(seed ^ s) + chance(seed ^ (s << 8)) + chance(seed ^ (s << 16)) - 1.5;
    (Vec3::grey(bell(0x11)) + vec3(bell(0x23), bell(0x35), bell(0x47)) * 0.4) * (2.0 * amount)
}

/// Distance between the pixels for which soft light is computed, in pixels.
const PITCH: usize = 4;
/// Distance that exceeds all distances in the scene, in metres.
const BEYOND_SCENE: f32 = 400.0;

/// Renders the scene for a camera with an image of `size` pixels.
///
/// The result is the same on every machine and for any number of threads, up to rounding of mathematical
/// functions.
#[must_use]
pub fn render(camera: &Camera, size: [u32; 2]) -> RgbImage {
    render_world(world(), camera, size)
}

/// Renders the scene a month later, with a moved shelf, other people and other light.
#[must_use]
pub fn render_later(camera: &Camera, size: [u32; 2]) -> RgbImage {
    render_world(world_later(), camera, size)
}

fn render_world(world: &'static World, camera: &Camera, size: [u32; 2]) -> RgbImage {
    let view = View::new(world, camera, size);
    let hits = render_rows(view.width, view.height, |y, row: &mut [Option<Hit>]| {
        for (x, hit) in row.iter_mut().enumerate() {
            *hit = view
                .line(x as f32 + 0.5, y as f32 + 0.5)
                .and_then(|line| view.world.tree.nearest(&line, BEYOND_SCENE));
        }
    });
    let probes = view.probes(&hits);
    let first = render_rows(view.width, view.height, |y, row: &mut [Vec3]| {
        for (x, colour) in row.iter_mut().enumerate() {
            let (u, v) = (x as f32 + 0.5, y as f32 + 0.5);
            if let Some(line) = view.line(u, v) {
                *colour = tone(view.shade(&line, hits[y * view.width + x], [u, v], &probes));
            }
        }
    });
    let smooth = render_rows(view.width, view.height, |y, row: &mut [Vec3]| {
        for (x, colour) in row.iter_mut().enumerate() {
            *colour = first[y * view.width + x];
            if is_edge(&first, view.width, view.height, x, y) {
                *colour = view.refine(*colour, x, y, &probes);
            }
        }
    });
    develop(&smooth, size)
}

/// Soft light at a sampled pixel, and the surface point that it applies to.
#[derive(Clone, Copy, Debug, Default)]
struct Probe {
    point: Vec3,
    /// Unit normal of the surface; zero if the ray meets no surface.
    normal: Vec3,
    light: Light,
}

/// Scene and camera rays of one image, shared by the steps of rendering.
struct View {
    world: &'static World,
    rays: Rays,
    width: usize,
    height: usize,
    /// Viewing angle of one pixel at the optical axis, in radians.
    angle: f32,
}

/// Point where a camera ray meets a solid.
struct Spot {
    surface: Surface,
    solid: usize,
    distance: f32,
}

impl View {
    fn new(world: &'static World, camera: &Camera, size: [u32; 2]) -> Self {
        let [width, height] = size.map(|side| side as usize);
        Self { world, rays: Rays::new(camera, size), width, height, angle: camera.focal.recip() as f32 }
    }

    fn line(&self, u: f32, v: f32) -> Option<Line> {
        self.rays.through(u, v)
    }

    fn spot(&self, line: &Line, hit: Hit) -> Spot {
        let solid = hit.solid as usize;
        let shape = &self.world.solids[solid].shape;
        let point = line.at(hit.distance);
        let normal = shape.normal(point);
        let bounds = shape.bounds();
        let slant = line.direction.dot(normal).abs().max(0.02);
        let wide = hit.distance * self.angle;
        let footprint = line.direction.map(|d| wide * (1.0 + (d / slant).powi(2)).sqrt());
        let surface = Surface {
            point,
            normal,
            local: point - bounds.min,
            size: bounds.size(),
            seed: mix(solid as u32),
            footprint,
        };
        Spot { surface, solid, distance: hit.distance }
    }

    /// Returns the query for the light at a spot; `turn` selects the ray directions.
    fn place(&self, line: &Line, spot: &Spot, turn: u32) -> LightQuery {
        let mirrors = self.world.solids[spot.solid].material.gloss > 0.0;
        let Surface { point, normal, .. } = spot.surface;
        LightQuery { point, normal, view: line.direction, mirrors, turn }
    }

    /// Returns the number of columns and rows of probes.
    const fn grid(&self) -> [usize; 2] {
        [self.width.div_ceil(PITCH), self.height.div_ceil(PITCH)]
    }

    /// Computes the probes: the soft light at every fourth pixel of every fourth row.
    fn probes(&self, hits: &[Option<Hit>]) -> Vec<Probe> {
        /// Number of rows of rays at a point, see [`gather`].
        const ROWS: u32 = 2;
        let [columns, rows] = self.grid();
        render_rows(columns, rows, |j, row: &mut [Probe]| {
            for (i, probe) in row.iter_mut().enumerate() {
                let x = (i * PITCH + PITCH / 2).min(self.width - 1);
                let y = (j * PITCH + PITCH / 2).min(self.height - 1);
                let Some(line) = self.line(x as f32 + 0.5, y as f32 + 0.5) else { continue };
                let Some(hit) = hits[y * self.width + x] else { continue };
                let spot = self.spot(&line, hit);
                // Every block of 4 x 4 probes contains each value of `turn` once.
                let place = self.place(&line, &spot, (4 * (j % 4) + (i + j) % 4) as u32);
                let light = gather(self.world, &place, ROWS);
                *probe = Probe { point: place.point, normal: place.normal, light };
            }
        })
    }

    /// Returns the soft light at a spot. It is interpolated from probes on the same surface, or computed if
    /// no probe is near. `u` and `v` are the pixel of the spot.
    fn light(&self, line: &Line, spot: &Spot, [u, v]: [f32; 2], probes: &[Probe]) -> Light {
        /// Number of rows of rays at a point, see [`gather`].
        const ROWS: u32 = 2;
        let Surface { point, normal, .. } = spot.surface;
        let [columns, rows] = self.grid().map(|n| n as i32);
        let (x, y) = ((u - 0.5) / PITCH as f32 - 0.5, (v - 0.5) / PITCH as f32 - 0.5);
        let (i0, j0) = ((x - 1.5).floor() as i32, (y - 1.5).floor() as i32);
        // Trapezoidal weights as wide as a block of 4 x 4 probes. On an even surface, every value of `turn`
        // then has the same weight.
        let share = |gap: f32| (2.5 - gap.abs()).clamp(0.0, 1.0);
        let thick = 0.012 + 0.004 * spot.distance;
        let (mut sum, mut total) = (Light::default(), 0.0);
        for j in j0.max(0)..=(j0 + 4).min(rows - 1) {
            for i in i0.max(0)..=(i0 + 4).min(columns - 1) {
                let probe = &probes[(j * columns + i) as usize];
                let facing = probe.normal.dot(normal);
                if facing < 0.8 || (probe.point - point).dot(normal).abs() > thick {
                    continue;
                }
                let weight = share(i as f32 - x) * share(j as f32 - y) * facing;
                sum.diffuse += probe.light.diffuse * weight;
                sum.mirror += probe.light.mirror * weight;
                total += weight;
            }
        }
        if total < 0.02 {
            let turn = cell((u * 8.0) as i32, (v * 8.0) as i32, 2) % 1024;
            return gather(self.world, &self.place(line, spot, turn), ROWS);
        }
        Light { diffuse: sum.diffuse * total.recip(), mirror: sum.mirror * total.recip() }
    }

    /// Returns the light that a camera ray receives at image position `at`, in pixels.
    fn shade(&self, line: &Line, hit: Option<Hit>, at: [f32; 2], probes: &[Probe]) -> Vec3 {
        let Some(hit) = hit else { return sky(line.direction) };
        let spot = self.spot(line, hit);
        let material = &self.world.solids[spot.solid].material;
        let albedo = material.albedo(&spot.surface);
        if material.glow > 2.0 {
            return albedo * material.glow;
        }
        let Surface { point, normal, .. } = spot.surface;
        let light = self.light(line, &spot, at, probes);
        let falls = light.diffuse + sunlight(self.world, point, normal) + Vec3::grey(material.glow);
        let colour = albedo * falls;
        if material.gloss == 0.0 {
            return colour;
        }
        // Schlick's approximation, halved because floors are less polished than glass.
        let grazing = (1.0 - line.direction.dot(normal).abs()).max(0.0).powi(5);
        let share = material.gloss + 0.5 * (1.0 - material.gloss) * grazing;
        colour * (1.0 - share) + light.mirror * share
    }

    /// Returns the mean display value of four points of a pixel. `middle` is the value at the pixel's centre.
    fn refine(&self, middle: Vec3, x: usize, y: usize, probes: &[Probe]) -> Vec3 {
        /// Positions of the other three points in the pixel, in pixels.
        const POINTS: [[f32; 2]; 3] = [[0.35, 0.1], [0.9, 0.45], [0.2, 0.85]];
        let more = POINTS.map(|[dx, dy]| {
            let (u, v) = (x as f32 + dx, y as f32 + dy);
            self.line(u, v).map_or(Vec3::ZERO, |line| {
                let hit = self.world.tree.nearest(&line, BEYOND_SCENE);
                tone(self.shade(&line, hit, [u, v], probes))
            })
        });
        more.into_iter().fold(middle, |sum, colour| sum + colour) * 0.25
    }
}

/// Whether a pixel visibly differs from one of its neighbours.
fn is_edge(picture: &[Vec3], width: usize, height: usize, x: usize, y: usize) -> bool {
    /// Smallest visible difference of a display value.
    const MIN_VISIBLE_STEP: f32 = 0.05;
    let here = picture[y * width + x];
    let differs = |x: usize, y: usize| {
        let d = picture[y * width + x] - here;
        let d = vec3(d.x.abs(), d.y.abs(), d.z.abs());
        d.x.max(d.y).max(d.z) > MIN_VISIBLE_STEP
    };
    (x > 0 && differs(x - 1, y))
        || (x + 1 < width && differs(x + 1, y))
        || (y > 0 && differs(x, y - 1))
        || (y + 1 < height && differs(x, y + 1))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_image_has_contrast_and_is_deterministic() {
        for (id, camera, size) in crate::site::cameras() {
            let small = 96.0 / f64::from(size[0]);
            let camera = crate::site::resized(&camera, small);
            let size = [96, (f64::from(size[1]) * small) as u32];
            let picture = render(&camera, size);
            assert_eq!(picture, render(&camera, size), "{id}");
            let bright = picture.pixels().filter(|p| p.0[1] > 128).count();
            let dark = picture.pixels().filter(|p| p.0[1] < 100).count();
            let all = picture.pixels().len();
            assert!(bright * 12 > all && dark * 12 > all, "{id}: {bright} bright, {dark} dark of {all}");
        }
    }
}
