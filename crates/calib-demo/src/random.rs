//! Random rooms with annotations, for measuring estimators. Each room has one camera, 2.5 to 6 m above the floor,
//! with an image of 1920 x 1080 pixels. Its horizontal field of view is 50 to 100 degrees, its pitch 15 to 60
//! degrees, and its roll up to 5 degrees.

use std::f64::consts::{FRAC_PI_2, PI};

use calib_core::{Annotation, Camera, Covariance, Kind, Lens, Pixel, WorldPoint};
use rand::Rng;

/// Width and height of every image, in pixels.
pub const SIZE: [f64; 2] = [1920.0, 1080.0];

/// Kind of annotations of a random scene.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum AnnotationSet {
    /// Option 1 of the paper: parallel and perpendicular floor lines, verticals.
    Directions,
    /// Option 2 of the paper: floor segments of equal length, verticals.
    Lengths,
}

/// Room with one camera and exact annotations.
#[derive(Clone, Debug)]
pub struct RandomScene {
    /// True camera, above (0, 0), with yaw 0.
    pub camera: Camera,
    /// Exact annotations.
    pub annotations: Vec<Annotation>,
    /// Polygon of the effective field of view (EFOV).
    pub efov: Vec<Pixel>,
}

impl RandomScene {
    /// Creates a random scene with these annotations. `hfov` (horizontal field of view) and `pitch` are in
    /// degrees, and random if absent.
    pub fn new(random: &mut impl Rng, drawn: AnnotationSet, hfov: Option<f64>, pitch: Option<f64>) -> Self {
        loop {
            if let Some(scene) = Self::attempt(random, drawn, hfov, pitch) {
                return scene;
            }
        }
    }

    fn attempt(
        random: &mut impl Rng,
        drawn: AnnotationSet,
        hfov: Option<f64>,
        pitch: Option<f64>,
    ) -> Option<Self> {
        let hfov = hfov.unwrap_or_else(|| random.random_range(50.0..100.0));
        let pitch = pitch.unwrap_or_else(|| random.random_range(15.0..60.0));
        let height = random.random_range(2.5..6.0);
        let focal = 0.5 * SIZE[0] / (0.5 * f64::to_radians(hfov)).tan();
        let camera = Camera {
            position: WorldPoint::new(0.0, 0.0, height),
            yaw: 0.0,
            pitch: pitch.to_radians(),
            roll: random.random_range(-5.0..5.0_f64).to_radians(),
            focal,
            lens: Lens::pinhole(Pixel::new(0.5 * SIZE[0], 0.5 * SIZE[1])),
            covariance: Covariance::EXACT,
        };
        let room = Room { camera, depth: random.random_range(3.0..5.0) * height };
        let azimuth = random.random_range(0.0..PI);
        let count = random.random_range(3..6);
        let verticals: Option<Vec<_>> = (0..count).map(|_| room.vertical(random)).collect();
        let mut annotations = vec![Annotation::from_segments(Kind::Vertical, verticals?)];
        match drawn {
            AnnotationSet::Directions => annotations.extend(room.directions(random, azimuth)?),
            AnnotationSet::Lengths => annotations.push(room.lengths(random, azimuth)?),
        }
        let efov = room.efov()?;
        Some(Self { camera, annotations, efov })
    }

    /// Returns the annotations with normal noise of `sigma` pixels on every coordinate.
    pub fn noisy(&self, random: &mut impl Rng, sigma: f64) -> Vec<Annotation> {
        let mut annotations = self.annotations.clone();
        for pixel in annotations.iter_mut().flat_map(|a| a.segments.iter_mut().flatten().flatten()) {
            pixel.u += sigma * normal(random);
            pixel.v += sigma * normal(random);
        }
        annotations
    }
}

/// Returns a standard normal number (Box and Muller 1958).
pub fn normal(random: &mut impl Rng) -> f64 {
    let radius = (-2.0 * (1.0 - random.random::<f64>()).ln()).sqrt();
    radius * (2.0 * PI * random.random::<f64>()).cos()
}

/// Room of a camera: the floor points within `depth` metres of the point below the camera.
struct Room {
    camera: Camera,
    depth: f64,
}

/// Pixels of both ends of a line.
type Segment = Vec<Pixel>;

impl Room {
    /// Returns a random point of the room at this height that the camera shows.
    fn point(&self, random: &mut impl Rng, height: f64) -> Option<WorldPoint> {
        let pixel = Pixel {
            u: random.random_range(20.0..SIZE[0] - 20.0),
            v: random.random_range(20.0..SIZE[1] - 20.0),
        };
        let floor = self.camera.pixel_to_floor(pixel, height)?;
        (floor.x.hypot(floor.y) < self.depth).then(|| floor.at_height(height))
    }

    /// Projects a segment in world coordinates to the image. Returns `None` unless both ends are in the image
    /// and more than `least` pixels apart.
    fn shown(&self, ends: [WorldPoint; 2], least: f64) -> Option<Segment> {
        let [a, b] = ends.map(|end| self.camera.world_to_pixel(end));
        let inside = |p: &Pixel| p.u > 4.0 && p.v > 4.0 && p.u < SIZE[0] - 4.0 && p.v < SIZE[1] - 4.0;
        let (a, b) = (a.filter(inside)?, b.filter(inside)?);
        (a.distance(b) > least).then(|| vec![a, b])
    }

    /// Returns a random floor segment with this azimuth (radians) and range of lengths (metres). It is more
    /// than `least` pixels long in the image.
    fn floor(&self, random: &mut impl Rng, azimuth: f64, length: (f64, f64), least: f64) -> Option<Segment> {
        (0..3000).find_map(|_| {
            let centre = self.point(random, 0.0)?;
            let reach = 0.5 * (length.0 + (length.1 - length.0) * random.random::<f64>());
            let (sin, cos) = azimuth.sin_cos();
            let end =
                |s: f64| WorldPoint { x: centre.x + s * reach * cos, y: centre.y + s * reach * sin, z: 0.0 };
            self.shown([end(-1.0), end(1.0)], least)
        })
    }

    /// Returns a random vertical segment, more than 80 pixels long in the image.
    fn vertical(&self, random: &mut impl Rng) -> Option<Segment> {
        let top = (self.camera.position.z - 0.2).min(3.0);
        (0..3000).find_map(|_| {
            let low = random.random_range(0.0..0.4 * top);
            let foot = self.point(random, low)?;
            let high = if top > low + 0.7 { random.random_range(low + 0.6..top) } else { top };
            self.shown([foot, WorldPoint { z: high, ..foot }], 80.0)
        })
    }

    /// Returns parallel and perpendicular floor lines; one direction has this azimuth, in radians.
    fn directions(&self, random: &mut impl Rng, azimuth: f64) -> Option<Vec<Annotation>> {
        let groups = random.random_range(1..3_usize);
        let count = random.random_range(2 * groups..7);
        let other = if random.random::<f64>() < 0.7 { FRAC_PI_2 } else { random.random_range(0.4..2.7) };
        let sizes = if groups == 1 { vec![count] } else { vec![count - count / 2, count / 2] };
        let mut annotations = Vec::new();
        for (size, angle) in sizes.into_iter().zip([azimuth, azimuth + other]) {
            let lines: Option<Vec<_>> =
                (0..size).map(|_| self.floor(random, angle, (1.0, 6.0), 120.0)).collect();
            annotations.push(Annotation::from_segments(Kind::Parallel, lines?));
        }
        for _ in 0..random.random_range(1..3) {
            let angle = if random.random::<f64>() < 0.6 { azimuth } else { random.random_range(0.0..PI) };
            let lines: Option<Vec<_>> = [angle, angle + FRAC_PI_2]
                .iter()
                .map(|&a| self.floor(random, a, (0.8, 4.0), 100.0))
                .collect();
            annotations.push(Annotation::from_segments(Kind::Perpendicular, lines?));
        }
        Some(annotations)
    }

    /// Returns floor segments of equal length; most are along or across this azimuth, in radians.
    fn lengths(&self, random: &mut impl Rng, azimuth: f64) -> Option<Annotation> {
        let length = random.random_range(0.6..2.0);
        let count = random.random_range(4..11);
        let lines: Option<Vec<_>> = (0..count)
            .map(|_| {
                let angle = match random.random::<f64>() {
                    r if r < 0.4 => azimuth,
                    r if r < 0.8 => azimuth + FRAC_PI_2,
                    _ => random.random_range(0.0..PI),
                };
                self.floor(random, angle, (length, length), 40.0)
            })
            .collect();
        Some(Annotation::from_segments(Kind::EqualLength, lines?))
    }

    /// Returns the corners of the EFOV in pixels: the bottom corners of the image, and two corners at the far
    /// end of the room.
    fn efov(&self) -> Option<Vec<Pixel>> {
        let far = |u: f64| {
            let rows = (0..(SIZE[1] / 5.0) as usize).map(|i| 5.0 * i as f64);
            let near = |v: &f64| {
                let floor = self.camera.pixel_to_floor(Pixel { u, v: *v }, 0.0);
                floor.is_some_and(|p| p.x.hypot(p.y) < self.depth)
            };
            rows.into_iter().find(near).unwrap_or(SIZE[1]).max(10.0)
        };
        let (left, right) = (far(60.0), far(SIZE[0] - 60.0));
        (left.max(right) <= SIZE[1] - 200.0).then(|| {
            vec![
                Pixel::new(60.0, SIZE[1] - 20.0),
                Pixel::new(SIZE[0] - 60.0, SIZE[1] - 20.0),
                Pixel::new(SIZE[0] - 60.0, right),
                Pixel::new(60.0, left),
            ]
        })
    }
}
