//! Walking people in the shop, and their detections by a simulated foot detector ([`walk`]).
//!
//! [`Crowd`] simulates visitors over many days, with the boxes of a simulated detector. It includes hidden
//! feet, children, seasonal changes, and noise in proportion to the height of the box.

use calib_core::camera::PanTiltZoom;
use calib_core::{Camera, FloorPoint, Pixel, WorldPoint};
use calib_health::Sighting;
use rand::{Rng as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;

use crate::random::normal;
use crate::world::{is_shown, visible};

/// Detection of a person's foot by a camera.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FootDetection {
    /// Index of the time step.
    pub moment: usize,
    /// Index of the camera.
    pub camera: usize,
    /// Raw pixel of the foot, with noise.
    pub pixel: Pixel,
    /// Index of the person; `None` for a false detection.
    pub person: Option<usize>,
}

/// Walking people and their detections.
#[derive(Clone, Debug)]
pub struct Walk {
    /// True positions by time step and person; `None` before a person enters and after they leave.
    pub truth: Vec<Vec<Option<FloorPoint>>>,
    /// Detections in the order of time, then of cameras.
    pub detections: Vec<FootDetection>,
}

impl Walk {
    /// Time step, in seconds.
    pub const STEP: f64 = 0.1;
    /// Standard deviation of each coordinate of a detected foot, in pixels.
    pub const NOISE: f64 = 2.0;
}

/// Paths of the people through the shop, as corners in metres: along the aisles, past each other, around the
/// tables. Shelves and tables hide a person from all cameras for less than 2 s.
const PATHS: [&[[f64; 2]]; 5] = [
    &[
        [4.0, 13.6],
        [5.7, 9.0],
        [12.9, 8.4],
        [13.0, 5.4],
        [4.0, 5.1],
        [3.7, 2.0],
        [13.3, 2.0],
        [14.8, 6.0],
        [15.1, 9.0],
        [21.6, 8.8],
        [21.6, 2.4],
    ],
    &[[21.7, 2.2], [21.6, 8.2], [15.0, 8.8], [5.6, 8.2], [3.6, 5.2], [12.8, 5.1], [14.6, 2.4], [20.8, 2.3]],
    &[
        [18.2, 8.4],
        [18.2, 2.4],
        [13.3, 2.6],
        [13.1, 9.2],
        [16.9, 10.2],
        [20.9, 10.6],
        [18.6, 8.6],
        [15.3, 8.6],
    ],
    &[[20.0, 8.7], [15.0, 8.1], [13.0, 8.0], [4.2, 8.3], [13.0, 8.8], [16.8, 9.4], [20.8, 8.8], [21.5, 5.2]],
    &[
        [21.4, 2.4],
        [21.5, 5.3],
        [21.5, 9.2],
        [14.8, 8.9],
        [12.6, 9.8],
        [12.4, 12.9],
        [16.7, 12.4],
        [16.8, 8.8],
        [14.7, 2.2],
    ],
];
/// Walking speed, in m/s.
const SPEED_M_PER_S: f64 = 1.25;
/// Time constant with which a person changes direction at a corner, in seconds.
const TURN_TIME_S: f64 = 0.4;
/// Probability that the detector misses a visible foot.
const MISSED: f64 = 0.05;
/// Expected number of false detections for each camera and time step.
const FALSE_DETECTIONS: f64 = 0.01;

/// Simulates 60 s of people walking through the shop. `cameras` are the cameras with their image sizes, in
/// pixels.
#[must_use]
pub fn walk(cameras: &[(Camera, [u32; 2])], seed: u64) -> Walk {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let paths: Vec<Vec<[f64; 2]>> = PATHS.iter().map(|way| path(way)).collect();
    let moments = (60.0 / Walk::STEP) as usize;
    let truth: Vec<Vec<Option<FloorPoint>>> = (0..moments)
        .map(|moment| {
            // People enter one after the other, at intervals of 10 time steps.
            let at = |(person, path): (usize, &Vec<[f64; 2]>)| {
                let gone = moment.checked_sub(10 * person)?;
                path.get(gone).map(|&[x, y]| FloorPoint { x, y })
            };
            paths.iter().enumerate().map(at).collect()
        })
        .collect();
    let mut seen = Vec::new();
    for (moment, people) in truth.iter().enumerate() {
        for (index, (camera, size)) in cameras.iter().enumerate() {
            for (person, at) in people.iter().enumerate() {
                let Some(foot) = at.map(|at| WorldPoint { x: at.x, y: at.y, z: 0.0 }) else { continue };
                if random.random_bool(MISSED) || !visible(camera, *size, foot, 0.2) {
                    continue;
                }
                let Some(Pixel { u, v }) = camera.world_to_pixel(foot) else { continue };
                let pixel =
                    Pixel::new(u + Walk::NOISE * normal(&mut random), v + Walk::NOISE * normal(&mut random));
                seen.push(FootDetection { moment, camera: index, pixel, person: Some(person) });
            }
            if random.random_bool(FALSE_DETECTIONS) {
                let [w, h] = size.map(f64::from);
                // False detections, such as reflections and boxes of goods, are not in the top of the image.
                let pixel = Pixel::new(random.random_range(0.0..w), random.random_range(0.3 * h..h));
                if camera.pixel_to_ray(pixel).is_some() {
                    seen.push(FootDetection { moment, camera: index, pixel, person: None });
                }
            }
        }
    }
    Walk { truth, detections: seen }
}

/// Returns the positions of a person who walks along a path, for each time step, in metres.
fn path(way: &[[f64; 2]]) -> Vec<[f64; 2]> {
    let Some((&first, rest)) = way.split_first() else { return Vec::new() };
    let (mut at, mut speed) = (first, [0.0; 2]);
    let mut path = vec![at];
    for &goal in rest {
        loop {
            let ahead = [goal[0] - at[0], goal[1] - at[1]];
            let distance = ahead[0].hypot(ahead[1]);
            if distance < 0.5 {
                break;
            }
            for k in 0..2 {
                let wanted = SPEED_M_PER_S * ahead[k] / distance;
                speed[k] += (wanted - speed[k]) * Walk::STEP / TURN_TIME_S;
                at[k] += speed[k] * Walk::STEP;
            }
            path.push(at);
        }
    }
    path
}

/// Nanoseconds in a second.
pub const SECOND: i64 = 1_000_000_000;

/// Change of a camera's pose at a point in time.
#[derive(Clone, Copy, Debug)]
pub struct PoseChange {
    /// Index of the camera.
    pub camera: usize,
    /// Time of the change, in nanoseconds since 1970.
    pub at: i64,
    /// Pan, tilt, roll and zoom by which the camera changes.
    pub by: PanTiltZoom,
}

/// Visitors and properties of the detector.
#[derive(Clone, Debug)]
pub struct Crowd {
    /// Number of people.
    pub people: usize,
    /// First and last time of the simulation, in nanoseconds since 1970.
    pub span: [i64; 2],
    /// Index of the camera in front of which all people walk. If absent, people walk in front of each camera
    /// in rotation.
    pub camera: Option<usize>,
    /// Time between frames, in seconds.
    pub frame: f64,
    /// Fraction of children.
    pub children: f64,
    /// Probability that the feet are hidden by an obstacle outside the scene model, for example other people.
    /// The box of the person then ends above the feet.
    pub hidden: f64,
    /// Relative increase of body heights from the first to the last time, for example by shoes and hats.
    pub season: f64,
    /// Standard deviations of box edges, divided by the box height. The first error is independent for each
    /// box; the second is common to all boxes of a person in one camera.
    pub noise: [f64; 2],
    /// Change of a camera's pose, if any.
    pub change: Option<PoseChange>,
    /// Whether the scene hides people, which is slow to compute.
    pub has_scene: bool,
}

impl Crowd {
    /// Returns typical visitors. `span` is the first and last time, in nanoseconds since 1970.
    #[must_use]
    pub const fn new(people: usize, span: [i64; 2]) -> Self {
        Self {
            people,
            span,
            camera: None,
            frame: 0.5,
            children: 0.12,
            hidden: 0.1,
            season: 0.0,
            noise: [0.025, 0.02],
            change: None,
            has_scene: true,
        }
    }

    /// Simulates the detections by cameras with their image sizes in pixels; returns them in the order of
    /// time.
    #[must_use]
    pub fn sightings(&self, cameras: &[(Camera, [u32; 2])], seed: u64) -> Vec<Sighting> {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let mut seen = Vec::new();
        for index in 0..self.people {
            let before = self.camera.unwrap_or(index % cameras.len());
            let walker = self.walker(&cameras[before], &mut random);
            self.follow(&walker, cameras, &mut random, &mut seen);
        }
        seen.sort_by_key(|sighting| (sighting.at, sighting.camera));
        seen
    }

    /// Creates a person who walks between two points in view of a camera.
    fn walker(&self, camera: &(Camera, [u32; 2]), random: &mut ChaCha8Rng) -> Walker {
        let ends = [(); 2].map(|()| self.place(camera, random));
        let length = (ends[1].x - ends[0].x).hypot(ends[1].y - ends[0].y);
        let seconds = (length / random.random_range(0.8..1.5)).max(2.0);
        let last = self.span[1] - (seconds * SECOND as f64) as i64;
        // All frames use one clock: the start is a multiple of the frame interval since 1970.
        let frame = (self.frame * SECOND as f64) as i64;
        let start = random.random_range(self.span[0]..last) / frame * frame;
        let through = (start - self.span[0]) as f64 / (self.span[1] - self.span[0]) as f64;
        let tall = if random.random_bool(self.children) {
            random.random_range(1.0..1.5)
        } else if random.random_bool(0.5) {
            1.78 + 0.07 * normal(random)
        } else {
            1.65 + 0.065 * normal(random)
        };
        Walker { ends, start, seconds, tall: tall * (1.0 + self.season * through) }
    }

    /// Returns a random floor point in view of a camera.
    fn place(&self, (camera, size): &(Camera, [u32; 2]), random: &mut ChaCha8Rng) -> FloorPoint {
        let [w, h] = size.map(f64::from);
        loop {
            let pixel =
                Pixel::new(random.random_range(0.05 * w..0.95 * w), random.random_range(0.15 * h..0.95 * h));
            let Some(floor) = camera.pixel_to_floor(pixel, 0.0) else { continue };
            let range = floor.distance(camera.position.on_floor());
            let is_open = || !self.has_scene || visible(camera, *size, floor.at_height(0.0), 0.2);
            if range < 16.0 && is_open() {
                return floor;
            }
        }
    }

    /// Adds the detections of a walking person by all cameras to `seen`.
    fn follow(
        &self,
        walker: &Walker,
        cameras: &[(Camera, [u32; 2])],
        random: &mut ChaCha8Rng,
        seen: &mut Vec<Sighting>,
    ) {
        let own: Vec<[f64; 2]> =
            cameras.iter().map(|_| [(); 2].map(|()| self.noise[1] * normal(random))).collect();
        let frames = (walker.seconds / self.frame) as i64;
        for frame in 0..frames {
            let at = walker.start + frame * (self.frame * SECOND as f64) as i64;
            let floor = walker.at(frame as f64 / frames as f64);
            for (index, (camera, size)) in cameras.iter().enumerate() {
                let moved = self.change.filter(|moved| moved.camera == index && at >= moved.at);
                let camera = moved.map_or(*camera, |moved| moved.by.apply_to(camera));
                let stands = PersonState { floor, tall: walker.tall, own: own[index] };
                seen.extend(self.detection_box(&stands, &camera, *size, random).map(
                    |(foot, head, width)| Sighting {
                        at,
                        camera: index,
                        foot,
                        head: Some(head),
                        width,
                        person: None,
                    },
                ));
            }
        }
    }

    /// Returns the foot and head pixels and the width, in pixels, of a person's box; `None` if the person is
    /// not detected.
    fn detection_box(
        &self,
        of: &PersonState,
        camera: &Camera,
        size: [u32; 2],
        random: &mut ChaCha8Rng,
    ) -> Option<(Pixel, Pixel, f64)> {
        /// Probability that the detector misses a visible person.
        const MISSED: f64 = 0.05;
        if random.random_bool(MISSED) {
            return None;
        }
        let at = |up: f64| of.floor.at_height(up * of.tall);
        let shows = |point: WorldPoint| !self.has_scene || visible(camera, size, point, 0.2);
        let head = camera.world_to_pixel(at(1.0))?;
        let foot = camera.world_to_pixel(at(0.0))?;
        let [w, h] = size.map(f64::from);
        if !is_shown(camera, size, head, 0.0) || !shows(at(0.92)) || foot.v < head.v + 15.0 {
            return None;
        }
        // The box ends at the lowest visible point of the body.
        let hidden = if random.random_bool(self.hidden) { random.random_range(0.1..0.5) } else { 0.0 };
        let lowest = (0..9).map(|step| 0.1 * f64::from(step)).find(|&up| shows(at(up)) || up > 0.75)?;
        let low = camera.world_to_pixel(at(lowest.max(hidden)))?;
        let tall = foot.v - head.v;
        let edge = |own: f64, random: &mut ChaCha8Rng| tall * (own + self.noise[0] * normal(random));
        let top = (head.v + edge(of.own[0], random)).clamp(0.0, h);
        let bottom = (low.v + edge(of.own[1], random)).clamp(0.0, h);
        let middle = 0.5 * (head.u + low.u) + 0.3 * edge(0.0, random);
        let width = 0.38 * tall;
        let [left, right] = [middle - 0.5 * width, middle + 0.5 * width].map(|u| u.clamp(0.0, w));
        let u = 0.5 * (left + right);
        (bottom > top + 10.0).then(|| (Pixel::new(u, bottom), Pixel::new(u, top), right - left))
    }
}

/// Person who walks along a straight line.
struct Walker {
    ends: [FloorPoint; 2],
    start: i64,
    seconds: f64,
    tall: f64,
}

impl Walker {
    fn at(&self, share: f64) -> FloorPoint {
        let [from, to] = self.ends;
        FloorPoint { x: from.x + share * (to.x - from.x), y: from.y + share * (to.y - from.y) }
    }
}

/// Position of a person on the floor, body height in metres, and the relative errors `own` of the upper and
/// lower edges of the person's boxes in one camera.
struct PersonState {
    floor: FloorPoint,
    tall: f64,
    own: [f64; 2],
}
