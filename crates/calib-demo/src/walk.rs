//! People who walk through the shop, and what a detector of feet sees of them.

use calib_core::{Camera, FloorPoint, Pixel, WorldPoint};
use rand::{Rng as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;

use crate::random::normal;
use crate::world::visible;

/// A foot as a camera shows it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Seen {
    /// Number of the moment.
    pub moment: usize,
    /// Index of the camera.
    pub camera: usize,
    /// Raw pixel.
    pub pixel: Pixel,
    /// Who it is; `None` for a false detection.
    pub person: Option<usize>,
}

/// People walking, and what was detected.
#[derive(Clone, Debug)]
pub struct Walk {
    /// Where everybody is at every moment, by moment and person; `None` before they come and after they leave.
    pub truth: Vec<Vec<Option<FloorPoint>>>,
    /// In order of time, then of cameras.
    pub seen: Vec<Seen>,
}

impl Walk {
    /// Seconds from moment to moment.
    pub const STEP: f64 = 0.1;
    /// Standard deviation of a detected foot, in pixels.
    pub const NOISE: f64 = 2.0;
}

/// Ways through the shop, in metres: along the aisles, past each other, around the tables. Shelves and
/// tables hide people from all cameras, but for less than 2 s.
const WAYS: [&[[f64; 2]]; 5] = [
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
const SPEED: f64 = 1.25;
/// How soon a walker turns to a new direction, in seconds.
const TURN: f64 = 0.4;
/// Share of feet that the detector misses.
const MISSED: f64 = 0.05;
/// False detections of a camera, a moment.
const FALSE: f64 = 0.01;

/// Sends people through the shop for 60 s before these cameras with images of these sizes.
#[must_use]
pub fn walk(cameras: &[(Camera, [u32; 2])], seed: u64) -> Walk {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let paths: Vec<Vec<[f64; 2]>> = WAYS.iter().map(|way| path(way)).collect();
    let moments = (60.0 / Walk::STEP) as usize;
    let truth: Vec<Vec<Option<FloorPoint>>> = (0..moments)
        .map(|moment| {
            // They come one after the other.
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
                seen.push(Seen { moment, camera: index, pixel, person: Some(person) });
            }
            if random.random_bool(FALSE) {
                let [w, h] = size.map(f64::from);
                // Below the horizon, as a detector's reflections and boxes of goods are.
                let pixel = Pixel::new(random.random_range(0.0..w), random.random_range(0.3 * h..h));
                if camera.pixel_to_ray(pixel).is_some() {
                    seen.push(Seen { moment, camera: index, pixel, person: None });
                }
            }
        }
    }
    Walk { truth, seen }
}

/// Where somebody is who walks along a way, from step to step.
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
                let wanted = SPEED * ahead[k] / distance;
                speed[k] += (wanted - speed[k]) * Walk::STEP / TURN;
                at[k] += speed[k] * Walk::STEP;
            }
            path.push(at);
        }
    }
    path
}
