//! The public of the demonstration site, day after day, and the boxes that a detector draws around it: feet hidden by
//! shelves, children, seasons, and noise that grows with the box.

use calib_core::{Camera, FloorPoint, Pixel, WorldPoint};

use calib_core::camera::Movement;

use calib_health::Sighting;
use rand::{Rng as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;

use crate::random::normal;
use crate::world::{is_shown, visible};

/// Nanoseconds of a second.
pub const SECOND: i64 = 1_000_000_000;

/// A camera that moves at some time.
#[derive(Clone, Copy, Debug)]
pub struct Moved {
    /// Index of the camera.
    pub camera: usize,
    /// Nanoseconds since 1970.
    pub at: i64,
    /// By how much.
    pub by: Movement,
}

/// Who comes, and what a detector makes of them.
#[derive(Clone, Debug)]
pub struct Crowd {
    /// People that come.
    pub people: usize,
    /// First and last time, in nanoseconds since 1970.
    pub span: [i64; 2],
    /// Camera before whom all of them walk; of all cameras in turn where there is none.
    pub before: Option<usize>,
    /// Seconds between frames.
    pub frame: f64,
    /// Share of children.
    pub children: f64,
    /// Boxes that end above the foot though nothing of the scene hides it: other people do, and goods.
    pub hidden: f64,
    /// What everybody is taller at the end, as a share: shoes, hats.
    pub season: f64,
    /// Standard deviation of the edges of a box: share of its height, of each box and of all of one person.
    pub noise: [f64; 2],
    /// A camera that moves.
    pub moved: Option<Moved>,
    /// Whether scene hides people: it takes long to tell.
    pub has_scene: bool,
}

impl Crowd {
    /// A usual public of so many people.
    #[must_use]
    pub const fn new(people: usize, span: [i64; 2]) -> Self {
        Self {
            people,
            span,
            before: None,
            frame: 0.5,
            children: 0.12,
            hidden: 0.1,
            season: 0.0,
            noise: [0.025, 0.02],
            moved: None,
            has_scene: true,
        }
    }

    /// What the cameras with images of these sizes see of them, in order of time.
    #[must_use]
    pub fn sightings(&self, cameras: &[(Camera, [u32; 2])], seed: u64) -> Vec<Sighting> {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let mut seen = Vec::new();
        for index in 0..self.people {
            let before = self.before.unwrap_or(index % cameras.len());
            let walker = self.walker(&cameras[before], &mut random);
            self.follow(&walker, cameras, &mut random, &mut seen);
        }
        seen.sort_by_key(|sighting| (sighting.at, sighting.camera));
        seen
    }

    /// Somebody who walks between two places before a camera.
    fn walker(&self, camera: &(Camera, [u32; 2]), random: &mut ChaCha8Rng) -> Walker {
        let ends = [(); 2].map(|()| self.place(camera, random));
        let length = (ends[1].x - ends[0].x).hypot(ends[1].y - ends[0].y);
        let seconds = (length / random.random_range(0.8..1.5)).max(2.0);
        let last = self.span[1] - (seconds * SECOND as f64) as i64;
        // Frames are those of one clock.
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

    /// Somewhere on the floor that a camera shows.
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
                let moved = self.moved.filter(|moved| moved.camera == index && at >= moved.at);
                let camera = moved.map_or(*camera, |moved| moved.by.applied(camera));
                let stands = Stands { floor, tall: walker.tall, own: own[index] };
                seen.extend(self.box_of(&stands, &camera, *size, random).map(|(foot, head, width)| {
                    Sighting { at, camera: index, foot, head: Some(head), width, person: None }
                }));
            }
        }
    }

    /// Foot, head and width of the box around somebody; `None` of who is not seen.
    fn box_of(
        &self,
        of: &Stands,
        camera: &Camera,
        size: [u32; 2],
        random: &mut ChaCha8Rng,
    ) -> Option<(Pixel, Pixel, f64)> {
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
        // What hides the foot hides all that is below what is seen first from there.
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

/// Somebody who walks straight on.
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

/// Where somebody stands, and what is off in all of their boxes of one camera.
struct Stands {
    floor: FloorPoint,
    tall: f64,
    own: [f64; 2],
}
