//! Random sites of several cameras with shared floor points, for measuring the joint solution.

use std::f64::consts::{PI, TAU};

use calib_core::{Camera, FloorPoint, Pixel, WorldPoint};
use calib_site::{Link, LinkKind, LinkObservation, SceneEntry, Site, SiteCamera};
use rand::Rng;

use crate::random::{AnnotationSet, RandomScene, SIZE, normal};

/// Site without plan and placements, and its true cameras.
#[derive(Clone, Debug)]
pub struct Layout {
    /// Site with noisy lines and links.
    pub site: Site,
    /// True cameras, in the order of the site.
    pub truth: Vec<Camera>,
}

/// Floor point below a camera, and the floor point that the camera looks at, in metres.
#[derive(Clone, Copy, Debug)]
struct Station {
    at: FloorPoint,
    toward: FloorPoint,
}

impl Layout {
    /// Creates cameras on a circle with a radius of 6.35 m (11 m apart for three of them) that look at its
    /// centre. All cameras share `points` floor points near the centre. All annotations have noise with a
    /// standard deviation of `sigma` pixels.
    pub fn ring(random: &mut impl Rng, cameras: usize, points: usize, sigma: f64) -> Self {
        /// Radius of the circle of cameras, in metres.
        const RING_RADIUS: f64 = 6.35;
        let start = random.random_range(0.0..TAU);
        let stations: Vec<Station> = (0..cameras)
            .map(|i| {
                let angle = start + TAU * i as f64 / cameras as f64 + random.random_range(-0.1..0.1);
                let at = FloorPoint { x: RING_RADIUS * angle.cos(), y: RING_RADIUS * angle.sin() };
                Station { at, toward: FloorPoint::default() }
            })
            .collect();
        let mut layout = Self::stations(random, &stations, sigma);
        while layout.site.links.len() < points {
            let (radius, angle) = (4.0 * random.random::<f64>().sqrt(), random.random_range(0.0..TAU));
            let at = FloorPoint { x: radius * angle.cos(), y: radius * angle.sin() };
            let all: Vec<usize> = (0..cameras).collect();
            layout.link(random, at, &all, cameras, sigma);
        }
        layout
    }

    /// Creates cameras in a row along the wall of a corridor, or around a courtyard if `closed`. Each camera
    /// shares `points` floor points only with the next camera.
    pub fn chain(random: &mut impl Rng, cameras: usize, closed: bool, points: usize, sigma: f64) -> Self {
        /// Distance between neighbouring cameras, in metres.
        const STEP: f64 = 4.0;
        let radius = cameras as f64 * STEP / TAU;
        let station = |i: usize| {
            let place = |from_wall: f64, along: f64| {
                if closed {
                    let angle = TAU * along / cameras as f64;
                    FloorPoint {
                        x: (radius + 5.0 - from_wall) * angle.cos(),
                        y: (radius + 5.0 - from_wall) * angle.sin(),
                    }
                } else {
                    FloorPoint { x: STEP * along, y: -from_wall }
                }
            };
            Station { at: place(0.0, i as f64), toward: place(6.0, i as f64) }
        };
        let stations: Vec<Station> = (0..cameras).map(station).collect();
        let mut layout = Self::stations(random, &stations, sigma);
        let last = if closed { cameras } else { cameras - 1 };
        for i in 0..last {
            layout.link_pair(random, [i, (i + 1) % cameras], points, sigma);
        }
        layout
    }

    /// Creates cameras over the squares of a hall with the same viewing direction. Views of neighbours
    /// overlap by about a third and share `points` points.
    pub fn grid(random: &mut impl Rng, [columns, rows]: [usize; 2], points: usize, sigma: f64) -> Self {
        /// Distance between neighbouring cameras, in metres.
        const STEP: f64 = 4.0;
        let stations: Vec<Station> = (0..columns * rows)
            .map(|i| {
                let (x, y) = (STEP * (i % columns) as f64, STEP * (i / columns) as f64);
                Station { at: FloorPoint { x, y }, toward: FloorPoint { x, y: y + 6.0 } }
            })
            .collect();
        let mut layout = Self::stations(random, &stations, sigma);
        for i in 0..columns * rows {
            if i % columns + 1 < columns {
                layout.link_pair(random, [i, i + 1], points, sigma);
            }
            if i + columns < columns * rows {
                layout.link_pair(random, [i, i + columns], points, sigma);
            }
        }
        layout
    }

    /// Creates a site with a camera at each station, whose annotations have noise of `sigma` pixels.
    fn stations(random: &mut impl Rng, stations: &[Station], sigma: f64) -> Self {
        // Objects of these scenes have exact dimensions.
        let site = Site { scene: Some(SceneEntry::EXACT), ..Site::new() };
        let mut layout = Self { site, truth: Vec::new() };
        for (index, Station { at, toward }) in stations.iter().enumerate() {
            let away = at.distance(*toward);
            let height = random.random_range(3.0..5.0);
            let pitch = f64::atan2(height, away) + random.random_range(-0.05..0.05);
            let hfov = random.random_range(70.0..95.0);
            let scene =
                RandomScene::new(random, AnnotationSet::Directions, Some(hfov), Some(pitch.to_degrees()));
            // Floor lines look the same at any height, so the room is scaled to this height.
            let camera = Camera {
                position: WorldPoint { x: at.x, y: at.y, z: height },
                yaw: (at.x - toward.x).atan2(toward.y - at.y) + random.random_range(-0.1..0.1),
                ..scene.camera
            };
            let mut entry = SiteCamera::new(format!("c{index}"), SIZE.map(|side| side as u32));
            entry.sigma_px = Some(sigma.max(1e-3));
            entry.annotations = scene.noisy(random, sigma);
            entry.efov_px = Some(scene.efov);
            layout.site.cameras.push(entry);
            layout.truth.push(camera);
        }
        layout
    }

    /// Adds links to floor points in view of both cameras.
    fn link_pair(&mut self, random: &mut impl Rng, pair: [usize; 2], points: usize, sigma: f64) {
        let goal = self.site.links.len() + points;
        let camera = self.truth[pair[0]];
        for _ in 0..20_000 {
            if self.site.links.len() >= goal {
                return;
            }
            let pixel = Pixel { u: random.random_range(0.0..SIZE[0]), v: random.random_range(0.0..SIZE[1]) };
            let Some(at) = camera.pixel_to_floor(pixel, 0.0) else { continue };
            self.link(random, at, &pair, 2, sigma);
        }
    }

    /// Adds a link to a floor point if at least `least` of these cameras show it and are near enough.
    fn link(&mut self, random: &mut impl Rng, at: FloorPoint, cameras: &[usize], least: usize, sigma: f64) {
        /// Maximum floor distance from a camera to a link, in metres.
        const MAX_LINK_DISTANCE: f64 = 15.0;
        let shown = |&index: &usize| {
            let camera = &self.truth[index];
            let pixel = camera.world_to_pixel(at.at_height(0.0))?;
            let inside = pixel.u > 0.0 && pixel.v > 0.0 && pixel.u < SIZE[0] && pixel.v < SIZE[1];
            (inside && at.distance(camera.position.on_floor()) < MAX_LINK_DISTANCE).then_some((index, pixel))
        };
        let seen: Vec<(usize, Pixel)> = cameras.iter().filter_map(shown).collect();
        if seen.len() < least {
            return;
        }
        let seen = seen.into_iter().map(|(index, pixel)| LinkObservation {
            px: Some(Pixel { u: pixel.u + sigma * normal(random), v: pixel.v + sigma * normal(random) }),
            ..LinkObservation::new(&self.site.cameras[index].id)
        });
        let seen = seen.collect();
        let id = format!("p{}", self.site.links.len());
        self.site.links.push(Link::new(Some(id), LinkKind::Point, seen));
    }

    /// Places the first camera at its true pose, which is the gauge of a site without plan.
    pub fn place_first(&mut self) {
        let camera = &self.truth[0];
        self.site.cameras[0].placement = Some(calib_site::PlacementEntry {
            move_m: camera.position.on_floor(),
            turn_deg: (camera.yaw + PI).rem_euclid(TAU).to_degrees() - 180.0,
            scale: Some(camera.position.z / calib_core::floor::STAGE_1_HEIGHT),
            fixed: false,
            held: calib_site::FixedEntry::default(),
            estimated: false,
        });
    }
}
